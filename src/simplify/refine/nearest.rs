//! The closest point of many triangles: boxes around runs of them along a curve through space, and around runs of boxes.

use super::source::{Foot, closest_point};
use crate::mesh::order::order_in_space;
use glam::{Vec3, Vec3A};

/// Triangles or boxes in a box.
const RUN: usize = 8;

/// Lower and upper corner.
type Bounds = [Vec3A; 2];

/// Boxes only: the triangles stay where they are, and must be asked for as they were.
#[derive(Debug)]
pub(super) struct NearestFace {
    /// Around runs of triangles, then around runs of the boxes before.
    levels: Vec<Vec<Bounds>>,
    /// The faces along the curve.
    order: Vec<u32>,
}

impl NearestFace {
    pub fn new(faces: &[u32], triangle: impl Fn(u32) -> [Vec3; 3]) -> Self {
        let centres = faces.iter().map(|&f| triangle(f).into_iter().sum::<Vec3>() / 3.0);
        let order: Vec<u32> = order_in_space(centres).into_iter().map(|i| faces[i as usize]).collect();
        let boxes: Vec<Bounds> = order.iter().map(|&f| bounds(triangle(f))).collect();
        let mut levels = vec![join_runs(&boxes)];
        while let Some(last) = levels.last().filter(|boxes| boxes.len() > RUN) {
            levels.push(join_runs(last));
        }
        Self { levels, order }
    }

    /// The closest point of all triangles, if it is nearer than `known`.
    pub fn find(&self, x: Vec3, known: Foot, triangle: impl Fn(u32) -> [Vec3; 3]) -> Foot {
        let (mut best, top) = (known, self.levels.len() - 1);
        for run in 0..self.levels[top].len() {
            self.descend(top, run, x, &triangle, &mut best);
        }
        best
    }

    fn descend(&self, level: usize, run: usize, x: Vec3, triangle: &impl Fn(u32) -> [Vec3; 3], best: &mut Foot) {
        let [low, high] = self.levels[level][run];
        let outside = (low - Vec3A::from(x)).max(Vec3A::from(x) - high).max(Vec3A::ZERO);
        if outside.length_squared() >= best.distance_squared {
            return;
        }
        let below = if level == 0 { self.order.len() } else { self.levels[level - 1].len() };
        for k in run * RUN..((run + 1) * RUN).min(below) {
            if level > 0 {
                self.descend(level - 1, k, x, triangle, best);
                continue;
            }
            let face = self.order[k];
            let (point, ..) = closest_point(triangle(face), x);
            let distance_squared = point.distance_squared(x);
            if distance_squared < best.distance_squared {
                *best = Foot { distance_squared, point, face };
            }
        }
    }
}

fn bounds([a, b, c]: [Vec3; 3]) -> Bounds {
    [a.min(b).min(c).into(), a.max(b).max(c).into()]
}

fn join_runs(boxes: &[Bounds]) -> Vec<Bounds> {
    let join = |run: &[Bounds]| {
        run.iter().fold([Vec3A::INFINITY, Vec3A::NEG_INFINITY], |[l, h], b| [l.min(b[0]), h.max(b[1])])
    };
    boxes.chunks(RUN).map(join).collect()
}

#[cfg(test)]
mod tests {
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
            let found = NearestFace::new(&(0..triangles.len() as u32).collect::<Vec<_>>(), triangle).find(x, none, triangle);
            let to = |t: &[Vec3; 3]| closest_point(*t, x).0.distance_squared(x);
            prop_assert_eq!(found.distance_squared, triangles.iter().map(to).fold(f32::INFINITY, f32::min));
        }
    }
}
