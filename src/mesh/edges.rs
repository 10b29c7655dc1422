//! The edges of a surface and what runs along them: open borders, seams, material borders, folds.

use super::surface::{Corner, Surface};
use rayon::prelude::*;
use smallvec::SmallVec;

/// An undirected edge, `a < b`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Edge {
    pub a: u32,
    pub b: u32,
    pub kind: EdgeKind,
}

/// A set of properties of an edge.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct EdgeKind(u8);

impl EdgeKind {
    /// One face only.
    pub const BORDER: Self = Self(1);
    /// Attributes differ between its faces.
    pub const SEAM: Self = Self(2);
    /// Its faces belong to different groups.
    pub const MATERIAL: Self = Self(4);
    /// More than two faces, or two that run along it in the same direction.
    pub const COMPLEX: Self = Self(8);
    /// Two faces folded onto each other.
    pub const FOLD: Self = Self(16);

    /// Whether any property of `other` is set.
    pub fn has(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Whether nothing runs along the edge.
    pub fn is_plain(self) -> bool {
        self.0 == 0
    }

    /// Both sets together.
    pub fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// A corner at the first point of an edge, in a face of that edge; `forward` if the face runs from the first point to the second.
type Side = (Corner, bool);

/// All edges, ordered by first and then by second point's appearance around it.
pub(crate) fn collect_edges(surface: &Surface) -> Vec<Edge> {
    const CHUNK: usize = 4096;
    let points = surface.points.len();
    let chunks: Vec<Vec<Edge>> = (0..points.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let mut edges = Vec::with_capacity(3 * CHUNK + CHUNK / 2);
            for a in chunk * CHUNK..((chunk + 1) * CHUNK).min(points) {
                edges_from(surface, a as u32, &mut edges);
            }
            edges
        })
        .collect();
    chunks.concat()
}

/// Appends the edges from `a` to points of higher index.
fn edges_from(surface: &Surface, a: u32, edges: &mut Vec<Edge>) {
    let mut spokes: SmallVec<[(u32, SmallVec<[Side; 2]>); 12]> = SmallVec::new();
    for &corner in surface.ring(a) {
        let [next, previous] = surface.opposite(corner);
        for (b, forward) in [(next, true), (previous, false)] {
            if b > a {
                match spokes.iter_mut().find(|(p, _)| *p == b) {
                    Some((_, sides)) => sides.push((corner, forward)),
                    None => spokes.push((b, SmallVec::from_slice(&[(corner, forward)]))),
                }
            }
        }
    }
    edges.extend(spokes.iter().map(|(b, sides)| Edge { a, b: *b, kind: classify(surface, sides) }));
}

/// The properties of the edge between `a` and `b`; `None` if no face has both.
pub(crate) fn edge_kind(surface: &Surface, a: u32, b: u32) -> Option<EdgeKind> {
    let mut sides: SmallVec<[Side; 4]> = SmallVec::new();
    for &corner in surface.ring(a) {
        let [next, previous] = surface.opposite(corner);
        if next == b {
            sides.push((corner, true));
        } else if previous == b {
            sides.push((corner, false));
        }
    }
    (!sides.is_empty()).then(|| classify(surface, &sides))
}

fn classify(surface: &Surface, sides: &[Side]) -> EdgeKind {
    let &[first, second] = sides else {
        return if sides.len() == 1 { EdgeKind::BORDER } else { EdgeKind::COMPLEX };
    };
    let mut kind = EdgeKind::default();
    if first.1 == second.1 {
        kind = kind.with(EdgeKind::COMPLEX);
    }
    let wedges = |side: Side| {
        let [next, previous] = surface.opposite_wedges(side.0);
        (surface.wedge_at(side.0), if side.1 { next } else { previous })
    };
    let (w1, w2) = (wedges(first), wedges(second));
    if surface.wedges.differ(w1.0, w2.0) || surface.wedges.differ(w1.1, w2.1) {
        kind = kind.with(EdgeKind::SEAM);
        if surface.wedges.group(w1.0) != surface.wedges.group(w2.0) {
            kind = kind.with(EdgeKind::MATERIAL);
        }
        // A fold without a seam would cost two normals an edge; sheets with two sides have different normals there.
        let normal = |side: Side| {
            let [p, q, r] = surface.triangle(Surface::face_of(side.0));
            (q - p).cross(r - p).normalize_or_zero()
        };
        if normal(first).dot(normal(second)) < -0.95 {
            kind = kind.with(EdgeKind::FOLD);
        }
    }
    kind
}
