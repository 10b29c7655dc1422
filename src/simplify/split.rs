//! The split pass: long edges get a vertex in their middle, paid for by collapses (ESQEM §2.2).
//!
//! The paper splits every edge longer than b times the mean at its midpoint. The better way, its own outlook, is to split where that
//! lowers the error and to put the new point on the source surface.

use super::deviation::Deviation;
use super::guard::face_quality;
use crate::attributes::fill_midpoint;
use crate::curvature::normal_and_area;
use crate::mesh::edges::{Edge, EdgeKind, collect_edges};
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

/// Splits the long edges whose middle is farthest from the source, at the source's nearest point, until `room` faces are added or nothing
/// is gained any more; gives the faces added.
pub(crate) fn split_at_source(surface: &mut Surface, deviation: &Deviation, factor: f64, room: usize) -> usize {
    let mut spots: Vec<(f64, Edge, DVec3)> = long_edges(surface, factor)
        .into_iter()
        .filter(|e| !e.kind.has(EdgeKind::COMPLEX) && !e.kind.has(EdgeKind::BORDER))
        .filter_map(|e| {
            let middle = (surface.points[e.a as usize] + surface.points[e.b as usize]) * 0.5;
            let there = surface.frame.leave(middle).map(f64::from);
            let (point, distance) = deviation.nearest(there.into())?;
            Some((distance, e, surface.frame.enter(point.as_vec3().to_array())))
        })
        .collect();
    spots.sort_by(|x, y| y.0.total_cmp(&x.0).then((x.1.a, x.1.b).cmp(&(y.1.a, y.1.b))));
    let before = surface.face_count();
    for (_, edge, target) in spots {
        let added = surface.face_count() - before;
        if added >= room {
            break;
        }
        if faces_at(surface, &edge).count() <= room - added && split_is_clean(surface, &edge, target) {
            split_here(surface, &edge, target);
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

/// Whether all faces that the split makes look the way of the face they come from and none is a needle.
fn split_is_clean(surface: &Surface, edge: &Edge, position: DVec3) -> bool {
    faces_at(surface, edge).all(|f| {
        let (old, _) = normal_and_area(surface.triangle(f));
        [edge.a, edge.b].iter().all(|replaced| {
            let points = surface.face(f).map(|p| if p == *replaced { position } else { surface.points[p as usize] });
            let (new, _) = normal_and_area(points);
            new.dot(old) > 0.5 && face_quality(points) > 0.15
        })
    })
}
