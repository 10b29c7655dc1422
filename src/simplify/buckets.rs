//! A queue of collapses by cost, to a per cent or two: all that are about equally cheap share a bucket.
//!
//! Those that are known from the start are sorted once (counting sort, in their order within a bucket, so that what lies together on the surface
//! comes out together); those that come later go to lists. Adding and taking cost the same however many there are.

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
}

impl Default for Buckets {
    fn default() -> Self {
        Self { sorted: Vec::new(), next: 0, bucket: BUCKETS, left: vec![0; BUCKETS], lists: Lists::default() }
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
    /// Starts with `edges` that cost `costs` ≥ 0, ranked at time 0. Those that cost infinitely much are left out.
    pub fn fill(&mut self, edges: &[Edge], costs: &[f32]) {
        self.lists.clear();
        let finite = || edges.iter().zip(costs).filter(|(_, cost)| cost.is_finite());
        let range = finite().map(|(_, cost)| bucket_of(*cost));
        let (first, last) = range.fold((BUCKETS, 0), |(first, last), b| (first.min(b), last.max(b)));
        self.left[self.bucket.min(BUCKETS)..].fill(0);
        finite().for_each(|(_, cost)| self.left[bucket_of(*cost)] += 1);
        let mut count = 0;
        let place = |&left: &u32| {
            count += left;
            count - left
        };
        let mut places: Vec<u32> = self.left.get(first..=last).unwrap_or_default().iter().map(place).collect();
        self.sorted.resize(count as usize, [0; 2]);
        for (edge, cost) in finite() {
            let place = &mut places[bucket_of(*cost) - first];
            self.sorted[*place as usize] = [edge.a, edge.b];
            *place += 1;
        }
        (self.next, self.bucket) = (0, first);
    }

    /// Adds a collapse that costs `cost` ≥ 0.
    #[inline]
    pub fn push(&mut self, cost: f32, entry: Entry) {
        if self.lists.is_full() && self.next > 0 {
            // What was taken makes room.
            self.sorted.drain(..std::mem::take(&mut self.next));
            self.sorted.shrink_to_fit();
        }
        self.lists.push(bucket_of(cost), entry);
    }

    /// Takes one of the cheapest, with the most that it may cost, if its bucket is below `end`.
    #[inline]
    pub fn pop(&mut self, end: usize) -> Option<(Entry, f32)> {
        let listed = self.lists.first();
        let bucket = self.bucket.min(listed);
        let entry = if bucket >= end {
            return None;
        } else if bucket == listed {
            self.lists.pop(bucket)
        } else {
            let [a, b] = self.sorted[self.next];
            self.next += 1;
            self.left[bucket] -= 1;
            self.find_bucket();
            Entry { a, b, time: 0 }
        };
        Some((entry, f32::from_bits(((bucket as u32 + 1) << SHIFT) - 1)))
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

/// The entries that came later, linked by bucket.
#[derive(Debug)]
struct Lists {
    heads: Vec<u32>,
    entries: Vec<(Entry, u32)>,
    /// First of the entries that were taken and may be used again.
    free: u32,
    /// Which buckets are not empty, and a word below which all are.
    filled: Vec<u64>,
    low: usize,
}

impl Default for Lists {
    fn default() -> Self {
        let filled = vec![0; BUCKETS / 64];
        Self { heads: vec![NONE; BUCKETS], entries: Vec::new(), free: NONE, low: filled.len(), filled }
    }
}

impl Lists {
    fn clear(&mut self) {
        while let Some(bucket) = Some(self.first()).filter(|b| *b < BUCKETS) {
            self.heads[bucket] = NONE;
            self.filled[bucket / 64] &= !(1 << (bucket % 64));
        }
        self.entries.clear();
        self.free = NONE;
    }

    /// Whether one more entry takes more memory.
    fn is_full(&self) -> bool {
        self.free == NONE && self.entries.len() == self.entries.capacity()
    }

    fn push(&mut self, bucket: usize, entry: Entry) {
        let link = (entry, self.heads[bucket]);
        self.heads[bucket] = match self.entries.get_mut(self.free as usize) {
            Some(slot) => std::mem::replace(&mut self.free, std::mem::replace(slot, link).1),
            None => {
                if self.entries.len() == self.entries.capacity() {
                    // Doubling would leave half of what is the most memory of all unused.
                    self.entries.reserve_exact(self.entries.len() / 8 + 256);
                }
                self.entries.push(link);
                self.entries.len() as u32 - 1
            }
        };
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
        let at = self.heads[bucket];
        let slot = &mut self.entries[at as usize];
        let (entry, next) = *slot;
        slot.1 = std::mem::replace(&mut self.free, at);
        self.heads[bucket] = next;
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

    proptest! {
        #[test]
        fn all_come_out_by_cost(first in prop::collection::vec(0.0f32..1e6, 0..50), later in prop::collection::vec(0.0f32..1e-3, 0..50)) {
            let edge = |(_, a): (_, u32)| Edge { a, b: a + 1, kind: EdgeKind::default() };
            let edges: Vec<Edge> = first.iter().zip(0..).map(edge).collect();
            let mut queue = Buckets::default();
            queue.fill(&edges, &first);
            let taken = queue.pop(BUCKETS);
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
            while let Some((entry, most)) = queue.pop(BUCKETS) {
                let cost = if entry.a >= 1000 { later[entry.a as usize - 1000] } else { first[entry.a as usize] };
                prop_assert!(cost <= most && most <= cost * 1.02 + f32::MIN_POSITIVE, "{} {}", cost, most);
                found.push(most);
            }
            prop_assert!(found.is_sorted());
            prop_assert_eq!(found.len(), all.len());
        }
    }
}
