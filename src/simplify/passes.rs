//! The fast schedule: all edges are ranked at once and collapse from the cheap end; those around a joined point are ranked again and take their new
//! turns. Costs of edges a little further away are looked at when their turn comes: they may have risen, then they wait for the new one.

mod parts;

use super::buckets::{BUCKETS, Buckets, Entry};
use super::cost::UNRANKED;
use super::options::Effort;
use super::prune::{self, Piece};
use super::reducer::{Outcome, Reducer, Terms};
use crate::mesh::edges::Edge;
use std::iter::Peekable;
use std::mem::take;
use std::vec::IntoIter;

/// Everything is looked at anew when so much of the faces is left.
const REFILL: f64 = 0.4;
/// Share of the edges that the queue keeps, the cheapest: on the way there no more than four of five were ever needed, and most of those that are ranked
/// again are dearer.
const KEPT: f64 = 0.85;

/// How closely the order of costs is kept.
#[derive(Debug, Clone, Copy)]
struct Order {
    /// What edges are ranked at, relative to the estimate of their costs: that is mostly too high, and who comes too early waits for the real cost.
    trust: f32,
    /// A collapse that turns out to cost this factor more than its edge was ranked at has to wait for its turn.
    reorder: f32,
    /// Share of the edges that is kept: all of them where they are ranked below their costs.
    kept: f64,
    /// What is known of the attributes of a point stays as it is when a neighbour moves.
    attributes_lag: bool,
}

impl Order {
    /// `is_start`: whether nothing has collapsed yet.
    fn of(reducer: &Reducer, is_start: bool) -> Self {
        let (trust, reorder, kept, attributes_lag) = match (reducer.goes_to_ends(), reducer.effort()) {
            // Which points stay is all there is to choose: their attributes are always as they are now.
            (true, _) => (1.0, 1.3, KEPT, reducer.cost.metric().is_empty()),
            (_, Effort::Fast) if reducer.cost.metric().is_empty() => (1.0, 1.7, KEPT, false),
            (_, Effort::Fast) => (1.0, 1.25, KEPT, true),
            // The collapses that follow make up for what these do, but not for attributes.
            (_, Effort::Default) if is_start && reducer.cost.metric().is_empty() => (0.8, 1.3, KEPT, false),
            (_, Effort::Default) => (0.6, 1.1, 1.0, false),
            (_, Effort::Best) => (0.4, 1.02, 1.0, false),
        };
        Self { trust, reorder, kept, attributes_lag }
    }
}

/// In the time of an entry whose cost has the fine in it.
const PAID: u32 = 1 << 31;
/// In the mark of a point.
const STALE: u32 = 1 << 31;
/// Mark of a point that is gone.
const GONE: u32 = PAID - 1;

/// What the schedule knows between two calls.
#[derive(Debug)]
pub(crate) struct Workspace {
    /// Of the last fill; `None` before there was one.
    order: Option<Order>,
    queue: Buckets,
    costs: Vec<f32>,
    /// Around the last joined point.
    around: Vec<u32>,
    pieces: Peekable<IntoIter<Piece>>,
    /// When each point was joined last, and whether a neighbour has moved since it was looked at ([`STALE`]).
    marks: Vec<u32>,
    /// Collapses since everything was looked at.
    time: u32,
    /// Number of faces down to which the queue serves; `None` before it was filled.
    serves_to: Option<usize>,
    /// Whether the queue was empty too early, as dear edges had been left out.
    needs_all: bool,
}

/// Collapses until `target` faces (± 1), or nothing may collapse any more.
pub(crate) fn run(reducer: &mut Reducer, workspace: &mut Workspace, target: usize) {
    while reducer.surface.face_count() > target {
        let limit = match workspace.serves_to {
            Some(limit) if reducer.surface.face_count() > limit && !parts::is_worthwhile(reducer, target) => limit,
            _ => workspace.fill(reducer, target),
        };
        if workspace.drain(reducer, target, target.max(limit), BUCKETS) {
            continue;
        }
        // The queue is empty.
        workspace.serves_to = None;
        workspace.needs_all = workspace.queue.is_cut();
        if workspace.time == 0 && !workspace.needs_all {
            // Nothing may collapse any more: then whole pieces have to go.
            let Some(piece) = workspace.pieces.next() else { return };
            let left = reducer.surface.face_count() - target;
            if prune::remove(&mut reducer.surface, &piece, left) == 0 {
                return;
            }
        }
    }
}

impl Default for Workspace {
    fn default() -> Self {
        Self {
            order: None,
            queue: Buckets::default(),
            costs: Vec::new(),
            around: Vec::new(),
            pieces: Vec::new().into_iter().peekable(),
            marks: Vec::new(),
            time: 0,
            serves_to: None,
            needs_all: false,
        }
    }
}

impl Workspace {
    /// Forgets what it knows, as the surface has become another one.
    pub fn forget(&mut self) {
        self.serves_to = None;
    }

    /// Looks at everything, in parts first where that is worth it; gives the number of faces down to which it serves.
    fn fill(&mut self, reducer: &mut Reducer, target: usize) -> usize {
        let mut order = Order::of(reducer, self.order.is_none());
        let limit = |reducer: &Reducer| (reducer.surface.face_count() as f64 * REFILL) as usize;
        let mut is_going_on = true;
        while is_going_on && parts::is_worthwhile(reducer, target) {
            let next = target.max(limit(reducer));
            is_going_on = parts::reduce(reducer, next, order);
            order = Order::of(reducer, false);
        }
        let share = if take(&mut self.needs_all) { 1.0 } else { order.kept };
        self.look_at_all(reducer, order, reducer.surface.points.len(), share);
        self.pieces = reducer.pieces().into_iter().peekable();
        let limit = limit(reducer);
        self.serves_to = Some(limit);
        limit
    }

    /// Looks at everything, and keeps the cheapest `share` of it. Points from `inner` on stay as they are.
    fn look_at_all(&mut self, reducer: &mut Reducer, order: Order, inner: usize, share: f64) {
        self.order = Some(order);
        reducer.refresh();
        reducer.rank(&mut self.costs);
        self.costs.iter_mut().for_each(|cost| *cost *= order.trust);
        let points = reducer.surface.points.len();
        if inner < points {
            let is_inner = |edge: &Edge| (edge.a.max(edge.b) as usize) < inner;
            let edges = reducer.edges.iter().zip(&mut self.costs);
            edges.filter(|(edge, _)| !is_inner(edge)).for_each(|(_, cost)| *cost = UNRANKED);
        }
        self.queue.fill(&reducer.edges, &self.costs, share);
        // All that is needed of them is in the queue: on large meshes this is the most memory that is ever held.
        (reducer.edges, self.costs) = Default::default();
        self.marks.clear();
        self.marks.resize(inner, 0);
        self.marks.resize(points, GONE);
        self.time = 0;
    }

    /// Collapses down to `limit` faces, `target` at the end of all, by the buckets below `end`; gives whether there are so few now.
    fn drain(&mut self, reducer: &mut Reducer, target: usize, limit: usize, end: usize) -> bool {
        let Some(order) = self.order else { return true };
        while reducer.surface.face_count() > limit {
            let joined = |p: u32| self.marks[p as usize] & !STALE;
            let is_current = |entry: Entry| entry.time & !PAID >= joined(entry.a).max(joined(entry.b));
            let Some((entry, cost)) = self.queue.pop(end, is_current) else { return false };
            let left = reducer.surface.face_count() - target;
            if let Some(piece) = self.pieces.next_if(|p| p.cost <= f64::from(cost)) {
                prune::remove(&mut reducer.surface, &piece, left);
                self.queue.push(cost, entry);
                continue;
            }
            let (a, b, time) = (entry.a, entry.b, entry.time & !PAID);
            for p in [a, b] {
                let mark = &mut self.marks[p as usize];
                if *mark & STALE != 0 {
                    *mark &= !STALE;
                    if order.attributes_lag {
                        reducer.cost.update_shape(&reducer.surface, p);
                    } else {
                        reducer.cost.update(&reducer.surface, p);
                    }
                }
            }
            let Some(candidate) = reducer.look_and_judge(a, b) else { continue };
            let most = cost * order.reorder;
            if candidate.cost as f32 > most {
                self.queue.push(candidate.cost as f32, entry);
                continue;
            }
            let terms = Terms { paid: entry.time != time, most: left + 1, limit: f64::from(most) };
            match reducer.collapse_looked_at(candidate, terms) {
                Outcome::Done { kept, gone } => self.requeue(reducer, order.trust, kept, gone),
                Outcome::Fined(cost) => self.queue.push(cost as f32, Entry { time: time | PAID, ..entry }),
                Outcome::Later(cost) => self.queue.push(cost as f32, entry),
                Outcome::Refused => {}
            }
        }
        true
    }

    /// Ranks the edges of a joined point anew.
    fn requeue(&mut self, reducer: &mut Reducer, trust: f32, kept: u32, gone: u32) {
        self.time += 1;
        self.marks[kept as usize] = self.time;
        self.marks[gone as usize] = GONE;
        reducer.cost.update(&reducer.surface, kept);
        reducer.rank_joined(&mut self.around, &mut self.costs);
        for (&other, &cost) in self.around.iter().zip(&self.costs) {
            let mark = &mut self.marks[other as usize];
            *mark |= STALE;
            if *mark != GONE | STALE {
                self.queue.push(cost * trust, Entry { a: kept.min(other), b: kept.max(other), time: self.time });
            }
        }
    }
}
