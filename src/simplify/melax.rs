//! Melax's cost (Melax 1998, "A Simple, Fast, and Effective Polygon Reduction Algorithm"): edge length times curvature, one end moves onto
//! the other.
//!
//! `cost(u, v) = |u − v| · max over f in T_u of min over n in T_uv of (1 − f·n) / 2`: T_u the faces at u, T_uv those that have v too. Moving
//! u onto v leaves the shape as it is where every face at u looks the way of a face beside the edge.

use super::appearance::Appearance;
use super::cost::{Candidate, Cost};
use super::normals::FaceNormals;
use super::options::Options;
use crate::attributes::Metric;
use crate::mesh::edges::Edge;
use crate::mesh::surface::Surface;
use glam::DVec3;
use smallvec::SmallVec;

pub(crate) struct Melax {
    normals: FaceNormals,
    appearance: Appearance,
}

impl Melax {
    pub fn new(surface: &Surface, edges: &[Edge], options: &Options) -> Self {
        Self { normals: FaceNormals::default(), appearance: Appearance::new(surface, edges, options) }
    }

    /// Curvature of moving `from` onto `onto`: 0 flat … 1.
    fn curvature(&self, surface: &Surface, from: u32, onto: u32) -> f64 {
        let ring = surface.ring(from);
        let normal = |corner: u32| self.normals.at(corner).0;
        let sides: SmallVec<[DVec3; 4]> =
            ring.iter().filter(|&&c| surface.opposite(c).contains(&onto)).map(|&c| normal(c)).collect();
        let turn = |&corner: &u32| {
            let nearest = sides.iter().map(|n| normal(corner).dot(*n)).fold(-1.0, f64::max);
            (1.0 - nearest) * 0.5
        };
        ring.iter().map(turn).fold(0.0, f64::max)
    }

    fn judge_move(&self, surface: &Surface, from: u32, onto: u32) -> Candidate {
        let position = surface.points[onto as usize];
        let length = surface.points[from as usize].distance(position);
        // Costs are lengths here.
        let others = self.appearance.deviation(surface, from, onto, position).sqrt();
        Candidate { cost: length * self.curvature(surface, from, onto) + others, position }
    }
}

impl Cost for Melax {
    fn refresh(&mut self, surface: &Surface, _edges: &[Edge]) {
        self.normals.refresh(surface);
        self.appearance.refresh(surface);
    }

    fn judge(&self, surface: &Surface, a: u32, b: u32, fixed: Option<DVec3>) -> Option<Candidate> {
        let onto_a = || self.judge_move(surface, b, a);
        let onto_b = || self.judge_move(surface, a, b);
        let best = match fixed {
            Some(x) if x == surface.points[a as usize] => onto_a(),
            Some(_) => onto_b(),
            None => {
                let (x, y) = (onto_a(), onto_b());
                if y.cost < x.cost { y } else { x }
            }
        };
        best.cost.is_finite().then_some(best)
    }

    fn metric(&self) -> &Metric {
        self.appearance.metric()
    }

    fn weigh(&self, _area: f64, distance_squared: f64) -> f64 {
        distance_squared.sqrt()
    }

    fn merged(&mut self, surface: &Surface, kept: u32, gone: u32) {
        self.normals.follow(kept);
        self.appearance.merged(surface, kept, gone);
    }

    fn update(&mut self, surface: &Surface, point: u32) {
        self.appearance.update(surface, point);
        self.normals.update(surface, point);
    }
}
