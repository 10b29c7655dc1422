//! A patch: the faces that a move replaces, with the samples on them, four to a block. Measures what other triangles in their place would be
//! worth. Everything is kept between patches: nothing is allocated for a candidate.

use super::level::NONE;
use super::prices::Prices;
use super::source::Sample;
use super::step::Step;
use glam::{BVec4A, Vec3, Vec4};
use smallvec::SmallVec;

/// Four samples of one face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block {
    position: Lanes,
    normal: Lanes,
    /// 0 in lanes without a sample.
    weight: Vec4,
    /// Squared distance to the nearest triangle, which one it is, and the cosine between the normals.
    nearest: Vec4,
    which: Vec4,
    turn: Vec4,
    /// Samples; `NONE` in lanes without one.
    ids: [u32; 4],
}

/// Four vectors.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lanes {
    x: Vec4,
    y: Vec4,
    z: Vec4,
}

impl Lanes {
    fn splat(v: Vec3) -> Self {
        Self { x: Vec4::splat(v.x), y: Vec4::splat(v.y), z: Vec4::splat(v.z) }
    }

    fn set(&mut self, lane: usize, v: Vec3) {
        self.x[lane] = v.x;
        self.y[lane] = v.y;
        self.z[lane] = v.z;
    }

    fn dot(&self, other: &Self) -> Vec4 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    fn minus(&self, other: &Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }

    fn scaled(&self, factor: Vec4) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
    }

    fn plus(&self, other: &Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

/// What a patch costs with some triangles in its place.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Appraisal {
    pub cost: f32,
    /// Area of the samples whose nearest triangle looks the other way.
    pub turned: f32,
    /// Triangles that look against the source.
    pub against: usize,
}

impl Appraisal {
    /// Whether nothing looks the other way that did not in `before`.
    pub fn faces_like(&self, before: &Self) -> bool {
        self.turned <= before.turned && self.against <= before.against
    }
}

#[derive(Debug, Default)]
pub(super) struct Patch {
    blocks: Vec<Block>,
    /// Lanes taken in the last block.
    taken: usize,
    /// The triangle that new samples belong to.
    current: f32,
    planes: Vec<Plane>,
}

impl Patch {
    pub fn clear(&mut self) {
        self.blocks.clear();
        self.taken = 4;
    }

    /// Samples pushed from now on belong to the triangle of this index.
    pub fn start_triangle(&mut self, index: usize) {
        self.current = index as f32;
        self.taken = 4;
    }

    /// Adds a sample of the current triangle, with its squared distance as far as that is known.
    pub fn push(&mut self, id: u32, sample: &Sample, squared: f32) {
        if self.taken == 4 {
            self.taken = 0;
            self.blocks.push(Block {
                position: Lanes::splat(sample.position),
                normal: Lanes::splat(sample.normal),
                weight: Vec4::ZERO,
                nearest: Vec4::ZERO,
                which: Vec4::splat(self.current),
                turn: Vec4::ONE,
                ids: [NONE; 4],
            });
        }
        let Some(block) = self.blocks.last_mut() else { return };
        let lane = self.taken;
        block.position.set(lane, sample.position);
        block.normal.set(lane, sample.normal);
        block.weight[lane] = sample.weight;
        block.nearest[lane] = squared;
        block.ids[lane] = id;
        self.taken += 1;
    }

    /// Each sample with its squared distance and the index of its triangle.
    pub fn found(&self) -> impl Iterator<Item = (u32, f32, usize)> + '_ {
        let lanes = |b: &'_ Block| {
            let (ids, nearest, which) = (b.ids, b.nearest, b.which);
            (0..4).map(move |k| (ids[k], nearest[k], which[k] as usize))
        };
        self.blocks.iter().flat_map(lanes).filter(|(id, ..)| *id != NONE)
    }

    /// Finds the nearest of `triangles` for every sample, and what all distances and normals cost.
    pub fn measure(&mut self, triangles: &[[Vec3; 3]], prices: &Prices) -> Appraisal {
        for block in &mut self.blocks {
            block.nearest = Vec4::INFINITY;
        }
        for (index, triangle) in triangles.iter().enumerate() {
            let (plane, index) = (Plane::new(triangle), Vec4::splat(index as f32));
            for block in &mut self.blocks {
                let (_, squared) = plane.approach(&block.position);
                let closer = squared.cmplt(block.nearest);
                block.nearest = Vec4::select(closer, squared, block.nearest);
                block.which = Vec4::select(closer, index, block.which);
                block.turn = Vec4::select(closer, block.normal.dot(&plane.normal), block.turn);
            }
        }
        self.appraise(triangles, prices)
    }

    /// What distances and normals cost as they are known; `triangles` are those that the samples were pushed for.
    pub fn measure_as_is(&mut self, triangles: &[[Vec3; 3]], prices: &Prices) -> Appraisal {
        self.planes.clear();
        self.planes.extend(triangles.iter().map(Plane::new));
        for block in &mut self.blocks {
            block.turn = block.normal.dot(&self.planes[block.which.x as usize].normal);
        }
        self.appraise(triangles, prices)
    }

    fn appraise(&self, triangles: &[[Vec3; 3]], prices: &Prices) -> Appraisal {
        let (mut cost, mut turned) = (Vec4::ZERO, Vec4::ZERO);
        for block in &self.blocks {
            cost += prices.of_samples(block.weight, block.nearest, block.turn);
            turned += Vec4::select(block.turn.cmplt(Vec4::ZERO), block.weight, Vec4::ZERO);
        }
        let (turned, against) = (turned.element_sum(), self.count_against(triangles));
        Appraisal { cost: cost.element_sum(), turned, against }
    }

    /// Triangles that look against their samples in the mean, or without any, against the nearest sample.
    fn count_against(&self, triangles: &[[Vec3; 3]]) -> usize {
        let mut along: SmallVec<[(f32, bool); 24]> = SmallVec::from_elem((0.0, false), triangles.len());
        for block in &self.blocks {
            let weighed = block.weight * block.turn;
            for k in 0..4 {
                let (sum, any) = &mut along[block.which[k] as usize];
                *sum += weighed[k];
                *any |= block.weight[k] > 0.0;
            }
        }
        let is_against = |(t, &(sum, any)): (&[Vec3; 3], &(f32, bool))| {
            let normal = (t[1] - t[0]).cross(t[2] - t[0]);
            let nearest = || self.nearest_normal((t[0] + t[1] + t[2]) / 3.0);
            if any { sum < 0.0 } else { nearest().is_some_and(|n| n.dot(normal) < 0.0) }
        };
        triangles.iter().zip(&along).filter(|&pair| is_against(pair)).count()
    }

    fn nearest_normal(&self, x: Vec3) -> Option<Vec3> {
        let at = Lanes::splat(x);
        let mut best: (f32, Option<Vec3>) = (f32::INFINITY, None);
        for block in &self.blocks {
            let offset = block.position.minus(&at);
            let squared = offset.dot(&offset);
            for k in (0..4).filter(|&k| block.weight[k] > 0.0) {
                if squared[k] < best.0 {
                    best = (squared[k], Some(Vec3::new(block.normal.x[k], block.normal.y[k], block.normal.z[k])));
                }
            }
        }
        best.1
    }

    /// Adds the samples to the least squares problem for the first corner of all triangles. To be called after [`Self::measure_as_is`].
    pub fn add_to(&self, step: &mut Step, prices: &Prices) {
        let mut sums = [Vec4::ZERO; 9];
        for block in &self.blocks {
            let plane = &self.planes[block.which.x as usize];
            let (foot, squared) = plane.approach(&block.position);
            let lever = plane.weight_of_first(&foot);
            let slope = prices.slopes(block.weight, squared);
            let local = block.position.minus(&plane.origin);
            let (dx, dy, dz) =
                (local.dot(&plane.along) - foot.x, local.dot(&plane.across) - foot.y, local.dot(&plane.normal));
            let length = Vec4::new(squared.x.sqrt(), squared.y.sqrt(), squared.z.sqrt(), squared.w.sqrt());
            let near = length.cmplt(Vec4::splat(1e-7));
            let inverse = Vec4::ONE / Vec4::select(near, Vec4::ONE, length);
            // Where there is no distance, its direction is the normal's.
            let (dx, dy, dz) = (
                Vec4::select(near, Vec4::ZERO, dx * inverse),
                Vec4::select(near, Vec4::ZERO, dy * inverse),
                Vec4::select(near, Vec4::ONE, dz * inverse),
            );
            let pull =
                plane.along.scaled(dx).plus(&plane.across.scaled(dy)).plus(&plane.normal.scaled(dz)).scaled(lever);
            let weighed = pull.scaled(slope);
            let products = [
                pull.x * weighed.x,
                pull.x * weighed.y,
                pull.x * weighed.z,
                pull.y * weighed.y,
                pull.y * weighed.z,
                pull.z * weighed.z,
                weighed.x * length,
                weighed.y * length,
                weighed.z * length,
            ];
            for (sum, product) in sums.iter_mut().zip(products) {
                *sum += product;
            }
        }
        step.add_sums(sums.map(Vec4::element_sum));
    }

    /// The sample nearest to `x` among those that look the way of `normal`.
    pub fn nearest_sample(&self, x: Vec3, normal: Vec3) -> Option<u32> {
        let (at, normal) = (Lanes::splat(x), Lanes::splat(normal));
        let (mut best, mut ids) = (Vec4::INFINITY, [NONE; 4]);
        for block in &self.blocks {
            let offset = block.position.minus(&at);
            let faces_along = block.normal.dot(&normal).cmpgt(Vec4::ZERO) & block.weight.cmpgt(Vec4::ZERO);
            let squared = Vec4::select(faces_along, offset.dot(&offset), Vec4::INFINITY);
            let closer = squared.cmplt(best).bitmask();
            best = best.min(squared);
            for (k, id) in ids.iter_mut().enumerate() {
                if closer >> k & 1 == 1 {
                    *id = block.ids[k];
                }
            }
        }
        let k = (0..4).min_by(|&a, &b| best[a].total_cmp(&best[b])).unwrap_or(0);
        (ids[k] != NONE).then_some(ids[k])
    }
}

/// A triangle in a frame of its own: the first corner is the origin, the first edge the x axis. Every number stands four times.
#[derive(Debug, Clone, Copy)]
struct Plane {
    origin: Lanes,
    along: Lanes,
    across: Lanes,
    normal: Lanes,
    /// Length of the first edge; place of the third corner.
    length: Vec4,
    apex: [Vec4; 2],
    /// 1 / square of the second and third edge's lengths.
    inverse: [Vec4; 2],
    has_area: BVec4A,
    /// Weight of the first corner: 1 + falls · place.
    falls: [Vec4; 2],
}

/// Places in a triangle's plane.
#[derive(Debug, Clone, Copy)]
struct Places {
    x: Vec4,
    y: Vec4,
}

impl Plane {
    fn new([a, b, c]: &[Vec3; 3]) -> Self {
        let (ab, ac) = (*b - *a, *c - *a);
        let normal = ab.cross(ac).normalize_or_zero();
        // A face without area is an edge or a point: any frame along it serves.
        let along = ab.try_normalize().or(ac.try_normalize()).unwrap_or(Vec3::X);
        let frame_normal = if normal == Vec3::ZERO { along.any_orthonormal_vector() } else { normal };
        let across = frame_normal.cross(along);
        let (length, x, y) = (ab.dot(along), ac.dot(along), ac.dot(across));
        let inverse = |squared: f32| if squared > 0.0 { 1.0 / squared } else { 0.0 };
        let has_area = length > 0.0 && y > 0.0;
        let falls = if has_area { [-1.0 / length, (x - length) / (length * y)] } else { [0.0; 2] };
        Self {
            origin: Lanes::splat(*a),
            along: Lanes::splat(along),
            across: Lanes::splat(across),
            normal: Lanes::splat(frame_normal),
            length: Vec4::splat(length),
            apex: [x, y].map(Vec4::splat),
            inverse: [inverse((x - length) * (x - length) + y * y), inverse(x * x + y * y)].map(Vec4::splat),
            has_area: if has_area { BVec4A::TRUE } else { BVec4A::FALSE },
            falls: falls.map(Vec4::splat),
        }
    }

    /// The closest points in the triangle, and the squared distances to them.
    #[inline(always)]
    fn approach(&self, position: &Lanes) -> (Places, Vec4) {
        let local = position.minus(&self.origin);
        let (x, y, height) = (local.dot(&self.along), local.dot(&self.across), local.dot(&self.normal));
        let [cx, cy] = self.apex;
        let clamp = |s: Vec4, most: Vec4| s.max(Vec4::ZERO).min(most);
        // Edge a b lies on the axis; b c and c a are taken from their far ends.
        let first = Places { x: clamp(x, self.length), y: Vec4::ZERO };
        let (ex, ey) = (cx - self.length, cy);
        let bx = x - self.length;
        let s = clamp((bx * ex + y * ey) * self.inverse[0], Vec4::ONE);
        let second = Places { x: self.length + ex * s, y: ey * s };
        let t = clamp((x * cx + y * cy) * self.inverse[1], Vec4::ONE);
        let third = Places { x: cx * t, y: cy * t };
        let square = |p: &Places| (x - p.x) * (x - p.x) + (y - p.y) * (y - p.y);
        let (d1, d2, d3) = (square(&first), square(&second), square(&third));
        let (nearer, d) = pick(d2.cmplt(d1), (second, d2), (first, d1));
        let (nearer, d) = pick(d3.cmplt(d), (third, d3), (nearer, d));
        let inside = self.has_area
            & y.cmpge(Vec4::ZERO)
            & (ex * y - ey * bx).cmpge(Vec4::ZERO)
            & (cy * x - cx * y).cmpge(Vec4::ZERO);
        let (place, d) = pick(inside, (Places { x, y }, Vec4::ZERO), (nearer, d));
        (place, d + height * height)
    }

    fn weight_of_first(&self, place: &Places) -> Vec4 {
        Vec4::ONE + self.falls[0] * place.x + self.falls[1] * place.y
    }
}

#[inline(always)]
fn pick(mask: BVec4A, yes: (Places, Vec4), no: (Places, Vec4)) -> (Places, Vec4) {
    let x = Vec4::select(mask, yes.0.x, no.0.x);
    let y = Vec4::select(mask, yes.0.y, no.0.y);
    (Places { x, y }, Vec4::select(mask, yes.1, no.1))
}

#[cfg(test)]
mod tests {
    use super::super::source::closest_point;
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
            patch.start_triangle(0);
            for (&position, id) in points.iter().zip(0..) {
                patch.push(id, &Sample { position, weight: 1.0, normal: Vec3::Z, face: 0 }, 0.0);
            }
            patch.measure(&triangles, &Prices::default());
            let found: Vec<_> = patch.found().collect();
            prop_assert_eq!(found.len(), points.len());
            for (id, squared, which) in found {
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
        patch.start_triangle(0);
        patch.push(0, &Sample { position: Vec3::Z * 0.1, weight: 1.0, normal: Vec3::Z, face: 0 }, 0.01);
        let prices = Prices::default();
        patch.measure_as_is(&fan, &prices);
        let mut step = Step::default();
        patch.add_to(&mut step, &prices);
        let (found, _) = step.solve().unwrap_or_default();
        assert!(found.distance(Vec3::Z * 0.1 / 1.02) < 1e-6, "{found}");
    }
}
