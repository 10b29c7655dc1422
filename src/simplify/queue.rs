//! The strict schedule: one collapse at a time, always the cheapest edge of the whole surface.

use super::cost::Reach;
use super::options::{Options, Placement};
use super::prune;
use super::reducer::{Outcome, Reducer, Terms};
use crate::error::{Error, Kind, Result};
use crate::mesh::Mesh;
use crate::mesh::surface::Surface;
use crate::progressive::Log;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

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

/// A collapse in the queue. Entries are never changed: one whose `version` is old is skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    rank: Rank,
    a: u32,
    b: u32,
    version: u32,
    paid: bool,
}

struct Queue {
    heap: BinaryHeap<Reverse<Entry>>,
    /// Raised whenever what is known about a point's edges becomes old.
    versions: Vec<u32>,
    /// Points with an edge that was refused or fined: it gets another chance when something next to it changes.
    waiting: Vec<bool>,
}

impl Queue {
    fn fill(reducer: &mut Reducer) -> Self {
        reducer.refresh();
        reducer.count_locked();
        let points = reducer.surface.points.len();
        let mut queue = Self {
            heap: BinaryHeap::with_capacity(reducer.edges.len()),
            versions: vec![0; points],
            waiting: vec![false; points],
        };
        for e in &reducer.edges {
            queue.push(reducer, e.a, e.b);
        }
        queue
    }

    fn push(&mut self, reducer: &Reducer, a: u32, b: u32) {
        let (a, b) = (a.min(b), a.max(b));
        if let Some(candidate) = reducer.judge(a, b) {
            let version = self.version(a, b);
            self.heap.push(Reverse(Entry { rank: Rank::of(candidate.cost), a, b, version, paid: false }));
        }
    }

    fn version(&self, a: u32, b: u32) -> u32 {
        self.versions[a as usize].wrapping_add(self.versions[b as usize])
    }
}

/// Collapses until `target` faces (± 1) or the end of the queue. Refused edges come back when something next to them changes.
pub(crate) fn drain(reducer: &mut Reducer, target: usize) {
    let mut queue = Queue::fill(reducer);
    let mut pieces = reducer.pieces().into_iter().peekable();
    let mut touched = vec![false; reducer.surface.points.len()];
    while let Some(left) = reducer.surface.face_count().checked_sub(target).filter(|left| *left > 0) {
        let Some(Reverse(entry)) = queue.heap.pop() else {
            // Nothing may collapse any more: then whole pieces have to go.
            let Some(piece) = pieces.next() else { return };
            remove_piece(reducer, &piece, left, &touched);
            continue;
        };
        if entry.version != queue.version(entry.a, entry.b) {
            continue;
        }
        if let Some(piece) = pieces.next_if(|p| p.cost <= entry.rank.cost()) {
            remove_piece(reducer, &piece, left, &touched);
            queue.heap.push(Reverse(entry));
            continue;
        }
        let Some(candidate) = reducer.judge(entry.a, entry.b) else { continue };
        let terms = Terms { paid: entry.paid, most: left + 1, limit: entry.rank.cost() };
        let outcome = reducer.collapse((entry.a, entry.b), candidate, terms);
        if let Outcome::Done { kept, gone } = outcome {
            touched[kept as usize] = true;
            requeue(&mut queue, reducer, kept, gone);
            continue;
        }
        [entry.a, entry.b].iter().for_each(|&p| queue.waiting[p as usize] = true);
        match outcome {
            Outcome::Fined(cost) => queue.heap.push(Reverse(Entry { rank: Rank::of(cost), paid: true, ..entry })),
            Outcome::Later(cost) => queue.heap.push(Reverse(Entry { rank: Rank::of(cost), ..entry })),
            Outcome::Done { .. } | Outcome::Refused => {}
        }
    }
}

/// Collapses down to `triangles`, or as far as it goes, and keeps what it takes to go back. Gives what is left, too.
///
/// # Errors
/// As [`simplify`](super::simplify).
pub(crate) fn record(mesh: &Mesh, options: &Options, triangles: usize) -> Result<(Log, Surface)> {
    mesh.validate()?;
    // The log knows no wedges that the end of an edge keeps.
    let options = &Options { placement: Placement::Optimal, ..options.clone() };
    let mut reducer = Reducer::with_log(mesh, options);
    let least = triangles.max(options.min_triangles);
    let mut before = usize::MAX;
    while reducer.surface.face_count() > least && reducer.surface.face_count() < before {
        before = reducer.surface.face_count();
        drain(&mut reducer, least);
    }
    let lost = || Error::new(Kind::Internal, "a run has lost its log");
    Ok((reducer.log.ok_or_else(lost)?.finished(), reducer.surface))
}

/// Removes a piece that nothing has changed since the queue was filled.
fn remove_piece(reducer: &mut Reducer, piece: &prune::Piece, most: usize, touched: &[bool]) {
    let surface = &mut reducer.surface;
    let is_as_it_was =
        |f: &u32| surface.is_live(*f as usize) && surface.face(*f as usize).iter().all(|&p| !touched[p as usize]);
    if !piece.faces.iter().all(is_as_it_was) || !prune::may_remove(surface, piece, most) {
        return;
    }
    if let Some(log) = &mut reducer.log {
        log.remove(surface, &piece.faces);
    }
    prune::remove(surface, piece, most);
}

/// Judges anew every edge whose cost the collapse changed: those at the joined point and, where costs reach so far, at its neighbours.
fn requeue(queue: &mut Queue, reducer: &mut Reducer, kept: u32, gone: u32) {
    let mut around = reducer.surface.neighbours(kept);
    around.insert(0, kept);
    around.iter().for_each(|&p| reducer.cost.update(&reducer.surface, p));
    around.iter().for_each(|&p| reducer.cost.settle(&reducer.surface, p));
    let everywhere = reducer.cost.reach() == Reach::Neighbours;
    around.retain(|p| everywhere || *p == kept || queue.waiting[*p as usize]);
    for &p in around.iter().chain(&[gone]) {
        queue.versions[p as usize] = queue.versions[p as usize].wrapping_add(1);
        queue.waiting[p as usize] = false;
    }
    for &p in &around {
        for q in reducer.surface.neighbours(p) {
            // Edges between two changed points are met from both ends.
            if p < q || !around.contains(&q) {
                queue.push(reducer, p, q);
            }
        }
    }
}
