//! Each paper's cost, equation by equation, on a square pyramid without a floor: apex (0, 0, 1), corners (±1, ±1, 0).
//!
//! Its faces have the normals (±1, 0, 1)/√2 and (0, ±1, 1)/√2 and the area √2; a slope is √3 long.

use super::cost::{Candidate, Cost};
use super::deviation::Deviation;
use super::fms::Fms;
use super::melax::Melax;
use super::paper::Paper;
use super::qfvp::Qfvp;
use super::reducer::Reducer;
use super::{
    Algorithm, AttributeWeights, EdgePolicy, Effort, FeatureWeight, NormalUpdate, Options, Target, passes, queue,
    queue::Rank, simplify, vertices,
};
use crate::attributes::{AttributeQuadric, Metric, facet, multiply};
use crate::curvature::{Curvature, border_points};
use crate::mesh::edges::{Edge, collect_edges};
use crate::mesh::surface::Surface;
use crate::mesh::surgery::pair_wedges;
use crate::mesh::{Attribute, Mesh, Semantic};
use glam::DVec3;
use std::f64::consts::PI;

/// The points in the order of the surface: apex, then corners.
const APEX: u32 = 0;
const CORNER: u32 = 2;

fn pyramid() -> (Surface, Vec<Edge>) {
    let mesh = Mesh {
        positions: vec![[0.0, 0.0, 1.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]],
        triangles: vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]],
        ..Mesh::default()
    };
    let mut surface = Surface::new(&mesh);
    // Undo the frame, so that the numbers here are those of the comments.
    for (point, position) in surface.points.iter_mut().zip(&mesh.positions) {
        *point = DVec3::from(position.map(f64::from));
    }
    let edges = collect_edges(&surface);
    (surface, edges)
}

/// Geometry alone, as in the papers.
fn bare() -> Options {
    Options { border: EdgePolicy::Free, ..Options::default() }
}

fn middle(surface: &Surface) -> DVec3 {
    (surface.points[APEX as usize] + surface.points[CORNER as usize]) * 0.5
}

fn assert_near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-10 * expected.abs().max(1.0), "{found}, expected {expected}");
}

/// Cost of joining apex and corner at `position`.
fn cost_at(cost: &dyn Cost, surface: &Surface, position: DVec3) -> f64 {
    cost.judge(surface, APEX, CORNER, Some(position)).expect("finite").cost
}

#[test]
fn curvature_is_the_angle_deficit_inside_and_on_the_border() {
    let (surface, edges) = pyramid();
    let border = border_points(surface.points.len(), &edges);
    let at = |p: u32| Curvature::at(&surface, p, border[p as usize]);
    // ESQEM eq. 8: four angles of acos(1/3) at the apex, whose faces have 4√2; eq. 9: two of acos(1/√3) at a corner, 2√2.
    let (inside, rim) = (at(APEX), at(CORNER));
    assert_near(inside.area, 4.0 * 2f64.sqrt());
    assert_near(inside.gauss, (2.0 * PI - 4.0 * (1.0 / 3f64).acos()) / (4.0 * 2f64.sqrt() / 3.0));
    assert_near(rim.gauss, (PI - 2.0 * (1.0 / 3f64.sqrt()).acos()) / (2.0 * 2f64.sqrt() / 3.0));
    // Eq. 10, 11: weighted by areas, 2 to 1.
    assert_near(Curvature::of_edge(inside, rim), (2.0 * inside.gauss.abs() + rim.gauss.abs()) / 3.0);
}

#[test]
fn qem_sums_squared_distances_to_planes() {
    let (surface, edges) = pyramid();
    let mut qem = Paper::qem(&surface, &edges, &bare());
    qem.refresh(&surface, &edges);
    // The apex lies on all planes; the midpoint 1/√2 off two of the apex's four; the corner √2 off both.
    assert_near(cost_at(&qem, &surface, surface.points[APEX as usize]), 0.0);
    assert_near(cost_at(&qem, &surface, middle(&surface)), 1.0);
    assert_near(cost_at(&qem, &surface, surface.points[CORNER as usize]), 4.0);
    let best = qem.judge(&surface, APEX, CORNER, None).expect("finite");
    assert!(best.position.distance(surface.points[APEX as usize]) < 1e-10, "the planes meet there (eq. 7)");
    // Eq. 5: quadrics add up. All six planes of a corner and the joined point, the front and right ones thrice.
    qem.merged(&surface, APEX, CORNER);
    let joined = qem.judge(&surface, APEX, 1, Some(middle(&surface))).expect("finite").cost;
    assert_near(joined, 0.5 * 1.0 + 0.5 * 2.0);
}

#[test]
fn esqem_adds_curvature_two_orders_below_the_quadrics() {
    let (surface, edges) = pyramid();
    // All planes of the pyramid meet in its apex; those on the border are what costs something.
    let options = Options::default();
    let [mut qem, mut esqem] = [Paper::qem(&surface, &edges, &options), Paper::esqem(&surface, &edges, &options)];
    qem.refresh(&surface, &edges);
    esqem.refresh(&surface, &edges);
    let border = border_points(surface.points.len(), &edges);
    let of_edge = |e: &Edge| {
        let [a, b] = [e.a, e.b].map(|p| Curvature::at(&surface, p, border[p as usize]));
        Curvature::of_edge(a, b)
    };
    let quadric = |e: &Edge| qem.judge(&surface, e.a, e.b, None).expect("finite").cost;
    // Eq. 13 with a = 0.01, eq. 12.
    let omega = 0.01 * edges.iter().map(quadric).sum::<f64>() / edges.iter().map(of_edge).sum::<f64>();
    assert!(omega > 0.0);
    for e in &edges {
        assert_near(esqem.judge(&surface, e.a, e.b, None).expect("finite").cost, quadric(e) + omega * of_edge(e));
    }
}

#[test]
fn qfvp_multiplies_by_a_power_of_the_angle_between_normals() {
    let (surface, edges) = pyramid();
    // Eq. 8: the normal of the apex is upright, that of a corner (1, -1, 2)/√6. Eq. 4.
    let f = 1.0 - 2.0 / 6f64.sqrt();
    for w in [0.0, 0.5, 1.0, 1.3, 1.5, 2.0] {
        let mut qfvp = Qfvp::new(&surface, &edges, &Options { qfvp_w: FeatureWeight::Fixed(w), ..bare() });
        qfvp.refresh(&surface, &edges);
        // Eq. 6; the quadric error is 1 at the midpoint.
        let expected = f.powf(w);
        assert!((cost_at(&qfvp, &surface, middle(&surface)) - expected).abs() < 1e-7, "w = {w}");
        let best = qfvp.judge(&surface, APEX, CORNER, None).expect("finite");
        assert_eq!(best.position, surface.points[APEX as usize], "the best of both ends and the midpoint");
    }
}

#[test]
fn qfvp_normals_follow_linearly_or_anew() {
    let (surface, edges) = pyramid();
    let cost_after = |qfvp_normals| {
        let mut qfvp =
            Qfvp::new(&surface, &edges, &Options { qfvp_w: FeatureWeight::Fixed(1.0), qfvp_normals, ..bare() });
        qfvp.refresh(&surface, &edges);
        qfvp.merged(&surface, APEX, CORNER);
        qfvp.update(&surface, APEX);
        // Between the joined point and the opposite corner, whose normal is (-1, 1, 2)/√6.
        qfvp.judge(&surface, APEX, 4, Some(DVec3::new(5.0, 0.0, 0.0))).expect("finite").cost
    };
    // Eq. 11: 4 faces with the mean (0, 0, 1)/√2, 2 with (1, -1, 2)/(2√2): together (1, -1, 6)/(6√2).
    let joined = DVec3::new(1.0, -1.0, 6.0).normalize();
    let corner = DVec3::new(-1.0, 1.0, 2.0).normalize();
    let (linear, anew) = (1.0 - joined.dot(corner), 1.0 - DVec3::Z.dot(corner));
    let ratio = cost_after(NormalUpdate::Linear) / cost_after(NormalUpdate::Recompute);
    assert_near(ratio, linear / anew);
}

#[test]
fn melax_is_length_times_the_sharpest_turn() {
    let (surface, edges) = pyramid();
    let mut melax = Melax::new(&surface, &edges, &bare());
    melax.refresh(&surface, &edges);
    // The apex onto a corner: the far faces turn by (1 − 1/2)/2 against the nearer of the two at the edge.
    let [apex, corner] = [APEX, CORNER].map(|p| surface.points[p as usize]);
    assert!((cost_at(&melax, &surface, corner) - 3f64.sqrt() * 0.25).abs() < 1e-5);
    // The corner onto the apex: both its faces stand at the edge.
    let best = melax.judge(&surface, APEX, CORNER, None).expect("finite");
    assert!(best.cost < 1e-5 && best.position == apex);
}

#[test]
fn fms_is_squared_length_and_relative_curvature() {
    let (surface, edges) = pyramid();
    let mut fms = Fms::new(&surface, &edges, &bare());
    fms.refresh(&surface, &edges);
    // Eq. 8: 45° at the apex, 30° at a corner; eq. 9 with a squared length of 3.
    let expected = 3.0 * (1.0 + 0.5 * (PI / 4.0 + PI / 6.0));
    let found = fms.judge(&surface, APEX, CORNER, None).expect("finite");
    // Angles are good to 2e-8.
    assert!((found.cost - expected).abs() < 1e-7, "{}, expected {expected}", found.cost);
    assert_eq!(found.position, middle(&surface));
    // §3.3: a vertex on a border stays where it is.
    let mut careful = Fms::new(&surface, &edges, &Options::default());
    careful.refresh(&surface, &edges);
    let found = careful.judge(&surface, APEX, CORNER, None).expect("finite");
    assert_eq!(found.position, surface.points[CORNER as usize]);
}

#[test]
fn fms_weights_grow_with_their_change() {
    let (mut surface, edges) = pyramid();
    let cost = |surface: &Surface, alpha: f32| {
        let (fresh, edges) = pyramid();
        let mut fms = Fms::new(&fresh, &edges, &Options { fms_alpha: alpha, ..bare() });
        fms.refresh(&fresh, &edges);
        (0..5).for_each(|p| fms.update(surface, p));
        (0..5).for_each(|p| fms.settle(surface, p));
        fms.judge(surface, APEX, CORNER, None).expect("finite").cost
    };
    assert_eq!(edges.len(), 8);
    assert_near(cost(&surface, 0.5), cost(&surface, 0.0));
    let before = cost(&surface, 0.0);
    // Twice as large: E is four times what it was, for all edges, so λ (eq. 10) is three times the first weight. The lightest edge of each
    // vertex is a slope.
    surface.points.iter_mut().for_each(|p| *p *= 2.0);
    assert_near(cost(&surface, 0.0), 4.0 * before);
    assert_near(cost(&surface, 0.5), 4.0 * before + 0.5 * 3.0 * before);
}

/// A bumpy height field: no two edges cost the same.
fn terrain(n: u32) -> Mesh {
    let at = |x: u32, y: u32| y * (n + 1) + x;
    let height = |i: u32| 0.01 * f64::from(i.wrapping_mul(2_654_435_761) >> 8).rem_euclid(97.0) as f32;
    let positions = (0..(n + 1) * (n + 1)).map(|i| [(i % (n + 1)) as f32, (i / (n + 1)) as f32, height(i)]).collect();
    let square = |(x, y)| [[at(x, y), at(x + 1, y), at(x + 1, y + 1)], [at(x, y), at(x + 1, y + 1), at(x, y + 1)]];
    let triangles = (0..n).flat_map(|y| (0..n).map(move |x| (x, y))).flat_map(square).collect();
    Mesh { positions, triangles, ..Mesh::default() }
}

fn cheapest_edge(reducer: &mut Reducer) -> (Rank, u32, u32) {
    reducer.refresh();
    let judge = |e: &Edge| Some((Rank::of(reducer.judge(e.a, e.b)?.cost), e.a, e.b));
    reducer.edges.iter().filter_map(judge).min().expect("edges")
}

#[test]
fn both_queues_begin_with_the_cheapest_edge() {
    for algorithm in [Algorithm::Qem, Algorithm::Qfvp, Algorithm::Fms, Algorithm::Melax] {
        for drain in [queue::drain, vertices::drain] {
            let mut reducer = Reducer::new(&terrain(8), &Options { algorithm, ..bare() });
            let (_, a, b) = cheapest_edge(&mut reducer);
            let target = reducer.surface.face_count() - 1;
            drain(&mut reducer, target);
            assert!(reducer.surface.ring(b).is_empty() && !reducer.surface.ring(a).is_empty(), "{algorithm:?}");
            assert!(reducer.surface.face_count() <= target);
        }
    }
}

#[test]
fn attributes_and_outlines_cost_in_every_algorithm() {
    let mut mesh = terrain(6);
    mesh.positions.iter_mut().for_each(|p| p[2] = 0.0);
    let values = mesh.positions.iter().flat_map(|p| [p[0] * p[0], p[1]]).collect();
    mesh.attributes.push(Attribute { semantic: Semantic::TexCoord(0), width: 2, values });
    // A flat sheet: geometry inside costs nothing but FMS's lengths.
    let cost = |algorithm, edge: (u32, u32), weight: f32, border| {
        let attribute_weights = AttributeWeights { tex_coord: weight, ..AttributeWeights::default() };
        let mut reducer = Reducer::new(&mesh, &Options { algorithm, attribute_weights, border, ..bare() });
        reducer.refresh();
        let corner = reducer.surface.points[edge.1 as usize];
        reducer.cost.judge(&reducer.surface, edge.0, edge.1, Some(corner)).expect("finite").cost
    };
    for algorithm in [Algorithm::Qem, Algorithm::Qfvp, Algorithm::Fms, Algorithm::Melax] {
        let (inner, rim) = ((16, 17), (8, 7));
        let free = |edge, weight| cost(algorithm, edge, weight, EdgePolicy::Free);
        assert!(free(inner, 1.0) > free(inner, 0.0) + 1e-6, "{algorithm:?}");
        let off_the_border = cost(algorithm, (7, 8), 0.0, EdgePolicy::Preserve);
        assert!(off_the_border > free((7, 8), 0.0) + 1e-6, "{algorithm:?}");
        assert!(free(rim, 0.0).is_finite());
    }
}

/// Every collapse costs something that single precision cannot tell from nothing.
struct Tiny(Metric);

impl Cost for Tiny {
    fn refresh(&mut self, _surface: &Surface, _edges: &[Edge]) {}

    fn judge(&self, surface: &Surface, a: u32, _b: u32, fixed: Option<DVec3>) -> Option<Candidate> {
        Some(Candidate { cost: 1e-60, position: fixed.unwrap_or(surface.points[a as usize]) })
    }

    fn metric(&self) -> &Metric {
        &self.0
    }

    fn weigh(&self, _area: f64, _distance_squared: f64) -> f64 {
        1e-60
    }

    fn merged(&mut self, _surface: &Surface, _kept: u32, _gone: u32) {}

    fn update(&mut self, _surface: &Surface, _point: u32) {}
}

#[test]
fn a_pass_ends_where_costs_vanish_in_single_precision() {
    let mut reducer = Reducer::new(&terrain(8), &bare());
    reducer.cost = Box::new(Tiny(Metric::default()));
    let target = reducer.surface.face_count() / 2;
    passes::run(&mut reducer, &mut passes::Workspace::default(), target);
    assert!(reducer.surface.face_count() < 2 * target);
}

#[test]
fn the_end_of_a_bar_is_dearer_than_its_width() {
    let corner = |i: u32| [(i & 1) as f32 * 0.1, (i >> 1 & 1) as f32 * 0.1, (i >> 2) as f32];
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let bar = Mesh {
        positions: (0..8).map(corner).collect(),
        triangles: sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        ..Mesh::default()
    };
    let mut reducer = Reducer::new(&bar, &Options::default());
    reducer.refresh();
    let cheapest = |ends: fn(f64) -> bool| {
        let length = |e: &&Edge| reducer.surface.points[e.a as usize].distance(reducer.surface.points[e.b as usize]);
        let edges = reducer.edges.iter().filter(|e| ends(length(e)));
        edges.filter_map(|e| reducer.judge(e.a, e.b)).map(|c| c.cost).fold(f64::INFINITY, f64::min)
    };
    let (across, along) = (cheapest(|length| length < 0.12), cheapest(|length| length > 0.9));
    assert!(along > 20.0 * across, "{along} {across}");
}

/// A plate of 400 needles beside a slightly bumpy field: the plate is flat, so it pays for the reduction alone.
#[test]
fn needles_of_the_source_are_no_reason_to_keep_its_flat_parts() {
    let mut mesh = terrain(16);
    mesh.positions.iter_mut().for_each(|p| p[2] *= 0.3);
    let first = mesh.positions.len() as u32;
    mesh.positions.extend((0..402).map(|i| [40.0 + (i / 2) as f32 * 0.05, (i % 2) as f32 * 10.0, 0.0]));
    mesh.triangles.extend((first..first + 400).map(|i| if i % 2 == 0 { [i, i + 2, i + 1] } else { [i, i + 1, i + 2] }));
    let options = Options { effort: Effort::Fast, levels: vec![Target::triangles(516)], ..Options::default() };
    let level = &simplify(&mesh, &options).expect("sound").levels[0].mesh;
    let rms = Deviation::new(&mesh).of(level).rms;
    assert!(level.triangles.len() <= 517 && rms < 1e-6, "{} triangles, {rms}", level.triangles.len());
}

#[test]
fn the_quadric_of_attributes_is_their_deviation_anywhere() {
    let mut mesh = terrain(4);
    let values = mesh.positions.iter().flat_map(|[x, y, _]| [0.1 * x * x - 0.05 * x * y, 0.07 * y * y + 0.1 * x]);
    mesh.attributes.push(Attribute { semantic: Semantic::TexCoord(0), width: 2, values: values.collect() });
    let surface = Surface::new(&mesh);
    let mut metric = Metric::new(&surface, &AttributeWeights::default());
    metric.refresh(&surface, |face| facet(&surface, face));
    let ends @ [a, b] = collect_edges(&surface).iter().map(|e| [e.a, e.b]).nth(20).expect("an edge");
    let pairs = pair_wedges(&surface, a, b);
    let edge = surface.points[b as usize] - surface.points[a as usize];
    let AttributeQuadric { matrix, right } = metric.quadric(ends, &pairs, edge.as_vec3());
    let at = |x: DVec3| {
        let (exact, x) = (metric.deviation(&surface, ends, &pairs, surface.points[a as usize] + x), x.as_vec3());
        (exact, f64::from(x.dot(multiply(&matrix, x)) - 2.0 * right.dot(x)))
    };
    let (exact, found) = at(DVec3::ZERO);
    for x in [edge, DVec3::new(0.3, -0.2, 0.1), DVec3::new(-0.1, 0.4, 0.2)] {
        let (more_exact, more_found) = at(x);
        let expected = more_exact - exact;
        assert!((more_found - found - expected).abs() < 1e-3 * expected.abs(), "{} {expected}", more_found - found);
    }
}
