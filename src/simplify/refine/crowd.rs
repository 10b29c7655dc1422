//! Samples that look for the nearest of a few triangles together, four at a time.

use super::lists::NONE;
use super::plane::Planes;
use crate::lanes::{LANES, Vec3x4};
use glam::Vec3;
use wide::f32x4;

/// The samples, and what they have found so far.
#[derive(Debug, Default)]
pub(super) struct Crowd {
    fours: Vec<Seeking>,
    count: usize,
    triangles: Planes,
}

/// Four samples, side by side.
#[derive(Debug, Clone, Copy)]
struct Seeking {
    position: Vec3x4,
    ids: [u32; LANES],
    squared: f32x4,
    /// As in [`Finding`]; the last one is a mask.
    which: f32x4,
    corner: f32x4,
    inside: f32x4,
}

/// What a sample has found.
pub(super) struct Finding {
    pub id: u32,
    pub squared: f32,
    /// The nearest triangle, and its corner whose share is largest at the closest point: beyond it faces may be nearer. The corner that is nearest may
    /// lie on the wrong side.
    pub which: usize,
    pub corner: usize,
    /// Whether the sample is straight above its triangle: then nothing beside it is nearer.
    pub is_inside: bool,
}

impl Crowd {
    pub fn clear(&mut self) {
        self.fours.clear();
        self.count = 0;
    }

    pub fn push(&mut self, id: u32, position: Vec3) {
        let lane = self.count % LANES;
        self.count += 1;
        if lane == 0 {
            self.fours.push(Seeking {
                position: position.to_array().map(f32x4::splat),
                ids: [NONE; LANES],
                squared: f32x4::splat(f32::INFINITY),
                which: f32x4::ZERO,
                corner: f32x4::ZERO,
                inside: f32x4::ZERO,
            });
        }
        if let Some(four) = self.fours.last_mut() {
            four.position.iter_mut().zip(position.to_array()).for_each(|(own, x)| own.as_mut_array()[lane] = x);
            four.ids[lane] = id;
        }
    }

    /// Offers these triangles to all samples.
    pub fn look_at(&mut self, triangles: &[[Vec3; 3]]) {
        self.triangles.fill(triangles);
        for k in 0..triangles.len() {
            let (plane, index) = (self.triangles.get(k), f32x4::splat(k as f32));
            for four in &mut self.fours {
                let (places, squared) = plane.approach(four.position);
                let closer = squared.simd_lt(four.squared);
                four.squared = squared.fast_min(four.squared);
                four.which = closer.bitselect(index, four.which);
                four.corner = closer.bitselect(plane.weightiest_corner(places), four.corner);
                four.inside = closer.bitselect(places.inside, four.inside);
            }
        }
    }

    /// What the samples have found, in the order in which they came.
    pub fn found(&self) -> impl Iterator<Item = Finding> + '_ {
        let finding = |four: &'_ Seeking| {
            let Seeking { ids, squared, which, corner, inside, .. } = *four;
            let [squared, which, corner, inside] = [squared, which, corner, inside].map(f32x4::to_array);
            (0..LANES).map(move |k| Finding {
                id: ids[k],
                squared: squared[k],
                which: which[k] as usize,
                corner: corner[k] as usize,
                is_inside: inside[k].to_bits() != 0,
            })
        };
        self.fours.iter().flat_map(finding).take(self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::super::source::{Feature, closest_point};
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-1.0f32..1.0).prop_map(Vec3::from)
    }

    proptest! {
        #[test]
        fn a_crowd_finds_what_each_sample_finds_alone(
            triangles in prop::collection::vec(prop::array::uniform3(vector()), 1..6),
            points in prop::collection::vec(vector(), 1..20),
        ) {
            let mut crowd = Crowd::default();
            points.iter().zip(0..).for_each(|(&point, id)| crowd.push(id, point));
            crowd.look_at(&triangles);
            let found: Vec<Finding> = crowd.found().collect();
            prop_assert_eq!(found.len(), points.len());
            for Finding { id, squared, which, corner, is_inside } in found {
                let point = points[id as usize];
                let to = |t: &[Vec3; 3]| closest_point(*t, point).0.distance(point);
                let nearest = triangles.iter().map(to).fold(f32::INFINITY, f32::min);
                prop_assert!((squared.sqrt() - nearest).abs() < 1e-3);
                prop_assert!((to(&triangles[which]) - nearest).abs() < 1e-3);
                let (_, shares, feature) = closest_point(triangles[which], point);
                // Needles and places next to an edge leave it open.
                let [a, b, c] = triangles[which];
                let is_clear = (b - a).cross(c - a).length() > 0.1 && shares.iter().all(|s| *s == 0.0 || *s > 0.01);
                prop_assert!(!is_clear || is_inside == (feature == Feature::Inside), "{:?}", shares);
                prop_assert!(!is_clear || shares.iter().all(|s| shares[corner] > s - 0.01), "{:?} {}", shares, corner);
            }
        }
    }
}
