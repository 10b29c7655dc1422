//! The fast schedule: rank all edges, sort once, collapse from the cheap end, repeat.
//!
//! A point moves once in a pass. Points next to it are judged anew when their turn comes, so that costs are those of the surface as it is;
//! only the order is that of the pass's start.

use super::cost::UNRANKED;
use super::prune;
use super::reducer::{Outcome, Reducer, Terms};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::mem::take;

/// Share of all faces that a pass may take at least: small steps do not pay for the ranking of all edges.
const LEAST_SHARE: f64 = 0.3;

/// How far a pass may stray from the strict order of costs.
#[derive(Debug, Clone, Copy)]
struct Leeway {
    /// A pass may go this factor above the cost of the last collapse it aims at, since neighbours of a collapse have to wait.
    slack: f32,
    /// A collapse that turns out to cost this factor more than its edge was ranked at has to wait for its turn.
    reorder: f32,
}

/// For points that move: where they go makes up for their order.
const FOR_MOVING: Leeway = Leeway { slack: 3.0, reorder: 2.0 };
/// For points that stay: which of them stay is all there is to choose, and wider passes cost 5 % of the distance.
const FOR_STAYING: Leeway = Leeway { slack: 1.1, reorder: 1.1 };

/// Memory that passes share.
#[derive(Debug, Default)]
pub(crate) struct Workspace {
    costs: Vec<f32>,
    order: Vec<Turn>,
    points: Vec<State>,
}

/// What a pass has done to a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum State {
    /// Nothing that is not known.
    Fresh,
    /// A neighbour moved: what is known of the point is old.
    Stale,
    /// It moved, or is gone.
    Moved,
}

/// One pass towards `target` faces (± 1).
pub(crate) fn run_pass(reducer: &mut Reducer, workspace: &mut Workspace, target: usize) {
    reducer.refresh();
    reducer.rank(&mut workspace.costs);
    let mut turns = Turns::new(&workspace.costs, take(&mut workspace.order));
    let excess = reducer.surface.face_count() - target;
    let mut pieces = reducer.pieces().into_iter().peekable();
    let points = &mut workspace.points;
    points.clear();
    points.resize(reducer.surface.points.len(), State::Fresh);
    let leeway = if reducer.goes_to_ends() { FOR_STAYING } else { FOR_MOVING };
    let mut pace = Pace::new(excess, reducer.surface.face_count(), leeway.slack);
    let mut left = excess;
    while let Some(turn) = turns.next() {
        let cost = turn.cost();
        while let Some(piece) = pieces.next_if(|p| p.cost <= f64::from(cost)) {
            let removed = remove_piece(reducer, &piece, left, points);
            pace.take(removed);
            left -= removed;
        }
        if left == 0 || pace.is_over(cost) {
            break;
        }
        let edge = &reducer.edges[turn.edge as usize];
        let (a, b) = (edge.a, edge.b);
        if points[a as usize].max(points[b as usize]) == State::Moved {
            pace.count(cost);
            continue;
        }
        for p in [a, b] {
            if points[p as usize] == State::Stale {
                reducer.cost.update(&reducer.surface, p);
                points[p as usize] = State::Fresh;
            }
        }
        let Some(candidate) = reducer.judge(a, b) else { continue };
        // Compared as the turns are: what is nothing in single precision would come up again and again.
        if candidate.cost as f32 > cost * leeway.reorder {
            turns.defer(Turn { key: (candidate.cost as f32).to_bits(), ..turn });
            continue;
        }
        match reducer.collapse(
            (a, b),
            candidate,
            Terms { paid: turn.paid, most: left + 1, limit: f64::from(cost * leeway.reorder) },
        ) {
            Outcome::Done(removed) => {
                pace.count(cost);
                pace.take(removed);
                left = left.saturating_sub(removed);
                touch(reducer, a, points);
                points[b as usize] = State::Moved;
            }
            Outcome::Fined(cost) => turns.defer(Turn { key: (cost as f32).to_bits(), paid: true, ..turn }),
            Outcome::Later(cost) => turns.defer(Turn { key: (cost as f32).to_bits(), ..turn }),
            Outcome::Refused => {}
        }
    }
    // Nothing may collapse any more: then whole pieces have to go.
    if left == excess
        && let Some(piece) = pieces.next()
    {
        remove_piece(reducer, &piece, left, points);
    }
    workspace.order = turns.sorted;
}

fn touch(reducer: &Reducer, point: u32, points: &mut [State]) {
    let surface = &reducer.surface;
    for &corner in surface.ring(point) {
        for p in surface.opposite(corner) {
            points[p as usize] = points[p as usize].max(State::Stale);
        }
    }
    points[point as usize] = State::Moved;
}

/// Removes a piece that is as it was when the pass began; gives the faces removed.
fn remove_piece(reducer: &mut Reducer, piece: &prune::Piece, most: usize, points: &mut [State]) -> usize {
    prune::remove(&mut reducer.surface, piece, most, |p| points[p as usize] == State::Fresh)
}

/// An edge in the order of costs. Costs are never negative, so their bits order as they do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Turn {
    key: u32,
    edge: u32,
    paid: bool,
}

impl Turn {
    fn cost(self) -> f32 {
        f32::from_bits(self.key)
    }
}

/// Edges by cost: those sorted at the start, and those that were fined since.
struct Turns {
    sorted: Vec<Turn>,
    next: usize,
    deferred: BinaryHeap<Reverse<Turn>>,
}

impl Turns {
    /// `sorted` is memory to reuse.
    fn new(costs: &[f32], mut sorted: Vec<Turn>) -> Self {
        sorted.clear();
        let possible = costs.iter().enumerate().filter(|(_, cost)| **cost < UNRANKED);
        sorted.extend(possible.map(|(i, cost)| Turn { key: cost.to_bits(), edge: i as u32, paid: false }));
        // Exponent and eight bits of the mantissa: an order to 0.4 % is as good, and takes two sweeps.
        radsort::sort_by_key(&mut sorted, |turn| (turn.key >> 15) as u16);
        Self { sorted, next: 0, deferred: BinaryHeap::new() }
    }

    fn next(&mut self) -> Option<Turn> {
        match (self.sorted.get(self.next), self.deferred.peek()) {
            (Some(fresh), Some(Reverse(fined))) if fined < fresh => self.deferred.pop().map(|turn| turn.0),
            (None, _) => self.deferred.pop().map(|turn| turn.0),
            (Some(&fresh), _) => {
                self.next += 1;
                Some(fresh)
            }
        }
    }

    fn defer(&mut self, turn: Turn) {
        self.deferred.push(Reverse(turn));
    }
}

/// How far up the costs a pass goes: as far as a strict order would for the collapses aimed at, and a little further.
///
/// Only edges that collapsed or wait for a neighbour count. Refused ones stay at the cheap end pass after pass; counted, they would stop each
/// pass before anything else got its turn.
struct Pace {
    /// Edges, collapsed or waiting, until the limit is set.
    open: usize,
    slack: f32,
    limit: Option<f32>,
    /// Faces until the pass ends in any case.
    faces: usize,
}

impl Pace {
    fn new(excess: usize, faces: usize, slack: f32) -> Self {
        // A collapse takes two faces.
        let aim = (excess as f64 * 0.5).max(faces as f64 * 0.5 * LEAST_SHARE).ceil() as usize;
        Self { open: aim, slack, limit: None, faces: 2 * aim }
    }

    fn take(&mut self, faces: usize) {
        self.faces = self.faces.saturating_sub(faces);
    }

    fn count(&mut self, cost: f32) {
        self.open = self.open.saturating_sub(1);
        if self.open == 0 && self.limit.is_none() {
            self.limit = Some(cost * self.slack);
        }
    }

    fn is_over(&self, cost: f32) -> bool {
        self.faces == 0 || self.limit.is_some_and(|limit| cost > limit)
    }
}
