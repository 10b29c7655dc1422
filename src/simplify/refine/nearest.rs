//! The nearest of many points that lie along a curve through space: boxes around runs of them, and around runs of boxes.

use glam::{Vec3, Vec3A};

/// Points or boxes in a box.
const RUN: usize = 16;

/// Boxes only: the points stay where they are.
#[derive(Debug)]
pub(super) struct Nearest {
    /// Around runs of points, then around runs of the boxes before.
    levels: Vec<Vec<[Vec3A; 2]>>,
    count: usize,
}

impl Nearest {
    pub fn new(points: impl Iterator<Item = Vec3>) -> Self {
        let boxes: Vec<[Vec3A; 2]> = points.map(|p| [Vec3A::from(p); 2]).collect();
        let count = boxes.len();
        let mut levels = vec![join_runs(&boxes)];
        while let Some(last) = levels.last().filter(|boxes| boxes.len() > RUN) {
            levels.push(join_runs(last));
        }
        Self { levels, count }
    }

    /// The index of the point nearest to `x`.
    pub fn find(&self, x: Vec3, point: impl Fn(usize) -> Vec3) -> Option<usize> {
        let mut best = (f32::INFINITY, None);
        let top = self.levels.len() - 1;
        for run in 0..self.levels[top].len() {
            self.descend(top, run, x, &point, &mut best);
        }
        best.1
    }

    fn descend(
        &self,
        level: usize,
        index: usize,
        x: Vec3,
        point: &impl Fn(usize) -> Vec3,
        best: &mut (f32, Option<usize>),
    ) {
        let [low, high] = self.levels[level][index];
        let outside = (low - Vec3A::from(x)).max(Vec3A::from(x) - high).max(Vec3A::ZERO);
        if outside.length_squared() >= best.0 {
            return;
        }
        let below = if level == 0 { self.count } else { self.levels[level - 1].len() };
        for k in index * RUN..((index + 1) * RUN).min(below) {
            if level > 0 {
                self.descend(level - 1, k, x, point, best);
                continue;
            }
            let squared = point(k).distance_squared(x);
            if squared < best.0 {
                *best = (squared, Some(k));
            }
        }
    }
}

fn join_runs(boxes: &[[Vec3A; 2]]) -> Vec<[Vec3A; 2]> {
    let join = |run: &[[Vec3A; 2]]| {
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
            points in prop::collection::vec(prop::array::uniform3(-1.0f32..1.0), 0..700),
            x in prop::array::uniform3(-2.0f32..2.0),
        ) {
            let (points, x): (Vec<Vec3>, Vec3) = (points.into_iter().map(Vec3::from).collect(), x.into());
            let found = Nearest::new(points.iter().copied()).find(x, |k| points[k]);
            let to = |k: usize| points[k].distance_squared(x);
            let least = (0..points.len()).map(to).min_by(f32::total_cmp);
            prop_assert_eq!(found.map(to), least);
        }
    }
}
