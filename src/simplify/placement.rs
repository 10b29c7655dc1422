//! Where the point of a collapsed edge goes and what that costs: between the minimum of the quadrics at its ends and the one that keeps the volume.
//!
//! The quadrics are memoryless: every plane of a point's quadric goes through the point itself, so that a quadric is a matrix `A` alone and its value at
//! `x` is `(x − p)ᵀ A (x − p)`. Relative to the first end, with `e` the edge and `y` the place looked for, the sum of both is least where
//! `(A + B) y = B e`, and the volume is kept where `g · y = N_b · e`: `g` is the sum of the area vectors of the faces around both ends, `N_b` of those
//! around the second (Lindstrom & Turk 1998, eq. 4). The point goes from the one towards the other, some of the way or all of it. A pull towards the
//! middle of the edge, three steps of it, decides where the surface does not (after Trettner & Kobbelt 2020).
//!
//! Places are found in single precision, relative to the edge; what they cost is evaluated in double precision, since a plane's error next to nothing
//! is the difference of large terms.

use super::fan::Four;
use crate::attributes::{AttributeQuadric, add_product, multiply};
use crate::curvature::Form;
use crate::lanes::{LANES, Vec3x4, dot, gather};
use glam::{DVec3, Vec3, Vec4, Vec4Swizzles};
use wide::f32x4;

/// Pull towards the edge's midpoint, relative to the quadrics' trace.
const STIFFNESS: f32 = 1e-5;
/// Square of the distance from the middle of the edge that a place may have, relative to the edge's.
const REACH_SQUARED: f32 = 4.0;
/// Square of the area vectors' sum, relative to the areas', below which they cancel: folds, needles. The volume constraint means nothing there.
const LEAST_NORMAL_SQUARED: f32 = 1e-4;
/// Largest K·|e|² that counts; beyond it the surface is not resolved anyway.
const CURVATURE_CAP: f32 = 3.0;
/// Factor by which the shape's error may grow for the sake of attributes: along what is ruled or flat, where the shape loses nothing, it goes on doing so.
const MOST_FOR_ATTRIBUTES: f64 = 2.0;
/// Weight of K·|e|² at a curvature weight of 1.
const CURVATURE_SCALE: f32 = 2.5;
/// 1 − cos of the angle between the end normals of an edge that counts as flat.
const FLAT_ANGLE: f32 = 0.02;
/// Cost of an edge's length on a flat surface, relative to area · length²: orders the collapses that cost nothing else.
const LENGTH_COST: f32 = 1e-10;

/// What a collapse to an end mostly costs at most, relative to its error by the old faces: the farthest one counts besides, see `ends`. With less, more
/// come too early and are judged twice.
const SWEPT: f32 = 2.0;

/// What is known of a point: one cache line.
///
/// The quadric `Σ area · n nᵀ` is kept as `weight · m mᵀ + spread`, with the mean normal `m` and the covariance of the normals around it: that is
/// exact where the surface is flat, even in single precision.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub(super) struct Apex {
    /// Σ area of the faces around the point, and their mean normal.
    mean: [f32; 4],
    /// The spread's xx, xy, xz, yy.
    spread: [f32; 4],
    /// The spread's yz, zz; the source's [form](Form), averaged at merges.
    rest: [f32; 4],
    position: [f32; 4],
}

impl Apex {
    pub fn with_form(form: Form) -> Self {
        let mut apex = Self::default();
        apex.set_form(form);
        apex
    }

    pub fn form(&self) -> Form {
        let [_, _, curvature, angle] = self.rest;
        Form { curvature, angle }
    }

    pub fn set_form(&mut self, Form { curvature, angle }: Form) {
        (self.rest[2], self.rest[3]) = (curvature, angle);
    }

    fn curvature(&self) -> f32 {
        self.rest[2]
    }

    /// Σ area of the faces around the point.
    pub fn weight(&self) -> f32 {
        self.mean[0]
    }

    /// Variance of the normals around the point.
    pub fn bend(&self) -> f64 {
        let [xx, _, _, yy, _, zz] = self.spread();
        if self.weight() > 0.0 { f64::from((xx + yy + zz) / self.weight()) } else { 0.0 }
    }

    /// Whether the normals around the point vary by more than that.
    #[inline]
    pub fn varies_by(&self, variance: f32) -> bool {
        self.spread[0] + self.spread[3] + self.rest[1] > variance * self.mean[0]
    }

    fn mean(&self) -> Vec3 {
        Vec3::new(self.mean[1], self.mean[2], self.mean[3])
    }

    /// xx, xy, xz, yy, yz, zz.
    fn spread(&self) -> [f32; 6] {
        let [xx, xy, xz, yy] = self.spread;
        [xx, xy, xz, yy, self.rest[0], self.rest[1]]
    }

    fn set_spread(&mut self, [xx, xy, xz, yy, yz, zz]: [f32; 6]) {
        self.spread = [xx, xy, xz, yy];
        (self.rest[0], self.rest[1]) = (yz, zz);
    }

    /// Takes the faces around the point.
    #[inline]
    pub fn set_faces(&mut self, position: DVec3, mut facets: impl Iterator<Item = Facet>) {
        let [x, y, z] = position.as_vec3().to_array();
        self.position = [x, y, z, 0.0];
        // Relative to the first normal, so that nothing cancels where all are alike.
        let Facet(first) = facets.next().unwrap_or_default();
        let (mut weight, mut sum, mut spread, mut rest) = (first.w, Vec4::ZERO, Vec4::ZERO, Vec4::ZERO);
        let mut add = |heavy: Vec4, off: Vec4| {
            spread += heavy.xxxy() * off.xyzy();
            rest += heavy.yzyz() * off.zzzz();
        };
        for Facet(facet) in facets {
            let off = facet - first;
            let heavy = off * facet.w;
            weight += facet.w;
            sum += heavy;
            add(heavy, off);
        }
        let shift = if weight > 0.0 { sum / weight } else { Vec4::ZERO };
        add(-sum, shift);
        let [x, y, z, _] = (first + shift).to_array();
        self.mean = [weight, x, y, z];
        self.spread = spread.to_array();
        (self.rest[0], self.rest[1]) = (rest.x, rest.y);
    }

    /// Adds a plane through the point, weighted by the square of its normal's length.
    pub fn add_plane(&mut self, normal: Vec3, weight: f32) {
        let mut spread = self.spread();
        add_product(&mut spread, normal * weight, normal);
        self.set_spread(spread);
    }

    /// Sum of the area vectors.
    fn normal(&self) -> Vec3 {
        self.mean() * self.weight()
    }

    fn value(&self, y: Vec3) -> f32 {
        let along = y.dot(self.mean());
        self.weight() * along * along + y.dot(multiply(&self.spread(), y))
    }

    fn matrix(&self) -> [f32; 6] {
        let mut matrix = self.spread();
        add_product(&mut matrix, self.normal(), self.mean());
        matrix
    }
}

/// Unit normal (xyz) and area (w) of a face; all zero where it has none.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Facet(pub Vec4);

impl Facet {
    /// Of the faces that have these two edges each, from one of their corners.
    #[inline]
    pub fn of_four(edges: [[Vec3; 2]; LANES]) -> [Self; LANES] {
        Four::new(gather(edges.map(|e| e[0])), gather(edges.map(|e| e[1]))).facets().map(Self)
    }

    /// Of unit length; zero without an area.
    pub fn normal(self) -> Vec3 {
        self.0.truncate()
    }

    /// Normal and area.
    pub fn parts(self) -> (Vec3, f32) {
        (self.normal(), self.0.w)
    }

    pub fn area(self) -> f32 {
        self.0.w
    }

    pub fn area_vector(self) -> Vec3 {
        self.normal() * self.0.w
    }
}

/// An edge and what is known of its ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Subject<'a> {
    pub ends: [&'a Apex; 2],
    /// From the first end to the second.
    pub edge: DVec3,
    /// Where the point has to go, as a share of the edge.
    pub pin: Option<f64>,
    /// How far it goes from the quadrics' minimum to the one that keeps the volume.
    pub volume_share: f32,
}

/// Where a point goes, relative to the edge's first end, and what it costs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub offset: DVec3,
    /// Area · distance².
    pub error: f64,
}

impl Subject<'_> {
    /// Finds the place. `shared`: sum of the area vectors of the faces at both ends; `of_attributes`: what they would have of the place, weighed
    /// against the shape; `fits`: whether a place is allowed.
    pub fn place(&self, shared: Vec3, of_attributes: Option<AttributeQuadric>, fits: impl Fn(DVec3) -> bool) -> Place {
        let at = |offset: DVec3| Place { offset, error: f64::from(self.error(offset.as_vec3())) };
        if let Some(share) = self.pin {
            return at(self.edge * share);
        }
        let of_shape = at(self.minimum(shared, None, &fits).unwrap_or_else(|| self.edge * self.best_share()));
        let wished = of_attributes.and_then(|quadric| self.minimum(shared, Some(quadric), &fits)).map(at);
        wished.filter(|wished| wished.error <= MOST_FOR_ATTRIBUTES * of_shape.error).unwrap_or(of_shape)
    }

    /// What it costs that the second end, or the first if `backwards`, goes to the other one, which stays: area · distance².
    pub fn error_of_end(&self, backwards: bool) -> f64 {
        let edge = self.edge.as_vec3();
        let goes = self.ends[usize::from(!backwards)];
        f64::from(goes.value(edge).max(0.0) + self.least())
    }

    /// How much an error counts here: more where the surface is curved, and where it bends between the ends.
    pub fn factor(&self, curvature_weight: f32) -> f64 {
        let [a, b] = self.ends;
        let [m, n] = [a.mean(), b.mean()].map(|mean| mean.to_array().map(f32x4::splat));
        let (curvature, square) = (a.curvature() + b.curvature(), self.edge.length_squared() as f32);
        let all = factor(m, n, f32x4::splat(curvature), f32x4::splat(square), curvature_weight);
        f64::from(all.to_array()[0])
    }

    /// The minimum near the edge, moved towards the one that keeps the volume, if that means something.
    fn minimum(
        &self,
        shared: Vec3,
        of_attributes: Option<AttributeQuadric>,
        fits: impl Fn(DVec3) -> bool,
    ) -> Option<DVec3> {
        let [a, b] = self.ends;
        let edge = self.edge.as_vec3();
        let (of_a, of_b) = (a.matrix(), b.matrix());
        let mut joint: [f32; 6] = std::array::from_fn(|i| of_a[i] + of_b[i]);
        let trace = joint[0] + joint[3] + joint[5];
        let mut right = multiply(&of_b, edge);
        if let Some(AttributeQuadric { matrix, right: wish }) = of_attributes {
            joint.iter_mut().zip(matrix).for_each(|(sum, of_attributes)| *sum += of_attributes);
            right += wish;
        }
        let pull = trace * STIFFNESS;
        let factors = Factors::of(&joint, pull);
        let middle = edge * 0.5;
        // Each step starts from the last one's result: powers of the pull's bias vanish wherever the surface decides. What a step leaves is the pull's
        // share of it.
        let first = factors.solve(right - multiply(&joint, middle));
        let second = factors.solve(first * pull);
        let free = middle + first + second + factors.solve(second * pull);
        let normal = a.normal() + b.normal() - shared;
        let direction = factors.solve(normal);
        let missing = b.normal().dot(edge) - normal.dot(free);
        let constrained = free + direction * (self.volume_share * missing / normal.dot(direction));

        let reach = REACH_SQUARED * edge.length_squared();
        let fits = |place: &DVec3| place.as_vec3().distance_squared(middle) < reach && fits(*place);
        let meaningful = normal.length_squared() > LEAST_NORMAL_SQUARED * trace * trace;
        let constrained = Some(constrained.as_dvec3()).filter(|place| meaningful && fits(place));
        constrained.or(Some(free.as_dvec3()).filter(fits))
    }

    /// Where no minimum is near, an end or the middle has to do: as a share of the edge.
    #[cold]
    fn best_share(&self) -> f64 {
        let [start, end, middle] = [0.0, 1.0, 0.5].map(|share| self.error((self.edge * share).as_vec3()));
        match (start <= end && start <= middle, end <= middle) {
            (true, _) => 0.0,
            (_, true) => 1.0,
            _ => 0.5,
        }
    }

    /// The quadrics' value, and the least that an edge of this length costs.
    fn error(&self, y: Vec3) -> f32 {
        let [a, b] = self.ends;
        (a.value(y) + b.value(y - self.edge.as_vec3())).max(0.0) + self.least()
    }

    /// The least that an edge of this length costs.
    pub fn least(&self) -> f32 {
        let [a, b] = self.ends;
        LENGTH_COST * (a.weight() + b.weight()) * self.edge.as_vec3().length_squared()
    }
}

/// How much an error counts between two mean normals, with the sum of the ends' curvatures.
#[inline]
fn factor(a: [f32x4; 3], b: [f32x4; 3], curvature: f32x4, length_squared: f32x4, curvature_weight: f32) -> f32x4 {
    let splat = f32x4::splat;
    let lengths = (dot(a, a) * dot(b, b)).sqrt();
    let cosine = dot(a, b) / lengths.fast_max(splat(f32::MIN_POSITIVE));
    // QFVP's factor with w = 1/8: an exponent that square roots give is the same on every machine.
    let angle = (splat(1.0 + FLAT_ANGLE) - cosine).fast_max(splat(0.0)).sqrt().sqrt().sqrt();
    let curvature = (splat(0.5) * curvature * length_squared).fast_min(splat(CURVATURE_CAP));
    (splat(1.0) + splat(curvature_weight * CURVATURE_SCALE) * curvature) * angle
}

/// How much the curvature lets an error count that reaches so far.
pub(super) fn emphasis(curvature: f64, length_squared: f64, curvature_weight: f32) -> f64 {
    1.0 + f64::from(curvature_weight * CURVATURE_SCALE) * (curvature * length_squared).min(f64::from(CURVATURE_CAP))
}

/// What the collapses of four edges cost about.
pub(super) struct Estimate {
    pub error: f32x4,
    /// How much it counts.
    pub factor: f32x4,
    /// From the first end to the second.
    pub edge: Vec3x4,
}

/// The least of both ends and of the best point above the middle of the edge, which is all that ranking needs. With `at_ends` the least of both ends
/// alone.
#[inline]
pub(super) fn estimate(a: &Lanes, b: &Lanes, curvature_weight: f32, at_ends: bool) -> Estimate {
    let splat = f32x4::splat;
    let edge = [0, 1, 2].map(|i| b.position[i] - a.position[i]);
    // A e = weight (m · e) m + spread e.
    let times_edge = |apex: &Lanes| {
        let [xx, xy, xz, yy, yz, zz] = apex.spread;
        let along = apex.weight * dot(apex.mean, edge);
        let spread = [dot([xx, xy, xz], edge), dot([xy, yy, yz], edge), dot([xz, yz, zz], edge)];
        let value = along * dot(apex.mean, edge) + dot(spread, edge);
        ([0, 1, 2].map(|i| along * apex.mean[i] + spread[i]), value)
    };
    let ((u, at_end), (v, at_start)) = (times_edge(a), times_edge(b));
    let length_squared = dot(edge, edge);
    let least = splat(LENGTH_COST) * (a.weight + b.weight) * length_squared;
    let error = if at_ends {
        let end = |error: f32x4, area: f32x4| {
            splat(SWEPT) * (error.fast_max(splat(0.0)) + least) / area.fast_max(splat(f32::MIN_POSITIVE)).sqrt()
        };
        end(at_start, b.weight).fast_min(end(at_end, a.weight))
    } else {
        let normal = [0, 1, 2].map(|i| a.weight * a.mean[i] + b.weight * b.mean[i]);
        let slope = dot(normal, [0, 1, 2].map(|i| u[i] - v[i]));
        let (na, nb) = (dot(normal, a.mean), dot(normal, b.mean));
        let [xx, xy, xz, yy, yz, zz] = std::array::from_fn(|i| a.spread[i] + b.spread[i]);
        let spread = dot(normal, [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]].map(|row| dot(row, normal)));
        let stiffness = (a.weight * na * na + b.weight * nb * nb + spread).fast_max(splat(f32::MIN_POSITIVE));
        let between = splat(0.25) * (at_start + at_end - slope * slope / stiffness);
        at_start.fast_min(at_end).fast_min(between).fast_max(splat(0.0)) + least
    };
    let factor = factor(a.mean, b.mean, a.curvature + b.curvature, length_squared, curvature_weight);
    Estimate { error, factor, edge }
}

/// What is known of four points, number by number.
pub(super) struct Lanes {
    weight: f32x4,
    mean: [f32x4; 3],
    spread: [f32x4; 6],
    curvature: f32x4,
    position: [f32x4; 3],
}

impl Lanes {
    #[inline]
    pub fn of(apexes: [&Apex; LANES]) -> Self {
        let numbers = |row: fn(&Apex) -> [f32; 4]| f32x4::transpose(apexes.map(|apex| f32x4::from(row(apex))));
        let [weight, mx, my, mz] = numbers(|apex| apex.mean);
        let [xx, xy, xz, yy] = numbers(|apex| apex.spread);
        let [yz, zz, curvature, _] = numbers(|apex| apex.rest);
        let [px, py, pz, _] = numbers(|apex| apex.position);
        Self { weight, mean: [mx, my, mz], spread: [xx, xy, xz, yy, yz, zz], curvature, position: [px, py, pz] }
    }

    /// One point four times.
    pub fn splat(apex: &Apex) -> Self {
        let three = |[_, x, y, z]: [f32; 4]| [x, y, z].map(f32x4::splat);
        let [x, y, z, _] = apex.position;
        Self {
            weight: f32x4::splat(apex.weight()),
            mean: three(apex.mean),
            spread: apex.spread().map(f32x4::splat),
            curvature: f32x4::splat(apex.curvature()),
            position: [x, y, z].map(f32x4::splat),
        }
    }
}

/// `L D Lᵀ` of a symmetric matrix: stable in single precision where a determinant is not.
struct Factors {
    lower: [f32; 3],
    inverse_diagonal: [f32; 3],
}

impl Factors {
    /// Of `matrix + pull · I`.
    fn of([xx, xy, xz, yy, yz, zz]: &[f32; 6], pull: f32) -> Self {
        let first = 1.0 / (xx + pull);
        let (l10, l20) = (xy * first, xz * first);
        // Rounding may eat what is left of a singular matrix, but not the pull.
        let second = 1.0 / (yy + pull - l10 * xy).max(pull);
        let cross = yz - l20 * xy;
        let l21 = cross * second;
        let third = 1.0 / (zz + pull - l20 * xz - l21 * cross).max(pull);
        Self { lower: [l10, l20, l21], inverse_diagonal: [first, second, third] }
    }

    fn solve(&self, right: Vec3) -> Vec3 {
        let [l10, l20, l21] = self.lower;
        let [first, second, third] = self.inverse_diagonal;
        let v = right.y - l10 * right.x;
        let w = right.z - l20 * right.x - l21 * v;
        let z = w * third;
        let y = v * second - l21 * z;
        Vec3::new(right.x * first - l10 * y - l20 * z, y, z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat3;

    fn apex(position: DVec3, triangles: &[[DVec3; 3]]) -> Apex {
        let mut apex = Apex::default();
        apex.set_faces(position, triangles.iter().map(|&t| facet_of(&t)));
        apex
    }

    fn facet_of(&[a, b, c]: &[DVec3; 3]) -> Facet {
        Facet::of_four([[(b - a).as_vec3(), (c - a).as_vec3()]; LANES])[0]
    }

    /// The quadric by its definition.
    fn value(position: DVec3, triangles: &[[DVec3; 3]], x: DVec3) -> f64 {
        let square = |[a, b, c]: &[DVec3; 3]| {
            let cross = (b - a).cross(c - a);
            0.5 * cross.length() * cross.normalize().dot(x - position).powi(2)
        };
        triangles.iter().map(square).sum()
    }

    const A: DVec3 = DVec3::new(0.1, 0.2, 0.0);
    const B: DVec3 = DVec3::new(1.0, 0.1, 0.2);

    /// Two tents that share the edge A–B.
    fn tents() -> [Vec<[DVec3; 3]>; 2] {
        let (up, down) = (DVec3::new(0.4, 1.0, -0.4), DVec3::new(0.6, -1.0, -0.5));
        let (left, right) = (DVec3::new(-1.0, 0.0, -0.6), DVec3::new(2.0, 0.3, -0.3));
        let shared = [[A, B, up], [B, A, down]];
        let around = |p, far| vec![shared[0], shared[1], [p, up, far], [p, far, down]];
        let [a, mut b] = [around(A, left), around(B, right)];
        b[2..].iter_mut().for_each(|t| t.swap(1, 2));
        [a, b]
    }

    #[test]
    fn the_split_quadric_is_the_sum_over_its_planes() {
        let [faces, _] = tents();
        let apex = apex(A, &faces);
        for x in [DVec3::ZERO, B, DVec3::new(0.3, -0.7, 2.0)] {
            let (found, expected) = (f64::from(apex.value((x - A).as_vec3())), value(A, &faces, x));
            assert!((found - expected).abs() < 1e-5 * expected.max(1e-3), "{found} {expected}");
        }
    }

    #[test]
    fn a_tilted_plane_costs_nothing_along_itself() {
        let (u, v) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(-2.0, 0.5, 1.0));
        let apex = apex(A, &[[A, A + u, A + v], [A, A + v, A - u], [A, A - u, A - v]]);
        assert!(apex.value((u * 3.0 - v).as_vec3()) < 1e-10);
    }

    #[test]
    fn the_place_keeps_the_volume_or_goes_half_of_the_way_there() {
        let [fa, fb] = tents();
        let (a, b) = (apex(A, &fa), apex(B, &fb));
        let shared: Vec3 = fa[..2].iter().map(|&t| facet_of(&t).area_vector()).sum();
        let place = |volume_share| {
            let subject = Subject { ends: [&a, &b], edge: B - A, pin: None, volume_share };
            A + subject.place(shared, None, |_| true).offset
        };
        let gained = |x: DVec3| -> f64 {
            let moved = |p: DVec3| if p == A || p == B { x } else { p };
            let all = fa.iter().chain(&fb[2..]);
            all.map(|&[a, b, c]| moved(a).dot(moved(b).cross(moved(c))) - a.dot(b.cross(c))).sum()
        };
        let [xx, xy, xz, yy, yz, zz] = std::array::from_fn(|i| a.matrix()[i] + b.matrix()[i]);
        let joint = Mat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
        let free = A + (joint.inverse() * multiply(&b.matrix(), (B - A).as_vec3())).as_dvec3();
        assert!(gained(place(1.0)).abs() < 1e-5, "{}", gained(place(1.0)));
        assert!(gained(free).abs() > 0.1, "{}", gained(free));
        let half = gained(place(0.5));
        assert!((half / gained(free) - 0.5).abs() < 1e-3, "{half} {}", gained(free));
    }

    #[test]
    fn an_estimate_is_about_what_the_place_costs() {
        let [fa, fb] = tents();
        let (a, b) = (apex(A, &fa), apex(B, &fb));
        let subject = Subject { ends: [&a, &b], edge: B - A, pin: None, volume_share: 0.5 };
        let shared: Vec3 = fa[..2].iter().map(|&t| facet_of(&t).area_vector()).sum();
        let exact = subject.place(shared, None, |_| true).error * subject.factor(1.0);
        let Estimate { error, factor, .. } = estimate(&Lanes::splat(&a), &Lanes::of([&b; LANES]), 1.0, false);
        for estimate in (error * factor).to_array() {
            assert!((0.5..2.0).contains(&(f64::from(estimate) / exact)), "{estimate} {exact}");
        }
    }

    #[test]
    fn attributes_move_a_place_only_where_the_shape_does_not_mind() {
        // A roof along x, of this height: flat, or with a ridge on which both ends are.
        let place = |height: f64| {
            let (a, b) = (DVec3::ZERO, DVec3::X);
            let eaves = |y: f64| [DVec3::new(-1.0, y, -height), DVec3::new(2.0, y, -height)];
            let around = |p: DVec3| [1.0, -1.0].map(eaves).map(|[from, to]| [p, from, to]);
            let [at_a, at_b] = [a, b].map(|p| apex(p, &around(p)));
            let subject = Subject { ends: [&at_a, &at_b], edge: b - a, pin: None, volume_share: 1.0 };
            let wish = Vec3::new(0.4, 0.2, 0.0);
            let quadric = AttributeQuadric { matrix: [1.0, 0.0, 0.0, 1.0, 0.0, 1.0], right: wish };
            subject.place(Vec3::ZERO, Some(quadric), |_| true).offset.distance(wish.as_dvec3())
        };
        assert!(place(0.0) < 1e-3, "{}", place(0.0));
        assert!(place(1.0) > 0.19, "{}", place(1.0));
    }

    #[test]
    fn a_pinned_point_stays_at_its_end() {
        let [fa, fb] = tents();
        let (a, b) = (apex(A, &fa), apex(B, &fb));
        let place = |pin| {
            Subject { ends: [&a, &b], edge: B - A, pin: Some(pin), volume_share: 1.0 }.place(Vec3::ZERO, None, |_| true)
        };
        assert_eq!(place(0.0).offset, DVec3::ZERO);
        assert_eq!(place(1.0).offset, B - A);
    }
}
