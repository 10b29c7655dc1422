//! The fast schedule: rank all edges, sort once, collapse greedily where nothing nearby has changed in this pass, repeat.

use super::cost::Rank;
use super::prune;
use super::reducer::{Outcome, Reducer, Terms};
use crate::mesh::edges::Edge;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::iter::Peekable;

/// Share of the collapses still needed that one pass aims at: less means stricter order, more means fewer passes.
const PASS_SHARE: f64 = 0.5;
/// Share of all faces that a pass may take at least: small steps do not pay for the ranking of all edges.
const LEAST_SHARE: f64 = 0.03;
/// A pass may go this factor above the cost of the last collapse it aims at, since neighbours of a collapse have to wait.
const COST_SLACK: f64 = 1.5;

/// One pass towards `target` faces (± 1).
pub(crate) fn run_pass(reducer: &mut Reducer, target: usize) {
    let edges = reducer.refresh();
    let mut ranking = Ranking::new(reducer, &edges);
    let excess = reducer.surface.face_count() - target;
    let mut pieces = prune::pieces(&reducer.surface, &*reducer.cost).into_iter().peekable();
    let mut touched = vec![false; reducer.surface.points.len()];
    let mut pace = Pace::new(excess, reducer.surface.face_count());
    let mut left = excess;
    while let Some(r) = ranking.next() {
        let cost = r.rank.cost();
        while let Some(piece) = pieces.next_if(|p| p.cost <= cost) {
            let removed = prune::remove(&mut reducer.surface, &piece, left, &mut touched);
            pace.take(removed);
            left -= removed;
        }
        if left == 0 || pace.is_over(cost) {
            break;
        }
        let e = &edges[r.edge as usize];
        if touched[e.a as usize] || touched[e.b as usize] {
            pace.count(cost);
            continue;
        }
        let Some(candidate) = reducer.judge(e.a, e.b) else { continue };
        match reducer.collapse((e.a, e.b), candidate, Terms { paid: r.paid, most: left + 1 }) {
            Outcome::Done(removed) => {
                pace.count(cost);
                pace.take(removed);
                touch(reducer, e.a, &mut touched);
                touched[e.b as usize] = true;
                left = left.saturating_sub(removed);
            }
            Outcome::Fined(cost) => ranking.defer(Ranked { rank: Rank::of(cost), paid: true, ..r }),
            Outcome::Refused => {}
        }
    }
    // Nothing may collapse any more: then whole pieces have to go.
    if left == excess
        && let Some(piece) = pieces.next()
    {
        prune::remove(&mut reducer.surface, &piece, left, &mut touched);
    }
}

/// What was judged before a neighbour moved is stale: it waits for the next pass.
fn touch(reducer: &Reducer, point: u32, touched: &mut [bool]) {
    touched[point as usize] = true;
    let surface = &reducer.surface;
    for &corner in surface.ring(point) {
        surface.opposite(corner).iter().for_each(|&p| touched[p as usize] = true);
    }
}

/// A collapse in the order of costs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Ranked {
    rank: Rank,
    edge: u32,
    paid: bool,
}

/// Edges by cost: those sorted at the start, and those that were fined since.
struct Ranking {
    sorted: Peekable<std::vec::IntoIter<Ranked>>,
    deferred: BinaryHeap<Reverse<Ranked>>,
}

impl Ranking {
    fn new(reducer: &mut Reducer, edges: &[Edge]) -> Self {
        reducer.count_locked(edges);
        let judge = |(i, e): (usize, &Edge)| {
            let candidate = reducer.judge(e.a, e.b)?;
            Some(Ranked { rank: Rank::of(candidate.cost), edge: i as u32, paid: false })
        };
        let mut sorted: Vec<Ranked> = edges.par_iter().enumerate().filter_map(judge).collect();
        sorted.par_sort_unstable();
        Self { sorted: sorted.into_iter().peekable(), deferred: BinaryHeap::new() }
    }

    fn next(&mut self) -> Option<Ranked> {
        match (self.sorted.peek(), self.deferred.peek()) {
            (Some(fresh), Some(Reverse(fined))) if fined < fresh => self.deferred.pop().map(|r| r.0),
            (None, _) => self.deferred.pop().map(|r| r.0),
            _ => self.sorted.next(),
        }
    }

    fn defer(&mut self, ranked: Ranked) {
        self.deferred.push(Reverse(ranked));
    }
}

/// How far up the costs a pass goes: as far as a strict order would for the collapses aimed at, and a little further.
///
/// Only edges that collapsed or wait for a neighbour count. Refused ones stay at the cheap end pass after pass; counted, they would stop each
/// pass before anything else got its turn.
struct Pace {
    /// Edges, collapsed or waiting, until the limit is set.
    open: usize,
    limit: Option<f64>,
    /// Faces until the pass ends in any case.
    faces: usize,
}

impl Pace {
    fn new(excess: usize, faces: usize) -> Self {
        // A collapse takes two faces.
        let aim = (excess as f64 * 0.5 * PASS_SHARE).max(faces as f64 * 0.5 * LEAST_SHARE).ceil() as usize;
        Self { open: aim, limit: None, faces: 2 * aim }
    }

    fn take(&mut self, faces: usize) {
        self.faces = self.faces.saturating_sub(faces);
    }

    fn count(&mut self, cost: f64) {
        self.open = self.open.saturating_sub(1);
        if self.open == 0 && self.limit.is_none() {
            self.limit = Some(cost * COST_SLACK);
        }
    }

    fn is_over(&self, cost: f64) -> bool {
        self.faces == 0 || self.limit.is_some_and(|limit| cost > limit)
    }
}
