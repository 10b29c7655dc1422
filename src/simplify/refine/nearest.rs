//! The closest point of many triangles: four at a time along a curve through space, in boxes that are four to a box in turn.

use super::plane::Planes;
use super::source::Foot;
use crate::lanes::{Boxes, LANES, Vec3x4, enclose};
use crate::mesh::order::order_in_space;
use glam::Vec3;
use smallvec::SmallVec;
use wide::f32x4;

#[derive(Debug)]
pub(super) struct NearestFace {
    /// Around the boxes of the level before, the first around triangles.
    levels: Vec<Vec<Boxes>>,
    /// The triangles along the curve, and which faces they are.
    triangles: Planes,
    order: Vec<u32>,
}

/// What is still to be looked at: four triangles below box number `index` of level 0, or four boxes below one of the others.
type Postponed = (f32, usize, usize);

impl NearestFace {
    pub fn new(faces: &[u32], triangle: impl Fn(u32) -> [Vec3; 3]) -> Self {
        let centres = faces.iter().map(|&f| triangle(f).into_iter().sum::<Vec3>() / 3.0);
        let order: Vec<u32> = order_in_space(centres).into_iter().map(|i| faces[i as usize]).collect();
        let corners: Vec<[Vec3; 3]> = order.iter().map(|&f| triangle(f)).collect();
        let mut triangles = Planes::default();
        triangles.fill(&corners);
        let mut bounds: Vec<[Vec3; 2]> =
            corners.chunks(LANES).map(|run| enclose(run.iter().flatten().copied())).collect();
        let mut levels = Vec::new();
        while !bounds.is_empty() {
            levels.push(bounds.chunks(LANES).map(Boxes::new).collect());
            if bounds.len() <= LANES {
                break;
            }
            bounds = bounds.chunks(LANES).map(|run| enclose(run.iter().flatten().copied())).collect();
        }
        Self { levels, triangles, order }
    }

    /// The closest point of all triangles, if it is nearer than `known`.
    pub fn find(&self, x: Vec3, known: Foot) -> Foot {
        let (mut best, at) = (known, x.to_array().map(f32x4::splat));
        let mut waiting: SmallVec<[Postponed; 64]> = SmallVec::new();
        waiting.extend((!self.levels.is_empty()).then_some((0.0, self.levels.len(), 0)));
        while let Some((squared, level, index)) = waiting.pop() {
            if squared >= best.distance_squared {
                continue;
            }
            if level == 0 {
                self.look_at(index, at, &mut best);
                continue;
            }
            let squared = self.levels[level - 1][index].distance_squared([at; 2]).to_array();
            let nearest = lowest(squared);
            for lane in (0..LANES).filter(|&lane| lane != nearest).chain([nearest]) {
                if squared[lane] < best.distance_squared {
                    waiting.push((squared[lane], level - 1, LANES * index + lane));
                }
            }
        }
        best
    }

    fn look_at(&self, index: usize, at: Vec3x4, best: &mut Foot) {
        let four = self.triangles.four(index);
        let (places, squared) = four.approach(at);
        if squared.simd_lt(f32x4::splat(best.distance_squared)).any() {
            let lane = lowest(squared.to_array());
            let face = self.order[(LANES * index + lane).min(self.order.len() - 1)];
            *best = Foot { distance_squared: squared.as_array()[lane], point: four.point(places, lane), face };
        }
    }
}

fn lowest(numbers: [f32; LANES]) -> usize {
    (1..LANES).fold(0, |best, lane| if numbers[lane] < numbers[best] { lane } else { best })
}

#[cfg(test)]
mod tests {
    use super::super::source::closest_point;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn finds_what_looking_at_all_finds(
            corners in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)), 0..300),
            x in prop::array::uniform3(-2.0f32..2.0),
        ) {
            let triangles: Vec<[Vec3; 3]> = corners.into_iter().map(|t| t.map(Vec3::from)).collect();
            let (x, triangle) = (Vec3::from(x), |f: u32| triangles[f as usize]);
            let none = Foot { distance_squared: f32::INFINITY, point: x, face: u32::MAX };
            let found = NearestFace::new(&(0..triangles.len() as u32).collect::<Vec<_>>(), triangle).find(x, none);
            let to = |t: &[Vec3; 3]| closest_point(*t, x).0.distance_squared(x);
            let nearest = triangles.iter().map(to).fold(f32::INFINITY, f32::min);
            prop_assert!(triangles.is_empty() || (found.distance_squared - nearest).abs() < 1e-5, "{found:?} {nearest}");
            prop_assert!(triangles.is_empty() || (to(&triangles[found.face as usize]) - nearest).abs() < 1e-5);
        }
    }
}
