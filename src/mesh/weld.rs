//! Welding: vertices → wedges (equal in everything) → points (equal in position).
//!
//! Classes are numbered by their first vertices, so that the result depends on values and order of the input only.

use super::Mesh;
use hashbrown::HashTable;
use std::cmp::Ordering;

/// For each vertex its point and its wedge; both are numbered in the order of their first vertex.
pub(super) struct Welded {
    /// Point of each vertex.
    pub point_of: Vec<u32>,
    /// Wedge of each vertex.
    pub wedge_of: Vec<u32>,
    /// First vertex of each point.
    pub point_vertex: Vec<u32>,
    /// First vertex of each wedge.
    pub wedge_vertex: Vec<u32>,
}

/// Welds the vertices that triangles use; the others get `u32::MAX`.
pub(super) fn weld(mesh: &Mesh) -> Welded {
    let group_of = vertex_groups(mesh);
    let used = |v: &u32| group_of[*v as usize] != u32::MAX;
    let keys: Vec<[u32; 3]> = mesh.positions.iter().map(|p| p.map(value_bits)).collect();
    let (point_of, point_vertex) = number_classes(
        keys.len(),
        used,
        |v| hash_position(keys[v as usize]),
        |a, b| keys[a as usize] == keys[b as usize],
    );
    if point_vertex.len() == point_of.iter().filter(|p| **p != u32::MAX).count() {
        return Welded { wedge_of: point_of.clone(), wedge_vertex: point_vertex.clone(), point_of, point_vertex };
    }
    let (wedge_of, wedge_vertex) = number_classes(
        keys.len(),
        used,
        |v| hash_wedge(mesh, point_of[v as usize], v as usize),
        |a, b| point_of[a as usize] == point_of[b as usize] && compare_wedges(mesh, &group_of, a, b) == Ordering::Equal,
    );
    Welded { point_of, wedge_of, point_vertex, wedge_vertex }
}

/// Numbers the classes of equal vertices in the order of their first ones; gives the class of each vertex and the first vertex of each class.
fn number_classes(
    vertices: usize,
    used: impl Fn(&u32) -> bool,
    hash: impl Fn(u32) -> u64,
    equal: impl Fn(u32, u32) -> bool,
) -> (Vec<u32>, Vec<u32>) {
    let mut class = vec![u32::MAX; vertices];
    let mut firsts: Vec<u32> = Vec::with_capacity(vertices);
    let mut table: HashTable<u32> = HashTable::with_capacity(vertices);
    for v in (0..vertices as u32).filter(used) {
        let entry =
            table.entry(hash(v), |&known| equal(firsts[known as usize], v), |&known| hash(firsts[known as usize]));
        class[v as usize] = *entry
            .or_insert_with(|| {
                firsts.push(v);
                firsts.len() as u32 - 1
            })
            .get();
    }
    (class, firsts)
}

fn hash_position(key: [u32; 3]) -> u64 {
    key.into_iter().fold(0, |hash, word| mix(hash, u64::from(word)))
}

/// Over what tells the wedges of a point apart most often: the first numbers of each attribute.
fn hash_wedge(mesh: &Mesh, point: u32, vertex: usize) -> u64 {
    let words = mesh.attributes.iter().flat_map(|a| &a.values[vertex * a.width..][..a.width.min(4)]);
    words.fold(u64::from(point), |hash, x| mix(hash, u64::from(value_bits(*x))))
}

fn mix(hash: u64, word: u64) -> u64 {
    // The table takes its tags from the upper bits and its slots from the lower ones.
    let product = u128::from(hash ^ word) * 0x9E37_79B9_7F4A_7C15;
    product as u64 ^ (product >> 64) as u64
}

fn vertex_groups(mesh: &Mesh) -> Vec<u32> {
    let mut groups = vec![u32::MAX; mesh.positions.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        triangle.iter().for_each(|&v| groups[v as usize] = mesh.group(t));
    }
    groups
}

/// Order by group, attributes and skin; `Equal` exactly for vertices of one wedge.
fn compare_wedges(mesh: &Mesh, group_of: &[u32], a: u32, b: u32) -> Ordering {
    let (a, b) = (a as usize, b as usize);
    let mut order = group_of[a].cmp(&group_of[b]);
    for attribute in &mesh.attributes {
        let w = attribute.width;
        order = order.then_with(|| {
            let row = |v: usize| attribute.values[v * w..][..w].iter().map(|x| value_bits(*x));
            row(a).cmp(row(b))
        });
    }
    if let Some(skin) = &mesh.skin {
        let n = skin.influences;
        order = order.then_with(|| skin.joints[a * n..][..n].cmp(&skin.joints[b * n..][..n])).then_with(|| {
            let row = |v: usize| skin.weights[v * n..][..n].iter().map(|x| value_bits(*x));
            row(a).cmp(row(b))
        });
    }
    order
}

/// Bits that are equal exactly for equal values: −0 is 0.
fn value_bits(x: f32) -> u32 {
    (x + 0.0).to_bits()
}
