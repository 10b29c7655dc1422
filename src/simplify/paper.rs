//! The costs of the papers: accumulated quadrics (QEM), and with Gaussian curvature added (ESQEM).

use super::constraints::{Constraints, upright_planes};
use super::cost::{Candidate, Cost, Reach, Room, cheapest};
use super::options::Options;
use super::quadric::Quadric;
use crate::attributes::{Metric, facet};
use crate::curvature::{Curvature, border_points, normal_and_area};
use crate::mesh::edges::{Edge, EdgeKind, edge_kind};
use crate::mesh::surface::Surface;
use crate::mesh::surgery::pair_wedges;
use glam::DVec3;

/// ESQEM's a: the curvature term lies two orders of magnitude below the quadric term.
const CURVATURE_SHARE: f64 = 0.01;

/// Quadrics summed up at merges (ESQEM eq. 1–7), plus `ω·K(e)` (eq. 12, 13).
pub(crate) struct Paper {
    constraints: Constraints,
    room: Room,
    quadrics: Vec<Quadric>,
    curvatures: Vec<Curvature>,
    /// ω = a · Q_avg / K_avg; 0 for QEM.
    omega: f64,
    metric: Metric,
}

impl Paper {
    /// QEM (Garland & Heckbert 1997).
    pub fn qem(surface: &Surface, edges: &[Edge], options: &Options) -> Self {
        let mut paper = Self {
            constraints: Constraints::new(options),
            room: Room::of(&surface.points),
            quadrics: face_quadrics(surface),
            curvatures: Vec::new(),
            omega: 0.0,
            metric: Metric::new(surface, &options.attribute_weights),
        };
        paper.add_outlines(surface, edges);
        paper
    }

    /// ESQEM: ω balances the averages of both terms over all edges.
    pub fn esqem(surface: &Surface, edges: &[Edge], options: &Options) -> Self {
        let mut paper = Self::qem(surface, edges, options);
        let border = border_points(surface.points.len(), edges);
        paper.curvatures = (0..surface.points.len()).map(|p| Curvature::at(surface, p as u32, border[p])).collect();
        let (mut quadric_sum, mut curvature_sum) = (0.0, 0.0);
        for e in edges {
            quadric_sum += paper.judge_quadric(surface, e.a, e.b, None).map_or(0.0, |c| c.cost);
            curvature_sum += paper.curvature(e.a, e.b);
        }
        if curvature_sum > 0.0 {
            paper.omega = CURVATURE_SHARE * f64::from(options.curvature_weight) * quadric_sum / curvature_sum;
        }
        paper
    }

    fn add_outlines(&mut self, surface: &Surface, edges: &[Edge]) {
        for edge in edges.iter().filter(|e| self.constraints.weight(e.kind) > 0.0) {
            let (through, weight) = (surface.points[edge.a as usize], self.constraints.weight(edge.kind));
            for normal in upright_planes(surface, edge) {
                let plane = Quadric::plane(normal, through, weight);
                self.quadrics[edge.a as usize].add(&plane);
                self.quadrics[edge.b as usize].add(&plane);
            }
        }
    }

    fn curvature(&self, a: u32, b: u32) -> f64 {
        match (self.curvatures.get(a as usize), self.curvatures.get(b as usize)) {
            (Some(&a), Some(&b)) => Curvature::of_edge(a, b),
            _ => 0.0,
        }
    }

    /// Least quadric error: at the optimum if the matrix is invertible, else at an end or the midpoint (eq. 7).
    fn judge_quadric(&self, surface: &Surface, a: u32, b: u32, fixed: Option<DVec3>) -> Option<Candidate> {
        let mut quadric = self.quadrics[a as usize];
        quadric.add(&self.quadrics[b as usize]);
        let [pa, pb] = [a, b].map(|p| surface.points[p as usize]);
        let middle = (pa + pb) * 0.5;
        // An optimum far away is an ill-conditioned one.
        let near = |x: &DVec3| x.distance_squared(middle) < 4.0 * pa.distance_squared(pb) && self.room.contains(*x);
        let positions: &[DVec3] = match fixed.or_else(|| quadric.minimum().filter(near)) {
            Some(x) => &[x],
            None => &[pa, pb, middle],
        };
        cheapest(positions, |x| quadric.at(x))
    }
}

impl Cost for Paper {
    fn refresh(&mut self, surface: &Surface, edges: &[Edge]) {
        if !self.curvatures.is_empty() {
            self.curvatures = curvatures(surface, edges);
        }
        self.metric.refresh(surface, |face| facet(surface, face));
    }

    fn judge(&self, surface: &Surface, a: u32, b: u32, fixed: Option<DVec3>) -> Option<Candidate> {
        let mut candidate = self.judge_quadric(surface, a, b, fixed)?;
        candidate.cost += self.omega * self.curvature(a, b);
        if !self.metric.is_empty() {
            let [pa, pb] = [a, b].map(|p| surface.points[p as usize]);
            let area = pa.distance_squared(pb);
            // The quadrics here are not weighted by area; divided by it, the attribute term is of their unit.
            if area > 0.0 {
                candidate.cost +=
                    self.metric.deviation(surface, [a, b], &pair_wedges(surface, a, b), candidate.position) / area;
            }
        }
        candidate.cost.is_finite().then_some(candidate)
    }

    fn metric(&self) -> &Metric {
        &self.metric
    }

    fn weigh(&self, _area: f64, distance_squared: f64) -> f64 {
        distance_squared
    }

    fn merged(&mut self, surface: &Surface, kept: u32, gone: u32) {
        self.metric.merged(surface, kept);
        let gone = self.quadrics[gone as usize];
        self.quadrics[kept as usize].add(&gone);
    }

    fn update(&mut self, surface: &Surface, point: u32) {
        self.metric.update(surface, point, |face| facet(surface, face));
        if let Some(curvature) = self.curvatures.get_mut(point as usize) {
            let on_border = |q| edge_kind(surface, point, q).is_some_and(|kind| kind.has(EdgeKind::BORDER));
            let border = surface.neighbours(point).into_iter().any(on_border);
            *curvature = Curvature::at(surface, point, border);
        }
    }

    fn reach(&self) -> Reach {
        // Quadrics belong to their point; curvature belongs to the faces around.
        if self.curvatures.is_empty() { Reach::Point } else { Reach::Neighbours }
    }
}

/// For each point the sum of the planes of its faces, each of weight 1 (eq. 3 and 4).
pub(super) fn face_quadrics(surface: &Surface) -> Vec<Quadric> {
    let mut quadrics = vec![Quadric::default(); surface.points.len()];
    for f in surface.live_faces() {
        let triangle = surface.triangle(f);
        let (normal, _) = normal_and_area(triangle);
        let plane = Quadric::plane(normal, triangle[0], 1.0);
        surface.face(f).iter().for_each(|&p| quadrics[p as usize].add(&plane));
    }
    quadrics
}

fn curvatures(surface: &Surface, edges: &[Edge]) -> Vec<Curvature> {
    let border = border_points(surface.points.len(), edges);
    (0..surface.points.len()).map(|p| Curvature::at(surface, p as u32, border[p])).collect()
}
