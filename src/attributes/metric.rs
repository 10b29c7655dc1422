//! What a collapse costs in attributes, and the values that cost least.

use super::slope::{Facet, Products, Slope, Spread, add_products, sum_products};
use super::{add_product, distinct_wedges, is_displacement, multiply};
use crate::lanes::{LANES, Vec3x4, dot};
use crate::mesh::Semantic;
use crate::mesh::surface::Surface;
use crate::mesh::wedges::Wedges;
use crate::simplify::AttributeWeights;
use glam::{DVec3, Vec3};
use smallvec::SmallVec;
use std::mem::replace;
use wide::f32x4;

/// A vector for each block; inline for the usual normal + UV.
type Blocks = SmallVec<[f32x4; 2]>;

/// How much a squared difference in the numbers of a row counts, in squared lengths of the unit frame, and what is known of wedges and points.
#[derive(Debug, Clone, Default)]
pub(crate) struct Metric {
    /// The numbers that count, displacements last.
    terms: Vec<Term>,
    /// How many of them are no displacements.
    plain_terms: usize,
    /// The same in fours, with their scales for the surface as it was at the last refresh; what fills up the last four counts nothing.
    blocks: Vec<Block>,
    /// What the numbers of each wedge are, a vector a block, scaled.
    values: Vec<f32x4>,
    /// Their mean gradients over the faces of each wedge, one a term.
    slopes: Vec<Vec3>,
    /// Areas of the faces of each wedge.
    areas: Vec<f32>,
    /// How gradients vary around each point, by area: the sum over its wedges of their covariances.
    spreads: Vec<Spread>,
    /// Of the source.
    area: f64,
    /// Unit frame over object units.
    frame: f32,
}

/// What attributes cost with the joined point at `x` from an edge's first end, but for a constant: `xᵀ matrix x − 2 right·x`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AttributeQuadric {
    pub matrix: Spread,
    pub right: Vec3,
}

impl AttributeQuadric {
    pub fn scaled(self, share: f32) -> Self {
        Self { matrix: self.matrix.map(|x| x * share), right: self.right * share }
    }
}

#[derive(Debug, Clone, Copy)]
struct Term {
    /// Index in the row.
    index: usize,
    weight: f32,
    /// The weight is in sizes of a face, not in lengths.
    by_size: bool,
}

#[derive(Debug, Clone, Copy)]
struct Block {
    indices: [usize; LANES],
    /// The first of its terms.
    first: usize,
    /// How many of them count.
    count: usize,
    scales: f32x4,
    /// For a displacement: its scale in the unit frame.
    displaces: Option<f32>,
}

impl Block {
    fn new((first, terms): (usize, &[Term]), displaces: Option<f32>, scale: impl Fn(&Term) -> f32) -> Self {
        Self {
            first,
            indices: std::array::from_fn(|lane| terms.get(lane).map_or(0, |term| term.index)),
            count: terms.len(),
            scales: f32x4::new(std::array::from_fn(|lane| terms.get(lane).map_or(0.0, &scale))),
            displaces,
        }
    }

    /// Three numbers of each term, from one vector for each of them.
    #[inline]
    fn rows(vectors: Vec3x4) -> [Vec3; LANES] {
        let [x, y, z] = vectors.map(f32x4::to_array);
        std::array::from_fn(|lane| Vec3::new(x[lane], y[lane], z[lane]))
    }

    fn of(&self, row: &[f32]) -> f32x4 {
        f32x4::new(self.indices.map(|i| row[i])) * self.scales
    }
}

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

    /// Looks at all faces. `facet`: unit normal and area of a face.
    pub fn refresh(&mut self, surface: &Surface, facet: impl Fn(usize) -> Facet) {
        if self.is_empty() {
            return;
        }
        self.scale(surface.face_count());
        let (wedges, blocks) = (surface.wedges.len(), self.blocks.len());
        self.values.resize(wedges * blocks, f32x4::ZERO);
        (0..wedges as u32).for_each(|wedge| self.read_values(surface, wedge));
        clear(&mut self.slopes, wedges * self.terms.len());
        clear(&mut self.areas, wedges);
        clear(&mut self.spreads, surface.points.len());
        // Of the wedges that are waiting for their means.
        let mut trusted = vec![0.0; wedges];
        for face in surface.live_faces() {
            if let Some(weight) = self.add_face(surface, face, facet(face)) {
                surface.face_wedges(face).into_iter().for_each(|wedge| trusted[wedge as usize] += weight);
            }
        }
        for face in surface.live_faces() {
            for (wedge, point) in surface.face_wedges(face).into_iter().zip(surface.face(face)) {
                let trusted = replace(&mut trusted[wedge as usize], f32::NAN);
                if !trusted.is_nan() {
                    self.take_means(wedge, point, trusted);
                }
            }
        }
    }

    /// Adds a face to the sums of its wedges and points; gives its weight, if it has any.
    fn add_face(&mut self, surface: &Surface, face: usize, facet: Facet) -> Option<f32> {
        let ([a, b, c], wedges) = (surface.triangle(face), surface.face_wedges(face));
        let slope = Slope::new([b - a, c - a].map(|edge| edge.as_vec3()), facet)?;
        let (stride, mut products) = (self.blocks.len(), Products::default());
        for (k, block) in self.blocks.iter().enumerate() {
            let [a, b, c] = wedges.map(|wedge| self.values[wedge as usize * stride + k]);
            let heavy = slope.gradient([b - a, c - a], block.displaces);
            let rows = Block::rows(heavy);
            for wedge in wedges {
                let sums = &mut self.slopes[wedge as usize * self.terms.len() + block.first..];
                sums.iter_mut().zip(rows).take(block.count).for_each(|(sum, row)| *sum += row);
            }
            add_products(&mut products, heavy.map(|h| h * slope.inverse), heavy);
        }
        let products = sum_products(products);
        surface.face(face).into_iter().for_each(|point| add(&mut self.spreads[point as usize], products));
        wedges.into_iter().for_each(|wedge| self.areas[wedge as usize] += slope.area);
        Some(slope.weight)
    }

    /// Turns the sums of a wedge into means, and takes those from what spreads around its point. `trusted`: area of which gradients are trusted.
    #[inline]
    fn take_means(&mut self, wedge: u32, point: u32, trusted: f32) {
        // Where all faces are thin, what they say is mostly noise.
        let weight = trusted.max(LEAST_TRUST * self.areas[wedge as usize]);
        let share = if weight > 0.0 { 1.0 / weight } else { 0.0 };
        let stride = self.terms.len();
        let spread = &mut self.spreads[point as usize];
        for slope in &mut self.slopes[wedge as usize * stride..][..stride] {
            let mean = *slope * share;
            add_product(spread, *slope, -mean);
            *slope = mean;
        }
    }

    /// A collapse has made the point `joined`: looks at the values that it has now.
    pub fn merged(&mut self, surface: &Surface, joined: u32) {
        if !self.is_empty() {
            distinct_wedges(surface, joined).into_iter().for_each(|wedge| self.read_values(surface, wedge));
        }
    }

    /// The numbers of a row that count, and the length in the unit frame that a difference of 1 in each is worth on a surface of so many faces.
    pub fn scales(&self, faces: usize) -> Vec<(usize, f32)> {
        let scale = self.scale_of(faces);
        self.terms.iter().map(|term| (term.index, scale(term))).collect()
    }

    fn scale_of(&self, faces: usize) -> impl Fn(&Term) -> f32 + use<> {
        let size = if self.area > 0.0 { (self.area / faces.max(1) as f64).sqrt() as f32 } else { 1.0 };
        move |term| if term.by_size { term.weight * size } else { term.weight }
    }

    /// Sets the scales of all numbers for a surface of so many faces.
    fn scale(&mut self, faces: usize) {
        let scale = self.scale_of(faces);
        let (plain, displacements) = self.terms.split_at(self.plain_terms);
        let plain = plain.chunks(LANES).zip((0..).step_by(LANES));
        let plain = plain.map(|(terms, first)| Block::new((first, terms), None, &scale));
        let displacements = displacements.chunks(3).zip((self.plain_terms..).step_by(3));
        let share = |terms: &[Term]| Some(terms[0].weight / self.frame);
        let displacements = displacements.map(|(terms, first)| Block::new((first, terms), share(terms), &scale));
        self.blocks = plain.chain(displacements).collect();
    }

    fn read_values(&mut self, surface: &Surface, wedge: u32) {
        let row = surface.wedges.row(wedge);
        let values = &mut self.values[wedge as usize * self.blocks.len()..];
        values.iter_mut().zip(&self.blocks).for_each(|(value, block)| *value = block.of(row));
    }

    /// Brings what is known of a point's wedges up to date with the faces around it. `facet`: unit normal and area of a face.
    #[inline]
    pub fn update(&mut self, surface: &Surface, point: u32, facet: impl Fn(usize) -> Facet) {
        if self.is_empty() {
            return;
        }
        let Some(&corner) = surface.ring(point).first() else { return };
        self.spreads[point as usize] = Spread::default();
        let mut products = Products::default();
        if !self.update_wedge(surface, point, surface.wedge_at(corner), &facet, &mut products) {
            for &wedge in &distinct_wedges(surface, point)[1..] {
                self.update_wedge(surface, point, wedge, &facet, &mut products);
            }
        }
        add(&mut self.spreads[point as usize], sum_products(products));
    }

    /// Takes mean gradients over the faces of a wedge, and adds how they vary to `products`. Gives whether the point has no other wedge.
    #[inline]
    fn update_wedge(
        &mut self,
        surface: &Surface,
        point: u32,
        wedge: u32,
        facet: &impl Fn(usize) -> Facet,
        products: &mut Products,
    ) -> bool {
        let (mut trusted, mut is_only) = (0.0, true);
        for first in (0..self.blocks.len()).step_by(2) {
            (trusted, is_only) = if first + 1 < self.blocks.len() {
                self.look_around::<2>(surface, (point, wedge), first, facet, products)
            } else {
                self.look_around::<1>(surface, (point, wedge), first, facet, products)
            };
        }
        self.take_means(wedge, point, trusted);
        is_only
    }

    /// Adds up the gradients of the `N` blocks from `first` on over the faces of a wedge, and adds their products to `products`. Gives the area of which
    /// gradients are trusted, and whether the point has no other wedge.
    #[inline]
    fn look_around<const N: usize>(
        &mut self,
        surface: &Surface,
        (point, wedge): (u32, u32),
        first: usize,
        facet: &impl Fn(usize) -> Facet,
        products: &mut Products,
    ) -> (f32, bool) {
        let at = |wedge: u32| wedge as usize * self.blocks.len() + first;
        let values = |wedge: u32| self.values[at(wedge)..].first_chunk::<N>();
        let (mut area, mut trusted, mut is_only) = (0.0, 0.0, true);
        let (mut sums, mut squares) = ([Vec3x4::default(); N], Products::default());
        if let (Some(blocks), Some(start)) = (self.blocks[first..].first_chunk::<N>(), values(wedge)) {
            let origin = surface.points[point as usize];
            for &corner in surface.ring(point) {
                if surface.wedge_at(corner) != wedge {
                    is_only = false;
                    continue;
                }
                let edges = surface.opposite(corner).map(|p| (surface.points[p as usize] - origin).as_vec3());
                let [Some(b), Some(c)] = surface.opposite_wedges(corner).map(values) else { continue };
                let Some(slope) = Slope::new(edges, facet(Surface::face_of(corner))) else { continue };
                area += slope.area;
                trusted += slope.weight;
                for k in 0..N {
                    let heavy = slope.gradient([b[k] - start[k], c[k] - start[k]], blocks[k].displaces);
                    (0..3).for_each(|axis| sums[k][axis] += heavy[axis]);
                    add_products(&mut squares, heavy.map(|h| h * slope.inverse), heavy);
                }
            }
        }
        self.areas[wedge as usize] = area;
        for (block, sums) in self.blocks[first..].iter().zip(sums) {
            let slopes = &mut self.slopes[wedge as usize * self.terms.len() + block.first..];
            slopes.iter_mut().zip(Block::rows(sums)).take(block.count).for_each(|(slope, sum)| *slope = sum);
        }
        products.iter_mut().zip(squares).for_each(|(sum, square)| *sum += square);
        (trusted, is_only)
    }

    #[inline]
    fn wedge(&self, wedge: u32) -> Known<'_> {
        let (wedge, stride) = (wedge as usize, self.blocks.len());
        let slopes = &self.slopes[wedge * self.terms.len()..];
        Known { area: self.areas[wedge], blocks: &self.blocks, values: &self.values[wedge * stride..], slopes }
    }

    /// About what four edges cost in attributes: what functions spread at their middles. `ends`: the points of each; `edges`: from one to the other.
    #[inline]
    pub fn guess(&self, ends: [[u32; 2]; LANES], edges: Vec3x4) -> f32x4 {
        let both = |first: usize| {
            let rows = ends.map(|points| {
                let [a, b] = points.map(|p| &self.spreads[p as usize]);
                f32x4::new(std::array::from_fn(|i| a[first + i])) + f32x4::new(std::array::from_fn(|i| b[first + i]))
            });
            f32x4::transpose(rows)
        };
        let ([xx, xy, xz, yy], [_, _, yz, zz]) = (both(0), both(2));
        let turned = [dot([xx, xy, xz], edges), dot([xy, yy, yz], edges), dot([xz, yz, zz], edges)];
        (dot(turned, edges) * f32x4::splat(0.25)).fast_max(f32x4::ZERO)
    }

    /// What the collapse of the edge costs in attributes, for the best values with the joined point at `position`: area · length². `pairs`: the wedges
    /// at its ends that its faces join.
    #[inline]
    pub fn deviation(&self, surface: &Surface, [a, b]: [u32; 2], pairs: &[(u32, u32)], position: DVec3) -> f64 {
        let [y, z] = [a, b].map(|p| (position - surface.points[p as usize]).as_vec3());
        let gaps = pairs.iter().map(|&(wa, wb)| self.wedge(wa).gap(y, self.wedge(wb), z));
        let sum = self.spread(a, y) + self.spread(b, z) + gaps.sum::<f32>();
        f64::from(sum.max(0.0))
    }

    /// [`Self::deviation`] for the joined point anywhere. `edge`: from the first end to the second.
    #[inline]
    pub fn quadric(&self, ends: [u32; 2], pairs: &[(u32, u32)], edge: Vec3) -> AttributeQuadric {
        let [of_a, of_b] = ends.map(|p| self.spreads[p as usize]);
        let mut quadric = AttributeQuadric { matrix: of_a, right: multiply(&of_b, edge) };
        add(&mut quadric.matrix, of_b);
        pairs.iter().for_each(|&(wa, wb)| self.wedge(wa).add_gap(edge, self.wedge(wb), &mut quadric));
        quadric
    }

    /// How far the functions of all faces of a point spread at `off` from it.
    #[inline]
    fn spread(&self, point: u32, off: Vec3) -> f32 {
        let [xx, xy, xz, yy, yz, zz] = self.spreads[point as usize];
        let (x, y, z) = (off.x, off.y, off.z);
        xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z)
    }

    /// What it costs in attributes that the point `goes` becomes `stays`, which keeps its values: area · length². `pairs`: of these points.
    pub fn deviation_of_end(
        &self,
        surface: &Surface,
        [stays, goes]: [u32; 2],
        pairs: impl Iterator<Item = (u32, u32)>,
    ) -> f64 {
        let off = (surface.points[stays as usize] - surface.points[goes as usize]).as_vec3();
        let steps = pairs.map(|(kept, gone)| self.wedge(gone).step(off, self.wedge(kept)));
        f64::from((self.spread(goes, off) + steps.sum::<f32>()).max(0.0))
    }

    /// Extends what counts of a wedge by `off` from its point.
    pub(super) fn extend(&self, wedge: u32, off: Vec3) -> Extended {
        if self.blocks.is_empty() {
            return Extended { values: Blocks::new(), area: 0.0 };
        }
        let known = self.wedge(wedge);
        Extended { values: known.at(off).collect(), area: known.area }
    }

    /// Writes extended values into a row.
    pub(super) fn write(&self, extended: &Extended, wedges: &Wedges, row: &mut [f32]) {
        for (block, &values) in self.blocks.iter().zip(&extended.values) {
            let values = (values / block.scales).to_array();
            for (&index, value) in block.indices.iter().zip(values).take(block.count) {
                row[index] = wedges.within_range(index, value);
            }
        }
    }
}

/// Values of what counts at some position, and the area that they stand for.
#[derive(Debug)]
pub(super) struct Extended {
    values: Blocks,
    pub area: f32,
}

impl Extended {
    /// The mean with `other`.
    pub fn join(&mut self, other: &Self) {
        let total = self.area + other.area;
        let share = f32x4::splat(if total > 0.0 { other.area / total } else { 0.5 });
        self.values.iter_mut().zip(&other.values).for_each(|(a, b)| *a += (*b - *a) * share);
        self.area = total;
    }
}

/// What is known of a wedge.
#[derive(Clone, Copy)]
struct Known<'a> {
    area: f32,
    blocks: &'a [Block],
    values: &'a [f32x4],
    slopes: &'a [Vec3],
}

impl Known<'_> {
    /// The values at `off` from the wedge's point.
    #[inline]
    fn at(&self, off: Vec3) -> impl Iterator<Item = f32x4> {
        self.blocks.iter().zip(self.values).map(move |(block, &value)| {
            let slopes = &self.slopes[block.first..][..block.count];
            value + f32x4::new(std::array::from_fn(|lane| slopes.get(lane).map_or(0.0, |slope| slope.dot(off))))
        })
    }

    /// How far the values that two wedges would have at one position lie apart.
    #[inline]
    fn gap(self, y: Vec3, other: Self, z: Vec3) -> f32 {
        self.joint_area(other) * distance_squared(self.at(y), other.at(z))
    }

    /// The same for a position anywhere, with the other wedge's point at `edge` from this one's.
    #[inline]
    fn add_gap(self, edge: Vec3, other: Self, quadric: &mut AttributeQuadric) {
        let joint = self.joint_area(other);
        for ((block, &here), there) in self.blocks.iter().zip(self.values).zip(other.at(-edge)) {
            let [near, far] = [self, other].map(|wedge| &wedge.slopes[block.first..][..block.count]);
            for ((near, far), step) in near.iter().zip(far).zip((here - there).to_array()) {
                let turn = *near - *far;
                add_product(&mut quadric.matrix, turn * joint, turn);
                quadric.right -= turn * (step * joint);
            }
        }
    }

    /// What a squared difference between the values of two wedges that become one counts, if both give in.
    #[inline]
    fn joint_area(self, other: Self) -> f32 {
        self.area * other.area / (self.area + other.area).max(f32::MIN_POSITIVE)
    }

    /// How far its values would be from those of `stays`, which is at `off`.
    fn step(self, off: Vec3, stays: Self) -> f32 {
        self.area * distance_squared(self.at(off), stays.values.iter().copied())
    }
}

#[inline]
fn distance_squared(a: impl Iterator<Item = f32x4>, b: impl Iterator<Item = f32x4>) -> f32 {
    let sum = a.zip(b).fold(f32x4::ZERO, |sum, (a, b)| sum + (a - b) * (a - b));
    sum.reduce_add()
}

fn add(sum: &mut Spread, spread: Spread) {
    sum.iter_mut().zip(spread).for_each(|(sum, number)| *sum += number);
}

/// Makes it so many zeros.
fn clear<T: Copy + Default>(numbers: &mut Vec<T>, count: usize) {
    numbers.clear();
    numbers.resize(count, T::default());
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
