//! Welding: vertices → wedges (equal in everything) → points (equal in position).
//!
//! By sorting, so that the result depends on values and order of the input only.

use super::Mesh;
use rayon::prelude::*;
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
    let keys: Vec<[u32; 3]> = mesh.positions.par_iter().map(|p| p.map(value_bits)).collect();
    let mut order: Vec<u32> = (0..mesh.positions.len() as u32).filter(|&v| group_of[v as usize] != u32::MAX).collect();
    let by_position = |&a: &u32, &b: &u32| keys[a as usize].cmp(&keys[b as usize]);
    order.par_sort_unstable_by(|a, b| {
        by_position(a, b).then_with(|| compare_wedges(mesh, &group_of, *a, *b)).then_with(|| a.cmp(b))
    });
    let same_point = |a: u32, b: u32| keys[a as usize] == keys[b as usize];
    let same_wedge = |a: u32, b: u32| same_point(a, b) && compare_wedges(mesh, &group_of, a, b) == Ordering::Equal;
    let (point_of, point_vertex) = number_runs(&order, mesh.positions.len(), same_point);
    let (wedge_of, wedge_vertex) = number_runs(&order, mesh.positions.len(), same_wedge);
    Welded { point_of, wedge_of, point_vertex, wedge_vertex }
}

/// Runs of `same` neighbours in `order` become one class each, numbered by their smallest vertex.
fn number_runs(order: &[u32], vertices: usize, same: impl Fn(u32, u32) -> bool) -> (Vec<u32>, Vec<u32>) {
    let mut first = vec![u32::MAX; vertices];
    let mut start = 0;
    while start < order.len() {
        let mut end = start + 1;
        while end < order.len() && same(order[end - 1], order[end]) {
            end += 1;
        }
        let run = &order[start..end];
        let smallest = run.iter().copied().min().unwrap_or(u32::MAX);
        run.iter().for_each(|&v| first[v as usize] = smallest);
        start = end;
    }
    let mut class = vec![u32::MAX; vertices];
    let mut representatives = Vec::new();
    for v in 0..vertices {
        let f = first[v];
        if f == v as u32 {
            class[v] = representatives.len() as u32;
            representatives.push(f);
        } else if f != u32::MAX {
            class[v] = class[f as usize];
        }
    }
    (class, representatives)
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
