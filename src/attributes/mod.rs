//! Attributes at a moved point: solved from the faces around it, not copied from an end.
//!
//! Over each face an attribute is a linear function of position. The value of a wedge at a new position is the one that minimises the
//! area-weighted squared difference to those functions, extended to there; the minimum itself is what the collapse costs in that attribute (Hoppe
//! 1999). All of a wedge's functions agree at its point `p`, so what is known of it is the mean gradient `ḡ` of each number and the covariance `C`
//! of the gradients around it: two wedges with values `s` that become one at `x` differ by
//!
//! `(x − p)ᵀ C (x − p)` on either side, and `W₁W₂ / (W₁ + W₂) · (s₁ + ḡ₁·(x − p₁) − s₂ − ḡ₂·(x − p₂))²` between them (`W` the areas).
//!
//! All of it is a quadric in `x`, and has a say in where the joined point goes: along a surface that is flat or evenly curved nothing else has.
//!
//! Displacements (of a morph target, of a pose) count like positions, though less: the shape is off by as much in that pose. What stands off a face
//! moves as the face turns, so that their gradients have a part along the normal, too, and what only turns costs nothing. They are the same on every
//! side of a seam, so that posed surfaces stay closed; so are joint influences, which follow the edge.
//!
//! Limits: morph displacements of normals and the like count nothing in the cost.

mod metric;
mod slope;
mod solution;

pub(crate) use metric::{AttributeQuadric, Metric};
pub(crate) use slope::Facet;
pub(crate) use solution::{Solution, fill_midpoint};

use crate::curvature::normal_and_area;
use crate::mesh::Semantic;
use crate::mesh::surface::Surface;
use glam::{Vec2, Vec3};
use smallvec::SmallVec;

/// Adds the upper half of `a bᵀ`: xx, xy, xz, yy, yz, zz.
#[inline]
pub(crate) fn add_product(m: &mut [f32], a: Vec3, b: Vec3) {
    let products = [a.x * b.x, a.x * b.y, a.x * b.z, a.y * b.y, a.y * b.z, a.z * b.z];
    m.iter_mut().zip(products).for_each(|(m, p)| *m += p);
}

/// The symmetric matrix (xx, xy, xz, yy, yz, zz) times `v`.
#[inline]
pub(crate) fn multiply([xx, xy, xz, yy, yz, zz]: &[f32; 6], v: Vec3) -> Vec3 {
    Vec3::new(xx * v.x + xy * v.y + xz * v.z, xy * v.x + yy * v.y + yz * v.z, xz * v.x + yz * v.y + zz * v.z)
}

/// Unit normal and area of a face.
pub(crate) fn facet(surface: &Surface, face: usize) -> Facet {
    let (normal, area) = normal_and_area(surface.triangle(face));
    (normal.as_vec3(), area as f32)
}

fn distinct_wedges(surface: &Surface, point: u32) -> SmallVec<[u32; 4]> {
    let mut wedges = SmallVec::new();
    let mut last = None;
    for &corner in surface.ring(point) {
        let wedge = surface.wedge_at(corner);
        if last != Some(wedge) && !wedges.contains(&wedge) {
            wedges.push(wedge);
        }
        last = Some(wedge);
    }
    wedges
}

/// Whether an attribute says where else the surface may be: then its errors are errors of the shape.
pub(crate) fn is_displacement(semantic: Semantic) -> bool {
    matches!(semantic, Semantic::MorphPosition(_) | Semantic::Pose(_))
}

/// Height of a triangle over its base below which it has no side: rounding.
const NO_HEIGHT: f32 = 1e-5;

/// Whether a triangle that has a side loses it, or turns over, as its apex goes from `old` to `new`.
pub(crate) fn turns_over([b, c]: [Vec2; 2], old: Vec2, new: Vec2) -> bool {
    let least = NO_HEIGHT * b.distance_squared(c);
    let (before, after) = ((b - old).perp_dot(c - old), (b - new).perp_dot(c - new));
    before.abs() > least && after * before.signum() <= least
}
