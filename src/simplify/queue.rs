//! The strict schedule: one collapse at a time, always the cheapest edge of the whole surface.

use super::prune;
use super::reducer::{Outcome, Reducer, Terms};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A cost as a key for sorting: costs are never negative, so their bits order as they do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Rank(u64);

impl Rank {
    fn of(cost: f64) -> Self {
        Self(cost.max(0.0).to_bits())
    }

    fn cost(self) -> f64 {
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
}

impl Queue {
    fn fill(reducer: &mut Reducer) -> Self {
        reducer.refresh();
        reducer.count_locked();
        let mut queue = Self {
            heap: BinaryHeap::with_capacity(reducer.edges.len()),
            versions: vec![0; reducer.surface.points.len()],
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
            prune::remove(&mut reducer.surface, &piece, left, |p| !touched[p as usize]);
            continue;
        };
        if entry.version != queue.version(entry.a, entry.b) {
            continue;
        }
        if let Some(piece) = pieces.next_if(|p| p.cost <= entry.rank.cost()) {
            prune::remove(&mut reducer.surface, &piece, left, |p| !touched[p as usize]);
            queue.heap.push(Reverse(entry));
            continue;
        }
        let Some(candidate) = reducer.judge(entry.a, entry.b) else { continue };
        let terms = Terms { paid: entry.paid, most: left + 1, limit: entry.rank.cost() };
        match reducer.collapse((entry.a, entry.b), candidate, terms) {
            Outcome::Done(_) => {
                touched[entry.a as usize] = true;
                requeue(&mut queue, reducer, entry.a, entry.b);
            }
            Outcome::Fined(cost) => queue.heap.push(Reverse(Entry { rank: Rank::of(cost), paid: true, ..entry })),
            Outcome::Later(cost) => queue.heap.push(Reverse(Entry { rank: Rank::of(cost), ..entry })),
            Outcome::Refused => {}
        }
    }
}

/// Judges anew every edge whose cost the collapse changed: those at the joined point and at its neighbours.
fn requeue(queue: &mut Queue, reducer: &mut Reducer, kept: u32, gone: u32) {
    let around = reducer.surface.neighbours(kept);
    queue.versions[gone as usize] = queue.versions[gone as usize].wrapping_add(1);
    for &p in around.iter().chain(&[kept]) {
        reducer.cost.update(&reducer.surface, p);
        queue.versions[p as usize] = queue.versions[p as usize].wrapping_add(1);
    }
    for &p in around.iter().chain(&[kept]) {
        for q in reducer.surface.neighbours(p) {
            // Edges between two changed points are met from both ends.
            if p < q || !(q == kept || around.contains(&q)) {
                queue.push(reducer, p, q);
            }
        }
    }
}
