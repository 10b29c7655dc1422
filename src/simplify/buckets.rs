//! A queue of collapses by cost, to a per cent or two: all that are about equally cheap share a bucket.
//!
//! Those that are known from the start are sorted once (counting sort, in their order within a bucket, so that what lies together on the surface
//! comes out together); those that come later go to lists. Adding and taking cost the same however many there are. What is so dear that its turn would
//! not come anyway need not be kept.

use crate::mesh::edges::Edge;

/// Bits of a cost below those that say which bucket it belongs to: the exponent and six bits of the mantissa do.
const SHIFT: u32 = 17;
/// How many there are: the end of all.
pub(crate) const BUCKETS: usize = 1 << (31 - SHIFT);

/// No entry; the end of a list.
const NONE: u32 = u32::MAX;

/// A collapse and when it was ranked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Entry {
    pub a: u32,
    pub b: u32,
    pub time: u32,
}

/// The queue.
#[derive(Debug)]
pub(crate) struct Buckets {
    /// The ends of the edges known from the start, the next one at `next`.
    sorted: Vec<[u32; 2]>,
    next: usize,
    /// The bucket of the next one; how many of each bucket are left.
    bucket: usize,
    left: Vec<u32>,
    lists: Lists,
    /// What costs so much or more is left out.
    limit: f32,
}

impl Default for Buckets {
    fn default() -> Self {
        Self {
            sorted: Vec::new(),
            next: 0,
            bucket: BUCKETS,
            left: vec![0; BUCKETS],
            lists: Lists::default(),
            limit: f32::INFINITY,
        }
    }
}

fn bucket_of(cost: f32) -> usize {
    // The bits of numbers that are not negative order as they do.
    (cost.to_bits() >> SHIFT) as usize
}

/// The least cost of a bucket.
pub(crate) fn least_of(bucket: usize) -> f32 {
    f32::from_bits((bucket as u32) << SHIFT)
}

impl Buckets {
    /// Starts with the cheapest `share` of the `edges` that cost `costs` ≥ 0, ranked at time 0. What costs more than those, or infinitely much, is left
    /// out, now and later.
    pub fn fill(&mut self, edges: &[Edge], costs: &[f32], share: f64) {
        self.lists.clear();
        self.left[self.bucket.min(BUCKETS)..].fill(0);
        let (mut first, mut last, mut finite) = (BUCKETS, 0, 0);
        for cost in costs.iter().filter(|cost| cost.is_finite()) {
            let bucket = bucket_of(*cost);
            (first, last, finite) = (first.min(bucket), last.max(bucket), finite + 1);
            self.left[bucket] += 1;
        }
        let (mut count, most) = (0, (share * f64::from(finite)).ceil() as u32);
        let mut places = Vec::with_capacity((last + 1).saturating_sub(first));
        for left in self.left.get_mut(first..=last).unwrap_or_default() {
            if count < most {
                places.push(count);
                count += *left;
            } else {
                *left = 0;
            }
        }
        self.limit = if count < finite { least_of(first + places.len()) } else { f32::INFINITY };
        self.sorted.resize(count as usize, [0; 2]);
        for (edge, cost) in edges.iter().zip(costs).filter(|(_, cost)| **cost < self.limit) {
            let place = &mut places[bucket_of(*cost) - first];
            self.sorted[*place as usize] = [edge.a, edge.b];
            *place += 1;
        }
        (self.next, self.bucket) = (0, first);
    }

    /// Whether anything may have been left out that has a cost.
    pub fn is_cut(&self) -> bool {
        self.limit < f32::INFINITY
    }

    /// Leaves out all from a bucket on, now and later.
    pub fn leave_out(&mut self, bucket: usize) {
        self.limit = self.limit.min(least_of(bucket.min(bucket_of(f32::INFINITY))));
    }

    /// Adds a collapse that costs `cost` ≥ 0.
    #[inline]
    pub fn push(&mut self, cost: f32, entry: Entry) {
        if cost < self.limit {
            self.insert(bucket_of(cost), entry);
        }
    }

    fn insert(&mut self, bucket: usize, entry: Entry) {
        if self.lists.is_full() && 2 * self.next > self.sorted.len() {
            // What was taken makes room.
            self.sorted.drain(..std::mem::take(&mut self.next));
            self.sorted.shrink_to_fit();
        }
        self.lists.push(bucket, entry);
    }

    /// Takes one of the cheapest that are wanted, with the most that it may cost, if its bucket is below `end`. Those that are not are dropped.
    #[inline]
    pub fn pop(&mut self, end: usize, is_wanted: impl Fn(Entry) -> bool) -> Option<(Entry, f32)> {
        let end = end.min(bucket_of(self.limit));
        let with_cost = |entry: Entry, bucket: usize| (entry, f32::from_bits(((bucket as u32 + 1) << SHIFT) - 1));
        loop {
            let listed = self.lists.first();
            while self.bucket < listed.min(end) {
                let bucket = self.bucket;
                let [a, b] = self.sorted[self.next];
                self.next += 1;
                self.left[bucket] -= 1;
                self.find_bucket();
                let entry = Entry { a, b, time: 0 };
                if is_wanted(entry) {
                    return Some(with_cost(entry, bucket));
                }
            }
            if listed >= end {
                return None;
            }
            let entry = self.lists.pop(listed);
            if is_wanted(entry) {
                return Some(with_cost(entry, listed));
            }
        }
    }

    /// How many of those known from the start are left in each bucket.
    pub fn counts(&self) -> &[u32] {
        &self.left
    }

    fn find_bucket(&mut self) {
        while self.left.get(self.bucket) == Some(&0) {
            self.bucket += 1;
        }
    }
}

/// Entries of one bucket, and the chunk that follows: a cache line.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct Chunk {
    entries: [Entry; CHUNK],
    next: u32,
}

/// Entries of a chunk. Those of a bucket mostly are of places far apart: one line for several of them.
const CHUNK: usize = 5;

/// The entries that came later: lists of chunks by bucket, of which only the first may not be full.
#[derive(Debug)]
struct Lists {
    /// For each bucket its first chunk and how many entries that has.
    heads: Vec<(u32, u32)>,
    chunks: Vec<Chunk>,
    /// First of the chunks that were emptied and may be used again.
    free: u32,
    /// Which buckets are not empty, and a word below which all are.
    filled: Vec<u64>,
    low: usize,
}

impl Default for Lists {
    fn default() -> Self {
        let filled = vec![0; BUCKETS / 64];
        Self { heads: vec![(NONE, 0); BUCKETS], chunks: Vec::new(), free: NONE, low: filled.len(), filled }
    }
}

impl Lists {
    fn clear(&mut self) {
        while let Some(bucket) = Some(self.first()).filter(|b| *b < BUCKETS) {
            self.heads[bucket] = (NONE, 0);
            self.filled[bucket / 64] &= !(1 << (bucket % 64));
        }
        self.chunks.clear();
        self.free = NONE;
    }

    /// Whether the next chunk takes more memory.
    fn is_full(&self) -> bool {
        self.free == NONE && self.chunks.len() == self.chunks.capacity()
    }

    fn push(&mut self, bucket: usize, entry: Entry) {
        let (at, count) = self.heads[bucket];
        match self.chunks.get_mut(at as usize).filter(|_| (count as usize) < CHUNK) {
            Some(chunk) => {
                chunk.entries[count as usize] = entry;
                self.heads[bucket].1 = count + 1;
            }
            None => self.push_chunk(bucket, Chunk { entries: [entry; CHUNK], next: at }),
        }
    }

    fn push_chunk(&mut self, bucket: usize, chunk: Chunk) {
        let at = match self.chunks.get_mut(self.free as usize) {
            Some(slot) => {
                let at = self.free;
                self.free = std::mem::replace(slot, chunk).next;
                at
            }
            None => {
                if self.chunks.len() == self.chunks.capacity() {
                    // Doubling would leave half of what is the most memory of all unused.
                    self.chunks.reserve_exact(self.chunks.len() / 3 + 64);
                }
                self.chunks.push(chunk);
                self.chunks.len() as u32 - 1
            }
        };
        self.heads[bucket] = (at, 1);
        self.filled[bucket / 64] |= 1 << (bucket % 64);
        self.low = self.low.min(bucket / 64);
    }

    /// The first bucket that is not empty, or [`BUCKETS`].
    fn first(&mut self) -> usize {
        while let Some(&word) = self.filled.get(self.low) {
            if word != 0 {
                return self.low * 64 + word.trailing_zeros() as usize;
            }
            self.low += 1;
        }
        BUCKETS
    }

    fn pop(&mut self, bucket: usize) -> Entry {
        let (at, count) = self.heads[bucket];
        let chunk = &mut self.chunks[at as usize];
        let entry = chunk.entries[count as usize - 1];
        if count > 1 {
            self.heads[bucket].1 = count - 1;
            return entry;
        }
        let next = std::mem::replace(&mut chunk.next, std::mem::replace(&mut self.free, at));
        self.heads[bucket] = if next == NONE { (NONE, 0) } else { (next, CHUNK as u32) };
        if next == NONE {
            self.filled[bucket / 64] &= !(1 << (bucket % 64));
        }
        entry
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::edges::EdgeKind;
    use proptest::prelude::*;

    #[test]
    fn dear_ones_are_left_out() {
        let costs = [4.0, 1.0, f32::INFINITY, 3.0, 2.0];
        let edges: Vec<Edge> = (0..5).map(|a| Edge { a, b: 9, kind: EdgeKind::default() }).collect();
        let mut queue = Buckets::default();
        queue.fill(&edges, &costs, 0.75);
        assert!(queue.is_cut());
        for (a, cost) in [(10, 2.5), (11, 5.0)] {
            queue.push(cost, Entry { a, b: 9, time: 1 });
        }
        let mut take_all = || std::iter::from_fn(|| queue.pop(BUCKETS, |entry| entry.a != 4)).collect::<Vec<_>>();
        assert_eq!(take_all().iter().map(|(entry, _)| entry.a).collect::<Vec<_>>(), [1, 10, 3]);
        queue.fill(&edges, &costs, 1.0);
        queue.leave_out(bucket_of(2.0));
        assert_eq!(queue.pop(BUCKETS, |_| true).map(|(entry, _)| entry.a), Some(1));
        assert_eq!(queue.pop(BUCKETS, |_| true), None);
    }

    proptest! {
        #[test]
        fn all_come_out_by_cost(first in prop::collection::vec(0.0f32..1e6, 0..50), later in prop::collection::vec(0.0f32..1e-3, 0..50)) {
            let edge = |(_, a): (_, u32)| Edge { a, b: a + 1, kind: EdgeKind::default() };
            let edges: Vec<Edge> = first.iter().zip(0..).map(edge).collect();
            let mut queue = Buckets::default();
            queue.fill(&edges, &first, 1.0);
            let taken = queue.pop(BUCKETS, |_| true);
            prop_assert_eq!(taken.is_some(), !first.is_empty());
            for (&cost, a) in later.iter().zip(1000..) {
                queue.push(cost, Entry { a, b: 0, time: 1 });
            }
            let mut all: Vec<f32> = first.iter().chain(&later).copied().collect();
            all.sort_by(f32::total_cmp);
            if taken.is_some() {
                all.remove(all.iter().position(|c| *c == first.iter().copied().fold(f32::INFINITY, f32::min)).unwrap_or(0));
            }
            let mut found = Vec::new();
            while let Some((entry, most)) = queue.pop(BUCKETS, |_| true) {
                let cost = if entry.a >= 1000 { later[entry.a as usize - 1000] } else { first[entry.a as usize] };
                prop_assert!(cost <= most && most <= cost * 1.02 + f32::MIN_POSITIVE, "{} {}", cost, most);
                found.push(most);
            }
            prop_assert!(found.is_sorted());
            prop_assert_eq!(found.len(), all.len());
        }
    }
}
