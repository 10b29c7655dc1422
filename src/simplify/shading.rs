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
use crate::mesh::surface::{Corner, Frame, Surface};
use crate::mesh::wedges::{Column, normalize_directions};
use crate::mesh::{Mesh, Semantic};
use glam::Vec3;
use rayon::prelude::*;
use smallvec::SmallVec;

/// Source vertices for each point of a level: fewer do not say more than the collapses have solved, more cost time.
const SAMPLES: [usize; 2] = [3, 16];
/// Samples that are looked at before any of them is added to its face.
const CHUNK: usize = 4096;
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
pub(super) struct Shading<'a> {
    column: Column,
    source: Source<'a>,
    /// One a wedge.
    samples: Vec<Sample>,
}

/// Where samples are looked up.
struct Source<'a> {
    mesh: &'a Mesh,
    normals: &'a [f32],
    frame: Frame,
}

struct Sample {
    vertex: u32,
    /// The point that it was at.
    point: u32,
    /// A third of the area of its faces.
    area: f32,
}

/// A sample as a level sees it.
struct Spot {
    position: Vec3,
    normal: Vec3,
    group: u32,
}

impl<'a> Shading<'a> {
    /// Of the source, also as a surface; `None` if it has no normals.
    pub fn new(mesh: &'a Mesh, surface: &Surface) -> Option<Self> {
        let is_normal = |c: &&Column| c.semantic == Semantic::Normal && c.width == 3;
        let column = *surface.wedges.columns().iter().find(is_normal)?;
        let normals = &mesh.attribute(Semantic::Normal)?.values;
        let sample = |wedge| Sample { vertex: surface.wedges.origin(wedge), point: 0, area: 0.0 };
        let mut samples: Vec<Sample> = (0..surface.wedges.len() as u32).map(sample).collect();
        for face in surface.live_faces() {
            let (_, area) = normal_and_area(surface.triangle(face));
            for (wedge, point) in surface.face_wedges(face).into_iter().zip(surface.face(face)) {
                let sample = &mut samples[wedge as usize];
                sample.point = point;
                sample.area += area as f32 / 3.0;
            }
        }
        Some(Self { column, source: Source { mesh, normals, frame: surface.frame }, samples })
    }

    /// The normal that a wedge had in the source, if it is one of the source's.
    fn normal_before(&self, wedge: u32) -> Option<Vec3> {
        self.samples.get(wedge as usize).map(|sample| self.source.normal(sample.vertex))
    }

    /// Fits the normals of `mesh`, which is `surface` as plain arrays.
    pub fn fit(&self, surface: &Surface, mesh: &mut Mesh) {
        if self.samples.len() < SAMPLES[0] * mesh.positions.len() {
            return;
        }
        let order = number_faces(surface);
        let faces = self.gather(surface, &order);
        let mut smooth = Normals::smooth(self, surface, &order);
        let mut creased = Normals::creased(&smooth, surface, &faces);
        if creased.values.len() == smooth.values.len() {
            smooth.fit(&faces);
        } else {
            [&mut smooth, &mut creased].into_par_iter().for_each(|normals| normals.fit(&faces));
            if smooth.take_creases(&creased, surface, &faces) {
                smooth.fit(&faces);
            }
        }
        smooth.write(&faces, mesh);
    }

    /// Every face of the level with the samples that are closest to it.
    fn gather(&self, surface: &Surface, order: &[u32]) -> Vec<Face> {
        let (shapes, mut faces) = look_at_faces(surface);
        let step = (self.samples.len() / (SAMPLES[1] * surface.face_count() / 2).max(1)).max(1);
        let look = |wedge: usize| {
            let sample = &self.samples[wedge];
            let spot = self.source.look_up(sample.vertex, surface.wedges.group(wedge as u32));
            let place = spot.place(surface, surface.heir(sample.point), &shapes, order);
            (place, spot.normal, sample.area * step as f32)
        };
        let chosen: Vec<usize> = (0..self.samples.len()).step_by(step).collect();
        for chosen in chosen.chunks(CHUNK) {
            let places: Vec<_> = chosen.par_iter().with_min_len(1024).map(|&wedge| look(wedge)).collect();
            for (place, normal, weight) in places {
                if let Some((face, shares)) = place {
                    faces[face as usize].add(normal, shares, weight);
                }
            }
        }
        faces
    }
}

impl Source<'_> {
    fn normal(&self, vertex: u32) -> Vec3 {
        Vec3::from_slice(&self.normals[3 * vertex as usize..][..3]).normalize_or_zero()
    }

    fn look_up(&self, vertex: u32, group: u32) -> Spot {
        let position = self.frame.enter(self.mesh.positions[vertex as usize]).as_vec3();
        Spot { position, normal: self.normal(vertex), group }
    }
}

/// The number of each live face in the level.
fn number_faces(surface: &Surface) -> Vec<u32> {
    let mut order = vec![u32::MAX; surface.face_slots()];
    surface.live_faces().zip(0..).for_each(|(slot, number)| order[slot] = number);
    order
}

fn read_normal(surface: &Surface, column: Column, wedge: u32) -> Vec3 {
    Vec3::from_slice(&surface.wedges.row(wedge)[column.offset..][..3]).normalize_or_zero()
}

impl Spot {
    /// The closest face around a point, and where: the closest of those that the spot is straight above or below, if there are any.
    fn place(&self, surface: &Surface, point: u32, shapes: &[Shape], order: &[u32]) -> Option<(u32, [f32; 3])> {
        let around = || {
            let slots = surface.ring(point).iter().map(|&corner| Surface::face_of(corner));
            let known = slots.map(|slot| (slot, &shapes[order[slot] as usize]));
            known.filter(|(_, shape)| shape.group == self.group && shape.normal.dot(self.normal) > 0.0)
        };
        let mut best = (f32::INFINITY, None);
        for (slot, shape) in around() {
            let off = self.position - shape.origin;
            let height = shape.normal.dot(off);
            let [b, c] = shape.along.map(|along| along.dot(off));
            if height * height < best.0 && b >= 0.0 && c >= 0.0 && b + c <= 1.0 {
                best = (height * height, Some((order[slot], [1.0 - b - c, b, c])));
            }
        }
        if best.1.is_some() {
            return best.1;
        }
        for (slot, shape) in around() {
            let height = shape.normal.dot(self.position - shape.origin);
            if height * height < best.0 {
                let triangle = surface.triangle(slot).map(|p| p.as_vec3());
                let (foot, shares, _) = closest_point(triangle, self.position);
                let distance = foot.distance_squared(self.position);
                if distance < best.0 {
                    best = (distance, Some((order[slot], shares)));
                }
            }
        }
        best.1
    }
}

/// Where a face of the level is.
struct Shape {
    /// Its first corner.
    origin: Vec3,
    normal: Vec3,
    /// The gradients of the second and the third barycentric weight.
    along: [Vec3; 2],
    group: u32,
}

/// A face of the level and the moments of its samples.
struct Face {
    normal: Vec3,
    area: f32,
    weight: f32,
    /// Σ w bₖ n.
    pulls: [Vec3; 3],
    /// Σ w bₖ bₗ: 00, 11, 22, 12, 20, 01.
    products: [f32; 6],
}

/// The faces of a level.
fn look_at_faces(surface: &Surface) -> (Vec<Shape>, Vec<Face>) {
    let mut shapes = Vec::with_capacity(surface.face_count());
    let mut faces = Vec::with_capacity(surface.face_count());
    for slot in surface.live_faces() {
        let triangle = surface.triangle(slot);
        let (normal, area) = normal_and_area(triangle);
        let [ab, ac] = [1, 2].map(|k| triangle[k] - triangle[0]);
        let along = [ac.cross(normal), normal.cross(ab)].map(|along| (along / (2.0 * area)).as_vec3());
        let (normal, group) = (normal.as_vec3(), surface.wedges.group(surface.face_wedges(slot)[0]));
        shapes.push(Shape { origin: triangle[0].as_vec3(), normal, along, group });
        let (pulls, products) = ([Vec3::ZERO; 3], [0.0; 6]);
        faces.push(Face { normal, area: area as f32, weight: 0.0, pulls, products });
    }
    (shapes, faces)
}

impl Face {
    fn add(&mut self, normal: Vec3, b: [f32; 3], weight: f32) {
        self.weight += weight;
        self.pulls.iter_mut().zip(b).for_each(|(pull, share)| *pull += normal * (share * weight));
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
    /// The corners around each point, by the numbers of their faces, from one entry of `starts` to the next.
    corners: Vec<Corner>,
    starts: Vec<u32>,
}

impl Normals {
    /// The normals that the surface has: wedges of a point that have the same one share it.
    fn smooth(source: &Shading<'_>, surface: &Surface, order: &[u32]) -> Self {
        let mut normals = Self {
            classes: vec![[0; 3]; surface.face_count()],
            values: Vec::new(),
            priors: Vec::new(),
            corners: Vec::with_capacity(3 * surface.face_count()),
            starts: Vec::with_capacity(surface.points.len() + 1),
        };
        normals.starts.push(0);
        let mut wedges: SmallVec<[(u32, Vec3, u32); 4]> = SmallVec::new();
        for p in 0..surface.points.len() as u32 {
            wedges.clear();
            for &corner in surface.ring(p) {
                let wedge = surface.wedge_at(corner);
                let class = match wedges.iter().find(|known| known.0 == wedge) {
                    Some(known) => known.2,
                    None => normals.add_wedge(source, surface, wedge, &mut wedges),
                };
                let corner = order[Surface::face_of(corner)] << 2 | corner & 3;
                normals.corners.push(corner);
                *normals.class_mut(corner) = class;
            }
            normals.starts.push(normals.corners.len() as u32);
        }
        normals.priors.clone_from(&normals.values);
        normals
    }

    /// The class of a wedge of a point of which some are known: with the normals they had in the source, and their classes.
    fn add_wedge(
        &mut self,
        source: &Shading<'_>,
        surface: &Surface,
        wedge: u32,
        known: &mut SmallVec<[(u32, Vec3, u32); 4]>,
    ) -> u32 {
        let now = read_normal(surface, source.column, wedge);
        let before = source.normal_before(wedge).unwrap_or(now);
        let same = known.iter().find(|(_, normal, _)| normal.dot(before) > SAME);
        let class = same.map_or(self.values.len() as u32, |same| same.2);
        if same.is_none() {
            self.values.push(now);
        }
        known.push((wedge, before, class));
        class
    }

    /// The corners around a point.
    fn around(&self, point: usize) -> &[Corner] {
        &self.corners[self.starts[point] as usize..self.starts[point + 1] as usize]
    }

    fn class(&self, corner: Corner) -> u32 {
        self.classes[Surface::face_of(corner)][(corner & 3) as usize]
    }

    fn class_mut(&mut self, corner: Corner) -> &mut u32 {
        &mut self.classes[Surface::face_of(corner)][(corner & 3) as usize]
    }

    /// Other classes for the same corners: split at every edge sharp enough.
    fn creased(smooth: &Self, surface: &Surface, faces: &[Face]) -> Self {
        let mut normals = Self {
            classes: smooth.classes.clone(),
            values: smooth.values.clone(),
            priors: Vec::new(),
            corners: Vec::new(),
            starts: Vec::new(),
        };
        for p in 0..surface.points.len() {
            let corners = smooth.around(p);
            let normal = |corner: &Corner| faces[Surface::face_of(*corner)].normal;
            if corners.iter().any(|corner| normal(corner).dot(normal(&corners[0])) < FLAT) {
                normals.split(surface.ring(p as u32), corners, surface, faces);
            }
        }
        normals.priors.clone_from(&normals.values);
        normals
    }

    /// Gives each fan of faces around a point, from crease to crease, a class of its own.
    fn split(&mut self, ring: &[Corner], corners: &[Corner], surface: &Surface, faces: &[Face]) {
        let face = |i: usize| &faces[Surface::face_of(corners[i])];
        let old: SmallVec<[u32; 16]> = corners.iter().map(|&corner| self.class(corner)).collect();
        let links: SmallVec<[[u32; 2]; 16]> = ring.iter().map(|&corner| surface.opposite(corner)).collect();
        // Each is named by its first corner.
        let mut fans: SmallVec<[usize; 16]> = (0..ring.len()).collect();
        for i in 0..ring.len() {
            for j in 0..i {
                let (a, b) = (links[i], links[j]);
                let is_joined = (a[0] == b[1] || a[1] == b[0])
                    && fans[i] != fans[j]
                    && old[i] == old[j]
                    && face(i).normal.dot(face(j).normal) > CREASE;
                if is_joined {
                    let (from, to) = (fans[i].max(fans[j]), fans[i].min(fans[j]));
                    fans.iter_mut().filter(|fan| **fan == from).for_each(|fan| *fan = to);
                }
            }
        }
        for fan in (0..ring.len()).filter(|&i| fans[i] == i) {
            let of_fan = (0..ring.len()).filter(|&i| fans[i] == fan);
            // It is the whole class.
            if (0..ring.len()).all(|i| old[i] != old[fan] || fans[i] == fan) {
                continue;
            }
            let normal: Vec3 = of_fan.clone().map(|i| face(i).normal * face(i).area).sum();
            let class = self.values.len() as u32;
            self.values.push(normal.normalize_or_zero());
            of_fan.for_each(|i| *self.class_mut(corners[i]) = class);
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

    /// Takes the classes of `creased` at the points where they are much better; gives whether there are any.
    fn take_creases(&mut self, creased: &Self, surface: &Surface, faces: &[Face]) -> bool {
        let error = |normals: &Self| -> Vec<f32> { (0..faces.len()).map(|f| faces[f].error(normals.at(f))).collect() };
        self.values.extend_from_slice(&creased.values[self.values.len()..]);
        self.priors.clone_from(&creased.priors);
        let (smooth_errors, creased_errors) = (error(self), error(creased));
        let mut is_any = false;
        for p in 0..surface.points.len() {
            let corners = &self.corners[self.starts[p] as usize..self.starts[p + 1] as usize];
            let sum = |errors: &[f32]| -> f32 { corners.iter().map(|&corner| errors[Surface::face_of(corner)]).sum() };
            let (before, after) = (sum(&smooth_errors), sum(&creased_errors));
            let weight: f32 = corners.iter().map(|&corner| faces[Surface::face_of(corner)].weight).sum();
            if after > GAIN * before || before - after < LEAST_SAVING * weight {
                continue;
            }
            is_any = true;
            for &corner in corners {
                let class = creased.class(corner);
                self.values[class as usize] = creased.values[class as usize];
                self.classes[Surface::face_of(corner)][(corner & 3) as usize] = class;
            }
        }
        is_any
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
