//! Facts about triangle soups, on positions that are equal bit for bit.

use std::collections::BTreeMap;

type Key = [u64; 3];

/// Edges at which the surface is open: those whose two directions do not occur equally often. A crack of any width
/// between two primitives leaves such edges, as does a hole.
pub fn open_edges(triangles: &[[[f64; 3]; 3]]) -> usize {
    let mut balance = BTreeMap::<(Key, Key), i64>::new();
    for t in triangles {
        let [a, b, c] = t.map(key);
        if a == b || b == c || c == a {
            continue;
        }
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let (edge, step) = if from < to { ((from, to), 1) } else { ((to, from), -1) };
            *balance.entry(edge).or_default() += step;
        }
    }
    balance.values().filter(|&&b| b != 0).count()
}

/// Six times the volume that a closed surface encloses.
pub fn volume(triangles: &[[[f64; 3]; 3]]) -> f64 {
    triangles.iter().map(|[a, b, c]| dot(*a, cross(*b, *c))).sum()
}

/// Lower and upper corner.
pub fn bounds(triangles: &[[[f64; 3]; 3]]) -> ([f64; 3], [f64; 3]) {
    let start = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    triangles
        .iter()
        .flatten()
        .fold(start, |(lo, hi), p| (std::array::from_fn(|k| lo[k].min(p[k])), std::array::from_fn(|k| hi[k].max(p[k]))))
}

/// Adding zero makes −0 equal to 0.
fn key(p: [f64; 3]) -> Key {
    p.map(|x| (x + 0.0).to_bits())
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
