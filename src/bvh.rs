//! Closest points on a set of triangles, exactly, through a bounding-volume hierarchy.
//!
//! Build: the centroids halved along their longest axis, and both halves once more, down to single triangles: four
//! children a node, whose boxes are looked at together; O(n log n). Query: near child first with a running bound.
//!
//! Exactness: triangles are tested in f64 on the positions as given. Boxes only decide what may be skipped: they are
//! f32 in a frame of the tree's own (centred, scaled by a power of two into the unit cube) and every rounding there
//! widens them, so neither a far origin nor a huge or tiny scale costs accuracy or speed.
//!
//! Limits: the distance to a triangle a billion times longer than high is good to about 1e-8 of its length.

use crate::lanes::{Boxes, LANES, Vec3x4, enclose};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use wide::f32x4;

/// Traversal keeps at most three postponed children a level, and 2³¹ triangles are 16 levels deep.
const STACK: usize = 64;

/// Points that one task handles in turn. Fixed, so that nothing depends on the threads.
const TASK: usize = 512;

/// Covers the rounding of an f32 box distance (a dozen operations of 6e-8 each).
const BOX_SLACK: f32 = 1.0 + 2e-6;

/// A closest-point structure over triangles; owns a copy of their corners.
#[derive(Debug, Clone)]
pub struct Bvh {
    nodes: Vec<Node>,
    /// In leaf order.
    corners: Vec<[[f32; 3]; 3]>,
    /// Index, in the order given, of the triangle in each slot of `corners`.
    ids: Vec<u32>,
    centre: DVec3,
    scale: f64,
}

/// A point of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Squared distance to the query point.
    pub distance_squared: f64,
    /// Index of the triangle, in the order given.
    pub triangle: u32,
    /// The closest point.
    pub point: DVec3,
    /// Weights of the triangle's corners at that point: ≥ 0, sum 1.
    pub barycentric: [f64; 3],
    slot: u32,
}

/// Up to four children.
#[derive(Debug, Clone, Copy)]
struct Node {
    boxes: Boxes,
    links: [Link; LANES],
}

/// Where a child is: a node, or the slot of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Link(u32);

impl Link {
    const TRIANGLE: u32 = 1 << 31;
    const ROOT: Self = Self(0);

    fn to_slot(slot: u32) -> Self {
        Self(slot | Self::TRIANGLE)
    }

    fn slot(self) -> Option<u32> {
        (self.0 & Self::TRIANGLE != 0).then_some(self.0 & !Self::TRIANGLE)
    }
}

/// The query point in the tree's frame, as the smallest f32 box around it, once for each lane.
type Probe = [Vec3x4; 2];

impl Bvh {
    /// Builds the tree. Degenerate triangles count as the segments or points that they are.
    ///
    /// # Panics
    /// When an index is out of range. Positions must be finite.
    pub fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Self {
        let corner = |v: u32| positions[v as usize];
        let corners = |t: u32| triangles[t as usize].map(corner);
        let (centre, scale) = unit_frame(triangles.iter().flatten().map(|&v| corner(v)));
        let mut centroids: Vec<Item> = (0..triangles.len() as u32)
            .map(|t| {
                let sum: DVec3 = corners(t).iter().map(|&p| wide(p)).sum();
                (((sum / 3.0 - centre) * scale).as_vec3(), t)
            })
            .collect();
        let mut nodes = Vec::with_capacity(triangles.len() / 2);
        if !centroids.is_empty() {
            let bounds = |t: u32| bound(corners(t).map(|p| (wide(p) - centre) * scale));
            build(&mut nodes, &mut centroids, 0, &bounds);
        }
        let ids: Vec<u32> = centroids.iter().map(|&(_, t)| t).collect();
        Self { nodes, corners: ids.iter().map(|&t| corners(t)).collect(), ids, centre, scale }
    }

    /// The point closest to `point` among those at most `limit` away (`f64::INFINITY`: any), `None` if there is none.
    /// Equally close triangles: the one with the lowest index.
    pub fn closest(&self, point: DVec3, limit: f64) -> Option<Hit> {
        self.search(point, limit * limit, -1.0, None)
    }

    /// [`Bvh::closest`] of each of `points`, without a limit; none if there are no triangles. Fast where points that follow each other are near each
    /// other.
    pub fn closest_to_each(&self, points: &[DVec3]) -> Vec<Hit> {
        points.par_chunks(TASK).flat_map_iter(|task| self.follow(task)).collect()
    }

    fn follow(&self, points: &[DVec3]) -> Vec<Hit> {
        let mut last = None;
        let closest = |&point: &DVec3| {
            last = self.search(point, f64::INFINITY, -1.0, last.as_ref());
            last
        };
        points.iter().filter_map(closest).collect()
    }

    /// The closest point, or some point at most `distance` away if there is one: much cheaper than [`Bvh::closest`] where there is, as there mostly is
    /// in the search for a maximum. Faster when `hint` was the answer for a point nearby.
    pub fn closest_or_within(&self, point: DVec3, distance: f64, hint: Option<&Hit>) -> Option<Hit> {
        self.search(point, f64::INFINITY, distance * distance, hint)
    }

    /// The closest point if it is farther than `distance`, else `None`.
    pub fn closest_beyond(&self, point: DVec3, distance: f64) -> Option<Hit> {
        self.closest_or_within(point, distance, None).filter(|hit| hit.distance_squared > distance * distance)
    }

    /// The largest of `known` and the distances of `points`: much cheaper than all of these, as most are no larger than what is known.
    pub fn largest_distance(&self, points: &[DVec3], known: f64) -> f64 {
        let raise = |task: &[DVec3]| {
            let (mut largest, mut last) = (known, None);
            for &point in task {
                last = self.closest_or_within(point, largest, last.as_ref());
                largest = last.as_ref().map_or(largest, |hit| hit.distance().max(largest));
            }
            largest
        };
        points.par_chunks(TASK).map(raise).reduce(|| known, f64::max)
    }

    /// The triangles in an order in which neighbours are mostly near each other.
    pub fn spatial_order(&self) -> &[u32] {
        &self.ids
    }

    /// Where a point is relative to the triangles, which lie within [-1, 1]³.
    pub fn to_unit_frame(&self, point: DVec3) -> Vec3 {
        (self.local(point) * 2.0).as_vec3()
    }

    /// Calls `visit` with the closest point of every triangle at most `radius` away, in no useful but a fixed order.
    pub fn visit_within(&self, point: DVec3, radius: f64, mut visit: impl FnMut(Hit)) {
        let radius_squared = radius * radius;
        let probe = self.probe(point);
        let reach = self.box_bound(radius_squared);
        let mut stack = [Link::ROOT; STACK];
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            match stack[depth].slot() {
                Some(slot) => self.hit(slot, point, radius_squared).into_iter().for_each(&mut visit),
                None => {
                    for (_, link) in self.nodes[stack[depth].0 as usize].within(probe, reach) {
                        stack[depth] = link;
                        depth += 1;
                    }
                }
            }
        }
    }

    /// The closest point within `limit` (squared); any point within `enough` (squared) ends the search early.
    fn search(&self, point: DVec3, limit: f64, enough: f64, hint: Option<&Hit>) -> Option<Hit> {
        let mut best = hint.and_then(|hint| self.hit(hint.slot, point, limit));
        let mut bound = best.as_ref().map_or(limit, |hit| hit.distance_squared);
        if self.nodes.is_empty() || bound <= enough {
            return best;
        }
        let probe = self.probe(point);
        let mut reach = self.box_bound(bound);
        // The nearest of a node's children is on top of the others.
        let mut stack = [(0f32, Link::ROOT); STACK];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (distance, link) = stack[depth];
            if distance > reach {
                continue;
            }
            let Some(slot) = link.slot() else {
                let first = depth;
                for child in self.nodes[link.0 as usize].within(probe, reach) {
                    let mut place = depth;
                    while place > first && stack[place - 1].0 < child.0 {
                        stack[place] = stack[place - 1];
                        place -= 1;
                    }
                    stack[place] = child;
                    depth += 1;
                }
                continue;
            };
            if let Some(hit) = self.hit(slot, point, bound)
                && best.as_ref().is_none_or(|best| hit.precedes(best))
            {
                bound = hit.distance_squared;
                best = Some(hit);
                if bound <= enough {
                    return best;
                }
                reach = self.box_bound(bound);
            }
        }
        best
    }

    /// The closest point of the triangle in `slot`, if its squared distance is at most `bound`.
    fn hit(&self, slot: u32, point: DVec3, bound: f64) -> Option<Hit> {
        let [a, b, c] = self.corners[slot as usize].map(|corner| wide(corner) - point);
        let (offset, barycentric) = closest_to_origin(a, b, c, bound)?;
        let distance_squared = offset.length_squared();
        (distance_squared <= bound).then(|| Hit {
            distance_squared,
            triangle: self.ids[slot as usize],
            point: point + offset,
            barycentric,
            slot,
        })
    }

    /// In the tree's frame.
    fn local(&self, point: DVec3) -> DVec3 {
        (point - self.centre) * self.scale
    }

    /// Clamped to a box that still contains the whole tree: that brings no point closer to the tree than it is to the
    /// clamped point, and nothing overflows.
    fn probe(&self, point: DVec3) -> Probe {
        let local = self.local(point).clamp(DVec3::splat(-1e12), DVec3::splat(1e12));
        bound([local]).map(|corner| corner.to_array().map(f32x4::splat))
    }

    /// What a box distance in the tree's frame must exceed to prove a squared distance greater than `squared`. Finite: no box is infinitely far.
    fn box_bound(&self, squared: f64) -> f32 {
        ((squared * self.scale * self.scale) as f32 * BOX_SLACK + f32::MIN_POSITIVE).min(f32::MAX)
    }
}

impl Hit {
    /// The distance to the query point.
    pub fn distance(&self) -> f64 {
        self.distance_squared.sqrt()
    }

    /// Closer, or as close with a lower index.
    pub fn precedes(&self, other: &Hit) -> bool {
        (self.distance_squared, self.triangle) < (other.distance_squared, other.triangle)
    }
}

impl Node {
    /// The children whose boxes are within reach, with their squared distances: never more than those between the point and anything in the box, but
    /// for [`BOX_SLACK`].
    #[inline]
    fn within(&self, probe: Probe, reach: f32) -> impl Iterator<Item = (f32, Link)> {
        let distances = self.boxes.distance_squared(probe).to_array();
        distances.into_iter().zip(self.links).filter(move |(distance, _)| *distance <= reach)
    }
}

/// The centroid of a triangle, and which one it is.
type Item = (Vec3, u32);

/// Adds the subtree of `items` to `nodes` and sorts `items` into leaf order; `first` is the slot of the first item. Gives the box around it.
fn build(nodes: &mut Vec<Node>, items: &mut [Item], first: u32, bounds: &impl Fn(u32) -> [Vec3; 2]) -> [Vec3; 2] {
    let index = nodes.len();
    nodes.push(Node { boxes: Boxes::new(&[]), links: [Link::ROOT; LANES] });
    let (mut boxes, mut links, mut slot) = (Vec::with_capacity(LANES), [Link::ROOT; LANES], first);
    let (low, high) = halve(items);
    for quarter in [low, high].into_iter().map(halve).flat_map(|(low, high)| [low, high]) {
        let link = match quarter {
            [] => continue,
            [(_, triangle)] => {
                boxes.push(bounds(*triangle));
                Link::to_slot(slot)
            }
            _ => {
                let link = Link(nodes.len() as u32);
                boxes.push(build(nodes, quarter, slot, bounds));
                link
            }
        };
        links[boxes.len() - 1] = link;
        slot += quarter.len() as u32;
    }
    nodes[index] = Node { boxes: Boxes::new(&boxes), links };
    enclose(boxes.into_iter().flatten())
}

/// Two halves, the lower one along the longest axis of the centroids first; of two, which is which does not matter.
fn halve(items: &mut [Item]) -> (&mut [Item], &mut [Item]) {
    let middle = items.len() / 2;
    if items.len() > 2 {
        let [lo, hi] = enclose(items.iter().map(|(centroid, _)| *centroid));
        let axis = (hi - lo).max_position();
        items.select_nth_unstable_by(middle, |(a, i), (b, j)| a[axis].total_cmp(&b[axis]).then(i.cmp(j)));
    }
    items.split_at_mut(middle)
}

/// The smallest f32 box that surely holds the points.
fn bound<const N: usize>(points: [DVec3; N]) -> [Vec3; 2] {
    let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let out = |corner: DVec3, next: fn(f32) -> f32| Vec3::from(corner.as_vec3().to_array().map(next));
    [out(low, f32::next_down), out(high, f32::next_up)]
}

/// Centre and scale (a power of two: exact) that bring `positions` into the unit cube.
fn unit_frame(positions: impl Iterator<Item = [f32; 3]>) -> (DVec3, f64) {
    let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (lo, hi) = positions.map(wide).fold(start, |(lo, hi), p| (lo.min(p), hi.max(p)));
    let extent = (hi - lo).max_element();
    if extent > 0.0 { ((lo + hi) / 2.0, (-extent.log2().ceil()).exp2()) } else { (lo.min(hi), 1.0) }
}

fn wide(p: [f32; 3]) -> DVec3 {
    DVec3::from(p.map(f64::from))
}

/// The point of triangle `abc` closest to the origin and its barycentric weights; may give up (`None`) where the
/// squared distance exceeds `bound`.
///
/// The weights come from triple products with the normal: on needles they lose digits with the ratio of height to
/// length, not with its square as the usual products of dot products do.
fn closest_to_origin(a: DVec3, b: DVec3, c: DVec3, bound: f64) -> Option<(DVec3, [f64; 3])> {
    let (ab, bc, ca) = (b - a, c - b, a - c);
    let normal = ab.cross(-ca);
    let area = normal.length_squared();
    let height = normal.dot(a);
    // The slack keeps ties between triangles that share the closest point.
    if height * height > area * bound * (1.0 + 1e-9) {
        return None;
    }
    let weights = [normal.dot(b.cross(bc)), normal.dot(c.cross(ca)), normal.dot(a.cross(ab))];
    if area > 0.0 && weights.iter().all(|&w| w >= 0.0) {
        let sum = weights[0] + weights[1] + weights[2];
        let [_, v, w] = weights.map(|weight| weight / sum);
        return Some((a + ab * v - ca * w, [(1.0 - v - w).max(0.0), v, w]));
    }
    // Outside, the closest point lies on an edge that the point sees from outside; without area, on any edge.
    let mut best: Option<(f64, DVec3, [f64; 3])> = None;
    for (edge, (from, along)) in [(b, bc), (c, ca), (a, ab)].into_iter().enumerate() {
        if area > 0.0 && weights[edge] > 0.0 {
            continue;
        }
        let length = along.length_squared();
        let t = if length > 0.0 { (-from.dot(along) / length).clamp(0.0, 1.0) } else { 0.0 };
        let point = from + along * t;
        let distance = point.length_squared();
        if best.is_none_or(|(d, ..)| distance < d) {
            let mut barycentric = [0.0; 3];
            barycentric[(edge + 1) % 3] = 1.0 - t;
            barycentric[(edge + 2) % 3] = t;
            best = Some((distance, point, barycentric));
        }
    }
    best.map(|(_, point, barycentric)| (point, barycentric))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn brute_force(positions: &[[f32; 3]], triangles: &[[u32; 3]], point: DVec3) -> Option<(f64, u32)> {
        let distance = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| wide(positions[v as usize]) - point);
            closest_to_origin(a, b, c, f64::INFINITY).unwrap().0.length_squared()
        };
        (0..).zip(triangles).map(|(i, t)| (distance(t), i)).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// The closest point by bisection of the triangle's edge parameters: slow, simple, independent.
    fn distance_by_refinement(corners: [DVec3; 3]) -> f64 {
        let nearest_on = |f: &dyn Fn(f64) -> f64| {
            let (mut lo, mut hi) = (0.0, 1.0);
            for _ in 0..200 {
                let (l, r) = (lo + (hi - lo) / 3.0, hi - (hi - lo) / 3.0);
                if f(l) < f(r) { hi = r } else { lo = l }
            }
            f((lo + hi) / 2.0)
        };
        let [a, b, c] = corners;
        nearest_on(&|s| {
            let (p, q) = (a.lerp(b, s), a.lerp(c, s));
            nearest_on(&|t| p.lerp(q, t).length_squared())
        })
        .sqrt()
    }

    const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

    #[test]
    fn finds_face_edge_and_corner() {
        let bvh = Bvh::new(&SQUARE, &[[0, 1, 2], [0, 2, 3]]);
        let face = bvh.closest(DVec3::new(0.75, 0.25, 2.0), f64::INFINITY).unwrap();
        assert_eq!((face.distance_squared, face.triangle), (4.0, 0));
        assert_eq!(face.point, DVec3::new(0.75, 0.25, 0.0));
        assert_eq!(face.barycentric, [0.25, 0.5, 0.25]);
        let edge = bvh.closest(DVec3::new(-3.0, 0.5, 4.0), f64::INFINITY).unwrap();
        assert_eq!((edge.distance(), edge.triangle), (5.0, 1));
        let corner = bvh.closest(DVec3::new(3.0, 2.0, 2.0), f64::INFINITY).unwrap();
        assert_eq!((corner.distance(), corner.triangle, corner.barycentric), (3.0, 0, [0.0, 0.0, 1.0]));
    }

    #[test]
    fn limits_are_inclusive() {
        let bvh = Bvh::new(&SQUARE, &[[0, 1, 2]]);
        let point = DVec3::new(0.5, 0.25, 2.0);
        assert!(bvh.closest(point, 2.0).is_some());
        assert!(bvh.closest(point, 1.99).is_none());
        assert!(bvh.closest_beyond(point, 1.99).is_some());
        assert!(bvh.closest_beyond(point, 2.0).is_none());
    }

    #[test]
    fn equal_distances_go_to_the_lowest_index() {
        let bvh = Bvh::new(&SQUARE, &[[0, 1, 2]; 40]);
        let hit = bvh.closest(DVec3::new(0.9, 0.1, 1.0), f64::INFINITY).unwrap();
        assert_eq!(hit.triangle, 0);
        let last = Hit { slot: bvh.ids.iter().position(|&t| t == 39).unwrap() as u32, ..hit };
        assert_eq!(bvh.search(DVec3::new(0.9, 0.1, 1.0), f64::INFINITY, -1.0, Some(&last)).unwrap().triangle, 0);
    }

    #[test]
    fn an_empty_tree_has_no_closest_point() {
        assert!(Bvh::new(&[], &[]).closest(DVec3::ZERO, f64::INFINITY).is_none());
    }

    #[test]
    fn points_and_segments_count() {
        let bvh = Bvh::new(&SQUARE, &[[2, 2, 2], [0, 1, 0]]);
        assert_eq!(bvh.closest(DVec3::new(1.0, 3.0, 0.0), f64::INFINITY).unwrap().distance(), 2.0);
        assert_eq!(bvh.closest(DVec3::new(0.5, -3.0, 4.0), f64::INFINITY).unwrap().distance(), 5.0);
    }

    /// Bits lost far from the origin must not show up as a distance.
    #[test]
    fn far_from_the_origin_the_distance_stays_exact() {
        let positions = SQUARE.map(|[x, y, z]| [x + 1.0e6, y - 2.0e6, z]);
        let bvh = Bvh::new(&positions, &[[0, 1, 2], [0, 2, 3]]);
        let hit = bvh.closest(DVec3::new(1.0e6 + 0.1, -2.0e6 + 0.3, 1e-9), f64::INFINITY).unwrap();
        assert_eq!(hit.distance(), 1e-9);
    }

    fn coordinate() -> impl Strategy<Value = f32> {
        prop_oneof![4 => -1.0f32..1.0, 1 => (-4i8..4).prop_map(|i| f32::from(i) / 4.0)]
    }

    prop_compose! {
        fn soup()(
            positions in prop::collection::vec(prop::array::uniform3(coordinate()), 1..60),
            picks in prop::collection::vec(prop::array::uniform3(any::<u32>()), 1..120),
        ) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
            let count = positions.len() as u32;
            (positions, picks.into_iter().map(|t| t.map(|v| v % count)).collect())
        }
    }

    proptest! {
        #[test]
        fn agrees_with_brute_force(
            (positions, triangles) in soup(),
            points in prop::collection::vec(prop::array::uniform3(-3.0f64..3.0), 1..20),
            exponent in -110i32..110,
            shift in prop::array::uniform3(-1e3f32..1e3),
        ) {
            let scale = 2f32.powi(exponent);
            let positions: Vec<_> =
                positions.iter().map(|p| [0, 1, 2].map(|i| (p[i] + shift[i]) * scale)).collect();
            let bvh = Bvh::new(&positions, &triangles);
            let points: Vec<DVec3> =
                points.into_iter().map(|p| (DVec3::from(p) + wide(shift)) * f64::from(scale)).collect();
            let hits: Vec<Hit> = points.iter().map(|&p| bvh.closest(p, f64::INFINITY).unwrap()).collect();
            prop_assert_eq!(&bvh.closest_to_each(&points), &hits);
            let mut hint = None;
            for (point, hit) in points.into_iter().zip(hits) {
                let (distance, triangle) = brute_force(&positions, &triangles, point).unwrap();
                prop_assert_eq!((hit.distance_squared, hit.triangle), (distance, triangle));
                let near_enough = bvh.closest_or_within(point, hit.distance() * 1.001, hint.as_ref()).unwrap();
                prop_assert!(near_enough.distance() <= hit.distance() * 1.001);
                prop_assert_eq!(Some(hit), bvh.closest_or_within(point, hit.distance() * 0.999, hint.as_ref()));

                let mut within = Vec::new();
                bvh.visit_within(point, hit.distance() * 1.5, |h| within.push(h.triangle));
                within.sort_unstable();
                let limit = (hit.distance() * 1.5).powi(2);
                let expected: Vec<u32> = (0..triangles.len() as u32)
                    .filter(|&t| {
                        let one = [triangles[t as usize]];
                        brute_force(&positions, &one, point).unwrap().0 <= limit
                    })
                    .collect();
                prop_assert_eq!(within, expected);
                hint = Some(hit);
            }
        }

        #[test]
        fn triangle_distance_is_the_minimum(corners in prop::array::uniform3(prop::array::uniform3(coordinate()))) {
            let corners = corners.map(wide);
            let [a, b, c] = corners;
            let (point, weights) = closest_to_origin(a, b, c, f64::INFINITY).unwrap();
            prop_assert!((point.length() - distance_by_refinement(corners)).abs() < 1e-6);
            prop_assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            prop_assert!((a * weights[0] + b * weights[1] + c * weights[2]).distance(point) < 1e-12);
        }
    }
}
