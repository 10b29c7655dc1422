//! ESQEM's split pass: every edge longer than b times the mean gets a vertex in its middle, paid for by collapses (§2.2).

use crate::attributes::fill_midpoint;
use crate::mesh::edges::{Edge, collect_edges};
use crate::mesh::surface::Surface;
use crate::mesh::surgery::split_edge;
use glam::DVec3;

/// Edges longer than `factor` times the mean edge length, longest first.
pub(crate) fn long_edges(surface: &Surface, factor: f64) -> Vec<Edge> {
    let edges = collect_edges(surface);
    let length = |e: &Edge| surface.points[e.a as usize].distance(surface.points[e.b as usize]);
    let mean = edges.iter().map(length).sum::<f64>() / edges.len().max(1) as f64;
    let mut long: Vec<(f64, Edge)> =
        edges.iter().map(|e| (length(e), *e)).filter(|(l, _)| *l > factor * mean).collect();
    long.sort_by(|x, y| y.0.total_cmp(&x.0).then((x.1.a, x.1.b).cmp(&(y.1.a, y.1.b))));
    long.into_iter().map(|(_, e)| e).collect()
}

/// Faces that splitting these edges adds.
pub(crate) fn faces_added(surface: &Surface, edges: &[Edge]) -> usize {
    edges.iter().map(|e| faces_at(surface, e).count()).sum()
}

/// Splits `edges` at their midpoints, in order, until `room` faces are added; gives the faces added.
pub(crate) fn split_at_midpoints(surface: &mut Surface, edges: &[Edge], room: usize) -> usize {
    let before = surface.face_count();
    for e in edges {
        let added = surface.face_count() - before;
        if added < room && faces_at(surface, e).count() <= room - added + 1 {
            let [a, b] = [e.a, e.b].map(|p| surface.points[p as usize]);
            split_here(surface, e, (a + b) * 0.5);
        }
    }
    surface.face_count() - before
}

fn split_here(surface: &mut Surface, edge: &Edge, position: DVec3) {
    let (_, made) = split_edge(surface, edge.a, edge.b, position);
    for wedges in made {
        fill_midpoint(&mut surface.wedges, wedges);
    }
}

fn faces_at<'a>(surface: &'a Surface, edge: &'a Edge) -> impl Iterator<Item = usize> + 'a {
    let with_both = |&&c: &&u32| surface.opposite(c).contains(&edge.b);
    surface.ring(edge.a).iter().filter(with_both).map(|&c| Surface::face_of(c))
}
