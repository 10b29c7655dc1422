//! What the edge policies mean: which points are locked and how much the shape of borders and seams costs.

use super::options::{EdgePolicy, Options, Placement};
use crate::curvature::normal_and_area;
use crate::mesh::edges::{Edge, EdgeKind};
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

/// Normals of the planes that stand on an edge, one for each of its faces, perpendicular to it. With two sides of different normals both
/// count: a fold keeps its outline whatever side is seen.
pub(crate) fn upright_planes(surface: &Surface, edge: &Edge) -> SmallVec<[DVec3; 2]> {
    let [a, b] = [edge.a, edge.b].map(|p| surface.points[p as usize]);
    let upright = |&c: &u32| {
        let (normal, _) = normal_and_area(surface.triangle(Surface::face_of(c)));
        normal.cross(b - a).normalize_or_zero()
    };
    let on_edge = surface.ring(edge.a).iter().filter(|&&c| surface.opposite(c).contains(&edge.b));
    on_edge.map(upright).filter(|n| *n != DVec3::ZERO).collect()
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

    /// Marks the ends of locked edges.
    pub fn lock_points(&self, points: usize, edges: &[Edge]) -> Vec<bool> {
        let locks = |kind: EdgeKind| {
            (kind.has(EdgeKind::BORDER) && self.border == EdgePolicy::Lock)
                || (kind.has(EdgeKind::MATERIAL) && self.material == EdgePolicy::Lock)
                || (kind.has(EdgeKind::SEAM) && !kind.has(EdgeKind::MATERIAL) && self.seam == EdgePolicy::Lock)
        };
        let mut locked = vec![false; points];
        for edge in edges.iter().filter(|e| locks(e.kind)) {
            locked[edge.a as usize] = true;
            locked[edge.b as usize] = true;
        }
        locked
    }
}
