//! What a collapse is worth and where the point goes: the policy that algorithms differ in.

use super::constraints::Locked;
use super::fan::Fan;
use crate::attributes::Metric;
use crate::mesh::edges::Edge;
use crate::mesh::regions::Region;
use crate::mesh::surface::{Corner, Surface};
use crate::mesh::surgery::Merge;
use glam::DVec3;
use std::any::Any;

/// A collapse that may be tried.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidate {
    /// Lower collapses earlier. The unit is the algorithm's own, see [`Cost::weigh`].
    pub cost: f64,
    /// Where the joined point goes.
    pub position: DVec3,
}

/// Cost of an edge that may not collapse.
pub(crate) const UNRANKED: f32 = f32::INFINITY;

/// Cost and placement of edge collapses.
pub(crate) trait Cost: Any + Send + Sync {
    /// Looks at the whole surface before a pass; `edges` are all its edges.
    fn refresh(&mut self, surface: &Surface, edges: &[Edge]);

    /// Judges the collapse of the edge between `a` and `b`, with the joined point at `fixed` if given; `None` if it has no finite cost.
    fn judge(&self, surface: &Surface, a: u32, b: u32, fixed: Option<DVec3>) -> Option<Candidate>;

    /// The candidate for the edge that `merge` has looked at.
    fn judge_merge(&self, surface: &Surface, merge: &Merge, fixed: Option<DVec3>) -> Option<Candidate> {
        self.judge(surface, merge.kept, merge.gone, fixed)
    }

    /// About what `edges` cost, to put them in order; [`UNRANKED`] where there is no candidate. As many `costs` as edges.
    fn rank(&self, surface: &Surface, edges: &[Edge], locked: &Locked, costs: &mut [f32]) {
        edges.iter().zip(costs).for_each(|(edge, cost)| *cost = self.rank_exactly(surface, edge, locked));
    }

    /// About what the edges from `hub` to the points around it cost; as many `costs` as points.
    fn rank_hub(&self, surface: &Surface, hub: u32, around: &[u32], costs: &mut [f32]) {
        for (&p, cost) in around.iter().zip(costs) {
            *cost = self.judge(surface, hub.min(p), hub.max(p), None).map_or(UNRANKED, |c| c.cost as f32);
        }
    }

    /// What an edge costs, as judged; [`UNRANKED`] where there is no candidate.
    fn rank_exactly(&self, surface: &Surface, edge: &Edge, locked: &Locked) -> f32 {
        let candidate =
            pinned(surface, locked, edge.a, edge.b).and_then(|pin| self.judge(surface, edge.a, edge.b, pin));
        candidate.map_or(UNRANKED, |c| c.cost as f32)
    }

    /// What attributes count; up to date as the rest is.
    fn metric(&self) -> &Metric;

    /// What it costs that `area` of the surface is off by the root of `distance_squared`: makes other changes comparable with collapses.
    fn weigh(&self, area: f64, distance_squared: f64) -> f64;

    /// How much the surface bends between two points, as a cylinder does: the variance of the normals around them. 0 where it is flat or creased, or
    /// nothing is known.
    fn bend(&self, _a: u32, _b: u32) -> f64 {
        0.0
    }

    /// Whether the source has nothing but needles between two points: then more of them are no loss.
    fn is_slender(&self, _a: u32, _b: u32) -> bool {
        false
    }

    /// How much an error counts where a piece around these points, of this squared diagonal, is lost.
    fn emphasis(&self, _points: &mut dyn Iterator<Item = u32>, _square: f64) -> f64 {
        1.0
    }

    /// Follows a collapse that was done: the faces at `spokes` are as in `fan` now.
    fn follow_faces(&mut self, _spokes: &[Corner], _fan: &Fan) {}

    /// Follows a collapse that was done: `gone` is part of `kept` now.
    fn merged(&mut self, surface: &Surface, kept: u32, gone: u32);

    /// Follows a collapse that bent the rules of topology: anything may have become of the edges around `kept`.
    fn broke(&mut self, _surface: &Surface, _kept: u32) {}

    /// Makes room for points that `surface` has and the cost has not met: those that a refinement made.
    fn grow(&mut self, _surface: &Surface) {}

    /// Brings what is known of one point up to date with the faces around it. The queues ask for it after each collapse, for the joined point,
    /// then for its neighbours.
    fn update(&mut self, surface: &Surface, point: u32);

    /// The same for a neighbour of a joined point, but what is known of attributes may stay as it was, and of the shape what judging does not need.
    fn update_shape(&mut self, surface: &Surface, point: u32) {
        self.update(surface, point);
    }

    /// After [`Self::update`] of a joined point and all around it: brings what depends on several of them up to date.
    fn settle(&mut self, _surface: &Surface, _point: u32) {}

    /// Whether [`Self::split`] may be called.
    fn is_separable(&self) -> bool {
        false
    }

    /// Costs for parts of the surface; each of them has to be [joined](Self::join) again.
    fn split(&mut self, _parts: &[(Region, Surface)]) -> Vec<Box<dyn Cost>> {
        Vec::new()
    }

    /// Brings what is known of points and faces into the caches.
    fn read_through(&self) {}

    /// Takes back what [`Self::split`] gave for parts of the surface, of `count` points now. A [refresh](Self::refresh) has to follow.
    fn join(&mut self, _parts: Vec<(&Region, Box<dyn Cost>)>, _count: usize) {}

    /// Whose edges cost something else after a collapse.
    fn reach(&self) -> Reach {
        Reach::Neighbours
    }
}

/// How far a collapse changes costs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reach {
    /// The edges at the joined point: what its neighbours know stays as it is.
    Point,
    /// The edges at its neighbours too: they know the shape around them.
    Neighbours,
}

/// A cost of which collapses to an end are taken only.
pub(crate) struct AtEnds(pub Box<dyn Cost>);

impl Cost for AtEnds {
    fn refresh(&mut self, surface: &Surface, edges: &[Edge]) {
        self.0.refresh(surface, edges);
    }

    fn judge(&self, surface: &Surface, a: u32, b: u32, fixed: Option<DVec3>) -> Option<Candidate> {
        let end = |p: u32| self.0.judge(surface, a, b, Some(surface.points[p as usize]));
        match fixed {
            Some(_) => self.0.judge(surface, a, b, fixed),
            None => [end(a), end(b)].into_iter().flatten().min_by(|a, b| a.cost.total_cmp(&b.cost)),
        }
    }

    fn metric(&self) -> &Metric {
        self.0.metric()
    }

    fn weigh(&self, area: f64, distance_squared: f64) -> f64 {
        self.0.weigh(area, distance_squared)
    }

    fn merged(&mut self, surface: &Surface, kept: u32, gone: u32) {
        self.0.merged(surface, kept, gone);
    }

    fn update(&mut self, surface: &Surface, point: u32) {
        self.0.update(surface, point);
    }

    fn settle(&mut self, surface: &Surface, point: u32) {
        self.0.settle(surface, point);
    }

    fn reach(&self) -> Reach {
        self.0.reach()
    }
}

/// Where the joined point of an edge has to go, if an end is locked; `None` if both are.
pub(crate) fn pinned(surface: &Surface, locked: &Locked, a: u32, b: u32) -> Option<Option<DVec3>> {
    match (locked.has(a), locked.has(b)) {
        (true, true) => None,
        (true, false) => Some(Some(surface.points[a as usize])),
        (false, true) => Some(Some(surface.points[b as usize])),
        (false, false) => Some(None),
    }
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
