//! FMS (Meng & Song 2007): no quadrics, but edge lengths and relative curvature (equations of the paper in brackets).
//!
//! `E(v,u) = |vu|² · (1 + (c_v + c_u)/2)` (9), `c_v` the mean angle between the normal of v and those of its faces (6)–(8). A vertex weighs
//! `min E(v,i) + α·λ` (10), λ the distance of its weight from its first one, which keeps one region from being eaten up. Of an edge the
//! smaller λ of its ends counts here: the cheapest edge then is the lightest vertex's best one, so that every schedule follows (10).

use super::appearance::Appearance;
use super::cost::{Candidate, Cost};
use super::normals::FaceNormals;
use super::options::Options;
use crate::attributes::Metric;
use crate::mesh::edges::Edge;
use crate::mesh::surface::{Corner, Surface};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::PI;

pub(crate) struct Fms {
    alpha: f64,
    points: Vec<PointState>,
    normals: FaceNormals,
    appearance: Appearance,
    /// Whether the first weights are known.
    started: bool,
}

#[derive(Debug, Clone, Copy, Default)]
struct PointState {
    /// Relative curvature c, radians.
    curvature: f64,
    /// min E at the start; of a joined point the lesser of both.
    first: f64,
    /// |min E − first|.
    lambda: f64,
}

impl Fms {
    pub fn new(surface: &Surface, edges: &[Edge], options: &Options) -> Self {
        Self {
            alpha: f64::from(options.fms_alpha),
            points: vec![PointState::default(); surface.points.len()],
            normals: FaceNormals::default(),
            appearance: Appearance::new(surface, edges, options),
            started: false,
        }
    }

    fn measure_curvature(&mut self, surface: &Surface) {
        self.normals.refresh(surface);
        let normals = &self.normals;
        let measure = |(p, state): (usize, &mut PointState)| {
            state.curvature = relative_curvature(surface.ring(p as u32), normals)
        };
        self.points.par_iter_mut().enumerate().for_each(measure);
    }

    fn least_costs(&self, surface: &Surface) -> Vec<f64> {
        (0..self.points.len() as u32).into_par_iter().map(|p| self.least_cost(surface, p)).collect()
    }

    /// E of the edge between two points (9).
    #[inline]
    fn edge_cost(&self, surface: &Surface, a: u32, b: u32) -> f64 {
        let square = surface.points[a as usize].distance_squared(surface.points[b as usize]);
        square * (1.0 + 0.5 * (self.points[a as usize].curvature + self.points[b as usize].curvature))
    }

    /// Least E of a point's edges; 0 of a point without any.
    fn least_cost(&self, surface: &Surface, point: u32) -> f64 {
        let least = surface.ring(point).iter().flat_map(|&c| surface.opposite(c));
        let least = least.map(|other| self.edge_cost(surface, point, other)).fold(f64::INFINITY, f64::min);
        if least.is_finite() { least } else { 0.0 }
    }

    /// A point on a line that keeps its shape stays, else the midpoint (§3.3). Of two such points the one at the sharper place stays.
    fn place(&self, surface: &Surface, a: u32, b: u32) -> DVec3 {
        let [pa, pb] = [a, b].map(|p| surface.points[p as usize]);
        match (self.appearance.is_on_outline(a), self.appearance.is_on_outline(b)) {
            (true, false) => pa,
            (false, true) => pb,
            (false, false) => (pa + pb) * 0.5,
            (true, true) => {
                let outline = |x| self.appearance.outline_at(a, b, x);
                if outline(pb) < outline(pa) { pb } else { pa }
            }
        }
    }
}

/// Mean angle between the normal of a point and the normals of the faces at its corners (6)–(8), in radians. The cross products of (6) make
/// large faces count more in (7).
fn relative_curvature(ring: &[Corner], normals: &FaceNormals) -> f64 {
    let face = |&corner: &Corner| normals.at(corner);
    let normal = ring.iter().map(face).map(|(normal, area)| normal * area).sum::<DVec3>().normalize_or_zero();
    let angle = |(face_normal, _): (DVec3, f64)| arc_cosine(face_normal.dot(normal));
    // A face without area has no normal to differ.
    let angles = ring.iter().map(face).filter(|(_, area)| *area > 0.0).map(angle);
    angles.sum::<f64>() / ring.len().max(1) as f64
}

/// The angle with this cosine, within 2e-8 (Abramowitz & Stegun 4.4.46). Arithmetic alone: a library's function costs more than all the rest.
fn arc_cosine(cosine: f64) -> f64 {
    const SERIES: [f64; 8] = [
        1.570_796_305_0,
        -0.214_598_801_6,
        0.088_978_987_4,
        -0.050_174_304_6,
        0.030_891_881_0,
        -0.017_088_125_6,
        0.006_670_090_1,
        -0.001_262_491_1,
    ];
    let x = cosine.abs().min(1.0);
    let angle = (1.0 - x).sqrt() * SERIES.iter().rev().fold(0.0, |sum, factor| sum * x + factor);
    if cosine < 0.0 { PI - angle } else { angle }
}

impl Cost for Fms {
    fn refresh(&mut self, surface: &Surface, _edges: &[Edge]) {
        self.measure_curvature(surface);
        let now = self.least_costs(surface);
        for (state, now) in self.points.iter_mut().zip(now) {
            if !self.started {
                state.first = now;
            }
            state.lambda = (now - state.first).abs();
        }
        self.started = true;
        self.appearance.refresh(surface);
    }

    fn judge(&self, surface: &Surface, a: u32, b: u32, fixed: Option<DVec3>) -> Option<Candidate> {
        let position = fixed.unwrap_or_else(|| self.place(surface, a, b));
        let lambda = self.points[a as usize].lambda.min(self.points[b as usize].lambda);
        let cost =
            self.edge_cost(surface, a, b) + self.alpha * lambda + self.appearance.deviation(surface, a, b, position);
        cost.is_finite().then_some(Candidate { cost, position })
    }

    fn metric(&self) -> &Metric {
        self.appearance.metric()
    }

    fn weigh(&self, _area: f64, distance_squared: f64) -> f64 {
        distance_squared
    }

    fn merged(&mut self, surface: &Surface, kept: u32, gone: u32) {
        let gone_first = self.points[gone as usize].first;
        let first = &mut self.points[kept as usize].first;
        *first = first.min(gone_first);
        self.normals.follow(kept);
        self.appearance.merged(surface, kept, gone);
    }

    fn update(&mut self, surface: &Surface, point: u32) {
        self.appearance.update(surface, point);
        self.normals.update(surface, point);
        self.points[point as usize].curvature = relative_curvature(surface.ring(point), &self.normals);
    }

    fn settle(&mut self, surface: &Surface, point: u32) {
        if self.alpha > 0.0 {
            let now = self.least_cost(surface, point);
            let state = &mut self.points[point as usize];
            state.lambda = (now - state.first).abs();
        }
    }
}
