//! FMS's schedule: a queue of vertices, not edges; the lightest vertex is joined along its cheapest edge (Meng & Song 2007, §3.2).
//!
//! One entry a vertex, a third of what a queue of edges holds. A weight is recomputed for the joined vertex and its neighbours only; a vertex
//! further out keeps its old one until its turn, when its best edge is looked for anew.

use super::prune;
use super::queue::Rank;
use super::reducer::{Outcome, Reducer, Terms};
use smallvec::SmallVec;

/// Collapses until `target` faces (± 1) or the end of the queue. Refused edges come back when something next to them changes.
pub(crate) fn drain(reducer: &mut Reducer, target: usize) {
    let mut queue = Queue::fill(reducer);
    let mut pieces = reducer.pieces().into_iter().peekable();
    while let Some(left) = reducer.surface.face_count().checked_sub(target).filter(|left| *left > 0) {
        let Some(point) = queue.heap.pop() else {
            // Nothing may collapse any more: then whole pieces have to go.
            let Some(piece) = pieces.next() else { return };
            prune::remove(&mut reducer.surface, &piece, left);
            continue;
        };
        let Some(best) = queue.find_best(reducer, point) else { continue };
        if let Some(piece) = pieces.next_if(|p| p.cost <= best.rank.cost()) {
            prune::remove(&mut reducer.surface, &piece, left);
            queue.weigh(reducer, point);
            continue;
        }
        let (a, b) = (point.min(best.other), point.max(best.other));
        let Some(candidate) = reducer.judge(a, b) else { continue };
        let terms = Terms { paid: best.paid, most: left + 1, limit: best.rank.cost() };
        match reducer.collapse((a, b), candidate, terms) {
            Outcome::Done { kept, gone } => queue.follow(reducer, kept, gone),
            Outcome::Fined(cost) => queue.set_back(reducer, point, best.other, Some(Rank::of(cost)), true),
            Outcome::Later(cost) => queue.set_back(reducer, point, best.other, Some(Rank::of(cost)), best.paid),
            Outcome::Refused => queue.set_back(reducer, point, best.other, None, false),
        }
    }
}

/// The cheapest way for a vertex to go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Best {
    rank: Rank,
    other: u32,
    paid: bool,
}

/// An edge that was refused, by its other end.
#[derive(Debug, Clone, Copy)]
struct Refused {
    other: u32,
    /// What it may go for, if it may at all.
    price: Option<Rank>,
    /// A fine is in that.
    paid: bool,
}

/// The heap, and for each vertex the edges that were refused since something near changed.
struct Queue {
    heap: IndexedHeap,
    refused: Vec<SmallVec<[Refused; 1]>>,
}

impl Queue {
    fn fill(reducer: &mut Reducer) -> Self {
        reducer.refresh();
        reducer.count_locked();
        let points = reducer.surface.points.len();
        let mut queue = Self { heap: IndexedHeap::new(points), refused: vec![SmallVec::new(); points] };
        (0..points as u32).for_each(|p| queue.weigh(reducer, p));
        queue
    }

    fn find_best(&self, reducer: &Reducer, point: u32) -> Option<Best> {
        let refused = &self.refused[point as usize];
        let judge = |other: u32| {
            if let Some(edge) = refused.iter().find(|edge| edge.other == other) {
                return edge.price.map(|rank| Best { rank, other, paid: edge.paid });
            }
            let candidate = reducer.judge(point.min(other), point.max(other))?;
            Some(Best { rank: Rank::of(candidate.cost), other, paid: false })
        };
        reducer.surface.neighbours(point).into_iter().filter_map(judge).min()
    }

    /// Puts a vertex where its weight belongs; out of the heap if it cannot go.
    fn weigh(&mut self, reducer: &Reducer, point: u32) {
        match self.find_best(reducer, point) {
            Some(best) => self.heap.set(point, best.rank),
            None => self.heap.remove(point),
        }
    }

    fn set_back(&mut self, reducer: &Reducer, point: u32, other: u32, price: Option<Rank>, paid: bool) {
        let refused = &mut self.refused[point as usize];
        refused.retain(|edge| edge.other != other);
        refused.push(Refused { other, price, paid });
        self.weigh(reducer, point);
    }

    /// Weighs the joined vertex and its neighbours anew.
    fn follow(&mut self, reducer: &mut Reducer, kept: u32, gone: u32) {
        self.heap.remove(gone);
        let mut around = reducer.surface.neighbours(kept);
        around.insert(0, kept);
        around.iter().for_each(|&p| reducer.cost.update(&reducer.surface, p));
        around.iter().for_each(|&p| reducer.cost.settle(&reducer.surface, p));
        for &p in &around {
            self.refused[p as usize].clear();
            self.weigh(reducer, p);
        }
    }
}

/// A binary heap of vertices that knows where each is: one entry a vertex, whose weight may change. Equal weights go by index.
struct IndexedHeap {
    order: Vec<u32>,
    /// Place of each vertex in `order`; `ABSENT` if it is not there.
    places: Vec<u32>,
    ranks: Vec<Rank>,
}

const ABSENT: u32 = u32::MAX;

impl IndexedHeap {
    fn new(points: usize) -> Self {
        Self { order: Vec::with_capacity(points), places: vec![ABSENT; points], ranks: vec![Rank::of(0.0); points] }
    }

    fn pop(&mut self) -> Option<u32> {
        let first = *self.order.first()?;
        self.remove(first);
        Some(first)
    }

    fn set(&mut self, point: u32, rank: Rank) {
        self.ranks[point as usize] = rank;
        if self.places[point as usize] == ABSENT {
            self.places[point as usize] = self.order.len() as u32;
            self.order.push(point);
        }
        self.restore(self.places[point as usize] as usize);
    }

    fn remove(&mut self, point: u32) {
        let place = self.places[point as usize];
        if place == ABSENT {
            return;
        }
        self.order.swap_remove(place as usize);
        self.places[point as usize] = ABSENT;
        if let Some(&moved) = self.order.get(place as usize) {
            self.places[moved as usize] = place;
            self.restore(place as usize);
        }
    }

    fn key(&self, place: usize) -> (Rank, u32) {
        let point = self.order[place];
        (self.ranks[point as usize], point)
    }

    /// Moves the entry at `place` up or down until the heap is one again.
    fn restore(&mut self, mut place: usize) {
        while place > 0 && self.key(place) < self.key((place - 1) / 2) {
            self.swap(place, (place - 1) / 2);
            place = (place - 1) / 2;
        }
        loop {
            let children = (2 * place + 1..2 * place + 3).filter(|&child| child < self.order.len());
            match children.min_by_key(|&child| self.key(child)) {
                Some(child) if self.key(child) < self.key(place) => {
                    self.swap(place, child);
                    place = child;
                }
                _ => return,
            }
        }
    }

    fn swap(&mut self, a: usize, b: usize) {
        self.order.swap(a, b);
        self.places[self.order[a] as usize] = a as u32;
        self.places[self.order[b] as usize] = b as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_heap_gives_entries_in_order_through_changes_and_removals() {
        let mut heap = IndexedHeap::new(50);
        let weight = |p: u32| f64::from(p * 37 % 23);
        (0..50).for_each(|p| heap.set(p, Rank::of(weight(p))));
        (0..50).step_by(7).for_each(|p| heap.remove(p));
        (0..50).filter(|p| p % 5 == 1).for_each(|p| heap.set(p, Rank::of(40.0 - weight(p))));
        let mut expected: Vec<(Rank, u32)> = (0..50)
            .filter(|p| p % 7 != 0 || p % 5 == 1)
            .map(|p| (Rank::of(if p % 5 == 1 { 40.0 - weight(p) } else { weight(p) }), p))
            .collect();
        expected.sort();
        let popped: Vec<u32> = std::iter::from_fn(|| heap.pop()).collect();
        assert_eq!(popped, expected.iter().map(|e| e.1).collect::<Vec<_>>());
    }
}
