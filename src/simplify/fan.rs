//! The faces that a collapse leaves around the joined point, four at a time: whether they turn over, how well they are shaped, which way they look.

use super::guard::Cause;
use crate::lanes::{LANES, Vec3x4, cross, dot, gather, minus};
use crate::mesh::surface::{Corner, Surface};
use crate::mesh::surgery::Merge;
use glam::{DVec3, Vec3, Vec4};
use wide::f32x4;

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

    /// Quality of each face, of which these are the edges that it was made of.
    #[inline]
    fn quality(&self, first: Vec3x4, second: Vec3x4) -> f32x4 {
        let across = minus(first, second);
        let edges = dot(first, first) + dot(second, second) + dot(across, across);
        f32x4::splat(2.0 * 3f32.sqrt()) * self.length / edges.fast_max(f32x4::splat(f32::MIN_POSITIVE))
    }

    /// Unit normal (xyz) and area (w) of each face; all zero where it has none.
    #[inline]
    pub fn facets(&self) -> [Vec4; LANES] {
        let inverse = self.length.simd_gt(f32x4::ZERO) & (f32x4::ONE / self.length);
        let [x, y, z] = self.cross.map(|c| c * inverse);
        f32x4::transpose([x, y, z, self.length * f32x4::HALF]).map(|facet| Vec4::from_array(facet.to_array()))
    }
}

/// Whether the quality of the face at one of these corners is `limit` at most.
pub(crate) fn is_any_poor(surface: &Surface, corners: &[Corner], limit: f32) -> bool {
    corners.chunks(LANES).any(|corners| {
        // The last four are filled up with copies.
        let edges = [0, 1, 2, 3].map(|lane: usize| {
            let [a, b, c] = surface.triangle(Surface::face_of(corners[lane.min(corners.len() - 1)]));
            [b - a, c - a].map(|edge| edge.as_vec3())
        });
        let [first, second] = [0, 1].map(|i| gather(edges.map(|edges| edges[i])));
        Four::new(first, second).quality(first, second).simd_le(f32x4::splat(limit)).any()
    })
}

/// Square of the distance from `point` to the nearest of `count` faces, which the origin has with each `rim`.
pub(super) fn distance_squared(point: Vec3, count: usize, rim: impl Fn(usize) -> [Vec3; 2]) -> f32 {
    let (zero, point) = (f32x4::ZERO, point.to_array().map(f32x4::splat));
    // The origin itself is there in any case.
    let mut least = dot(point, point);
    for start in (0..count).step_by(LANES) {
        // The last four are filled up with copies.
        let four = [0, 1, 2, 3].map(|lane: usize| rim((start + lane).min(count - 1)));
        let (first, second) = (gather(four.map(|rim| rim[0])), gather(four.map(|rim| rim[1])));
        let normal = cross(first, second);
        let area = dot(normal, normal);
        let (v, w) = (dot(cross(point, second), normal), dot(cross(first, point), normal));
        let is_above = v.simd_ge(zero) & w.simd_ge(zero) & (v + w).simd_le(area) & area.simd_gt(zero);
        let to_edge = |from: Vec3x4, along: Vec3x4| {
            let off = minus(point, from);
            let share = dot(off, along) / dot(along, along).fast_max(f32x4::splat(f32::MIN_POSITIVE));
            let share = share.fast_max(zero).fast_min(f32x4::ONE);
            let off = minus(off, along.map(|x| x * share));
            dot(off, off)
        };
        let spokes = to_edge([zero; 3], first).fast_min(to_edge([zero; 3], second));
        let edges = spokes.fast_min(to_edge(first, minus(second, first)));
        let height = dot(normal, point);
        least = least.fast_min(is_above.select(height * height / area, edges));
    }
    least.to_array().into_iter().fold(f32::INFINITY, f32::min)
}

impl Fan {
    /// Looks at the faces that `merge` leaves, with the joined point at `position`, from the spoke `first` on; gives the least quality among them:
    /// 4√3 · area / Σ edge², 1 for an equilateral triangle, 0 for a degenerate one.
    pub fn look(&mut self, surface: &Surface, merge: &Merge, position: DVec3, first: usize) -> Result<f32, Cause> {
        self.fours.clear();
        let from = |p: u32| (surface.points[p as usize] - position).as_vec3();
        let ends = [merge.kept, merge.gone].map(|end| from(end).to_array().map(f32x4::splat));
        let places = f32x4::from([0.0, 1.0, 2.0, 3.0]);
        let rims = &merge.rims()[first..];
        // What fills up the last four belongs to the same end as the last one.
        let of_kept = if merge.spokes_of_gone().is_empty() { usize::MAX } else { merge.spokes_of_kept().len() - first };
        let mut worst = f32x4::splat(f32::INFINITY);
        for start in (0..rims.len()).step_by(LANES) {
            // The last four are filled up with copies.
            let last = rims.len() - 1;
            let four = [0, 1, 2, 3].map(|lane: usize| rims[(start + lane).min(last)]);
            let (first, second) = (gather(four.map(|rim| from(rim[0]))), gather(four.map(|rim| from(rim[1]))));
            let is_of_kept = places.simd_lt(f32x4::splat(of_kept as f32 - start as f32));
            let apex = std::array::from_fn(|i| is_of_kept.select(ends[0][i], ends[1][i]));
            let (new, old) = (Four::new(first, second), Four::new(minus(first, apex), minus(second, apex)));
            let turned = dot(new.cross, old.cross).simd_le(f32x4::splat(FLIP_COSINE) * new.length * old.length);
            if (turned & old.length.simd_gt(f32x4::ZERO)).any() {
                return Err(Cause::Flip);
            }
            worst = worst.fast_min(new.quality(first, second));
            self.fours.push(new);
        }
        Ok(worst.to_array().into_iter().fold(f32::INFINITY, f32::min))
    }

    /// What the faces are like, in the order of [`Merge::spokes`] from the first on that was looked at; the last four are filled up with copies.
    pub fn fours(&self) -> &[Four] {
        &self.fours
    }
}

#[cfg(test)]
mod tests {
    use super::super::refine::closest_point;
    use super::*;
    use crate::mesh::Mesh;
    use proptest::prelude::*;

    /// Two points at 0 and 1, and a ring of others around both.
    fn ring(heights: &[f32]) -> Mesh {
        let count = heights.len() as u32;
        let around = |(k, &z): (usize, &f32)| {
            let angle = k as f32 / heights.len() as f32 * std::f32::consts::TAU;
            [0.5 + angle.cos() * 1.5, angle.sin(), z]
        };
        let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]].into_iter();
        let positions: Vec<[f32; 3]> = positions.chain(heights.iter().enumerate().map(around)).collect();
        // The first half of the ring belongs to the point at 1, the other to the one at 0.
        let quarter = count / 4;
        let owner = |k: u32| u32::from(k < quarter || k >= count - quarter);
        let mut triangles: Vec<[u32; 3]> = (0..count).map(|k| [owner(k), 2 + k, 2 + (k + 1) % count]).collect();
        triangles.extend([[0, 1, 2 + quarter], [1, 0, 2 + count - quarter]]);
        Mesh { positions, triangles, ..Mesh::default() }
    }

    /// Quality of the triangle `[a, b, c]`, as [`Fan::look`] has it.
    fn quality([a, b, c]: [DVec3; 3]) -> f64 {
        let edges = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
        if edges > 0.0 { 2.0 * 3f64.sqrt() * (b - a).cross(c - a).length() / edges } else { 0.0 }
    }

    proptest! {
        #[test]
        fn the_nearest_of_some_faces(
            point in prop::array::uniform3(-1.0f32..1.0),
            rims in prop::collection::vec(prop::array::uniform2(prop::array::uniform3(-1.0f32..1.0)), 0..12),
        ) {
            let point = Vec3::from(point);
            let faces = rims.iter().map(|&[q, r]| [Vec3::ZERO, Vec3::from(q), Vec3::from(r)]);
            let squared = faces.map(|face| closest_point(face, point).0.distance_squared(point));
            let expected = squared.fold(point.length_squared(), f32::min);
            let found = distance_squared(point, rims.len(), |i| rims[i].map(Vec3::from));
            prop_assert!((found - expected).abs() < 1e-5, "{} {}", found, expected);
        }

        #[test]
        fn four_at_a_time_are_as_good_as_one(
            heights in prop::collection::vec(-0.3f32..0.3, 8..13).prop_map(|mut h| { h.truncate(h.len() / 4 * 4); h }),
            place in prop::array::uniform3(-0.8f32..0.8),
        ) {
            let surface = Surface::new(&ring(&heights));
            let merge = Merge::new(&surface, 0, 1);
            prop_assert_eq!(merge.spokes().len(), heights.len());
            let position = surface.points[0].lerp(surface.points[1], 0.5) + DVec3::from(place.map(f64::from)) * 0.3;
            let mut fan = Fan::default();
            let found = fan.look(&surface, &merge, position, 0);
            let moved = |&c: &u32| {
                let [p, q] = surface.opposite(c).map(|p| surface.points[p as usize]);
                [position, p, q]
            };
            let normal = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).normalize();
            let cosines = merge.spokes().iter().map(|c| normal(moved(c)).dot(normal({
                let [p, q] = surface.opposite(*c).map(|p| surface.points[p as usize]);
                let apex = if merge.spokes_of_kept().contains(c) { 0 } else { 1 };
                [surface.points[apex], p, q]
            })));
            let least = cosines.fold(1.0, f64::min);
            prop_assume!((least - f64::from(FLIP_COSINE)).abs() > 1e-4);
            prop_assert_eq!(found.is_ok(), least > f64::from(FLIP_COSINE));
            if let Ok(worst) = found {
                let expected = merge.spokes().iter().map(|c| quality(moved(c))).fold(f64::INFINITY, f64::min);
                prop_assert!((f64::from(worst) - expected).abs() < 1e-5);
                let facets: Vec<Vec4> = fan.fours().iter().flat_map(Four::facets).take(heights.len()).collect();
                for (facet, corner) in facets.iter().zip(merge.spokes()) {
                    let [a, b, c] = moved(corner);
                    prop_assert!(facet.truncate().as_dvec3().distance(normal([a, b, c])) < 1e-4);
                    prop_assert!((f64::from(facet.w) - 0.5 * (b - a).cross(c - a).length()).abs() < 1e-5);
                }
            }
        }
    }
}
