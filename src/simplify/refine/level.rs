//! A level under refinement: which samples each face stands for, and what its errors are worth.

use super::patch::{Appraisal, Patch};
use super::peaks::find_worst;
use super::prices::Prices;
use super::source::{Foot, Source};
use crate::mesh::surface::Surface;
use glam::Vec3;
use smallvec::SmallVec;

/// How a move is judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Manner {
    /// By samples and points.
    Quick,
    /// By all places that the move changes.
    Thorough,
}

/// No sample; the end of a list.
pub(super) const NONE: u32 = u32::MAX;

/// Squared distance, relative to the mean, from which a foot found by walking is not trusted.
const SUSPICIOUS: f32 = 9.0;

pub(super) type Faces = SmallVec<[usize; 16]>;
pub(super) type Triangles = SmallVec<[[Vec3; 3]; 16]>;

/// Lists of samples by face (or point), and how far each is. Kept between levels.
#[derive(Debug, Default)]
pub(super) struct Lists {
    /// First sample of each face.
    pub head: Vec<u32>,
    /// For each sample the next of the same face.
    pub next: Vec<u32>,
    /// For each sample its squared distance: that to some place of the level, at most a little more than to the nearest.
    pub squared: Vec<f32>,
}

impl Lists {
    pub fn reset(&mut self, faces: usize, samples: usize) {
        self.head.clear();
        self.head.resize(faces, NONE);
        self.next.resize(samples, NONE);
        self.squared.resize(samples, 0.0);
    }

    pub fn push(&mut self, face: usize, sample: u32) {
        self.next[sample as usize] = self.head[face];
        self.head[face] = sample;
    }

    pub fn of(&self, face: usize) -> impl Iterator<Item = u32> + '_ {
        let mut at = self.head[face];
        std::iter::from_fn(move || {
            let found = (at != NONE).then_some(at)?;
            at = self.next[at as usize];
            Some(found)
        })
    }
}

pub(super) struct Level<'a> {
    pub surface: &'a mut Surface,
    pub source: &'a Source,
    pub lists: &'a mut Lists,
    pub patch: &'a mut Patch,
    /// For each point the closest of the source; face NONE for points without faces.
    pub feet: Vec<Foot>,
    pub prices: Prices,
}

impl Level<'_> {
    pub fn triangle(&self, face: usize) -> [Vec3; 3] {
        self.surface.triangle(face).map(|p| p.as_vec3())
    }

    pub fn point(&self, p: u32) -> Vec3 {
        self.surface.points[p as usize].as_vec3()
    }

    /// The source's closest point to `x`, walking from the face `start`. A walk that starts on the wrong side of a thin part or of a sharp edge ends
    /// there: where a foot is suspiciously far it is searched for.
    pub fn look_back(&self, x: Vec3, start: u32) -> Foot {
        let foot = self.source.walk(x, start);
        if foot.distance_squared > SUSPICIOUS * self.prices.mean_square { self.source.search(x, foot) } else { foot }
    }

    pub fn foot(&self, p: u32) -> Foot {
        self.feet[p as usize]
    }

    /// Puts the samples of these faces, which are `triangles`, into the patch; gives what they and the shapes cost.
    pub fn gather(&mut self, faces: &[usize], triangles: &[[Vec3; 3]]) -> Appraisal {
        self.patch.clear();
        for (k, &f) in faces.iter().enumerate() {
            self.patch.start_triangle(k);
            let mut at = self.lists.head[f];
            while at != NONE {
                self.patch.push(at, &self.source.samples[at as usize], self.lists.squared[at as usize]);
                at = self.lists.next[at as usize];
            }
        }
        let found = self.patch.measure_as_is(triangles, &self.prices);
        self.with_shapes(found, triangles)
    }

    /// What the patch's samples and the shapes cost with `triangles` in its place.
    pub fn appraise(&mut self, triangles: &[[Vec3; 3]]) -> Appraisal {
        let found = self.patch.measure(triangles, &self.prices);
        self.with_shapes(found, triangles)
    }

    fn with_shapes(&self, appraisal: Appraisal, triangles: &[[Vec3; 3]]) -> Appraisal {
        let shapes: f32 = triangles.iter().map(|t| self.prices.of_shape(t)).sum();
        Appraisal { cost: appraisal.cost + shapes, ..appraisal }
    }

    /// Mean and largest squared distance of the samples and points; `thorough`: the largest of places on the faces, too.
    pub fn error(&self, thorough: bool) -> (f32, f32) {
        let (mut squares, mut area, mut worst) = (0.0f64, 0.0f64, 0.0f32);
        for f in self.surface.live_faces() {
            for s in self.lists.of(f) {
                let (weight, squared) = (self.source.samples[s as usize].weight, self.lists.squared[s as usize]);
                squares += f64::from(weight * squared);
                area += f64::from(weight);
                worst = worst.max(squared);
            }
            worst = worst.max(if thorough { find_worst(self, f) } else { 0.0 });
        }
        for foot in &self.feet {
            worst = worst.max(foot.distance_squared);
        }
        ((squares / area.max(f64::MIN_POSITIVE)) as f32, worst)
    }

    /// Gives the patch's samples to `faces`, which are the triangles appraised last; `old` are the faces they came from.
    pub fn settle(&mut self, old: &[usize], faces: &[usize]) {
        for &f in old {
            self.lists.head[f] = NONE;
        }
        if self.lists.head.len() < self.surface.face_slots() {
            self.lists.head.resize(self.surface.face_slots(), NONE);
        }
        for (id, squared, which) in self.patch.found() {
            self.lists.squared[id as usize] = squared;
            self.lists.push(faces[which], id);
        }
    }

    /// The faces around `p` as triangles that start with it.
    pub fn fan(&self, p: u32) -> (Faces, Triangles) {
        let here = self.point(p);
        let ring = self.surface.ring(p);
        let faces = ring.iter().map(|&c| Surface::face_of(c)).collect();
        let triangle = |&c: &u32| {
            let [q, r] = self.surface.opposite(c);
            [here, self.point(q), self.point(r)]
        };
        (faces, ring.iter().map(triangle).collect())
    }
}

/// Unit normal; zero without area.
pub(super) fn unit_normal([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (*b - *a).cross(*c - *a).normalize_or_zero()
}

pub(super) fn area([a, b, c]: &[Vec3; 3]) -> f32 {
    (*b - *a).cross(*c - *a).length() * 0.5
}

pub(super) fn centre([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (*a + *b + *c) / 3.0
}
