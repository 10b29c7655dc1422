//! The default cost: memoryless quadrics, volume-preserving placement, curvature and normal angle as factors.
//!
//! The quadric of a point is rebuilt from the current faces at each pass, weighted by area, so that errors of long gone faces do not
//! pile up (Lindstrom & Turk 1998, 1999). The joined point keeps the volume. ESQEM's Gaussian curvature and QFVP's angle between the
//! end normals multiply the cost rather than add to it: a dimensionless factor serves meshes of all sizes, and flat regions stay free.
//!
//! Limits: quadrics at the ends of an edge lag behind collapses next to it within one pass.

use super::constraints::{Constraints, upright_planes};
use super::cost::{Candidate, Cost, Room, cheapest};
use super::options::Options;
use super::quadric::{Quadric, Volume};
use crate::attributes::Metric;
use crate::curvature::{Curvature, border_points, normal_and_area};
use crate::mesh::edges::{Edge, edge_kind};
use crate::mesh::surface::Surface;
use crate::mesh::surgery::Merge;
use glam::DVec3;
use rayon::prelude::*;

/// Pull towards the edge's midpoint, relative to the quadric's trace: decides where the surface does not.
const STIFFNESS: f64 = 1e-7;
/// Largest K·|e|² that counts; beyond it the surface is not resolved anyway.
const CURVATURE_CAP: f64 = 20.0;
/// Weight of K·|e|² at a curvature weight of 1.
const CURVATURE_SCALE: f64 = 2.0;
/// Exponent of the normal-angle factor (QFVP's w).
const ANGLE_EXPONENT: f64 = 0.15;
/// 1 − cos of the angle between the end normals of an edge that counts as flat.
const FLAT_ANGLE: f64 = 0.02;
/// Cost of an edge's length on a flat surface, relative to area · length²: orders the collapses that cost nothing else.
const LENGTH_COST: f64 = 1e-12;

pub(crate) struct Enhanced {
    constraints: Constraints,
    room: Room,
    options: Options,
    points: Vec<PointState>,
    metric: Metric,
}

#[derive(Debug, Clone, Copy, Default)]
struct PointState {
    quadric: Quadric,
    volume: Volume,
    /// |K| of the source, averaged at merges.
    curvature: f64,
}

impl Enhanced {
    pub fn new(surface: &Surface, edges: &[Edge], options: &Options) -> Self {
        let border = border_points(surface.points.len(), edges);
        let points = (0..surface.points.len() as u32)
            .into_par_iter()
            .map(|p| PointState {
                curvature: Curvature::at(surface, p, border[p as usize]).gauss.abs(),
                ..PointState::default()
            })
            .collect();
        let room = Room::of(&surface.points);
        Self {
            constraints: Constraints::new(options),
            room,
            options: options.clone(),
            points,
            metric: Metric::default(),
        }
    }

    /// Quadric and volume of the faces around a point; constraint planes come from edges.
    fn of_faces(surface: &Surface, point: u32) -> (Quadric, Volume) {
        let (mut quadric, mut volume) = (Quadric::default(), Volume::default());
        for &corner in surface.ring(point) {
            let triangle = surface.triangle(Surface::face_of(corner));
            let (normal, area) = normal_and_area(triangle);
            quadric.add(&Quadric::plane(normal, triangle[0], area));
            volume.add(&Volume::face(normal * area, triangle[0]), 1.0);
        }
        (quadric, volume)
    }

    /// The plane through an edge, perpendicular to its faces' mean normal.
    fn of_edge(&self, surface: &Surface, edge: &Edge) -> Option<Quadric> {
        let weight = self.constraints.weight(edge.kind);
        if weight == 0.0 {
            return None;
        }
        let [a, b] = [edge.a, edge.b].map(|p| surface.points[p as usize]);
        let plane = upright_planes(surface, edge);
        let mut scaled = Quadric::default();
        let trace = plane.trace();
        if trace > 0.0 {
            scaled.add_scaled(&plane, weight * a.distance_squared(b) / trace);
        }
        Some(scaled)
    }

    fn factor(&self, a: &PointState, b: &PointState, length_squared: f64) -> f64 {
        let curvature = (0.5 * (a.curvature + b.curvature) * length_squared).min(CURVATURE_CAP);
        let angle = 1.0 - a.volume.normal.normalize_or_zero().dot(b.volume.normal.normalize_or_zero()) + FLAT_ANGLE;
        (1.0 + f64::from(self.options.curvature_weight) * CURVATURE_SCALE * curvature) * angle.powf(ANGLE_EXPONENT)
    }

    /// The minimum of the quadric that keeps the volume, unless it lies far off.
    fn place(
        &self,
        surface: &Surface,
        ends: (u32, u32),
        quadric: &Quadric,
        middle: DVec3,
        length_squared: f64,
    ) -> Option<DVec3> {
        let volume = self.joint_volume(surface, ends.0, ends.1);
        // Where area vectors cancel (folds, needles) the constraint plane means nothing.
        let meaningful = volume.normal.length_squared() > 1e-4 * quadric.trace() * quadric.trace();
        let near = |x: &DVec3| x.distance_squared(middle) < 4.0 * length_squared && self.room.contains(*x);
        let constrained =
            meaningful.then(|| quadric.minimum_near(middle, STIFFNESS, Some(&volume))).flatten().filter(near);
        constrained.or_else(|| quadric.minimum_near(middle, STIFFNESS, None).filter(near))
    }

    /// Volume constraint of the faces around both ends, each face once.
    fn joint_volume(&self, surface: &Surface, a: u32, b: u32) -> Volume {
        let mut volume = self.points[a as usize].volume;
        volume.add(&self.points[b as usize].volume, 1.0);
        for &corner in surface.ring(a) {
            if surface.opposite(corner).contains(&b) {
                let triangle = surface.triangle(Surface::face_of(corner));
                let (normal, area) = normal_and_area(triangle);
                volume.add(&Volume::face(normal * area, triangle[0]), -1.0);
            }
        }
        volume
    }
}

impl Cost for Enhanced {
    fn refresh(&mut self, surface: &Surface, edges: &[Edge]) {
        self.points.par_iter_mut().enumerate().for_each(|(p, state)| {
            (state.quadric, state.volume) = Self::of_faces(surface, p as u32);
        });
        for edge in edges.iter().filter(|e| !e.kind.is_plain()) {
            if let Some(plane) = self.of_edge(surface, edge) {
                self.points[edge.a as usize].quadric.add(&plane);
                self.points[edge.b as usize].quadric.add(&plane);
            }
        }
        self.metric = Metric::new(surface, &self.options.attribute_weights);
    }

    fn judge(&self, surface: &Surface, a: u32, b: u32, fixed: Option<DVec3>) -> Option<Candidate> {
        let (sa, sb) = (&self.points[a as usize], &self.points[b as usize]);
        let mut quadric = sa.quadric;
        quadric.add(&sb.quadric);
        let [pa, pb] = [a, b].map(|p| surface.points[p as usize]);
        let (middle, length_squared) = ((pa + pb) * 0.5, pa.distance_squared(pb));
        let geometric = |x: DVec3| quadric.at(x) + LENGTH_COST * quadric.trace() * length_squared;
        let found = match fixed.or_else(|| self.place(surface, (a, b), &quadric, middle, length_squared)) {
            Some(x) => Candidate { cost: geometric(x), position: x },
            None => cheapest(&[pa, pb, middle], geometric)?,
        };
        let mut cost = found.cost;
        if !self.metric.is_empty() {
            cost += self.metric.deviation(surface, &Merge::new(surface, a, b), found.position);
        }
        cost *= self.factor(sa, sb, length_squared);
        cost.is_finite().then_some(Candidate { cost, position: found.position })
    }

    fn weigh(&self, area: f64, distance_squared: f64) -> f64 {
        area * distance_squared
    }

    fn merged(&mut self, kept: u32, gone: u32) {
        let gone = self.points[gone as usize].curvature;
        let kept = &mut self.points[kept as usize].curvature;
        *kept = 0.5 * (*kept + gone);
    }

    fn grow(&mut self, surface: &Surface) {
        let known = self.points.len();
        for p in known..surface.points.len() {
            // New points take the mean of their neighbours' curvature; the rest is rebuilt at each pass.
            let (mut sum, mut count) = (0.0, 0.0);
            for n in surface.neighbours(p as u32).into_iter().filter(|&n| (n as usize) < known) {
                sum += self.points[n as usize].curvature;
                count += 1.0;
            }
            let curvature = if count > 0.0 { sum / count } else { 0.0 };
            self.points.push(PointState { curvature, ..PointState::default() });
        }
    }

    fn update(&mut self, surface: &Surface, point: u32) {
        let (mut quadric, volume) = Self::of_faces(surface, point);
        for other in surface.neighbours(point) {
            let Some(kind) = edge_kind(surface, point, other).filter(|k| !k.is_plain()) else { continue };
            if let Some(plane) = self.of_edge(surface, &Edge { a: point, b: other, kind }) {
                quadric.add(&plane);
            }
        }
        let state = &mut self.points[point as usize];
        (state.quadric, state.volume) = (quadric, volume);
    }
}
