//! The samples that each face stands for, four to a block: as moves want them, so that nothing is copied one by one for a candidate.

use super::source::Sample;
use crate::lanes::{LANES, Vec3x4, dot, minus};
use glam::Vec3;
use std::iter::successors;
use wide::f32x4;

/// No sample, no block; the end of a list.
pub(super) const NONE: u32 = u32::MAX;

/// Four samples, side by side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Four {
    pub position: Vec3x4,
    pub normal: Vec3x4,
    /// 0 in lanes without a sample.
    pub weight: f32x4,
    /// Squared distances to some place of the level, at most a little more than to the nearest; 0 in lanes without a sample.
    pub squared: f32x4,
    /// Samples; `NONE` in lanes without one.
    pub ids: [u32; LANES],
}

impl Four {
    /// One sample, four times; three of them do not count.
    pub fn new(id: u32, sample: &Sample, squared: f32) -> Self {
        let mut four = Self {
            position: sample.position.to_array().map(f32x4::splat),
            normal: sample.normal.to_array().map(f32x4::splat),
            weight: f32x4::ZERO,
            squared: f32x4::ZERO,
            ids: [NONE; LANES],
        };
        four.set(0, id, sample, squared);
        four
    }

    pub fn set(&mut self, lane: usize, id: u32, sample: &Sample, squared: f32) {
        for k in 0..3 {
            self.position[k].as_mut_array()[lane] = sample.position[k];
            self.normal[k].as_mut_array()[lane] = sample.normal[k];
        }
        self.weight.as_mut_array()[lane] = sample.weight;
        self.squared.as_mut_array()[lane] = squared;
        self.ids[lane] = id;
    }

    /// Takes over one sample of another four.
    fn take(&mut self, lane: usize, other: &Self, from: usize) {
        for k in 0..3 {
            self.position[k].as_mut_array()[lane] = other.position[k].as_array()[from];
            self.normal[k].as_mut_array()[lane] = other.normal[k].as_array()[from];
        }
        self.weight.as_mut_array()[lane] = other.weight.as_array()[from];
        self.squared.as_mut_array()[lane] = other.squared.as_array()[from];
        self.ids[lane] = other.ids[from];
    }

    /// The samples, by their lanes.
    pub fn samples(&self) -> impl Iterator<Item = (usize, u32)> + '_ {
        self.ids.iter().copied().enumerate().filter(|(_, id)| *id != NONE)
    }
}

#[derive(Debug, Clone, Copy)]
struct Block {
    four: Four,
    /// Lanes taken, and the next block of the same face: all but the first of a face are full.
    taken: usize,
    next: u32,
}

/// Lists of samples by face. Kept between levels.
#[derive(Debug)]
pub(super) struct Lists {
    /// First block of each face.
    heads: Vec<u32>,
    blocks: Vec<Block>,
    /// First of the blocks that no face has.
    free: u32,
}

impl Default for Lists {
    fn default() -> Self {
        Self { heads: Vec::new(), blocks: Vec::new(), free: NONE }
    }
}

impl Lists {
    /// Empty ones for so many faces, which will have about so many samples.
    pub fn reset(&mut self, faces: usize, samples: usize) {
        self.heads.clear();
        self.blocks.clear();
        self.blocks.reserve_exact(samples / LANES);
        self.free = NONE;
        self.grow(faces);
    }

    /// Makes room for new faces.
    pub fn grow(&mut self, faces: usize) {
        self.heads.resize(faces, NONE);
    }

    pub fn of(&self, face: usize) -> impl Iterator<Item = &Four> {
        let at = |block: u32| self.blocks.get(block as usize);
        successors(at(self.heads[face]), move |block| at(block.next)).map(|block| &block.four)
    }

    /// The samples of a face.
    pub fn samples(&self, face: usize) -> impl Iterator<Item = u32> {
        self.of(face).flat_map(|four| four.ids).filter(|id| *id != NONE)
    }

    pub fn push(&mut self, face: usize, id: u32, sample: &Sample, squared: f32) {
        match self.open(face) {
            Some(block) => {
                block.four.set(block.taken, id, sample, squared);
                block.taken += 1;
            }
            None => self.put_first(face, Block { four: Four::new(id, sample, squared), taken: 1, next: NONE }),
        }
    }

    /// Adds the sample in a lane of `four`.
    pub fn push_lane(&mut self, face: usize, four: &Four, lane: usize) {
        match self.open(face) {
            Some(block) => {
                block.four.take(block.taken, four, lane);
                block.taken += 1;
            }
            None => {
                let mut new = Four { weight: f32x4::ZERO, squared: f32x4::ZERO, ids: [NONE; LANES], ..*four };
                new.take(0, four, lane);
                self.put_first(face, Block { four: new, taken: 1, next: NONE });
            }
        }
    }

    /// Adds all four.
    pub fn push_four(&mut self, face: usize, four: &Four) {
        let mut new = Block { four: *four, taken: LANES, next: NONE };
        let first = self.heads[face];
        if self.open(face).is_none() {
            return self.put_first(face, new);
        }
        // The first block stays first, as it is not full.
        new.next = self.blocks[first as usize].next;
        self.blocks[first as usize].next = self.store(new);
    }

    /// Takes all samples from a face.
    pub fn empty(&mut self, face: usize) {
        let first = std::mem::replace(&mut self.heads[face], NONE);
        if first == NONE {
            return;
        }
        let mut last = first as usize;
        while self.blocks[last].next != NONE {
            last = self.blocks[last].next as usize;
        }
        self.blocks[last].next = std::mem::replace(&mut self.free, first);
    }

    /// The block of a face that has a free lane.
    fn open(&mut self, face: usize) -> Option<&mut Block> {
        self.blocks.get_mut(self.heads[face] as usize).filter(|block| block.taken < LANES)
    }

    fn put_first(&mut self, face: usize, block: Block) {
        let next = self.heads[face];
        self.heads[face] = self.store(Block { next, ..block });
    }

    fn store(&mut self, block: Block) -> u32 {
        match self.blocks.get_mut(self.free as usize) {
            Some(slot) => {
                let at = self.free;
                self.free = std::mem::replace(slot, block).next;
                at
            }
            None => {
                if self.blocks.len() == self.blocks.capacity() {
                    // Doubling would leave much of what is the most memory of all unused.
                    self.blocks.reserve_exact(self.blocks.len() / 8 + 64);
                }
                self.blocks.push(block);
                self.blocks.len() as u32 - 1
            }
        }
    }
}

/// The search for the sample nearest to a place.
pub(super) struct NearestSample {
    at: Vec3x4,
    squared: f32x4,
    ids: [u32; LANES],
}

impl NearestSample {
    pub fn to(place: Vec3) -> Self {
        Self { at: place.to_array().map(f32x4::splat), squared: f32x4::splat(f32::INFINITY), ids: [NONE; LANES] }
    }

    /// Looks at those of the four that look the way of `normal`; at all if that is zero.
    pub fn look_at(&mut self, four: &Four, normal: Vec3) {
        let offset = minus(four.position, self.at);
        let mut counts = four.weight.simd_gt(f32x4::ZERO);
        if normal != Vec3::ZERO {
            counts &= dot(four.normal, normal.to_array().map(f32x4::splat)).simd_gt(f32x4::ZERO);
        }
        let squared = counts.bitselect(dot(offset, offset), f32x4::splat(f32::INFINITY));
        let closer = squared.simd_lt(self.squared).to_bitmask();
        self.squared = self.squared.fast_min(squared);
        for (k, id) in self.ids.iter_mut().enumerate() {
            if closer >> k & 1 == 1 {
                *id = four.ids[k];
            }
        }
    }

    pub fn found(&self) -> Option<u32> {
        let squared = self.squared.as_array();
        let lane = (1..LANES).fold(0, |best, lane| if squared[lane] < squared[best] { lane } else { best });
        (self.ids[lane] != NONE).then_some(self.ids[lane])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample(id: u32) -> Sample {
        Sample { position: Vec3::splat(id as f32), weight: 1.0, normal: Vec3::Z, face: id }
    }

    fn sorted(lists: &Lists, face: usize) -> Vec<u32> {
        let mut ids: Vec<u32> = lists.samples(face).collect();
        ids.sort_unstable();
        ids
    }

    proptest! {
        #[test]
        fn samples_are_where_they_were_put(moves in prop::collection::vec((0usize..4, 0usize..4), 0..60)) {
            let mut lists = Lists::default();
            lists.reset(4, moves.len());
            let mut expected = vec![Vec::new(); 4];
            for (id, &(face, _)) in (0..).zip(&moves) {
                lists.push(face, id, &sample(id), id as f32);
                expected[face].push(id);
            }
            for &(from, to) in moves.iter().filter(|(from, to)| from != to) {
                let fours: Vec<Four> = lists.of(from).copied().collect();
                lists.empty(from);
                let gone = std::mem::take(&mut expected[from]);
                expected[to].extend(gone);
                for four in &fours {
                    if four.samples().count() == LANES {
                        lists.push_four(to, four);
                    } else {
                        four.samples().for_each(|(lane, _)| lists.push_lane(to, four, lane));
                    }
                }
            }
            for (face, ids) in expected.iter_mut().enumerate() {
                ids.sort_unstable();
                prop_assert_eq!(&sorted(&lists, face), ids);
                for (four, (lane, id)) in lists.of(face).flat_map(|four| four.samples().map(move |s| (four, s))) {
                    prop_assert_eq!(four.squared.as_array()[lane], id as f32);
                    prop_assert_eq!(four.position[1].as_array()[lane], id as f32);
                    prop_assert_eq!(four.weight.as_array()[lane], 1.0);
                }
            }
            let count = |four: &Four| four.weight.reduce_add();
            let all: f32 = (0..4).flat_map(|face| lists.of(face)).map(count).sum();
            prop_assert_eq!(all, moves.len() as f32);
        }
    }

    #[test]
    fn the_nearest_sample_that_looks_that_way() {
        let mut lists = Lists::default();
        lists.reset(1, 7);
        for id in 0..7 {
            let normal = if id == 3 { -Vec3::Z } else { Vec3::Z };
            lists.push(0, id, &Sample { normal, ..sample(id) }, 0.0);
        }
        let nearest = |normal: Vec3| {
            let mut search = NearestSample::to(Vec3::splat(3.2));
            lists.of(0).for_each(|four| search.look_at(four, normal));
            search.found()
        };
        assert_eq!((nearest(Vec3::Z), nearest(Vec3::ZERO), nearest(-Vec3::Z)), (Some(4), Some(3), Some(3)));
        assert_eq!(nearest(Vec3::X), None);
    }
}
