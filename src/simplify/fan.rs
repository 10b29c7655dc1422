//! The faces that a collapse leaves around the joined point, four at a time: whether they turn over, how well they are shaped, which way they look.

use super::guard::Cause;
use crate::lanes::{Vec3x4, cross, dot, gather, minus};
use crate::mesh::surface::Surface;
use crate::mesh::surgery::Merge;
use glam::{DVec3, Vec4};
use wide::f32x4;

const LANES: usize = 4;

/// Cosine of the largest angle by which a collapse may turn a face.
const FLIP_COSINE: f32 = 0.2;

/// The faces of one candidate. Kept for its memory.
#[derive(Debug, Default)]
pub(crate) struct Fan {
    fours: Vec<Four>,
}

/// What faces are like.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Four {
    cross: Vec3x4,
    /// Of `cross`.
    length: f32x4,
}

impl Four {
    /// Of the faces that have these edges at one of their corners.
    #[inline]
    pub fn new(first: Vec3x4, second: Vec3x4) -> Self {
        let cross = cross(first, second);
        Self { cross, length: dot(cross, cross).sqrt() }
    }

    /// Unit normal (xyz) and area (w) of each face; all zero where it has none.
    #[inline]
    pub fn facets(&self) -> [Vec4; LANES] {
        let inverse = self.length.simd_gt(f32x4::ZERO) & (f32x4::ONE / self.length);
        let [x, y, z] = self.cross.map(|c| c * inverse);
        f32x4::transpose([x, y, z, self.length * f32x4::HALF]).map(|facet| Vec4::from_array(facet.to_array()))
    }
}

impl Fan {
    /// Looks at the faces that `merge` leaves, with the joined point at `position`; gives the least quality among them: 4√3 · area / Σ edge², 1 for
    /// an equilateral triangle, 0 for a degenerate one.
    pub fn look(&mut self, surface: &Surface, merge: &Merge, position: DVec3) -> Result<f32, Cause> {
        self.fours.clear();
        let from = |p: u32| (surface.points[p as usize] - position).as_vec3();
        let ends = [merge.kept, merge.gone].map(from);
        let (rims, of_kept) = (merge.rims.as_slice(), merge.spokes_of_kept().len());
        let mut worst = f32x4::splat(f32::INFINITY);
        for start in (0..rims.len()).step_by(LANES) {
            // The last four are filled up with copies.
            let at = |lane: usize| (start + lane).min(rims.len() - 1);
            let first = gather(std::array::from_fn(|lane| from(rims[at(lane)][0])));
            let second = gather(std::array::from_fn(|lane| from(rims[at(lane)][1])));
            let apex = gather(std::array::from_fn(|lane| ends[usize::from(at(lane) >= of_kept)]));
            let (new, old) = (Four::new(first, second), Four::new(minus(first, apex), minus(second, apex)));
            let turned = dot(new.cross, old.cross).simd_le(f32x4::splat(FLIP_COSINE) * new.length * old.length);
            if (turned & old.length.simd_gt(f32x4::ZERO)).any() {
                return Err(Cause::Flip);
            }
            let across = minus(first, second);
            let edges = dot(first, first) + dot(second, second) + dot(across, across);
            worst = worst.fast_min(new.length / edges.fast_max(f32x4::splat(f32::MIN_POSITIVE)));
            self.fours.push(new);
        }
        let least = worst.to_array().into_iter().fold(f32::INFINITY, f32::min);
        Ok(2.0 * 3f32.sqrt() * least)
    }

    /// What the faces are like, in the order of [`Merge::spokes`]; the last four are filled up with copies.
    pub fn fours(&self) -> &[Four] {
        &self.fours
    }
}

/// Quality of the triangle `[a, b, c]`, as [`Fan::look`] has it.
pub(crate) fn quality([a, b, c]: [DVec3; 3]) -> f64 {
    let edges = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
    if edges > 0.0 { 2.0 * 3f64.sqrt() * (b - a).cross(c - a).length() / edges } else { 0.0 }
}
