//! Triangles as the search for closest points wants them: each in a frame of its own, made four at a time and asked by four places at a time.

use super::prices::Prices;
use super::step::Step;
use crate::lanes::{LANES, Vec3x4, cross, dot, gather, minus};
use glam::Vec3;
use wide::f32x4;

/// Triangles, four to a block; the last block is filled up with copies.
#[derive(Debug, Default)]
pub(super) struct Planes {
    fours: Vec<Four>,
    count: usize,
}

/// Four triangles, one a lane.
#[derive(Debug, Clone, Copy)]
struct Four {
    frames: Plane,
    /// 4√3 · area / Σ edge², see [`Prices::of_shapes`]; large in copies.
    quality: f32x4,
    /// Σ edge².
    squares: f32x4,
}

/// The frames of four triangles, or of one four times: the first corner is the origin, the first edge the x axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    pub origin: Vec3x4,
    pub along: Vec3x4,
    pub across: Vec3x4,
    pub normal: Vec3x4,
    /// Length of the first edge; place of the third corner.
    length: f32x4,
    apex: [f32x4; 2],
    /// 1 / square of the second and third edge's lengths.
    inverse: [f32x4; 2],
    /// Weight of the first corner: 1 + falls · place.
    falls: [f32x4; 2],
    /// Mask: triangles with an area.
    solid: f32x4,
}

/// Places in triangles, in their planes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Places {
    pub x: f32x4,
    pub y: f32x4,
    /// Mask: those straight below what they are the closest to; the others are on an edge or a corner.
    pub inside: f32x4,
}

impl Planes {
    /// Takes these triangles instead of those it has.
    pub fn fill(&mut self, triangles: &[[Vec3; 3]]) {
        self.count = triangles.len();
        self.fours.clear();
        self.fours.reserve_exact(triangles.len().div_ceil(LANES));
        for start in (0..triangles.len()).step_by(LANES) {
            let at = |lane: usize| (start + lane).min(triangles.len() - 1);
            let corner = |k: usize| gather(std::array::from_fn(|lane| triangles[at(lane)][k]));
            let mut four = Four::new(corner(0), corner(1), corner(2));
            if !four.frames.solid.all() {
                four.mend(|lane| triangles[at(lane)]);
            }
            for copy in triangles.len() - start..LANES {
                four.quality.as_mut_array()[copy] = f32::INFINITY;
            }
            self.fours.push(four);
        }
    }

    pub fn len(&self) -> usize {
        self.count
    }

    #[inline(always)]
    pub fn get(&self, index: usize) -> Plane {
        let (four, lane) = (&self.fours[index / LANES].frames, index % LANES);
        let number = |v: &f32x4| f32x4::splat(v.as_array()[lane]);
        let vector = |v: &Vec3x4| [number(&v[0]), number(&v[1]), number(&v[2])];
        Plane {
            origin: vector(&four.origin),
            along: vector(&four.along),
            across: vector(&four.across),
            normal: vector(&four.normal),
            length: number(&four.length),
            apex: [number(&four.apex[0]), number(&four.apex[1])],
            inverse: [number(&four.inverse[0]), number(&four.inverse[1])],
            falls: [number(&four.falls[0]), number(&four.falls[1])],
            solid: number(&four.solid),
        }
    }

    /// Four triangles side by side: those from 4 · `index` on.
    #[inline(always)]
    pub fn four(&self, index: usize) -> &Plane {
        &self.fours[index].frames
    }

    /// The least cosine between the normals of these triangles and the `others`, one by one; -1 if one of them has no area.
    pub fn least_cosine(&self, others: &Self) -> f32 {
        let mut least = f32x4::ONE;
        for (a, b) in self.fours.iter().zip(&others.fours) {
            let (a, b) = (&a.frames, &b.frames);
            let cosine = dot(a.normal, b.normal);
            least = least.fast_min((a.solid & b.solid).bitselect(cosine, -f32x4::ONE));
        }
        least.to_array().into_iter().fold(1.0, f32::min)
    }

    /// What the triangles' shapes cost.
    pub fn price(&self, prices: &Prices) -> f32 {
        self.fours.iter().map(|four| prices.of_shapes(four.quality).reduce_add()).sum()
    }

    /// What shapes add to the least squares problem for the first corner of all triangles.
    pub fn add_shapes_to(&self, step: &mut Step, prices: &Prices) {
        for (index, four) in (0..self.count).map(|index| (index, &self.fours[index / LANES])) {
            let (frames, number) = (&four.frames, |v: f32x4| v.as_array()[index % LANES]);
            let vector = |v: &Vec3x4| Vec3::from_array(v.map(number));
            let (quality, squares) = (number(four.quality), number(four.squares));
            let fall = frames.falls.map(number);
            // The area grows as the corner's share does, and the squares of its edges fall towards the other two.
            let others = [number(frames.length + frames.apex[0]), number(frames.apex[1])];
            let [x, y] = [0, 1].map(|i| quality * (fall[i] + 2.0 * others[i] / squares));
            prices.draw_to_shape(step, quality, vector(&frames.along) * x + vector(&frames.across) * y);
        }
    }
}

impl Four {
    fn new(a: Vec3x4, b: Vec3x4, c: Vec3x4) -> Self {
        let (ab, ac, bc) = (minus(b, a), minus(c, a), minus(c, b));
        let normal = cross(ab, ac);
        let squares = [ab, ac, bc].map(|e| dot(e, e));
        let (length, double_area) = (squares[0].sqrt(), dot(normal, normal).sqrt());
        let solid = double_area.simd_gt(f32x4::ZERO) & length.simd_gt(f32x4::ZERO);
        // Where there is no area, zero over zero is taken out again.
        let over = |number: f32x4, by: f32x4| solid & (number / by);
        let (unit, flat) = (over(f32x4::ONE, length), over(f32x4::ONE, double_area));
        let (along, normal) = (ab.map(|x| x * unit), normal.map(|x| x * flat));
        let (x, y) = (dot(ac, along), double_area * unit);
        let edges = squares[0] + squares[1] + squares[2];
        let frames = Plane {
            origin: a,
            along,
            across: cross(normal, along),
            normal,
            length,
            apex: [x, y],
            inverse: [over(f32x4::ONE, squares[2]), over(f32x4::ONE, squares[1])],
            falls: [-unit, (x - length) * flat],
            solid,
        };
        Self { frames, quality: over(f32x4::splat(2.0 * 3f32.sqrt()) * double_area, edges), squares: edges }
    }

    /// Gives triangles without an area, which are edges or points, a frame along them.
    fn mend(&mut self, triangle: impl Fn(usize) -> [Vec3; 3]) {
        let frames = &mut self.frames;
        for lane in 0..LANES {
            if frames.solid.as_array()[lane].to_bits() != 0 {
                continue;
            }
            let [a, b, c] = triangle(lane);
            let (ab, ac) = (b - a, c - a);
            let along = ab.try_normalize().or(ac.try_normalize()).unwrap_or(Vec3::X);
            let normal = along.any_orthonormal_vector();
            let (length, x) = (ab.dot(along), ac.dot(along));
            let inverse = |length: f32| if length * length > 0.0 { 1.0 / (length * length) } else { 0.0 };
            let set = |four: &mut f32x4, value: f32| four.as_mut_array()[lane] = value;
            let set_vector = |four: &mut Vec3x4, v: Vec3| (0..3).for_each(|i| set(&mut four[i], v[i]));
            set_vector(&mut frames.along, along);
            set_vector(&mut frames.across, normal.cross(along));
            set_vector(&mut frames.normal, normal);
            set(&mut frames.length, length);
            set(&mut frames.apex[0], x);
            set(&mut frames.apex[1], 0.0);
            set(&mut frames.inverse[0], inverse(x - length));
            set(&mut frames.inverse[1], inverse(x));
        }
    }
}

impl Plane {
    /// The closest points in the triangle, and the squared distances to them.
    #[inline(always)]
    pub fn approach(&self, position: Vec3x4) -> (Places, f32x4) {
        let local = minus(position, self.origin);
        let (x, y, height) = (dot(local, self.along), dot(local, self.across), dot(local, self.normal));
        let [cx, cy] = self.apex;
        let clamp = |s: f32x4, most: f32x4| s.fast_max(f32x4::ZERO).fast_min(most);
        // Edge a b lies on the axis; b c and c a are taken from their far ends.
        let first = clamp(x, self.length);
        let (ex, bx) = (cx - self.length, x - self.length);
        let s = clamp((bx * ex + y * cy) * self.inverse[0], f32x4::ONE);
        let second = [self.length + ex * s, cy * s];
        let t = clamp((x * cx + y * cy) * self.inverse[1], f32x4::ONE);
        let third = [cx * t, cy * t];
        let square = |[px, py]: [f32x4; 2]| (x - px) * (x - px) + (y - py) * (y - py);
        let (d1, d2, d3) = (square([first, f32x4::ZERO]), square(second), square(third));
        let closer = d2.simd_lt(d1);
        let (px, py, d) = (closer.bitselect(second[0], first), closer & second[1], d2.fast_min(d1));
        let closer = d3.simd_lt(d);
        let (px, py, d) = (closer.bitselect(third[0], px), closer.bitselect(third[1], py), d3.fast_min(d));
        let inside = self.solid & y.simd_ge(f32x4::ZERO) & (ex * y).simd_ge(cy * bx) & (cx * y).simd_le(cy * x);
        let places = Places { x: inside.bitselect(x, px), y: inside.bitselect(y, py), inside };
        (places, height * height + (d & !inside))
    }

    /// Where a place lies in space, by its lane.
    pub fn point(&self, places: Places, lane: usize) -> Vec3 {
        let number = |v: f32x4| v.as_array()[lane];
        let vector = |v: &Vec3x4| Vec3::from_array(v.map(number));
        vector(&self.origin) + vector(&self.along) * number(places.x) + vector(&self.across) * number(places.y)
    }

    /// The first corner's share at these places.
    pub fn weight_of_first(&self, places: Places) -> f32x4 {
        f32x4::ONE + self.falls[0] * places.x + self.falls[1] * places.y
    }

    /// The normal, and the gradient of the first corner's share: with a step of that corner the normal turns by the step's height against it.
    pub fn tilt(&self) -> [Vec3x4; 2] {
        let fall = std::array::from_fn(|i| self.falls[0] * self.along[i] + self.falls[1] * self.across[i]);
        [self.normal, fall]
    }

    /// Which corner's share is largest at these places: 0, 1 or 2; of triangles without an area the first.
    #[inline(always)]
    pub fn weightiest_corner(&self, places: Places) -> f32x4 {
        let first = self.weight_of_first(places);
        let third = self.solid & (places.y / self.apex[1]);
        let second = f32x4::ONE - first - third;
        let corner = second.simd_gt(first) & f32x4::ONE;
        third.simd_gt(first.fast_max(second)).bitselect(f32x4::splat(2.0), corner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn shapes_draw_a_corner_to_where_they_cost_less(x in -1.5f32..2.5, height in 0.05f32..0.3) {
            let prices = Prices::of_normals_and_needles(0.0, 1.0);
            let triangle = |hub: Vec3| [hub, Vec3::new(0.0, 0.3, 0.0), Vec3::new(1.0, 0.0, 0.4)];
            let hub = Vec3::new(x, 0.3 * (1.0 - x) + height, 0.4 * x);
            let mut planes = Planes::default();
            planes.fill(&[triangle(hub)]);
            let mut step = Step::default();
            planes.add_shapes_to(&mut step, &prices);
            let cost = |hub: Vec3| prices.of_shape(&triangle(hub));
            prop_assume!(cost(hub) > 1e-3);
            let (found, _) = step.solve(&[]).unwrap_or_default();
            let slope = Vec3::AXES.map(|axis| (cost(hub - axis * 1e-3) - cost(hub + axis * 1e-3)) / 2e-3);
            let slope = Vec3::from_array(slope);
            prop_assert!(found.normalize().dot(slope.normalize()) > 0.999, "{} {}", found, slope);
            prop_assert!(cost(hub + found * 0.1) < cost(hub));
        }
    }
}
