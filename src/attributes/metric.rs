//! What a collapse costs in attributes, and the values that cost least.

use super::{distinct_wedges, is_displacement};
use crate::mesh::Semantic;
use crate::mesh::surface::Surface;
use crate::mesh::surgery::pair_wedges;
use crate::simplify::AttributeWeights;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use smallvec::SmallVec;
use std::mem::take;
use wide::f32x4;

/// Rows of attribute values in work; inline for the usual normal + tangent + UV.
pub(super) type Row = SmallVec<[f32; 16]>;

/// Numbers that are worked on together.
const LANES: usize = 4;

/// How much a squared difference in the numbers of a row counts, in squared lengths of the unit frame, and what is known of each wedge.
#[derive(Debug, Clone, Default)]
pub(crate) struct Metric {
    /// The numbers that count, displacements last.
    pub(super) terms: Vec<Term>,
    /// How many of them are no displacements.
    plain_terms: usize,
    /// The same in fours, with their scales for the surface as it was at the last refresh; what fills up the last four counts nothing.
    blocks: Vec<Block>,
    /// [`Self::stride`] vectors a wedge: its [`Head`], then gradients (x, y, z) and values of each block, all of them scaled.
    states: Vec<f32x4>,
    /// The same of the faces, without values.
    faces: Vec<f32x4>,
    /// The wedge of each point that has but one, else [`SEVERAL`].
    only: Vec<u32>,
    /// Of the source.
    area: f64,
    /// Unit frame over object units.
    frame: f32,
}

/// Stands for the wedge of a point that has more than one, or none.
const SEVERAL: u32 = u32::MAX;

#[derive(Debug, Clone, Copy)]
pub(super) struct Term {
    /// Index in the row.
    pub index: usize,
    weight: f32,
    /// The weight is in sizes of a face, not in lengths.
    by_size: bool,
}

#[derive(Debug, Clone, Copy)]
struct Block {
    indices: [usize; LANES],
    scales: f32x4,
    /// For a displacement: its scale in the unit frame.
    displaces: Option<f32>,
}

impl Block {
    fn of(&self, row: &[f32]) -> f32x4 {
        f32x4::new(self.indices.map(|i| row[i])) * self.scales
    }
}

/// Area (of all faces of a wedge), a symmetric matrix (xx, xy, xz, yy, yz, zz), and how far the gradients are trusted (by area).
const HEAD: usize = 2;
/// A face thinner than this share of its length says little of its gradient across.
const THIN: f32 = 0.1;
/// Mean trust in the gradients around a wedge below which they count for less.
const LEAST_TRUST: f32 = 0.01;

/// A unit normal that turns by δ over a face of size L hides a shape error of about δ·L/8; that the eye sees shading before it sees shape makes it
/// more.
const NORMAL_SCALE: f64 = 0.35;
/// A colour step of 1 counts like a shape error of this share of a face's size.
const COLOR_SCALE: f64 = 0.25;
/// A texture that slides counts less than a silhouette that moves by the same length.
const TEX_COORD_SCALE: f64 = 0.25;
/// The shape at rest is seen in all poses: each alone counts less.
const POSE_SCALE: f64 = 0.3;
const MORPH_SCALE: f64 = 0.5;

impl Metric {
    /// Weights that make one preset serve all sizes: directions and colours by the size of the faces at hand, UVs by their density.
    pub fn new(surface: &Surface, weights: &AttributeWeights) -> Self {
        let mut terms = Vec::new();
        for column in surface.wedges.columns() {
            let (weight, by_size) = match column.semantic {
                Semantic::Normal => (f64::from(weights.normal) * NORMAL_SCALE, true),
                Semantic::Color(_) => (f64::from(weights.color) * COLOR_SCALE, true),
                Semantic::TexCoord(_) if weights.tex_coord > 0.0 => {
                    let length = length_per_uv(surface, column.offset);
                    (f64::from(weights.tex_coord) * TEX_COORD_SCALE * length, false)
                }
                _ => continue,
            };
            if weight > 0.0 {
                let columns = column.offset..column.offset + column.width;
                terms.extend(columns.map(|index| Term { index, weight: weight as f32, by_size }));
            }
        }
        let plain_terms = terms.len();
        for column in surface.wedges.columns().iter().filter(|c| is_displacement(c.semantic) && c.width == 3) {
            let share = if matches!(column.semantic, Semantic::Pose(_)) { POSE_SCALE } else { MORPH_SCALE };
            let weight = (surface.frame.scale() * share) as f32;
            terms.extend((column.offset..column.offset + 3).map(|index| Term { index, weight, by_size: false }));
        }
        let double_areas = surface.live_faces().map(|f| double_area(surface.triangle(f)));
        let area = if terms.is_empty() { 0.0 } else { 0.5 * double_areas.sum::<f64>() };
        Self { terms, plain_terms, frame: surface.frame.scale() as f32, area, ..Self::default() }
    }

    /// Whether no attribute counts.
    pub fn is_empty(&self) -> bool {
        self.terms.is_empty()
    }

    /// Whether errors of the shape in poses are among what counts.
    pub fn has_displacements(&self) -> bool {
        self.plain_terms < self.terms.len()
    }

    fn stride(&self) -> usize {
        HEAD + 4 * self.blocks.len()
    }

    fn face_width(&self) -> usize {
        HEAD + 3 * self.blocks.len()
    }

    /// The wedges of a point.
    pub(super) fn wedges(&self, surface: &Surface, point: u32) -> SmallVec<[u32; 4]> {
        match self.only.get(point as usize) {
            Some(&wedge) if wedge != SEVERAL => SmallVec::from_slice(&[wedge]),
            _ => distinct_wedges(surface, point),
        }
    }

    /// Looks at all faces.
    pub fn refresh(&mut self, surface: &Surface) {
        if self.is_empty() {
            return;
        }
        self.scale(surface.face_count());
        let (width, stride) = (self.face_width(), self.stride());
        let mut faces = take(&mut self.faces);
        faces.resize(surface.face_slots() * width, f32x4::ZERO);
        faces.par_chunks_mut(width).with_min_len(1024).enumerate().for_each(|(face, out)| {
            if surface.is_live(face) {
                self.read_face(surface, face, out);
            }
        });
        let mut point_of = vec![u32::MAX; surface.wedges.len()];
        for face in surface.live_faces() {
            for (wedge, point) in surface.face_wedges(face).into_iter().zip(surface.face(face)) {
                point_of[wedge as usize] = point;
            }
        }
        let mut states = take(&mut self.states);
        states.resize(surface.wedges.len() * stride, f32x4::ZERO);
        states.par_chunks_mut(stride).with_min_len(1024).enumerate().for_each(|(wedge, state)| {
            if point_of[wedge] == u32::MAX {
                return;
            }
            state.fill(f32x4::ZERO);
            for &corner in surface.ring(point_of[wedge]) {
                if surface.wedge_at(corner) as usize == wedge {
                    self.collect(state, &faces[Surface::face_of(corner) * width..][..width]);
                }
            }
            self.settle(state, surface.wedges.row(wedge as u32));
        });
        (self.faces, self.states) = (faces, states);
        let only = |point: usize| only_wedge(surface, point as u32);
        (0..surface.points.len()).into_par_iter().with_min_len(4096).map(only).collect_into_vec(&mut self.only);
    }

    /// A collapse has made the point `joined`: looks at the faces around it.
    pub fn merged(&mut self, surface: &Surface, joined: u32) {
        if self.is_empty() {
            return;
        }
        let (mut faces, width) = (take(&mut self.faces), self.face_width());
        for face in surface.ring(joined).iter().map(|&corner| Surface::face_of(corner)) {
            self.read_face(surface, face, &mut faces[face * width..][..width]);
        }
        self.faces = faces;
    }

    /// Sets the scales of all numbers for a surface of so many faces.
    fn scale(&mut self, faces: usize) {
        let size = if self.area > 0.0 { (self.area / faces.max(1) as f64).sqrt() as f32 } else { 1.0 };
        let scale = |term: &Term| if term.by_size { term.weight * size } else { term.weight };
        let block = |terms: &[Term], displaces| Block {
            indices: std::array::from_fn(|lane| terms.get(lane).map_or(0, |term| term.index)),
            scales: f32x4::new(std::array::from_fn(|lane| terms.get(lane).map_or(0.0, scale))),
            displaces,
        };
        let (plain, displacements) = self.terms.split_at(self.plain_terms);
        let plain = plain.chunks(LANES).map(|terms| block(terms, None));
        let share = |terms: &[Term]| terms[0].weight / self.frame;
        let displacements = displacements.chunks(3).map(|terms| block(terms, Some(share(terms))));
        self.blocks = plain.chain(displacements).collect();
    }

    /// Brings what is known of a point's wedges up to date with the faces around it.
    pub fn update(&mut self, surface: &Surface, point: u32) {
        if self.is_empty() {
            return;
        }
        let (width, stride) = (self.face_width(), self.stride());
        let mut states = take(&mut self.states);
        let only = only_wedge(surface, point);
        self.only[point as usize] = only;
        let wedges = if only == SEVERAL { distinct_wedges(surface, point) } else { SmallVec::from_slice(&[only]) };
        for &wedge in &wedges {
            states[wedge as usize * stride..][..stride].fill(f32x4::ZERO);
        }
        for &corner in surface.ring(point) {
            let face = &self.faces[Surface::face_of(corner) * width..][..width];
            self.collect(&mut states[surface.wedge_at(corner) as usize * stride..][..stride], face);
        }
        for &wedge in &wedges {
            self.settle(&mut states[wedge as usize * stride..][..stride], surface.wedges.row(wedge));
        }
        self.states = states;
    }

    /// Area of a face, sum of the products of its gradients with themselves, and the gradients.
    #[inline]
    fn read_face(&self, surface: &Surface, face: usize, out: &mut [f32x4]) {
        let [a, b, c] = surface.triangle(face);
        let (ab, ac) = ((b - a).as_vec3(), (c - a).as_vec3());
        let normal = ab.cross(ac);
        let double_area = normal.length();
        let square = double_area * double_area;
        if square <= f32::MIN_POSITIVE {
            out.fill(f32x4::ZERO);
            return;
        }
        let longest = ab.length_squared().max(ac.length_squared()).max(ab.distance_squared(ac));
        let trust = (double_area / (THIN * longest)).min(1.0);
        let (along_b, along_c) = (splat(ac.cross(normal) / square), splat(normal.cross(ab) / square));
        let [ra, rb, rc] = surface.face_wedges(face).map(|w| surface.wedges.row(w));
        let (head, gradients) = out.split_at_mut(HEAD);
        let mut products = [f32x4::ZERO; 6];
        for (block, gradient) in self.blocks.iter().zip(gradients.chunks_exact_mut(3)) {
            let start = block.of(ra);
            let (to_b, to_c) = (block.of(rb) - start, block.of(rc) - start);
            let mut g: [f32x4; 3] = std::array::from_fn(|axis| along_b[axis] * to_b + along_c[axis] * to_c);
            if let Some(share) = block.displaces {
                let turn = turn_of_normal([ab, ac], [to_b, to_c].map(|d| as_vec3(d) / share), normal / double_area);
                let turn = f32x4::new([turn.x, turn.y, turn.z, 0.0]) * share;
                let unit = splat(normal / double_area);
                (0..3).for_each(|axis| g[axis] += unit[axis] * turn);
            }
            add_squares(&mut products, g, f32x4::splat(trust));
            gradient.copy_from_slice(&g.map(|g| g * trust));
        }
        write_head(head, 0.5 * double_area, products, trust);
    }

    /// Adds a face to the sums of a wedge.
    #[inline]
    fn collect(&self, state: &mut [f32x4], face: &[f32x4]) {
        let area = face[0].to_array()[0];
        let weight = f32x4::splat(area);
        state[0] += face[0] * f32x4::new([1.0, area, area, area]);
        state[1] += face[1] * weight;
        for (sums, gradient) in state[HEAD..].chunks_exact_mut(4).zip(face[HEAD..].chunks_exact(3)) {
            sums.iter_mut().zip(gradient).for_each(|(sum, g)| *sum += *g * weight);
        }
    }

    /// Turns sums into means and covariances.
    #[inline]
    fn settle(&self, state: &mut [f32x4], row: &[f32]) {
        let (head, blocks) = state.split_at_mut(HEAD);
        let (area, trusted) = (head[0].to_array()[0], head[1].to_array()[3]);
        // Where all faces are thin, what they say is mostly noise.
        let weight = trusted.max(LEAST_TRUST * area);
        let share = f32x4::splat(if weight > 0.0 { 1.0 / weight } else { 0.0 });
        let mut products = [f32x4::ZERO; 6];
        for (block, known) in self.blocks.iter().zip(blocks.chunks_exact_mut(4)) {
            known[..3].iter_mut().for_each(|sum| *sum *= share);
            add_squares(&mut products, [known[0], known[1], known[2]], f32x4::splat(-weight));
            known[3] = block.of(row);
        }
        let mut means = [f32x4::ZERO; HEAD];
        write_head(&mut means, 0.0, products, 0.0);
        head.iter_mut().zip(means).for_each(|(sum, mean)| *sum += mean);
    }

    #[inline]
    fn state(&self, wedge: u32) -> Known<'_> {
        let stride = self.stride();
        Known(&self.states[wedge as usize * stride..][..stride])
    }

    /// What the collapse of the edge costs in attributes, for the best values with the joined point at `position`: area · length².
    #[inline]
    pub fn deviation(&self, surface: &Surface, a: u32, b: u32, position: DVec3) -> f64 {
        let [y, z] = [a, b].map(|p| (position - surface.points[p as usize]).as_vec3());
        let [wa, wb] = [a, b].map(|p| self.only[p as usize]);
        let sum = if wa != SEVERAL && wb != SEVERAL {
            let [wa, wb] = [wa, wb].map(|w| self.state(w));
            wa.spread(y) + wb.spread(z) + wa.gap(y, wb, z)
        } else {
            self.deviation_at_seam(surface, [(a, y), (b, z)])
        };
        f64::from(sum.max(0.0))
    }

    fn deviation_at_seam(&self, surface: &Surface, [(a, y), (b, z)]: [(u32, Vec3); 2]) -> f32 {
        let spread = |point: u32, off: Vec3| -> f32 {
            distinct_wedges(surface, point).iter().map(|&w| self.state(w).spread(off)).sum()
        };
        let gaps = pair_wedges(surface, a, b).into_iter().map(|(wa, wb)| self.state(wa).gap(y, self.state(wb), z));
        spread(a, y) + spread(b, z) + gaps.sum::<f32>()
    }

    /// What it costs in attributes that the point `goes` becomes `stays`, which keeps its values: area · length².
    pub fn deviation_of_end(&self, surface: &Surface, stays: u32, goes: u32) -> f64 {
        let off = (surface.points[stays as usize] - surface.points[goes as usize]).as_vec3();
        let step = |kept: u32, gone: u32| self.state(gone).step(off, self.state(kept));
        let spread = |wedge: u32| self.state(wedge).spread(off);
        let [kept, gone] = [stays, goes].map(|p| self.only[p as usize]);
        let sum = if kept != SEVERAL && gone != SEVERAL {
            spread(gone) + step(kept, gone)
        } else {
            let spreads: f32 = distinct_wedges(surface, goes).into_iter().map(spread).sum();
            spreads + pair_wedges(surface, stays, goes).iter().map(|&(k, g)| step(k, g)).sum::<f32>()
        };
        f64::from(sum.max(0.0))
    }

    /// Extends what counts of a wedge by `off` from its point.
    pub(super) fn extend(&self, wedge: u32, off: Vec3) -> Extended {
        if self.blocks.is_empty() {
            return Extended { values: Row::new(), area: 0.0 };
        }
        let known = self.state(wedge);
        let scaled = self.blocks.iter().enumerate().flat_map(|(k, block)| {
            let (values, scales) = (known.at(k, splat(off)).to_array(), block.scales.to_array());
            (0..LANES).filter(move |&lane| scales[lane] > 0.0).map(move |lane| values[lane] / scales[lane])
        });
        Extended { values: scaled.collect(), area: known.area() }
    }
}

/// Values of the terms at some position, and the area that they stand for.
#[derive(Debug)]
pub(super) struct Extended {
    pub values: Row,
    pub area: f32,
}

impl Extended {
    /// The mean with `other`.
    pub fn join(&mut self, other: &Self) {
        let total = self.area + other.area;
        let share = if total > 0.0 { other.area / total } else { 0.5 };
        self.values.iter_mut().zip(&other.values).for_each(|(a, b)| *a += (*b - *a) * share);
        self.area = total;
    }
}

/// What is known of a wedge.
#[derive(Clone, Copy)]
struct Known<'a>(&'a [f32x4]);

impl Known<'_> {
    fn area(self) -> f32 {
        self.0[0].to_array()[0]
    }

    /// The values of a block at `off` from the wedge's point.
    #[inline]
    fn at(self, block: usize, off: [f32x4; 3]) -> f32x4 {
        let [x, y, z, value] = std::array::from_fn(|k| self.0[HEAD + 4 * block + k]);
        value + x * off[0] + y * off[1] + z * off[2]
    }

    fn blocks(self) -> usize {
        (self.0.len() - HEAD) / 4
    }

    /// How far the functions of its faces spread at `off` from its point.
    #[inline]
    fn spread(self, off: Vec3) -> f32 {
        let ([_, xx, xy, xz], [yy, yz, zz, _]) = (self.0[0].to_array(), self.0[1].to_array());
        let (x, y, z) = (off.x, off.y, off.z);
        xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z)
    }

    /// How far the values that two wedges would have at one position lie apart.
    #[inline]
    fn gap(self, y: Vec3, other: Self, z: Vec3) -> f32 {
        let joint = self.area() * other.area() / (self.area() + other.area()).max(f32::MIN_POSITIVE);
        let (y, z) = (splat(y), splat(z));
        let mut sum = f32x4::ZERO;
        for block in 0..self.blocks() {
            let difference = self.at(block, y) - other.at(block, z);
            sum += difference * difference;
        }
        joint * sum.reduce_add()
    }

    /// How far its values would be from those of `stays`, which is at `off`.
    fn step(self, off: Vec3, stays: Self) -> f32 {
        let mut sum = f32x4::ZERO;
        for block in 0..self.blocks() {
            let difference = self.at(block, splat(off)) - stays.at(block, [f32x4::ZERO; 3]);
            sum += difference * difference;
        }
        self.area() * sum.reduce_add()
    }
}

#[inline]
fn splat(v: Vec3) -> [f32x4; 3] {
    v.to_array().map(f32x4::splat)
}

fn as_vec3(lanes: f32x4) -> Vec3 {
    let [x, y, z, _] = lanes.to_array();
    Vec3::new(x, y, z)
}

/// By how much the unit normal of a face turns where its edges become longer by `steps`: how what stands off the face is displaced.
fn turn_of_normal(edges: [Vec3; 2], steps: [Vec3; 2], unit: Vec3) -> Vec3 {
    let turned = (edges[0] + steps[0]).cross(edges[1] + steps[1]);
    turned.try_normalize().map_or(Vec3::ZERO, |turned| turned - unit)
}

/// Adds the upper half of `weight · g gᵀ` of each lane: xx, xy, xz, yy, yz, zz.
#[inline]
fn add_squares(products: &mut [f32x4; 6], [x, y, z]: [f32x4; 3], weight: f32x4) {
    let (heavy_x, heavy_y) = (x * weight, y * weight);
    let added = [heavy_x * x, heavy_x * y, heavy_x * z, heavy_y * y, heavy_y * z, z * weight * z];
    products.iter_mut().zip(added).for_each(|(sum, product)| *sum += product);
}

/// Writes the area, the sums of the lanes of `products`, and how far gradients are trusted.
#[inline]
fn write_head(head: &mut [f32x4], area: f32, products: [f32x4; 6], trust: f32) {
    let [xx, xy, xz, yy, yz, zz] = products.map(f32x4::reduce_add);
    head[0] = f32x4::new([area, xx, xy, xz]);
    head[1] = f32x4::new([yy, yz, zz, trust]);
}

fn only_wedge(surface: &Surface, point: u32) -> u32 {
    let mut wedges = surface.ring(point).iter().map(|&corner| surface.wedge_at(corner));
    let first = wedges.next().unwrap_or(SEVERAL);
    if wedges.all(|wedge| wedge == first) { first } else { SEVERAL }
}

fn double_area([a, b, c]: [DVec3; 3]) -> f64 {
    (b - a).cross(c - a).length()
}

/// Length in the unit frame of one UV unit: root of the ratio of the areas; 0 where the UVs have none.
fn length_per_uv(surface: &Surface, offset: usize) -> f64 {
    let (mut space, mut texture) = (0.0, 0.0);
    for f in surface.live_faces() {
        space += double_area(surface.triangle(f));
        let [a, b, c] = surface.face_wedges(f).map(|w| {
            let row = surface.wedges.row(w);
            glam::Vec2::new(row[offset], row[offset + 1]).as_dvec2()
        });
        texture += (b - a).perp_dot(c - a).abs();
    }
    if texture > 0.0 && texture.is_finite() { (space / texture).sqrt() } else { 0.0 }
}
