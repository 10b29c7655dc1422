//! Attributes at a moved point: solved from the faces around it, not copied from an end.
//!
//! Over each face an attribute is a linear function of position. The value of a wedge at a new position `x` is the one that
//! minimises the area-weighted squared difference to those functions, extended to `x` (Hoppe 1999); the minimum itself is what the collapse costs
//! in that attribute. Joint influences and morph displacements of positions follow the edge instead, on every side of a seam alike, so
//! that posed surfaces stay closed.
//!
//! Limits: morph displacements of normals and the like count nothing in the cost.

use crate::mesh::Semantic;
use crate::mesh::surface::Surface;
use crate::mesh::surgery::Merge;
use crate::mesh::wedges::Wedges;
use crate::simplify::AttributeWeights;
use glam::DVec3;
use smallvec::SmallVec;

/// Rows of attribute values in work; inline for the usual normal + tangent + UV.
type Row = SmallVec<[f32; 16]>;

/// How much a squared difference in the numbers of a row counts, in squared lengths of the unit frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Metric {
    /// The numbers that count.
    terms: Vec<Term>,
}

#[derive(Debug, Clone, Copy)]
struct Term {
    /// Index in the row.
    index: usize,
    /// Weight², in lengths² or, where `by_edge`, in squares of the collapsing edge.
    weight: f32,
    by_edge: bool,
}

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
        Self { terms }
    }

    /// Whether no attribute counts.
    pub fn is_empty(&self) -> bool {
        self.terms.is_empty()
    }

    /// Σ area · weight² · (difference)² over the faces at both ends, for the best values at `position`.
    pub fn deviation(&self, surface: &Surface, merge: &Merge, position: DVec3) -> f64 {
        let [a, b] = [merge.kept, merge.gone].map(|p| surface.points[p as usize]);
        let edge = a.distance_squared(b) as f32;
        let mut classes: SmallVec<[Spread; 4]> = SmallVec::new();
        let mut squares = 0.0;
        for corner in merge.corners(surface) {
            let Some((area, lambda)) = extrapolation(surface, Surface::face_of(corner), position) else { continue };
            let rows = surface.face_wedges(Surface::face_of(corner)).map(|w| surface.wedges.row(w));
            let value = |i: usize| rows[0][i] * lambda[0] + rows[1][i] * lambda[1] + rows[2][i] * lambda[2];
            let wedge = merge.target(surface.wedge_at(corner));
            let Some(class) = classes.iter_mut().find(|c| c.wedge == wedge) else {
                let first = self.terms.iter().map(|t| value(t.index)).collect();
                classes.push(Spread { wedge, area, first, sum: SmallVec::from_elem(0.0, self.terms.len()) });
                continue;
            };
            class.area += area;
            for (k, term) in self.terms.iter().enumerate() {
                let difference = value(term.index) - class.first[k];
                class.sum[k] += area * difference;
                squares += f64::from(area * term.weight_for(edge) * difference * difference);
            }
        }
        let explained = classes.iter().flat_map(|class| {
            let square = move |(t, sum): (&Term, &f32)| f64::from(t.weight_for(edge) * sum * sum / class.area);
            self.terms.iter().zip(&class.sum).map(square)
        });
        (squares - explained.sum::<f64>()).max(0.0)
    }
}

impl Term {
    fn weight_for(&self, edge_squared: f32) -> f32 {
        if self.by_edge { self.weight * edge_squared } else { self.weight }
    }
}

/// The values that the faces of one wedge extend to, as differences to the first of them: equal values cancel exactly.
struct Spread {
    wedge: u32,
    area: f32,
    first: Row,
    sum: Row,
}

/// A unit normal that turns by δ over an edge of length L hides a shape error of about δ·L/8.
const NORMAL_SCALE: f64 = 0.125;
/// A colour step of 1 over an edge counts like a shape error of this share of its length.
const COLOR_SCALE: f64 = 0.25;
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

/// Area of a face and the barycentric coordinates of `x` projected into its plane; `None` for a face without area.
fn extrapolation(surface: &Surface, face: usize, x: DVec3) -> Option<(f32, [f32; 3])> {
    let [a, b, c] = surface.triangle(face);
    let normal = (b - a).cross(c - a);
    let square = normal.length_squared();
    if square <= f64::MIN_POSITIVE {
        return None;
    }
    let u = (c - b).cross(x - b).dot(normal) / square;
    let v = (a - c).cross(x - c).dot(normal) / square;
    // Far outside a needle the linear function says nothing any more.
    let limit = |l: f64| l.clamp(-3.0, 4.0) as f32;
    let (u, v) = (limit(u), limit(v));
    Some(((square.sqrt() * 0.5) as f32, [u, v, 1.0 - u - v]))
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
    /// The wedges at the kept and at the gone point, where the class has one.
    kept: Option<u32>,
    gone: Option<u32>,
    /// Sum over the class's faces of area, area · extended value, and the range of the values at their corners.
    area: f32,
    row: Row,
    low: Row,
    high: Row,
    influences: Vec<(u16, f32)>,
}

impl Solution {
    /// Solves every wedge of `merge` at `position`, to be taken for the share `t` of the way from `kept` to `gone` where an attribute follows the edge.
    /// To be called before the surface changes.
    pub fn solve(&mut self, surface: &Surface, merge: &Merge, position: DVec3, t: f32) {
        self.classes.clear();
        for point in [merge.kept, merge.gone] {
            for &corner in surface.ring(point) {
                let face = Surface::face_of(corner);
                let class = self.class_of(surface, merge, corner, point == merge.kept);
                if point == merge.gone && merge.faces.contains(&face) {
                    continue;
                }
                if let Some((area, lambda)) = extrapolation(surface, face, position) {
                    class.collect(area, lambda, surface.face_wedges(face).map(|w| surface.wedges.row(w)));
                }
            }
        }
        let first = |of: fn(&Class) -> Option<u32>| self.classes.iter().find_map(of);
        let ends = (first(|c| c.kept), first(|c| c.gone));
        for class in &mut self.classes {
            class.finish(&surface.wedges, ends, t);
        }
    }

    fn class_of(&mut self, surface: &Surface, merge: &Merge, corner: u32, at_kept: bool) -> &mut Class {
        let wedge = surface.wedge_at(corner);
        let id = if at_kept { wedge } else { merge.target(wedge) };
        let index = self.classes.iter().position(|c| c.wedge == id).unwrap_or_else(|| {
            self.classes.push(Class::new(id, surface.wedges.stride()));
            self.classes.len() - 1
        });
        let class = &mut self.classes[index];
        if at_kept { &mut class.kept } else { &mut class.gone }.get_or_insert(wedge);
        class
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
    fn new(wedge: u32, stride: usize) -> Self {
        let filled = |x: f32| SmallVec::from_elem(x, stride);
        Self {
            wedge,
            kept: None,
            gone: None,
            area: 0.0,
            row: filled(0.0),
            low: filled(f32::INFINITY),
            high: filled(f32::NEG_INFINITY),
            influences: Vec::new(),
        }
    }

    fn collect(&mut self, area: f32, lambda: [f32; 3], rows: [&[f32]; 3]) {
        self.area += area;
        for i in 0..self.row.len() {
            let [a, b, c] = rows.map(|r| r[i]);
            self.row[i] += area * (a * lambda[0] + b * lambda[1] + c * lambda[2]);
            self.low[i] = self.low[i].min(a).min(b).min(c);
            self.high[i] = self.high[i].max(a).max(b).max(c);
        }
    }

    /// Turns sums into values. `ends`: some wedge at either end, for the attributes that are continuous over seams.
    fn finish(&mut self, wedges: &Wedges, ends: (Option<u32>, Option<u32>), t: f32) {
        let own = |side: Option<u32>, other: Option<u32>| side.or(other).unwrap_or(self.wedge);
        let (a, b) = (own(self.kept, self.gone), own(self.gone, self.kept));
        let (start, end) = (own(self.kept, ends.0), own(self.gone, ends.1));
        let mix = |i: usize, a: u32, b: u32| wedges.row(a)[i] * (1.0 - t) + wedges.row(b)[i] * t;
        for column in wedges.columns() {
            for i in column.offset..column.offset + column.width {
                self.row[i] = match column.semantic {
                    Semantic::MorphPosition(_) => mix(i, start, end),
                    Semantic::Id => wedges.row(if t < 0.5 { a } else { b })[i],
                    // The handedness of a tangent is a sign.
                    Semantic::Tangent if i == column.offset + 3 => wedges.row(if t < 0.5 { a } else { b })[i],
                    _ if self.area > 0.0 => {
                        let (low, high) = (self.low[i], self.high[i]);
                        let beyond = (high - low) * reach(column.semantic);
                        wedges.within_range(i, (self.row[i] / self.area).max(low - beyond).min(high + beyond))
                    }
                    _ => mix(i, a, b),
                };
            }
        }
        let (start, end) = match (wedges.is_skinned(start), wedges.is_skinned(end)) {
            (true, false) => (start, start),
            (false, true) => (end, end),
            _ => (start, end),
        };
        wedges.mix_influences(start, end, t, &mut self.influences);
    }
}

/// How far a solved value may leave the range around it, in units of that range. UVs are coordinates and go on linearly beside a seam, where the
/// point moves out of the faces on one side; what is seen as such does not.
fn reach(semantic: Semantic) -> f32 {
    match semantic {
        Semantic::TexCoord(_) => 1.0,
        _ => 0.0,
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
