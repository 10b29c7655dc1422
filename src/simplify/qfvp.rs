//! QFVP: quadric error times a power of a curvature-like feature (equations of the paper in brackets).
//!
//! `Δ = (xᵀQx) · f^w` with `f = 1 − cos θ` between the normals at the ends (4)–(6); the point goes to the best of both ends and the
//! midpoint (§2.4.2); normals start as the mean of the face normals (8) and follow collapses linearly (11).

use super::appearance::Appearance;
use super::cost::{Candidate, Cost, Reach, cheapest};
use super::options::{FeatureWeight, NormalUpdate, Options};
use super::paper::face_quadrics;
use super::quadric::Quadric;
use crate::attributes::Metric;
use crate::curvature::normal_and_area;
use crate::mesh::edges::Edge;
use crate::mesh::surface::Surface;
use crate::predictor::{self, Reduction, Shape};
use glam::DVec3;
use rayon::prelude::*;

/// Share of the source's triangles that counts as the target where an error alone ends the level: its count is not known before.
const UNKNOWN_TARGET: f64 = 0.1;

pub(crate) struct Qfvp {
    w: f64,
    normals: NormalUpdate,
    points: Vec<PointState>,
    appearance: Appearance,
}

#[derive(Debug, Clone, Copy, Default)]
struct PointState {
    quadric: Quadric,
    /// Mean of the unit normals of the faces around (8).
    normal: DVec3,
    /// Number of those faces.
    faces: u32,
}

impl Qfvp {
    pub fn new(surface: &Surface, edges: &[Edge], options: &Options) -> Self {
        let quadrics = face_quadrics(surface);
        let state = |(p, quadric)| PointState {
            quadric,
            normal: mean_normal(surface, p as u32),
            faces: surface.ring(p as u32).len() as u32,
        };
        Self {
            w: choose_w(surface, edges, options),
            normals: options.qfvp_normals,
            points: quadrics.into_par_iter().enumerate().map(state).collect(),
            appearance: Appearance::new(surface, edges, options),
        }
    }
}

fn choose_w(surface: &Surface, edges: &[Edge], options: &Options) -> f64 {
    let reduction = || Reduction { before: surface.face_count(), after: coarsest_level(options, surface.face_count()) };
    match options.qfvp_w {
        FeatureWeight::Fixed(w) => w,
        FeatureWeight::Auto => predictor::builtin().predict(reduction()),
        FeatureWeight::Shape => predictor::builtin().predict_by_shape(reduction(), Shape::of(surface, edges)),
    }
}

/// Triangles of the last level, as far as they are known before.
fn coarsest_level(options: &Options, source: usize) -> usize {
    let unknown = (source as f64 * UNKNOWN_TARGET) as usize;
    options.levels.last().map_or(source, |target| target.count(source, unknown))
}

/// Mean of the unit normals of the faces at a point (8).
fn mean_normal(surface: &Surface, point: u32) -> DVec3 {
    let ring = surface.ring(point);
    let sum: DVec3 = ring.iter().map(|&c| normal_and_area(surface.triangle(Surface::face_of(c))).0).sum();
    if ring.is_empty() { sum } else { sum / ring.len() as f64 }
}

/// 1 − cos of the angle between two normals (4): 0 flat … 2.
fn feature(a: DVec3, b: DVec3) -> f64 {
    (1.0 - a.normalize_or_zero().dot(b.normalize_or_zero())).clamp(0.0, 2.0)
}

/// `f^w`. The predictor's classes need roots only, which are the same on every machine.
fn power(f: f64, w: f64) -> f64 {
    match w {
        0.0 => 1.0,
        0.5 => f.sqrt(),
        1.0 => f,
        1.5 => f * f.sqrt(),
        2.0 => f * f,
        _ => libm::pow(f, w),
    }
}

/// Normal of the point that two points become (11); `faces` around each before the collapse.
fn join_normals(a: &PointState, b: &PointState) -> DVec3 {
    let (ca, cb) = (f64::from(a.faces), f64::from(b.faces));
    (a.normal * ca + b.normal * cb) / (ca + cb).max(1.0)
}

impl Cost for Qfvp {
    fn refresh(&mut self, surface: &Surface, _edges: &[Edge]) {
        let recompute = self.normals == NormalUpdate::Recompute;
        self.points.par_iter_mut().enumerate().for_each(|(p, state)| {
            state.faces = surface.ring(p as u32).len() as u32;
            if recompute {
                state.normal = mean_normal(surface, p as u32);
            }
        });
        self.appearance.refresh(surface);
    }

    fn judge(&self, surface: &Surface, a: u32, b: u32, fixed: Option<DVec3>) -> Option<Candidate> {
        let (sa, sb) = (&self.points[a as usize], &self.points[b as usize]);
        let mut quadric = sa.quadric;
        quadric.add(&sb.quadric);
        let [pa, pb] = [a, b].map(|p| surface.points[p as usize]);
        let positions: &[DVec3] = match fixed {
            Some(x) => &[x],
            None => &[pa, pb, (pa + pb) * 0.5],
        };
        let position =
            cheapest(positions, |x| quadric.at(x) + self.appearance.outline_at(a, b, x)).map(|best| best.position)?;
        let cost = quadric.at(position) * power(feature(sa.normal, sb.normal), self.w)
            + self.appearance.deviation(surface, a, b, position);
        cost.is_finite().then_some(Candidate { cost, position })
    }

    fn metric(&self) -> &Metric {
        self.appearance.metric()
    }

    fn weigh(&self, _area: f64, distance_squared: f64) -> f64 {
        distance_squared
    }

    fn merged(&mut self, surface: &Surface, kept: u32, gone: u32) {
        let gone_state = self.points[gone as usize];
        let state = &mut self.points[kept as usize];
        state.normal = join_normals(state, &gone_state);
        state.quadric.add(&gone_state.quadric);
        self.appearance.merged(surface, kept, gone);
    }

    fn update(&mut self, surface: &Surface, point: u32) {
        self.appearance.update(surface, point);
        let state = &mut self.points[point as usize];
        state.faces = surface.ring(point).len() as u32;
        if self.normals == NormalUpdate::Recompute {
            state.normal = mean_normal(surface, point);
        }
    }

    fn reach(&self) -> Reach {
        Reach::Point
    }
}
