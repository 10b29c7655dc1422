//! Which face of the level each sample belongs to: followed from where it was, not searched.
//!
//! Every sample has an anchor, a point of the level near it: at first a corner of its source face, later a corner of its face at the level before.
//! Collapses tell which point an anchor has become part of. From there the nearest face is a few steps downhill.

use super::crowd::{Crowd, Finding};
use super::level::Distance;
use super::lists::{Lists, NONE};
use super::nearest::NearestFace;
use super::source::{Foot, Source, closest_point};
use crate::mesh::surface::Surface;
use glam::Vec3;

/// Rounds in which samples move on to a nearer corner; the rest stays where it is, a little farther than need be.
const MOST_ROUNDS: usize = 6;

/// Squared distance, relative to the mean, from which a face found downhill is not trusted.
const SUSPICIOUS: f32 = 16.0;

/// Samples on their way from level to level.
#[derive(Debug)]
pub(super) struct Followed {
    /// For each sample a point of the level near it.
    pub anchors: Vec<u32>,
    /// How far each was when it was assigned last (squared).
    squared: Vec<f32>,
}

/// Samples by the point where they are looked for next.
struct ByPoint {
    /// The first one of each point, and for each the next of the same point.
    head: Vec<u32>,
    next: Vec<u32>,
}

impl ByPoint {
    fn push(&mut self, point: u32, sample: u32) {
        self.next[sample as usize] = std::mem::replace(&mut self.head[point as usize], sample);
    }
}

impl Followed {
    pub fn new(source: &Source) -> Self {
        let anchors: Vec<u32> = source.samples.iter().map(|s| source.corner(s)).collect();
        Self { squared: vec![f32::INFINITY; anchors.len()], anchors }
    }

    /// Finds the nearest faces of the `chosen` samples, and moves their anchors; those that moves may know of come into their faces' lists.
    pub fn assign(
        &mut self,
        surface: &Surface,
        source: &Source,
        chosen: impl Iterator<Item = usize>,
        lists: &mut Lists,
    ) {
        let mut found = self.go_downhill(surface, source, chosen);
        self.search_far_ones(surface, source, &mut found);
        let count = found.iter().take(source.held_out).filter(|&&face| face != NONE).count();
        lists.reset(surface.face_slots(), count);
        for (s, &face) in found.iter().enumerate().take(source.held_out) {
            if face != NONE {
                lists.push(face as usize, s as u32, &source.samples[s], self.squared[s]);
            }
        }
    }

    /// For each sample the face found from its anchor.
    fn go_downhill(&mut self, surface: &Surface, source: &Source, chosen: impl Iterator<Item = usize>) -> Vec<u32> {
        let (points, samples) = (surface.points.len(), source.samples.len());
        let mut by_point = ByPoint { head: vec![NONE; points], next: vec![NONE; samples] };
        for s in chosen {
            let anchor = surface.heir(self.anchors[s]);
            self.anchors[s] = anchor;
            self.squared[s] = f32::INFINITY;
            by_point.push(anchor, s as u32);
        }
        let mut found = vec![NONE; samples];
        let mut active: Vec<u32> = (0..points as u32).filter(|&p| by_point.head[p as usize] != NONE).collect();
        let mut triangles: Vec<[Vec3; 3]> = Vec::new();
        let mut crowd = Crowd::default();
        for _ in 0..MOST_ROUNDS {
            let mut moved = Vec::new();
            for &p in &active {
                let ring = surface.ring(p);
                triangles.clear();
                triangles.extend(ring.iter().map(|&c| surface.triangle(Surface::face_of(c)).map(|x| x.as_vec3())));
                crowd.clear();
                let mut at = std::mem::replace(&mut by_point.head[p as usize], NONE);
                while at != NONE {
                    crowd.push(at, source.samples[at as usize].position);
                    at = by_point.next[at as usize];
                }
                crowd.look_at(&triangles);
                for Finding { id, squared, which, corner, is_inside } in crowd.found() {
                    let s = id as usize;
                    if squared >= self.squared[s] {
                        continue;
                    }
                    self.squared[s] = squared;
                    let face = Surface::face_of(ring[which]);
                    found[s] = face as u32;
                    let corner = surface.face(face)[corner];
                    self.anchors[s] = corner;
                    if corner != p && !is_inside {
                        moved.push((corner, id));
                    }
                }
            }
            active.clear();
            for (p, s) in moved {
                if by_point.head[p as usize] == NONE {
                    active.push(p);
                }
                by_point.push(p, s);
            }
            if active.is_empty() {
                break;
            }
        }
        found
    }

    /// Samples that have ended suspiciously far from the surface may have gone down on the wrong side of a thin part: their nearest face is searched for.
    fn search_far_ones(&mut self, surface: &Surface, source: &Source, found: &mut [u32]) {
        let known = |&s: &usize| found[s] != NONE;
        let (sum, count) =
            (0..found.len()).filter(known).fold((0.0, 0), |(sum, n), s| (sum + f64::from(self.squared[s]), n + 1));
        let limit = SUSPICIOUS * (sum / f64::from(count.max(1))) as f32;
        let far: Vec<usize> = (0..found.len()).filter(known).filter(|&s| self.squared[s] > limit).collect();
        if far.is_empty() {
            return;
        }
        let triangle = |f: u32| surface.triangle(f as usize).map(|x| x.as_vec3());
        let faces: Vec<u32> = surface.live_faces().map(|f| f as u32).collect();
        let nearest = NearestFace::new(&faces, triangle);
        for s in far {
            let x = source.samples[s].position;
            let foot = nearest.find(x, Foot { distance_squared: self.squared[s], point: x, face: found[s] });
            (self.squared[s], found[s]) = (foot.distance_squared, foot.face);
            self.anchors[s] = surface.face(foot.face as usize)[weightiest_corner(triangle(foot.face), x)];
        }
    }

    /// How far these samples were when they were assigned.
    pub fn distance_of(&self, samples: impl Iterator<Item = usize>) -> Distance {
        let (mut squares, mut count, mut worst) = (0.0f64, 0usize, 0.0f32);
        for squared in samples.map(|s| self.squared[s]).filter(|squared| squared.is_finite()) {
            squares += f64::from(squared);
            count += 1;
            worst = worst.max(squared);
        }
        Distance { mean: (squares / count.max(1) as f64) as f32, worst }
    }

    /// Corners of the faces that samples lie on now become their anchors.
    pub fn move_anchors(&mut self, surface: &Surface, lists: &Lists) {
        for f in surface.live_faces() {
            let corners = surface.face(f);
            for s in lists.samples(f) {
                let anchor = &mut self.anchors[s as usize];
                if !corners.contains(anchor) {
                    *anchor = corners[0];
                }
            }
        }
    }
}

/// The corner whose share is largest at the closest point.
fn weightiest_corner(triangle: [Vec3; 3], x: Vec3) -> usize {
    let (_, shares, _) = closest_point(triangle, x);
    (1..3).fold(0, |best, k| if shares[k] > shares[best] { k } else { best })
}
