//! Attributes at a moved point: solved from the faces around it, not copied from an end.
//!
//! Over each face an attribute is a linear function of position. The value of a wedge at a new position is the one that minimises the
//! area-weighted squared difference to those functions, extended to there; the minimum itself is what the collapse costs in that attribute (Hoppe
//! 1999). All of a wedge's functions agree at its point `p`, so what is known of it is the mean gradient `ḡ` of each number and the covariance `C`
//! of the gradients around it: two wedges with values `s` that become one at `x` differ by
//!
//! `(x − p)ᵀ C (x − p)` on either side, and `W₁W₂ / (W₁ + W₂) · (s₁ + ḡ₁·(x − p₁) − s₂ − ḡ₂·(x − p₂))²` between them (`W` the areas).
//!
//! Joint influences and morph displacements of positions follow the edge instead, on every side of a seam alike, so that posed surfaces stay
//! closed.
//!
//! Limits: morph displacements of normals and the like count nothing in the cost.

use crate::mesh::Semantic;
use crate::mesh::surface::Surface;
use crate::mesh::surgery::{Merge, pair_wedges};
use crate::mesh::wedges::Wedges;
use crate::simplify::AttributeWeights;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use smallvec::SmallVec;

/// Rows of attribute values in work; inline for the usual normal + tangent + UV.
type Row = SmallVec<[f32; 16]>;

/// How much a squared difference in the numbers of a row counts, in squared lengths of the unit frame, and what is known of each wedge.
#[derive(Debug, Clone, Default)]
pub(crate) struct Metric {
    /// The numbers that count.
    terms: Vec<Term>,
    /// [`Self::stride`] numbers a wedge: area, covariance of what counts by length and by edge, mean gradient of each term.
    states: Vec<f32>,
    /// The wedge of each point that has but one, else [`SEVERAL`].
    only: Vec<u32>,
    /// Of equilateral faces as large as the mean of all.
    typical_edge_squared: f32,
}

/// Stands for the wedge of a point that has more than one, or none.
const SEVERAL: u32 = u32::MAX;

#[derive(Debug, Clone, Copy)]
struct Term {
    /// Index in the row.
    index: usize,
    /// Weight², in lengths² or, where `by_edge`, in squares of the collapsing edge.
    weight: f32,
    by_edge: bool,
}

/// Where the mean gradients stand in a wedge's state.
const GRADIENTS: usize = 13;
/// A face thinner than this share of its length says little of its gradient across.
const THIN: f32 = 0.1;

impl Metric {
    /// Weights that make one preset serve all sizes: directions and colours by the length of the edge at hand, UVs by their density.
    pub fn new(surface: &Surface, weights: &AttributeWeights) -> Self {
        let mut terms = Vec::new();
        for column in surface.wedges.columns() {
            let (weight, by_edge) = match column.semantic {
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
                terms.extend(columns.map(|index| Term { index, weight: (weight * weight) as f32, by_edge }));
            }
        }
        Self { terms, ..Self::default() }
    }

    /// Whether no attribute counts.
    pub fn is_empty(&self) -> bool {
        self.terms.is_empty()
    }

    fn stride(&self) -> usize {
        GRADIENTS + 3 * self.terms.len()
    }

    /// Looks at all faces.
    pub fn refresh(&mut self, surface: &Surface) {
        if self.is_empty() {
            return;
        }
        let (width, stride) = (1 + 3 * self.terms.len(), self.stride());
        let mut gradients = vec![0.0; surface.face_slots() * width];
        gradients.par_chunks_mut(width).with_min_len(1024).enumerate().for_each(|(face, gradients)| {
            if surface.is_live(face) {
                self.read_gradients(surface, face, gradients);
            }
        });
        let area: f64 = gradients.chunks_exact(width).map(|face| f64::from(face[0])).sum();
        self.typical_edge_squared = (4.0 / 3f64.sqrt() * area / surface.face_count().max(1) as f64) as f32;
        let mut point_of = vec![u32::MAX; surface.wedges.len()];
        for face in surface.live_faces() {
            for (wedge, point) in surface.face_wedges(face).into_iter().zip(surface.face(face)) {
                point_of[wedge as usize] = point;
            }
        }
        let mut states = std::mem::take(&mut self.states);
        states.resize(surface.wedges.len() * stride, 0.0);
        states.par_chunks_mut(stride).with_min_len(1024).enumerate().for_each(|(wedge, state)| {
            if point_of[wedge] == u32::MAX {
                return;
            }
            state.fill(0.0);
            for &corner in surface.ring(point_of[wedge]) {
                if surface.wedge_at(corner) as usize == wedge {
                    self.collect(state, &gradients[Surface::face_of(corner) * width..][..width]);
                }
            }
            self.settle(state);
        });
        self.states = states;
        let only = |point: usize| only_wedge(surface, point as u32);
        (0..surface.points.len()).into_par_iter().with_min_len(4096).map(only).collect_into_vec(&mut self.only);
    }

    /// Looks at the faces around one point.
    pub fn update(&mut self, surface: &Surface, point: u32) {
        if self.is_empty() {
            return;
        }
        let stride = self.stride();
        self.states.resize(surface.wedges.len() * stride, 0.0);
        let mut states = std::mem::take(&mut self.states);
        let wedges = distinct_wedges(surface, point);
        self.only[point as usize] = if wedges.len() == 1 { wedges[0] } else { SEVERAL };
        for &wedge in &wedges {
            states[wedge as usize * stride..][..stride].fill(0.0);
        }
        let mut gradients: SmallVec<[f32; 32]> = SmallVec::from_elem(0.0, 1 + 3 * self.terms.len());
        for &corner in surface.ring(point) {
            self.read_gradients(surface, Surface::face_of(corner), &mut gradients);
            self.collect(&mut states[surface.wedge_at(corner) as usize * stride..][..stride], &gradients);
        }
        for &wedge in &wedges {
            self.settle(&mut states[wedge as usize * stride..][..stride]);
        }
        self.states = states;
    }

    /// Area of a face and the gradient of each term over it.
    fn read_gradients(&self, surface: &Surface, face: usize, out: &mut [f32]) {
        let [a, b, c] = surface.triangle(face);
        let (ab, ac) = ((b - a).as_vec3(), (c - a).as_vec3());
        let normal = ab.cross(ac);
        let double_area = normal.length();
        out[0] = 0.5 * double_area;
        let square = double_area * double_area;
        if square <= f32::MIN_POSITIVE {
            out.fill(0.0);
            return;
        }
        let longest = ab.length_squared().max(ac.length_squared()).max(ab.distance_squared(ac));
        let trust = (double_area / (THIN * longest)).min(1.0) / square;
        let (along_b, along_c) = (ac.cross(normal) * trust, normal.cross(ab) * trust);
        let [ra, rb, rc] = surface.face_wedges(face).map(|w| surface.wedges.row(w));
        for (gradient, term) in out[1..].chunks_exact_mut(3).zip(&self.terms) {
            let i = term.index;
            (along_b * (rb[i] - ra[i]) + along_c * (rc[i] - ra[i])).write_to_slice(gradient);
        }
    }

    fn collect(&self, state: &mut [f32], gradients: &[f32]) {
        let area = gradients[0];
        state[0] += area;
        let (head, sums) = state.split_at_mut(GRADIENTS);
        for ((term, gradient), sum) in
            self.terms.iter().zip(gradients[1..].chunks_exact(3)).zip(sums.chunks_exact_mut(3))
        {
            let g = Vec3::from_slice(gradient);
            (Vec3::from_slice(sum) + g * area).write_to_slice(sum);
            add_product(term.covariance(head), g * (area * term.weight), g);
        }
    }

    /// Turns sums into means and covariances.
    fn settle(&self, state: &mut [f32]) {
        let (head, sums) = state.split_at_mut(GRADIENTS);
        let area = head[0];
        if area <= 0.0 {
            return;
        }
        for (term, sum) in self.terms.iter().zip(sums.chunks_exact_mut(3)) {
            let mean = Vec3::from_slice(sum) / area;
            add_product(term.covariance(head), mean * (-area * term.weight), mean);
            mean.write_to_slice(sum);
        }
    }

    fn state(&self, wedge: u32) -> Known<'_> {
        let stride = self.stride();
        Known { state: &self.states[wedge as usize * stride..][..stride] }
    }

    /// What the collapse of the edge costs in attributes, for the best values with the joined point at `position`: area · length².
    pub fn deviation(&self, surface: &Surface, a: u32, b: u32, position: DVec3) -> f64 {
        let [start, end] = [a, b].map(|p| surface.points[p as usize]);
        let (y, z) = ((position - start).as_vec3(), (position - end).as_vec3());
        let edge = start.distance_squared(end) as f32;
        let [wa, wb] = [a, b].map(|p| self.only[p as usize]);
        let sum = if wa != SEVERAL && wb != SEVERAL {
            self.state(wa).spread(y, edge) + self.state(wb).spread(z, edge) + self.gap(surface, [wa, wb], y, z, edge)
        } else {
            let spread = |point: u32, off: Vec3| -> f32 {
                distinct_wedges(surface, point).iter().map(|&w| self.state(w).spread(off, edge)).sum()
            };
            let pairs = pair_wedges(surface, a, b);
            let gaps: f32 = pairs.iter().map(|&pair| self.gap(surface, pair.into(), y, z, edge)).sum();
            spread(a, y) + spread(b, z) + gaps
        };
        f64::from(sum.max(0.0))
    }

    /// What it costs in attributes that the point `goes` becomes `stays`, which keeps its values: area · length².
    pub fn deviation_of_end(&self, surface: &Surface, stays: u32, goes: u32) -> f64 {
        let off = (surface.points[stays as usize] - surface.points[goes as usize]).as_vec3();
        let edge = DIRECTIONS_AT_ENDS * self.typical_edge_squared;
        let step = |kept: u32, gone: u32| {
            let known = self.state(gone);
            let (rk, rg) = (surface.wedges.row(kept), surface.wedges.row(gone));
            let differences = self.terms.iter().enumerate().map(|(k, term)| {
                let difference = rg[term.index] + known.gradient(k).dot(off) - rk[term.index];
                term.weight_for(edge) * difference * difference
            });
            known.area() * differences.sum::<f32>()
        };
        let spread = |wedge: u32| self.state(wedge).spread(off, edge);
        let [kept, gone] = [stays, goes].map(|p| self.only[p as usize]);
        let sum = if kept != SEVERAL && gone != SEVERAL {
            spread(gone) + step(kept, gone)
        } else {
            let spreads: f32 = distinct_wedges(surface, goes).into_iter().map(spread).sum();
            spreads + pair_wedges(surface, stays, goes).iter().map(|&(k, g)| step(k, g)).sum::<f32>()
        };
        f64::from(sum.max(0.0))
    }

    /// How far the values that two wedges would have at one position lie apart.
    fn gap(&self, surface: &Surface, [wa, wb]: [u32; 2], y: Vec3, z: Vec3, edge: f32) -> f32 {
        let (known_a, known_b) = (self.state(wa), self.state(wb));
        let (ra, rb) = (surface.wedges.row(wa), surface.wedges.row(wb));
        let joint = known_a.area() * known_b.area() / (known_a.area() + known_b.area()).max(f32::MIN_POSITIVE);
        let differences = self.terms.iter().enumerate().map(|(k, term)| {
            let difference = ra[term.index] + known_a.gradient(k).dot(y) - rb[term.index] - known_b.gradient(k).dot(z);
            term.weight_for(edge) * difference * difference
        });
        joint * differences.sum::<f32>()
    }

    /// Extends what counts of a wedge by `off` from its point.
    fn extend(&self, surface: &Surface, wedge: u32, off: Vec3) -> Extended {
        if self.is_empty() {
            return Extended { values: Row::new(), area: 0.0 };
        }
        let (known, row) = (self.state(wedge), surface.wedges.row(wedge));
        let values = self.terms.iter().enumerate().map(|(k, term)| row[term.index] + known.gradient(k).dot(off));
        Extended { values: values.collect(), area: known.area() }
    }
}

/// Values of the terms at some position, and the area that they stand for.
#[derive(Debug)]
struct Extended {
    values: Row,
    area: f32,
}

impl Extended {
    /// The mean with `other`.
    fn join(&mut self, other: &Self) {
        let total = self.area + other.area;
        let share = if total > 0.0 { other.area / total } else { 0.5 };
        self.values.iter_mut().zip(&other.values).for_each(|(a, b)| *a += (*b - *a) * share);
        self.area = total;
    }
}

/// What is known of a wedge.
struct Known<'a> {
    state: &'a [f32],
}

impl Known<'_> {
    fn area(&self) -> f32 {
        self.state[0]
    }

    fn gradient(&self, term: usize) -> Vec3 {
        Vec3::from_slice(&self.state[GRADIENTS + 3 * term..][..3])
    }

    /// How far the functions of its faces spread at `off` from its point.
    fn spread(&self, off: Vec3, edge_squared: f32) -> f32 {
        let product = |m: &[f32]| {
            let (x, y, z) = (off.x, off.y, off.z);
            m[0] * x * x + m[3] * y * y + m[5] * z * z + 2.0 * (m[1] * x * y + m[2] * x * z + m[4] * y * z)
        };
        product(&self.state[1..7]) + edge_squared * product(&self.state[7..13])
    }
}

impl Term {
    fn weight_for(&self, edge_squared: f32) -> f32 {
        if self.by_edge { self.weight * edge_squared } else { self.weight }
    }

    /// The covariance it counts in, of the head of a state.
    fn covariance<'a>(&self, head: &'a mut [f32]) -> &'a mut [f32] {
        if self.by_edge { &mut head[7..13] } else { &mut head[1..7] }
    }
}

/// Adds the upper half of `a bᵀ`: xx, xy, xz, yy, yz, zz.
#[inline]
pub(crate) fn add_product(m: &mut [f32], a: Vec3, b: Vec3) {
    let products = [a.x * b.x, a.x * b.y, a.x * b.z, a.y * b.y, a.y * b.z, a.z * b.z];
    m.iter_mut().zip(products).for_each(|(m, p)| *m += p);
}

fn distinct_wedges(surface: &Surface, point: u32) -> SmallVec<[u32; 4]> {
    let mut wedges = SmallVec::new();
    for &corner in surface.ring(point) {
        let wedge = surface.wedge_at(corner);
        if !wedges.contains(&wedge) {
            wedges.push(wedge);
        }
    }
    wedges
}

fn only_wedge(surface: &Surface, point: u32) -> u32 {
    let mut wedges = surface.ring(point).iter().map(|&corner| surface.wedge_at(corner));
    let first = wedges.next().unwrap_or(SEVERAL);
    if wedges.all(|wedge| wedge == first) { first } else { SEVERAL }
}

/// A unit normal that turns by δ over an edge of length L hides a shape error of about δ·L/8.
const NORMAL_SCALE: f64 = 0.125;
/// A colour step of 1 over an edge counts like a shape error of this share of its length.
const COLOR_SCALE: f64 = 0.25;
/// How much more directions and colours count where points stay. No value is fitted to its place there, so that the order has to make up for it. And
/// they count by the typical edge instead of the one at hand: short edges with a turn between them would go first.
const DIRECTIONS_AT_ENDS: f32 = 50.0;
/// A texture that slides counts less than a silhouette that moves by the same length.
const TEX_COORD_SCALE: f64 = 0.25;

/// Length in the unit frame of one UV unit: root of the ratio of the areas; 0 where the UVs have none.
fn length_per_uv(surface: &Surface, offset: usize) -> f64 {
    let (mut space, mut texture) = (0.0, 0.0);
    for f in surface.live_faces() {
        let [a, b, c] = surface.triangle(f);
        space += (b - a).cross(c - a).length();
        let [a, b, c] = surface.face_wedges(f).map(|w| {
            let row = surface.wedges.row(w);
            glam::Vec2::new(row[offset], row[offset + 1]).as_dvec2()
        });
        texture += (b - a).perp_dot(c - a).abs();
    }
    if texture > 0.0 && texture.is_finite() { (space / texture).sqrt() } else { 0.0 }
}

/// The new values of the wedges of a joined point.
#[derive(Debug, Default)]
pub(crate) struct Solution {
    classes: Vec<Class>,
}

/// Wedges that become one.
#[derive(Debug)]
struct Class {
    /// Its id afterwards.
    wedge: u32,
    row: Row,
    influences: Vec<(u16, f32)>,
}

impl Solution {
    /// Solves every wedge of `merge` at `position`, to be taken for the share `t` of the way from `kept` to `gone` where an attribute follows the edge.
    /// To be called before the surface changes; `metric` must know both points as they are.
    pub fn solve(&mut self, surface: &Surface, metric: &Metric, merge: &Merge, position: DVec3, t: f32) {
        self.classes.clear();
        let [at_kept, at_gone] = [merge.kept, merge.gone].map(|p| distinct_wedges(surface, p));
        let [off_kept, off_gone] = [merge.kept, merge.gone].map(|p| (position - surface.points[p as usize]).as_vec3());
        let (Some(&any_kept), Some(&any_gone)) = (at_kept.first(), at_gone.first()) else { return };
        for &wedge in &at_kept {
            let partners: SmallVec<[u32; 2]> =
                at_gone.iter().copied().filter(|&w| merge.target(w) == wedge && w != wedge).collect();
            let mut extended = metric.extend(surface, wedge, off_kept);
            for &partner in &partners {
                extended.join(&metric.extend(surface, partner, off_gone));
            }
            let end = partners.first().copied();
            self.classes.push(Class::new(surface, metric, &extended, [wedge, wedge, end.unwrap_or(wedge)], t));
            self.follow_edge(surface, [wedge, end.unwrap_or(any_gone)], t);
        }
        for &wedge in at_gone.iter().filter(|&&w| merge.pairs.iter().all(|pair| pair.1 != w)) {
            let extended = metric.extend(surface, wedge, off_gone);
            self.classes.push(Class::new(surface, metric, &extended, [wedge; 3], t));
            self.follow_edge(surface, [any_kept, wedge], t);
        }
    }

    /// Gives the last class what is continuous over seams: from a wedge at either end.
    fn follow_edge(&mut self, surface: &Surface, [start, end]: [u32; 2], t: f32) {
        let (Some(class), wedges) = (self.classes.last_mut(), &surface.wedges) else { return };
        let (a, b) = (wedges.row(start), wedges.row(end));
        for column in wedges.columns().iter().filter(|c| matches!(c.semantic, Semantic::MorphPosition(_))) {
            for i in column.offset..column.offset + column.width {
                class.row[i] = a[i] * (1.0 - t) + b[i] * t;
            }
        }
        let (start, end) = match (wedges.is_skinned(start), wedges.is_skinned(end)) {
            (true, false) => (start, start),
            (false, true) => (end, end),
            _ => (start, end),
        };
        wedges.mix_influences(start, end, t, &mut class.influences);
    }

    /// Writes the solved values; to be called after the merge was applied.
    pub fn write(&self, wedges: &mut Wedges) {
        for class in &self.classes {
            wedges.row_mut(class.wedge).copy_from_slice(&class.row);
            if !class.influences.is_empty() {
                wedges.set_influences(class.wedge, &class.influences);
            }
        }
    }
}

impl Class {
    /// The class `id` of the wedges `start` and `end`, one at either end of the edge; both are the same where there is only one.
    fn new(surface: &Surface, metric: &Metric, extended: &Extended, [id, start, end]: [u32; 3], t: f32) -> Self {
        let wedges = &surface.wedges;
        let (a, b) = (wedges.row(start), wedges.row(end));
        let nearer = if t < 0.5 { a } else { b };
        let mut row: Row = a.iter().zip(b).map(|(a, b)| a * (1.0 - t) + b * t).collect();
        for column in wedges.columns() {
            let taken = match column.semantic {
                Semantic::Id => column.offset..column.offset + column.width,
                // The handedness of a tangent is a sign.
                Semantic::Tangent if column.width == 4 => column.offset + 3..column.offset + 4,
                _ => continue,
            };
            row[taken.clone()].copy_from_slice(&nearer[taken]);
        }
        for (term, value) in metric.terms.iter().zip(&extended.values) {
            row[term.index] = wedges.within_range(term.index, *value);
        }
        normalize_normals(wedges, &mut row);
        Self { wedge: id, row, influences: Vec::new() }
    }
}

/// Means of unit normals get shorter at each collapse, and would count for less.
fn normalize_normals(wedges: &Wedges, row: &mut Row) {
    for column in wedges.columns().iter().filter(|c| c.semantic == Semantic::Normal) {
        let normal = &mut row[column.offset..][..3];
        let unit = Vec3::from_slice(normal).normalize_or_zero();
        if unit != Vec3::ZERO {
            unit.write_to_slice(normal);
        }
    }
}

/// Gives a wedge the values halfway between two others (an edge split at its midpoint).
pub(crate) fn fill_midpoint(wedges: &mut Wedges, [new, a, b]: [u32; 3]) {
    let row: Row = wedges
        .columns()
        .iter()
        .flat_map(|c| (c.offset..c.offset + c.width).map(move |i| (c, i)))
        .map(|(c, i)| {
            let sign_or_id = c.semantic == Semantic::Id || (c.semantic == Semantic::Tangent && i == c.offset + 3);
            let (x, y) = (wedges.row(a)[i], wedges.row(b)[i]);
            if sign_or_id { x } else { (x + y) * 0.5 }
        })
        .collect();
    wedges.row_mut(new).copy_from_slice(&row);
    let mut influences = Vec::new();
    wedges.mix_influences(a, b, 0.5, &mut influences);
    if !influences.is_empty() {
        wedges.set_influences(new, &influences);
    }
}
