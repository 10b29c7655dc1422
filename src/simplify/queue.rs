//! The strict schedule: one collapse at a time, always the cheapest edge of the whole surface.

use super::guard::Strictness;
use super::reducer::Reducer;
use super::{Stop, prune};
use crate::simplify::guard::Cause;
use smallvec::SmallVec;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// A collapse in the queue. Entries are never changed: one whose `version` is old is skipped.
#[derive(Debug, Clone, Copy)]
struct Entry {
    cost: f64,
    a: u32,
    b: u32,
    version: u32,
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.cost.total_cmp(&other.cost).then((self.a, self.b, self.version).cmp(&(other.a, other.b, other.version)))
    }
}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Entry {}

struct Queue {
    heap: BinaryHeap<Reverse<Entry>>,
    /// Raised whenever what is known about a point's edges becomes old.
    versions: Vec<u32>,
}

impl Queue {
    fn fill(reducer: &mut Reducer) -> Self {
        let edges = reducer.refresh();
        let mut queue =
            Self { heap: BinaryHeap::with_capacity(edges.len()), versions: vec![0; reducer.surface.points.len()] };
        for e in &edges {
            queue.push(reducer, e.a, e.b);
        }
        queue
    }

    fn push(&mut self, reducer: &mut Reducer, a: u32, b: u32) {
        if reducer.is_locked(a, b) {
            reducer.refusals.count(Cause::Border);
        }
        let (a, b) = (a.min(b), a.max(b));
        if let Some(candidate) = reducer.judge(a, b) {
            let version = self.version(a, b);
            self.heap.push(Reverse(Entry { cost: candidate.cost, a, b, version }));
        }
    }

    fn version(&self, a: u32, b: u32) -> u32 {
        self.versions[a as usize].wrapping_add(self.versions[b as usize])
    }
}

/// One collapse in so many faces may be done under relaxed rules before the strict ones are tried again.
const RELAXED_SHARE: usize = 200;

/// Reduces to `target` faces (± 1).
pub(crate) fn run(reducer: &mut Reducer, target: usize) -> Stop {
    let mut strictness = Strictness::Full;
    while reducer.surface.face_count() > target {
        let before = reducer.surface.face_count();
        drain(reducer, target, strictness);
        if reducer.surface.face_count() < before {
            strictness = Strictness::Full;
            continue;
        }
        strictness = match strictness {
            Strictness::Full => Strictness::Seams,
            Strictness::Seams => Strictness::Topology,
            Strictness::Topology => return Stop::Stuck,
        };
    }
    Stop::Target
}

/// Collapses until the target or the end of the queue. Refused edges come back when something next to them changes.
fn drain(reducer: &mut Reducer, target: usize, strictness: Strictness) {
    let mut queue = Queue::fill(reducer);
    let mut pieces = prune::cheap_pieces(&reducer.surface, f32::INFINITY).into_iter().peekable();
    let mut touched = vec![false; reducer.surface.points.len()];
    let mut relaxed = 0;
    while reducer.surface.face_count() > target {
        let Some(Reverse(entry)) = queue.heap.pop() else { return };
        if entry.version != queue.version(entry.a, entry.b) {
            continue;
        }
        while let Some(piece) = pieces.next_if(|p| p.cost <= entry.cost) {
            let left = reducer.surface.face_count().saturating_sub(target);
            prune::remove(&mut reducer.surface, &piece, left, &mut touched);
        }
        let left = reducer.surface.face_count().saturating_sub(target);
        let Some(candidate) = reducer.judge(entry.a, entry.b).filter(|_| left > 0) else { continue };
        if reducer.collapse((entry.a, entry.b), candidate, strictness, left + 1).is_ok() {
            touched[entry.a as usize] = true;
            requeue(&mut queue, reducer, entry.a, entry.b);
            // Relaxed rules apply to a few collapses; then the strict ones get their turn.
            relaxed += usize::from(strictness != Strictness::Full);
            if relaxed * RELAXED_SHARE > reducer.surface.face_count() {
                return;
            }
        }
    }
}

/// Judges anew every edge whose cost the collapse changed: those at the joined point and at its neighbours.
fn requeue(queue: &mut Queue, reducer: &mut Reducer, kept: u32, gone: u32) {
    let around = neighbours(reducer, kept);
    queue.versions[gone as usize] = queue.versions[gone as usize].wrapping_add(1);
    for &p in around.iter().chain(&[kept]) {
        reducer.cost.update(&reducer.surface, p);
        queue.versions[p as usize] = queue.versions[p as usize].wrapping_add(1);
    }
    for &p in around.iter().chain(&[kept]) {
        for q in neighbours(reducer, p) {
            // Edges between two changed points are met from both ends.
            if p < q || !(q == kept || around.contains(&q)) {
                queue.push(reducer, p, q);
            }
        }
    }
}

fn neighbours(reducer: &Reducer, point: u32) -> SmallVec<[u32; 16]> {
    let mut found = SmallVec::new();
    for &corner in reducer.surface.ring(point) {
        for p in reducer.surface.opposite(corner) {
            if !found.contains(&p) {
                found.push(p);
            }
        }
    }
    found
}
