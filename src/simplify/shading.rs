//! Normals of a level: those whose interpolation is nearest to the source's, with creases where that needs them.
//!
//! A source without hard edges turns its normals over narrow bands of faces. Once a band is gone, the faces on either side share normals that are
//! right for neither, and shading runs over what is flat. There a level gets a crease: more vertices, not more triangles.
//!
//! Source vertices stand for the area around them. Each is followed to the point it has become part of, and counts where it is closest to a face
//! there. Of each face only the moments are kept: with `b` the barycentric weights of its samples, `Mₖₗ = Σ w bₖ bₗ` and `Sₖ = Σ w bₖ n`, corner normals
//! `N` are off by `Σ w − 2 Σ Nₖ·Sₖ + Σ Mₖₗ Nₖ·Nₗ`. Two candidates, smooth and creased, are fitted all over; each point takes the crease only where
//! that brings its faces much nearer.

use super::refine::closest_point;
use crate::curvature::normal_and_area;
use crate::mesh::surface::{Corner, Surface};
use crate::mesh::wedges::{Column, normalize_directions};
use crate::mesh::{Mesh, Semantic};
use glam::Vec3;
use rayon::prelude::*;
use smallvec::SmallVec;

/// Source vertices for each point of a level: fewer do not say more than the collapses have solved, more cost time.
const SAMPLES: [usize; 2] = [3, 16];
/// Weight of the normal that a corner starts with, in areas of its face.
const PRIOR: f32 = 0.02;
/// Rounds of fitting.
const ROUNDS: usize = 3;
/// Cosine of the angle from which an edge may become a crease.
const CREASE: f32 = 0.7;
/// Faces around a point within this (cosine) of the first one have no such edge: half the angle.
const FLAT: f32 = 0.922;
/// Wedges of a point whose normals in the source are closer than this (cosine) share one: what parts them is no hard edge.
const SAME: f32 = 0.999;
/// A crease has to take away so much of the squared error around its point …
const GAIN: f32 = 0.5;
/// … and has to save so much as a mean over the area (a unit normal turned by 6°).
const LEAST_SAVING: f32 = 0.01;

/// The source's normals.
pub(super) struct Shading {
    column: Column,
    /// One a wedge.
    samples: Vec<Sample>,
}

struct Sample {
    position: Vec3,
    normal: Vec3,
    /// A third of the area of its faces.
    area: f32,
    point: u32,
    group: u32,
}

impl Shading {
    /// Of the source as a surface; `None` if it has no normals.
    pub fn new(surface: &Surface) -> Option<Self> {
        let is_normal = |c: &&Column| c.semantic == Semantic::Normal && c.width == 3;
        let column = *surface.wedges.columns().iter().find(is_normal)?;
        let mut samples: Vec<Sample> = (0..surface.wedges.len() as u32)
            .map(|w| Sample {
                position: Vec3::ZERO,
                normal: read_normal(surface, column, w),
                area: 0.0,
                point: 0,
                group: surface.wedges.group(w),
            })
            .collect();
        for face in surface.live_faces() {
            let (_, area) = normal_and_area(surface.triangle(face));
            for (wedge, point) in surface.face_wedges(face).into_iter().zip(surface.face(face)) {
                let sample = &mut samples[wedge as usize];
                (sample.point, sample.position) = (point, surface.points[point as usize].as_vec3());
                sample.area += area as f32 / 3.0;
            }
        }
        Some(Self { column, samples })
    }

    /// Fits the normals of `mesh`, which is `surface` as plain arrays.
    pub fn fit(&self, surface: &Surface, mesh: &mut Mesh) {
        if self.samples.len() < SAMPLES[0] * mesh.positions.len() {
            return;
        }
        let faces = self.gather(surface);
        let mut smooth = Normals::smooth(self, surface, &faces);
        let mut creased = Normals::creased(&smooth, surface, &faces);
        [&mut smooth, &mut creased].into_par_iter().for_each(|normals| normals.fit(&faces));
        smooth.take_creases(&creased, surface, &faces);
        smooth.fit(&faces);
        smooth.write(&faces, mesh);
    }

    /// Every face of the level with the samples that are closest to it.
    fn gather(&self, surface: &Surface) -> Vec<Face> {
        let mut order = vec![u32::MAX; surface.face_slots()];
        let mut faces: Vec<Face> = Vec::with_capacity(surface.face_count());
        for slot in surface.live_faces() {
            order[slot] = faces.len() as u32;
            faces.push(Face::new(surface, slot));
        }
        let step = (self.samples.len() / (SAMPLES[1] * surface.face_count() / 2).max(1)).max(1);
        let chosen = (0..self.samples.len()).into_par_iter().step_by(step).with_min_len(1024);
        let places: Vec<Option<(u32, [f32; 3])>> =
            chosen.map(|i| self.samples[i].place(surface, &faces, &order)).collect();
        for (sample, place) in self.samples.iter().step_by(step).zip(places) {
            if let Some((face, shares)) = place {
                faces[face as usize].add(sample, shares, sample.area * step as f32);
            }
        }
        faces
    }
}

fn read_normal(surface: &Surface, column: Column, wedge: u32) -> Vec3 {
    Vec3::from_slice(&surface.wedges.row(wedge)[column.offset..][..3]).normalize_or_zero()
}

impl Sample {
    /// The face around the point that this sample has become part of that is closest, and where.
    fn place(&self, surface: &Surface, faces: &[Face], order: &[u32]) -> Option<(u32, [f32; 3])> {
        let mut best = (f32::INFINITY, None);
        for &corner in surface.ring(surface.heir(self.point)) {
            let index = order[Surface::face_of(corner)];
            let face = &faces[index as usize];
            let height = face.normal.dot(self.position - face.triangle[0]);
            let is_farther = height * height >= best.0;
            if is_farther || face.group != self.group || face.normal.dot(self.normal) <= 0.0 {
                continue;
            }
            let (foot, shares, _) = closest_point(face.triangle, self.position);
            let distance = foot.distance_squared(self.position);
            if distance < best.0 {
                best = (distance, Some((index, shares)));
            }
        }
        best.1
    }
}

/// A face of the level and the moments of its samples.
struct Face {
    triangle: [Vec3; 3],
    normal: Vec3,
    area: f32,
    group: u32,
    weight: f32,
    /// Σ w bₖ n.
    pulls: [Vec3; 3],
    /// Σ w bₖ bₗ: 00, 11, 22, 12, 20, 01.
    products: [f32; 6],
}

impl Face {
    fn new(surface: &Surface, slot: usize) -> Self {
        let triangle = surface.triangle(slot);
        let (normal, area) = normal_and_area(triangle);
        Self {
            triangle: triangle.map(|p| p.as_vec3()),
            normal: normal.as_vec3(),
            area: area as f32,
            group: surface.wedges.group(surface.face_wedges(slot)[0]),
            weight: 0.0,
            pulls: [Vec3::ZERO; 3],
            products: [0.0; 6],
        }
    }

    fn add(&mut self, sample: &Sample, b: [f32; 3], weight: f32) {
        self.weight += weight;
        self.pulls.iter_mut().zip(b).for_each(|(pull, share)| *pull += sample.normal * (share * weight));
        let products = [b[0] * b[0], b[1] * b[1], b[2] * b[2], b[1] * b[2], b[2] * b[0], b[0] * b[1]];
        self.products.iter_mut().zip(products).for_each(|(sum, product)| *sum += product * weight);
    }

    /// What the samples want the normal of corner `k` to be, times the weight that comes with it; the others stay.
    fn wanted(&self, k: usize, n: [Vec3; 3]) -> (Vec3, f32) {
        let (next, last) = ((k + 1) % 3, (k + 2) % 3);
        (self.pulls[k] - n[next] * self.products[3 + last] - n[last] * self.products[3 + next], self.products[k])
    }

    fn error(&self, n: [Vec3; 3]) -> f32 {
        let p = &self.products;
        let pulls: f32 = n.iter().zip(&self.pulls).map(|(n, pull)| n.dot(*pull)).sum();
        let squares = p[0] * n[0].length_squared() + p[1] * n[1].length_squared() + p[2] * n[2].length_squared();
        let mixed = p[3] * n[1].dot(n[2]) + p[4] * n[2].dot(n[0]) + p[5] * n[0].dot(n[1]);
        (self.weight - 2.0 * pulls + squares + 2.0 * mixed).max(0.0)
    }
}

/// One normal for each class of corners.
struct Normals {
    /// Class of each corner of each face.
    classes: Vec<[u32; 3]>,
    values: Vec<Vec3>,
    /// What they are at the start.
    priors: Vec<Vec3>,
    /// The corners around each point: (face, corner), from one entry of `starts` to the next.
    corners: Vec<(u32, usize)>,
    starts: Vec<usize>,
}

impl Normals {
    /// The normals that the surface has: wedges of a point that have the same one share it.
    fn smooth(source: &Shading, surface: &Surface, faces: &[Face]) -> Self {
        let mut order = vec![0; surface.face_slots()];
        surface.live_faces().enumerate().for_each(|(index, slot)| order[slot] = index as u32);
        let mut normals = Self {
            classes: vec![[0; 3]; faces.len()],
            values: Vec::new(),
            priors: Vec::new(),
            corners: Vec::with_capacity(3 * faces.len()),
            starts: vec![0],
        };
        let mut originals: SmallVec<[Vec3; 4]> = SmallVec::new();
        for p in 0..surface.points.len() as u32 {
            let first = normals.values.len();
            originals.clear();
            for &corner in surface.ring(p) {
                let wedge = surface.wedge_at(corner);
                let now = read_normal(surface, source.column, wedge);
                let before = source.samples.get(wedge as usize).map_or(now, |sample| sample.normal);
                let known = originals.iter().position(|n: &Vec3| n.dot(before) > SAME);
                let class = first + known.unwrap_or(originals.len());
                if known.is_none() {
                    originals.push(before);
                    normals.values.push(now);
                }
                let (face, k) = (order[Surface::face_of(corner)], (corner & 3) as usize);
                normals.classes[face as usize][k] = class as u32;
                normals.corners.push((face, k));
            }
            normals.starts.push(normals.corners.len());
        }
        normals.priors.clone_from(&normals.values);
        normals
    }

    /// Other classes for the same corners: split at every edge sharp enough.
    fn creased(smooth: &Self, surface: &Surface, faces: &[Face]) -> Self {
        let mut normals = Self {
            classes: smooth.classes.clone(),
            values: smooth.values.clone(),
            priors: Vec::new(),
            corners: smooth.corners.clone(),
            starts: smooth.starts.clone(),
        };
        for p in (0..surface.points.len()).filter(|&p| smooth.starts[p] < smooth.starts[p + 1]) {
            let (ring, corners) = (surface.ring(p as u32), &smooth.corners[smooth.starts[p]..smooth.starts[p + 1]]);
            let normal = |corner: &(u32, usize)| faces[corner.0 as usize].normal;
            if corners.iter().any(|corner| normal(corner).dot(normal(&corners[0])) < FLAT) {
                normals.split(surface, ring, corners, faces);
            }
        }
        normals.priors.clone_from(&normals.values);
        normals
    }

    /// Gives each fan of faces around a point, from crease to crease, a class of its own.
    fn split(&mut self, surface: &Surface, ring: &[Corner], corners: &[(u32, usize)], faces: &[Face]) {
        let class = |normals: &Self, i: usize| normals.classes[corners[i].0 as usize][corners[i].1];
        let old: SmallVec<[u32; 16]> = (0..ring.len()).map(|i| class(self, i)).collect();
        let mut fans: SmallVec<[usize; 16]> = (0..ring.len()).collect();
        for i in 0..ring.len() {
            for j in 0..i {
                let (a, b) = (surface.opposite(ring[i]), surface.opposite(ring[j]));
                let [fi, fj] = [i, j].map(|i| &faces[corners[i].0 as usize]);
                let joined = (a[0] == b[1] || a[1] == b[0]) && old[i] == old[j] && fi.normal.dot(fj.normal) > CREASE;
                if joined && fans[i] != fans[j] {
                    let (from, to) = (fans[i].max(fans[j]), fans[i].min(fans[j]));
                    fans.iter_mut().filter(|fan| **fan == from).for_each(|fan| *fan = to);
                }
            }
        }
        for fan in 0..ring.len() {
            let of_fan = (0..ring.len()).filter(|&i| fans[i] == fan);
            let normal: Vec3 = of_fan.clone().map(|i| &faces[corners[i].0 as usize]).map(|f| f.normal * f.area).sum();
            let covers_class = of_fan.clone().count() == old.iter().filter(|c| **c == old[fan]).count();
            if covers_class || of_fan.clone().next().is_none() {
                continue;
            }
            self.values.push(normal.normalize_or_zero());
            of_fan.for_each(|i| self.classes[corners[i].0 as usize][corners[i].1] = self.values.len() as u32 - 1);
        }
    }

    fn at(&self, face: usize) -> [Vec3; 3] {
        self.classes[face].map(|class| self.values[class as usize])
    }

    /// Goes from the priors towards the least error; the steps are damped, as all normals move at once.
    fn fit(&mut self, faces: &[Face]) {
        let mut sums = vec![(Vec3::ZERO, 0.0_f32); self.values.len()];
        for _ in 0..ROUNDS {
            sums.fill((Vec3::ZERO, 0.0));
            for (f, face) in faces.iter().enumerate() {
                let normals = self.at(f);
                for (k, class) in self.classes[f].into_iter().enumerate() {
                    let ((wanted, weight), prior) = (face.wanted(k, normals), PRIOR * face.area);
                    let sum = &mut sums[class as usize];
                    sum.0 += wanted + self.priors[class as usize] * prior;
                    sum.1 += weight + prior;
                }
            }
            for (value, (sum, weight)) in self.values.iter_mut().zip(&sums) {
                let new = if *weight > 0.0 { *sum / *weight } else { *value };
                *value = (*value + (new - *value) * DAMPING).try_normalize().unwrap_or(*value);
            }
        }
    }

    /// Takes the classes of `creased` at the points where they are much better.
    fn take_creases(&mut self, creased: &Self, surface: &Surface, faces: &[Face]) {
        let error = |normals: &Self| -> Vec<f32> { (0..faces.len()).map(|f| faces[f].error(normals.at(f))).collect() };
        self.values.extend_from_slice(&creased.values[self.values.len()..]);
        self.priors.clone_from(&creased.priors);
        let (smooth_errors, creased_errors) = (error(self), error(creased));
        for p in 0..surface.points.len() {
            let corners = &self.corners[self.starts[p]..self.starts[p + 1]];
            let sum = |errors: &[f32]| -> f32 { corners.iter().map(|&(f, _)| errors[f as usize]).sum() };
            let (before, after) = (sum(&smooth_errors), sum(&creased_errors));
            let weight: f32 = corners.iter().map(|&(f, _)| faces[f as usize].weight).sum();
            if after > GAIN * before || before - after < LEAST_SAVING * weight {
                continue;
            }
            for &(f, k) in corners {
                let class = creased.classes[f as usize][k] as usize;
                self.values[class] = creased.values[class];
                self.classes[f as usize][k] = class as u32;
            }
        }
    }

    /// Writes the normals into the level; a vertex whose corners are of several classes becomes several.
    fn write(&self, faces: &[Face], mesh: &mut Mesh) {
        let mut class_of = vec![u32::MAX; mesh.positions.len()];
        let mut vertices: Vec<u32> = (0..mesh.positions.len() as u32).collect();
        let mut copies: hashbrown::HashMap<(u32, u32), u32> = hashbrown::HashMap::new();
        for (f, triangle) in mesh.triangles.iter_mut().enumerate().take(faces.len()) {
            for (vertex, class) in triangle.iter_mut().zip(self.classes[f]) {
                let known = &mut class_of[*vertex as usize];
                if *known == u32::MAX {
                    *known = class;
                } else if *known != class {
                    let original = *vertex;
                    *vertex = *copies.entry((original, class)).or_insert_with(|| {
                        vertices.push(original);
                        vertices.len() as u32 - 1
                    });
                }
            }
        }
        if !copies.is_empty() {
            let (triangles, groups) = (std::mem::take(&mut mesh.triangles), std::mem::take(&mut mesh.groups));
            *mesh = Mesh { triangles, groups, ..mesh.pick_vertices(&vertices) };
        }
        for attribute in mesh.attributes.iter_mut().filter(|a| a.semantic == Semantic::Normal && a.width == 3) {
            for (triangle, classes) in mesh.triangles.iter().zip(&self.classes) {
                for (&vertex, &class) in triangle.iter().zip(classes) {
                    let normal = self.values[class as usize];
                    if normal != Vec3::ZERO {
                        normal.write_to_slice(&mut attribute.values[3 * vertex as usize..][..3]);
                    }
                }
            }
        }
        normalize_directions(&mut mesh.attributes);
    }
}

/// Share of the way that a round of fitting goes.
const DAMPING: f32 = 0.7;
