//! The worst spots: where the level is farthest from the source, in either direction, edges flip and points move.

use super::flip::try_flip;
use super::level::{Level, Manner, centre, unit_normal};
use super::relocate::relocate;
use super::source::Foot;
use crate::mesh::surface::Surface;
use glam::Vec3;
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

/// Works on up to `most` spots, the worst first. Not `thorough`: those that samples and points tell of. Gives the largest squared distance left.
pub(super) fn lower_peaks(level: &mut Level, fixed: &[bool], most: usize, thorough: bool) -> f32 {
    let mut left = 0.0f32;
    let mut peaks = Peaks::new(level, thorough);
    for _ in 0..most {
        let Some((face, squared)) = peaks.pop(level) else { break };
        level.prices.set_peak(squared * PEAK_SHARE);
        let corners = level.surface.face(face);
        let mut touched: SmallVec<[u32; 12]> = SmallVec::new();
        for k in 0..3 {
            if try_flip(level, corners[k], corners[(k + 1) % 3], Manner::Thorough) {
                touched.extend(corners);
            }
        }
        for p in corners {
            if !fixed[p as usize] && relocate(level, p, Manner::Thorough) {
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
    fn new(level: &mut Level, thorough: bool) -> Self {
        let faces: Vec<usize> = level.surface.live_faces().collect();
        let mut rank = |f: usize| {
            let worst = if thorough { level.worst(f) } else { find_worst_known(level, f) };
            Ranked { squared: worst.to_bits(), face: f as u32, stamp: 0 }
        };
        Self { heap: faces.into_iter().map(&mut rank).collect(), stamps: vec![0; level.surface.face_slots()] }
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
            let squared = level.worst(f).to_bits();
            self.heap.push(Ranked { squared, face: f as u32, stamp: self.stamps[f] });
        }
    }
}

/// The largest squared distance of a face's samples, corners, centre and middles of edges.
pub(super) fn find_worst(level: &Level, face: usize) -> f32 {
    let triangle = level.triangle(face);
    let [a, b, c] = triangle;
    let normal = unit_normal(&triangle);
    let feet = level.surface.face(face).map(|p| level.foot(p));
    let mut worst = find_worst_known(level, face);
    let mut look = |place: Vec3, start: u32| {
        worst = worst.max(look_back(level, face, place, normal, start).distance_squared);
    };
    look(centre(&triangle), feet[0].face);
    for (k, (p, q)) in [(a, b), (b, c), (c, a)].into_iter().enumerate() {
        look(p.midpoint(q), feet[k].face);
    }
    worst
}

/// The largest squared distance of a face's samples and corners.
fn find_worst_known(level: &Level, face: usize) -> f32 {
    let samples = level.lists.of(face).map(|s| level.lists.squared[s as usize]);
    samples.chain(level.surface.face(face).map(|p| level.foot(p).distance_squared)).fold(0.0, f32::max)
}

/// The source's closest point to a place on a face, from the face's nearest sample that looks its way or else from `start`.
fn look_back(level: &Level, face: usize, place: Vec3, normal: Vec3, start: u32) -> Foot {
    let mut best = (f32::INFINITY, start);
    for s in level.lists.of(face) {
        let sample = &level.source.samples[s as usize];
        let squared = sample.position.distance_squared(place);
        if squared < best.0 && sample.normal.dot(normal) > 0.0 {
            best = (squared, sample.face);
        }
    }
    level.look_back(place, best.1)
}
