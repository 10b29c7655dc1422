//! What the papers' costs leave out and files need: outlines (borders, seams, material borders) and attributes, as squared lengths.
//!
//! The papers know geometry alone. On a closed surface without attributes everything here is zero, and their costs stand as printed.

use super::constraints::{Constraints, upright_planes};
use super::options::Options;
use super::quadric::Quadric;
use crate::attributes::{Metric, facet};
use crate::mesh::edges::Edge;
use crate::mesh::surface::Surface;
use crate::mesh::surgery::pair_wedges;
use glam::DVec3;

/// Cost of an edge's length², where nothing else costs anything: shortest first beats index order.
const LENGTH_COST: f64 = 1e-12;

/// Outlines accumulated at points, and what attributes count.
pub(crate) struct Appearance {
    /// One a point: whether a line that costs something runs through it.
    on_outline: Vec<bool>,
    /// The planes that stand on those lines; one a point if there is any line at all.
    outlines: Vec<Quadric>,
    metric: Metric,
}

impl Appearance {
    pub fn new(surface: &Surface, edges: &[Edge], options: &Options) -> Self {
        let constraints = Constraints::new(options);
        let mut on_outline = vec![false; surface.points.len()];
        let mut outlines = Vec::new();
        for edge in edges.iter().filter(|e| constraints.weight(e.kind) > 0.0) {
            outlines.resize(surface.points.len(), Quadric::default());
            on_outline[edge.a as usize] = true;
            on_outline[edge.b as usize] = true;
            let (through, weight) = (surface.points[edge.a as usize], constraints.weight(edge.kind));
            for normal in upright_planes(surface, edge) {
                let plane = Quadric::plane(normal, through, weight);
                outlines[edge.a as usize].add(&plane);
                outlines[edge.b as usize].add(&plane);
            }
        }
        Self { on_outline, outlines, metric: Metric::new(surface, &options.attribute_weights) }
    }

    /// Brings what is known of attributes up to date with the whole surface.
    pub fn refresh(&mut self, surface: &Surface) {
        self.metric.refresh(surface, |face| facet(surface, face));
    }

    /// The same with the faces around one point.
    pub fn update(&mut self, surface: &Surface, point: u32) {
        self.metric.update(surface, point, |face| facet(surface, face));
    }

    /// What attributes count.
    pub fn metric(&self) -> &Metric {
        &self.metric
    }

    /// Follows a collapse.
    pub fn merged(&mut self, surface: &Surface, kept: u32, gone: u32) {
        self.metric.merged(surface, kept);
        if self.on_outline[gone as usize] {
            self.on_outline[kept as usize] = true;
            let gone = self.outlines[gone as usize];
            self.outlines[kept as usize].add(&gone);
        }
    }

    /// Whether a line that keeps its shape runs through the point.
    #[inline]
    pub fn is_on_outline(&self, point: u32) -> bool {
        self.on_outline[point as usize]
    }

    /// Squared distance by which the lines through `a` and `b` would be off at `x`.
    #[inline]
    pub fn outline_at(&self, a: u32, b: u32, x: DVec3) -> f64 {
        let of = |p: u32| if self.is_on_outline(p) { self.outlines[p as usize].at(x) } else { 0.0 };
        of(a) + of(b)
    }

    /// Squared length by which outlines and attributes are off once `a` and `b` are joined at `x`.
    #[inline]
    pub fn deviation(&self, surface: &Surface, a: u32, b: u32, x: DVec3) -> f64 {
        let square = surface.points[a as usize].distance_squared(surface.points[b as usize]);
        let mut cost = self.outline_at(a, b, x) + LENGTH_COST * square;
        if !self.metric.is_empty() && square > 0.0 {
            // The metric sums over areas; the papers' costs do not.
            cost += self.metric.deviation(surface, [a, b], &pair_wedges(surface, a, b), x) / square;
        }
        cost
    }
}
