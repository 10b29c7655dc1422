//! A patch: the faces that a move replaces, with the samples on them, four to a block. Measures what other triangles in their place would be
//! worth. Everything is kept between patches: nothing is allocated for a candidate.

use super::lists::{Four, Lists, NONE, NearestSample};
use super::plane::Planes;
use super::prices::Prices;
use super::step::Step;
use crate::lanes::{LANES, Vec3x4, dot, minus};
use glam::Vec3;
use std::ops::Range;
use wide::f32x4;

/// Samples a face below which nothing moves.
const FEWEST_SAMPLES: usize = 2;

/// Four samples of one face.
#[derive(Debug, Clone, Copy)]
struct Block {
    /// Their squared distances are those to the nearest triangle.
    four: Four,
    /// Which triangle that is, and the cosine between the normals.
    which: f32x4,
    turn: f32x4,
}

/// What a patch costs with some triangles in its place.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Appraisal {
    pub cost: f32,
    /// Area of the samples whose nearest triangle looks the other way.
    pub turned: f32,
}

#[derive(Debug, Default)]
pub(super) struct Patch {
    blocks: Vec<Block>,
    /// First block of each triangle.
    starts: Vec<usize>,
    /// The triangles as they are, and those tried in their place.
    pub planes: Planes,
    pub tried: Planes,
}

impl Patch {
    pub fn clear(&mut self) {
        self.blocks.clear();
        self.starts.clear();
    }

    /// Samples pushed from now on belong to the next triangle.
    pub fn start_triangle(&mut self) {
        self.starts.push(self.blocks.len());
    }

    /// Adds four samples of the current triangle.
    pub fn push_four(&mut self, four: &Four) {
        let which = f32x4::splat(self.starts.len() as f32 - 1.0);
        self.blocks.push(Block { four: *four, which, turn: f32x4::ONE });
    }

    /// Whether there are enough samples to judge other triangles by.
    pub fn can_judge(&self) -> bool {
        let samples: usize = self.blocks.iter().map(|b| b.four.samples().count()).sum();
        samples >= FEWEST_SAMPLES * self.starts.len()
    }

    /// Gives the samples to the faces that are the triangles now.
    pub fn hand_over(&self, faces: &[usize], lists: &mut Lists) {
        for Block { four, which, .. } in &self.blocks {
            let which = which.to_array();
            if four.ids[LANES - 1] != NONE && which.iter().all(|&k| k == which[0]) {
                lists.push_four(faces[which[0] as usize], four);
            } else {
                four.samples().for_each(|(lane, _)| lists.push_lane(faces[which[lane] as usize], four, lane));
            }
        }
    }

    /// What the patch costs as it is; `triangles` are those that the samples were pushed for.
    pub fn look(&mut self, triangles: &[[Vec3; 3]], prices: &Prices) -> Appraisal {
        self.planes.fill(triangles);
        let all = self.blocks.len();
        for k in 0..triangles.len() {
            let normal = self.planes.get(k).normal;
            for block in &mut self.blocks[range(&self.starts, k, all)] {
                block.turn = dot(block.four.normal, normal);
            }
        }
        self.appraise(&self.planes, prices)
    }

    /// What the patch costs with `triangles` instead, as many as there are, neighbours side by side: samples stay in their triangle or go on to
    /// one beside it.
    pub fn attempt(&mut self, triangles: &[[Vec3; 3]], prices: &Prices) -> Appraisal {
        let (count, all) = (triangles.len(), self.blocks.len());
        self.tried.fill(triangles);
        self.forget();
        for k in 0..count {
            let near = [(k + count - 1) % count, k, (k + 1) % count];
            for (i, &of) in near.iter().enumerate() {
                if !near[..i].contains(&of) {
                    measure(&self.tried, k, &mut self.blocks[range(&self.starts, of, all)]);
                }
            }
        }
        self.appraise(&self.tried, prices)
    }

    /// What the patch costs with any `triangles` instead.
    pub fn attempt_any(&mut self, triangles: &[[Vec3; 3]], prices: &Prices) -> Appraisal {
        self.find_nearest(triangles);
        self.appraise(&self.tried, prices)
    }

    /// Finds the nearest of any `triangles` for every sample.
    fn find_nearest(&mut self, triangles: &[[Vec3; 3]]) {
        self.tried.fill(triangles);
        self.forget();
        for k in 0..triangles.len() {
            measure(&self.tried, k, &mut self.blocks);
        }
    }

    fn forget(&mut self) {
        for block in &mut self.blocks {
            block.four.squared = f32x4::splat(f32::INFINITY);
        }
    }

    fn appraise(&self, planes: &Planes, prices: &Prices) -> Appraisal {
        let (mut cost, mut turned) = (f32x4::ZERO, f32x4::ZERO);
        for Block { four, turn, .. } in &self.blocks {
            cost += prices.of_samples(four.weight, four.squared, *turn);
            turned += turn.simd_lt(f32x4::ZERO) & four.weight;
        }
        Appraisal { cost: cost.reduce_add() + planes.price(prices), turned: turned.reduce_add() }
    }

    /// Adds the samples to the least squares problem for the first corner of all triangles, as they are. To be called after [`Self::look`].
    pub fn add_to(&self, step: &mut Step, prices: &Prices) {
        let mut sums = [f32x4::ZERO; 9];
        for k in 0..self.planes.len() {
            let plane = self.planes.get(k);
            let [normal, fall] = plane.tilt();
            let (mut area, mut turned) = (f32x4::ZERO, f32x4::ZERO);
            for Block { four, .. } in &self.blocks[range(&self.starts, k, self.blocks.len())] {
                area += four.weight;
                turned += four.weight * dot(four.normal, fall);
                let (foot, squared) = plane.approach(four.position);
                let (lever, slope) = (plane.weight_of_first(foot), prices.slopes(four.weight, squared));
                let local = minus(four.position, plane.origin);
                let offset =
                    [dot(local, plane.along) - foot.x, dot(local, plane.across) - foot.y, dot(local, plane.normal)];
                let length = squared.sqrt();
                // Where there is no distance, its direction is the normal's.
                let far = length.simd_gt(f32x4::splat(1e-7));
                let unit = lever / far.bitselect(length, f32x4::ONE);
                let [dx, dy] = [offset[0], offset[1]].map(|d| far & (d * unit));
                let dz = far.bitselect(offset[2] * unit, lever);
                let pull: Vec3x4 =
                    std::array::from_fn(|i| plane.along[i] * dx + plane.across[i] * dy + plane.normal[i] * dz);
                let weighed = pull.map(|p| p * slope);
                let products = [
                    pull[0] * weighed[0],
                    pull[0] * weighed[1],
                    pull[0] * weighed[2],
                    pull[1] * weighed[1],
                    pull[1] * weighed[2],
                    pull[2] * weighed[2],
                    weighed[0] * length,
                    weighed[1] * length,
                    weighed[2] * length,
                ];
                for (sum, product) in sums.iter_mut().zip(products) {
                    *sum += product;
                }
            }
            let (area, turned) = (area.reduce_add(), turned.reduce_add());
            let [normal, fall] = [normal, fall].map(|v| Vec3::from_array(v.map(|x| x.as_array()[0])));
            let steepness = fall.length();
            if area * steepness > 0.0 {
                step.add_pull(normal * steepness, -turned / (area * steepness), 0.5 * prices.of_turning() * area);
            }
        }
        step.add_sums(sums.map(f32x4::reduce_add));
    }

    /// The sample nearest to `x` among those that look the way of `normal`.
    pub fn nearest_sample(&self, x: Vec3, normal: Vec3) -> Option<u32> {
        let mut search = NearestSample::to(x);
        self.blocks.iter().for_each(|block| search.look_at(&block.four, normal));
        search.found()
    }
}

/// Blocks of a triangle, of `blocks` in all.
fn range(starts: &[usize], triangle: usize, blocks: usize) -> Range<usize> {
    starts[triangle]..starts.get(triangle + 1).copied().unwrap_or(blocks)
}

/// Offers a triangle to the samples of some blocks.
#[inline(always)]
fn measure(planes: &Planes, index: usize, blocks: &mut [Block]) {
    let (plane, index) = (planes.get(index), f32x4::splat(index as f32));
    for block in blocks {
        let four = &mut block.four;
        let (_, squared) = plane.approach(four.position);
        let closer = squared.simd_lt(four.squared);
        four.squared = squared.fast_min(four.squared);
        block.which = closer.bitselect(index, block.which);
        block.turn = closer.bitselect(dot(four.normal, plane.normal), block.turn);
    }
}

#[cfg(test)]
mod tests {
    use super::super::source::{Sample, closest_point};
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vec3> {
        // Thirds and halves: points on edges and corners, and triangles without area, come up.
        prop::array::uniform3(prop_oneof![-1.0f32..1.0, (-3i8..4).prop_map(|i| f32::from(i) / 3.0)])
            .prop_map(Vec3::from)
    }

    proptest! {
        #[test]
        fn four_at_a_time_are_as_good_as_one(
            triangles in prop::collection::vec(prop::array::uniform3(vector()), 1..6),
            points in prop::collection::vec(vector(), 1..20),
        ) {
            let mut patch = Patch::default();
            patch.start_triangle();
            let sample = |id: usize| Sample { position: points[id], weight: 1.0, normal: Vec3::Z, face: 0 };
            for first in (0..points.len()).step_by(LANES) {
                let mut four = Four::new(first as u32, &sample(first), 0.0);
                for id in first + 1..points.len().min(first + LANES) {
                    four.set(id - first, id as u32, &sample(id), 0.0);
                }
                patch.push_four(&four);
            }
            patch.find_nearest(&triangles);
            let found: Vec<_> = patch.blocks.iter().flat_map(|b| b.four.samples().map(move |at| (b, at))).collect();
            prop_assert_eq!(found.len(), points.len());
            for (Block { four, which, .. }, (lane, id)) in found {
                let (squared, which) = (four.squared.as_array()[lane], which.as_array()[lane] as usize);
                let to = |t: &[Vec3; 3]| closest_point(*t, points[id as usize]).0.distance_squared(points[id as usize]);
                let nearest = triangles.iter().map(to).fold(f32::INFINITY, f32::min);
                prop_assert!((squared.sqrt() - nearest.sqrt()).abs() < 1e-3, "{} {}", squared, nearest);
                prop_assert!((to(&triangles[which]).sqrt() - nearest.sqrt()).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn a_sample_above_a_corner_pulls_that_corner() {
        let fan = [[Vec3::ZERO, Vec3::X, Vec3::Y]];
        let mut patch = Patch::default();
        patch.start_triangle();
        let sample = Sample { position: Vec3::Z * 0.1, weight: 1.0, normal: Vec3::Z, face: 0 };
        patch.push_four(&Four::new(0, &sample, 0.01));
        let prices = Prices::default();
        patch.look(&fan, &prices);
        let mut step = Step::default();
        patch.add_to(&mut step, &prices);
        let (found, _) = step.solve(&[]).unwrap_or_default();
        assert!(found.distance(Vec3::Z * 0.1 / 1.02) < 1e-6, "{found}");
    }

    #[test]
    fn a_sample_that_looks_another_way_tilts_the_face_towards_it() {
        let fan = [[Vec3::ZERO, Vec3::new(-0.5, 1.0, 0.0), Vec3::new(-0.5, -1.0, 0.0)]];
        let normal = Vec3::new(-0.1, 0.0, 1.0).normalize();
        let mut patch = Patch::default();
        patch.start_triangle();
        patch.push_four(&Four::new(0, &Sample { position: fan[0][1], weight: 1.0, normal, face: 0 }, 0.0));
        let prices = Prices::of_normals_and_needles(1.0, 0.0);
        let before = patch.look(&fan, &prices).cost;
        let mut step = Step::default();
        patch.add_to(&mut step, &prices);
        let (found, promise) = step.solve(&[]).unwrap_or_default();
        let mut moved = fan;
        moved[0][0] += found;
        assert!(found.truncate().length() < 1e-6 && (found.z - 0.05).abs() < 0.002, "{found}");
        assert!(promise > 0.0 && patch.look(&moved, &prices).cost < 0.01 * before);
    }
}
