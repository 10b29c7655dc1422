//! The worst spots: where the level is farthest from the source, in either direction, edges flip and points move.

use super::flip::try_flip;
use super::level::{Level, Manner};
use super::relocate::relocate;
use crate::mesh::surface::Surface;
use smallvec::SmallVec;
use std::collections::BinaryHeap;

/// Squared distance from which a spot's neighbourhood pays for peaks, relative to the spot's own.
const PEAK_SHARE: f32 = 0.6;

/// A face by the distance of its worst spot: squared distances are never negative, so their bits order as they do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Ranked {
    squared: u32,
    face: u32,
    stamp: u32,
}

/// Works on up to `most` spots that are farther off than `enough` (squared), the worst first. Gives the largest squared distance left.
pub(super) fn lower_peaks(level: &mut Level, most: usize, enough: f32) -> f32 {
    let mut left = 0.0f32;
    let mut peaks = Peaks::new(level);
    for _ in 0..most {
        let Some((face, squared)) = peaks.pop(level) else { break };
        if squared <= enough {
            return left.max(squared);
        }
        level.prices.set_peak(squared * PEAK_SHARE);
        let corners = level.surface.face(face);
        let mut touched: SmallVec<[u32; 12]> = SmallVec::new();
        for k in 0..3 {
            if try_flip(level, corners[k], corners[(k + 1) % 3], Manner::Thorough) {
                touched.extend(corners);
            }
        }
        for p in corners {
            if relocate(level, p, Manner::Thorough) {
                touched.push(p);
            }
        }
        if touched.is_empty() {
            left = left.max(squared);
        } else {
            peaks.push_around(level, &touched);
        }
    }
    peaks.pop(level).map_or(left, |(_, squared)| left.max(squared))
}

/// Faces by their worst spots.
struct Peaks {
    heap: BinaryHeap<Ranked>,
    /// Of each face: entries with another stamp are out of date.
    stamps: Vec<u32>,
}

impl Peaks {
    fn new(level: &mut Level) -> Self {
        let faces: Vec<usize> = level.surface.live_faces().collect();
        let rank = |f: usize| Ranked { squared: level.spots(f).worst.to_bits(), face: f as u32, stamp: 0 };
        Self { heap: faces.into_iter().map(rank).collect(), stamps: vec![0; level.surface.face_slots()] }
    }

    fn pop(&mut self, level: &Level) -> Option<(usize, f32)> {
        while let Some(top) = self.heap.pop() {
            let face = top.face as usize;
            if level.surface.is_live(face) && self.stamps[face] == top.stamp {
                return Some((face, f32::from_bits(top.squared)));
            }
        }
        None
    }

    /// Ranks the faces at these points anew.
    fn push_around(&mut self, level: &mut Level, points: &[u32]) {
        let mut faces: Vec<usize> =
            points.iter().flat_map(|&p| level.surface.ring(p)).map(|&c| Surface::face_of(c)).collect();
        faces.sort_unstable();
        faces.dedup();
        for f in faces {
            self.stamps[f] += 1;
            let squared = level.spots(f).worst.to_bits();
            self.heap.push(Ranked { squared, face: f as u32, stamp: self.stamps[f] });
        }
    }
}
