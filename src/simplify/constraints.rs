//! What the edge policies mean: which points are locked and how much the shape of borders and seams costs.

use super::options::{EdgePolicy, Options, Placement};
use crate::curvature::normal_and_area;
use crate::mesh::edges::{Edge, EdgeKind};
use crate::mesh::regions::{Region, join_flags};
use crate::mesh::surface::Surface;
use glam::DVec3;
use smallvec::SmallVec;

/// Weight of an open border's plane, relative to the surface: the square on an edge counts as this many times its area.
const BORDER_WEIGHT: f64 = 1.5;
/// The same for an attribute seam, whose error shows only through the attribute.
const SEAM_WEIGHT: f64 = 0.15;
/// The same where points stay: with attributes that count more, seams would be what bends.
const SEAM_WEIGHT_AT_ENDS: f64 = 1.5;
/// The same for a border between materials.
const MATERIAL_WEIGHT: f64 = 0.5;

/// Cosine of the angle by which a face may bend away from one that it continues.
pub(super) const CONTINUES: f64 = 0.5;

/// Normals of the planes that stand on an edge, one for each of its faces, perpendicular to it. With two sides of different normals both
/// count: a fold keeps its outline whatever side is seen. Where many faces meet, some [have no outline](keep_outlines).
pub(crate) fn upright_planes(surface: &Surface, edge: &Edge) -> SmallVec<[DVec3; 2]> {
    let [a, b] = [edge.a, edge.b].map(|p| surface.points[p as usize]);
    // Points into the face.
    let upright = |&c: &u32| {
        let (normal, _) = normal_and_area(surface.triangle(Surface::face_of(c)));
        let way = if surface.opposite(c)[0] == edge.b { 1.0 } else { -1.0 };
        normal.cross(b - a).normalize_or_zero() * way
    };
    let on_edge = surface.ring(edge.a).iter().filter(|&&c| surface.opposite(c).contains(&edge.b));
    let mut planes: SmallVec<[DVec3; 2]> = on_edge.map(upright).filter(|n| *n != DVec3::ZERO).collect();
    if edge.kind.has(EdgeKind::COMPLEX) {
        keep_outlines(&mut planes, |m, n| m.dot(n) > -CONTINUES);
    }
    planes
}

/// Drops the planes of faces that go on beyond an edge: of sheets with two sides, of a floor on which a wall stands. `parts`: whether a face is no such
/// continuation of another.
pub(super) fn keep_outlines<T: Copy, const N: usize>(planes: &mut SmallVec<[T; N]>, parts: impl Fn(T, T) -> bool)
where
    [T; N]: smallvec::Array<Item = T>,
{
    let all = planes.clone();
    planes.retain(|n| all.iter().all(|m| parts(*m, *n)));
}

/// The policies of a run.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Constraints {
    border: EdgePolicy,
    seam: EdgePolicy,
    material: EdgePolicy,
    seam_weight: f64,
}

impl Constraints {
    pub fn new(options: &Options) -> Self {
        let seam_weight = match options.placement {
            Placement::Optimal => SEAM_WEIGHT,
            Placement::Subset => SEAM_WEIGHT_AT_ENDS,
        };
        Self { border: options.border, seam: options.seam, material: options.material_border, seam_weight }
    }

    /// Weight of the plane that stands on an edge of this kind, perpendicular to the surface; 0 for none.
    pub fn weight(&self, kind: EdgeKind) -> f64 {
        let of = |bits: EdgeKind, policy: EdgePolicy, weight: f64| {
            if kind.has(bits) && policy != EdgePolicy::Free { weight } else { 0.0 }
        };
        of(EdgeKind::BORDER, self.border, BORDER_WEIGHT)
            .max(of(EdgeKind::MATERIAL, self.material, MATERIAL_WEIGHT))
            .max(of(EdgeKind::SEAM, self.seam, self.seam_weight))
            .max(if kind.has(EdgeKind::FOLD) || kind.has(EdgeKind::COMPLEX) { BORDER_WEIGHT } else { 0.0 })
    }

    /// Whether seams may end anywhere.
    pub fn seams_are_free(&self) -> bool {
        self.seam == EdgePolicy::Free
    }

    /// Locks the ends of locked edges.
    pub fn lock_points(&self, points: usize, edges: &[Edge]) -> Locked {
        let locks = |kind: EdgeKind| {
            (kind.has(EdgeKind::BORDER) && self.border == EdgePolicy::Lock)
                || (kind.has(EdgeKind::MATERIAL) && self.material == EdgePolicy::Lock)
                || (kind.has(EdgeKind::SEAM) && !kind.has(EdgeKind::MATERIAL) && self.seam == EdgePolicy::Lock)
        };
        let mut locked = Vec::new();
        for edge in edges.iter().filter(|e| locks(e.kind)) {
            locked.resize(points, false);
            locked[edge.a as usize] = true;
            locked[edge.b as usize] = true;
        }
        Locked(locked)
    }
}

/// The points that may not move.
#[derive(Debug, Clone)]
pub(crate) struct Locked(
    /// Of each point; empty where all may.
    Vec<bool>,
);

impl Locked {
    /// Whether there are no such points.
    pub fn are_none(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether the point is one of them.
    pub fn has(&self, point: u32) -> bool {
        self.0.get(point as usize).is_some_and(|is| *is)
    }

    /// Locks `point` too, if `other` is locked.
    pub fn follow(&mut self, point: u32, other: u32) {
        if self.has(other) {
            self.0[point as usize] = true;
        }
    }

    /// Makes room for points that may move.
    pub fn grow(&mut self, points: usize) {
        if !self.are_none() {
            self.0.resize(points, false);
        }
    }

    /// What is known of some points.
    pub fn pick(&self, points: &[u32]) -> Self {
        if self.are_none() { self.clone() } else { Self(points.iter().map(|&p| self.has(p)).collect()) }
    }

    /// Takes what has become of the `count` points there are now, each in one of the parts at least.
    pub fn join<'a>(&mut self, parts: impl Iterator<Item = (&'a Region, Self)>, count: usize) {
        if !self.are_none() {
            self.0 = join_flags(parts.map(|(region, part)| (region, part.0)), count);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::mesh::edges::collect_edges;

    /// Two triangles over a square, and what else is given.
    fn surface(rest: &[[u32; 3]]) -> Surface {
        let positions =
            vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 1.0], [0.5, 0.5, -1.0]];
        Surface::new(&Mesh { positions, triangles: [&[[0, 1, 2], [0, 2, 3]], rest].concat(), ..Mesh::default() })
    }

    /// How many planes stand on the edge between two points.
    fn planes(surface: &Surface, a: u32, b: u32) -> usize {
        let edges = collect_edges(surface);
        let edge = edges.iter().find(|e| [e.a, e.b] == [a, b]).expect("an edge");
        if edge.kind.is_plain() { 0 } else { upright_planes(surface, edge).len() }
    }

    #[test]
    fn sheets_with_two_sides_have_an_outline_and_no_inner_ones() {
        let sheet = surface(&[[2, 1, 0], [3, 2, 0]]);
        assert_eq!(planes(&sheet, 0, 2), 0);
        assert_eq!(planes(&sheet, 0, 1), 2);
    }

    #[test]
    fn a_wall_ends_on_the_floor_that_goes_on() {
        assert_eq!(planes(&surface(&[[0, 2, 4]]), 0, 2), 1);
        assert_eq!(planes(&surface(&[[0, 2, 4], [0, 2, 5]]), 0, 2), 0);
    }
}
