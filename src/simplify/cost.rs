//! What a collapse is worth and where the point goes: the policy that algorithms differ in.

use crate::mesh::edges::Edge;
use crate::mesh::surface::Surface;
use glam::DVec3;

/// A collapse that may be tried.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidate {
    /// Lower collapses earlier. The unit is the algorithm's own, see [`Cost::weigh`].
    pub cost: f64,
    /// Where the joined point goes.
    pub position: DVec3,
}

/// A cost as a key for sorting: costs are never negative, so their bits order as they do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Rank(u64);

impl Rank {
    /// Of a cost ≥ 0.
    pub fn of(cost: f64) -> Self {
        Self(cost.max(0.0).to_bits())
    }

    /// The cost.
    pub fn cost(self) -> f64 {
        f64::from_bits(self.0)
    }
}

/// Cost and placement of edge collapses.
pub(crate) trait Cost: Send + Sync {
    /// Looks at the whole surface before a pass; `edges` are all its edges.
    fn refresh(&mut self, surface: &Surface, edges: &[Edge]);

    /// Judges the collapse of the edge between `a` and `b`, with the joined point at `fixed` if given; `None` if it has no finite cost.
    fn judge(&self, surface: &Surface, a: u32, b: u32, fixed: Option<DVec3>) -> Option<Candidate>;

    /// What it costs that `area` of the surface is off by the root of `distance_squared`: makes other changes comparable with collapses.
    fn weigh(&self, area: f64, distance_squared: f64) -> f64;

    /// Follows a collapse that was done: `gone` is part of `kept` now.
    fn merged(&mut self, kept: u32, gone: u32);

    /// Makes room for points that `surface` has and the cost has not met.
    fn grow(&mut self, surface: &Surface);

    /// Brings what is known of one point up to date with the faces around it. Only the queue asks for it.
    fn update(&mut self, surface: &Surface, point: u32);
}

/// The cheapest of some positions by `cost`.
pub(crate) fn cheapest(positions: &[DVec3], cost: impl Fn(DVec3) -> f64) -> Option<Candidate> {
    positions
        .iter()
        .map(|&position| Candidate { cost: cost(position), position })
        .filter(|c| c.cost.is_finite())
        .min_by(|a, b| a.cost.total_cmp(&b.cost))
}

/// Where points may go: the source's bounding box with some slack. A handful of faces that keep a volume, or an ill-conditioned optimum, would
/// stick out far.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    low: DVec3,
    high: DVec3,
}

impl Room {
    pub fn of(points: &[DVec3]) -> Self {
        let (low, high) =
            points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
        let slack = 0.02 * low.distance(high);
        Self { low: low - slack, high: high + slack }
    }

    pub fn contains(&self, x: DVec3) -> bool {
        x.cmpge(self.low).all() && x.cmple(self.high).all()
    }
}
