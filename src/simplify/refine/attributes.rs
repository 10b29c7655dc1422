//! Attributes after points have moved: fitted to the source, not averaged along the way.
//!
//! The values at the points are those whose interpolation over the faces is nearest to the source's values at all samples (least squares, by
//! damped Jacobi steps from what the collapses have solved). One place alone would have the source's noise, and it is between the points that
//! shading and textures go wrong. Joint influences are looked up at the closest point of the source.
//!
//! Only points without a seam change. Samples of another group or another chart do not count.

use super::level::Level;
use super::source::{Source, closest_point};
use crate::attributes::turns_over;
use crate::mesh::Semantic;
use crate::mesh::surface::Surface;
use crate::mesh::wedges::{Column, Wedges};
use glam::{Vec2, Vec3};
use smallvec::SmallVec;

/// Rounds of fitting; each takes up more than half of what is left.
const ROUNDS: usize = 4;
/// A sample whose texture coordinates are farther off than this share of the face's extent in the texture is of another chart.
const SAME_CHART: f32 = 1.0;
/// A face's area in the texture may grow by this factor.
const MOST_GROWTH: f32 = 8.0;

type Row = SmallVec<[f32; 16]>;

/// Attributes of the source, by its faces.
#[derive(Debug, Clone)]
pub(super) struct SourceAttributes {
    wedges: Wedges,
    corners: Vec<[u32; 3]>,
}

impl SourceAttributes {
    /// `None` if there is nothing to look up.
    pub fn new(surface: &Surface) -> Option<Self> {
        let corners = surface.live_faces().map(|f| surface.face_wedges(f)).collect();
        (!surface.wedges.is_plain()).then(|| Self { wedges: surface.wedges.clone(), corners })
    }

    /// The values at a sample, with unit normals.
    fn row_at(&self, source: &Source, sample: u32) -> Row {
        let sample = &source.samples[sample as usize];
        let (_, weights, _) = closest_point(source.triangle(sample.face), sample.position);
        blend_rows(&self.wedges, self.corners[sample.face as usize], weights)
    }
}

/// Fits the attributes of all points that are not `fixed`.
pub(super) fn fit(level: &mut Level, attributes: &SourceAttributes, fixed: &[bool]) {
    if attributes.wedges.stride() > 0 {
        for _ in 0..ROUNDS {
            let pulls = gather_pulls(level, attributes);
            for p in (0..level.surface.points.len() as u32).filter(|&p| !fixed[p as usize]) {
                pulls.apply(level.surface, p);
            }
        }
    }
    for p in (0..level.surface.points.len() as u32).filter(|&p| !fixed[p as usize]) {
        look_up_influences(level, attributes, p);
    }
}

/// What the samples around each point would add to its values.
struct Pulls {
    stride: usize,
    sums: Vec<f32>,
    /// By column, as samples may count for some columns only.
    weights: Vec<f32>,
    columns: Vec<Column>,
}

fn gather_pulls(level: &Level, attributes: &SourceAttributes) -> Pulls {
    let columns = attributes.wedges.columns().to_vec();
    let (points, stride) = (level.surface.points.len(), attributes.wedges.stride());
    let (sums, weights) = (vec![0.0; points * stride], vec![0.0; points * columns.len()]);
    let mut pulls = Pulls { stride, sums, weights, columns };
    for f in level.surface.live_faces() {
        let (triangle, corners) = (level.triangle(f), level.surface.face_wedges(f));
        let group = level.surface.wedges.group(corners[0]);
        for s in level.lists.samples(f) {
            let sample = &level.source.samples[s as usize];
            if attributes.wedges.group(attributes.corners[sample.face as usize][0]) != group {
                continue;
            }
            let (_, shares, _) = closest_point(triangle, sample.position);
            let now = blend_rows(&level.surface.wedges, corners, shares);
            let wanted = attributes.row_at(level.source, s);
            pulls.add(level.surface, f, shares.map(|share| share * sample.weight), &now, &wanted);
        }
    }
    pulls
}

impl Pulls {
    fn add(&mut self, surface: &Surface, face: usize, weights: [f32; 3], now: &Row, wanted: &Row) {
        for (c, column) in self.columns.iter().enumerate() {
            let range = column.offset..column.offset + column.width;
            if let Semantic::TexCoord(_) = column.semantic
                && is_other_chart(surface, face, column.offset, now, wanted)
            {
                continue;
            }
            for (p, weight) in surface.face(face).into_iter().zip(weights) {
                self.weights[p as usize * self.columns.len() + c] += weight;
                for i in range.clone() {
                    self.sums[p as usize * self.stride + i] += weight * (wanted[i] - now[i]);
                }
            }
        }
    }

    fn apply(&self, surface: &mut Surface, p: u32) {
        let own = wedges_of(surface, p);
        let Some(&first) = own.first() else { return };
        let mut row: Row = SmallVec::from_slice(surface.wedges.row(first));
        for (c, column) in self.columns.iter().enumerate() {
            let weight = self.weights[p as usize * self.columns.len() + c];
            if weight <= 0.0 || column.semantic == Semantic::Id {
                continue;
            }
            let is_sign = |i: usize| column.semantic == Semantic::Tangent && i == column.offset + 3;
            for i in (column.offset..column.offset + column.width).filter(|&i| !is_sign(i)) {
                row[i] = surface.wedges.within_range(i, row[i] + self.sums[p as usize * self.stride + i] / weight);
            }
            if column.semantic == Semantic::Normal && column.width == 3 {
                let old = &surface.wedges.row(first)[column.offset..column.offset + 3];
                let new = Vec3::from_slice(&row[column.offset..column.offset + 3]).try_normalize();
                new.unwrap_or(Vec3::from_slice(old)).write_to_slice(&mut row[column.offset..column.offset + 3]);
            }
        }
        keep_charts(surface, p, &mut row);
        for wedge in own {
            surface.wedges.row_mut(wedge).copy_from_slice(&row);
        }
    }
}

/// Whether a sample's texture coordinates cannot be those of a face.
fn is_other_chart(surface: &Surface, face: usize, offset: usize, now: &Row, wanted: &Row) -> bool {
    let at = |row: &[f32]| Vec2::new(row[offset], row[offset + 1]);
    let [a, b, c] = surface.face_wedges(face).map(|w| at(surface.wedges.row(w)));
    let extent = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    at(now).distance_squared(at(wanted)) > SAME_CHART * SAME_CHART * extent
}

fn look_up_influences(level: &mut Level, attributes: &SourceAttributes, p: u32) {
    let foot = level.foot(p);
    let Some(&corners) = attributes.corners.get(foot.face as usize) else { return };
    let own = wedges_of(level.surface, p);
    if own.iter().any(|&w| level.surface.wedges.group(w) != attributes.wedges.group(corners[0])) {
        return;
    }
    let (_, weights, _) = closest_point(level.source.triangle(foot.face), foot.point);
    let influences = attributes.wedges.blend_influences(corners, weights);
    if !influences.is_empty() {
        own.iter().for_each(|&wedge| level.surface.wedges.set_influences(wedge, &influences));
    }
}

/// The wedges of a point, each once.
fn wedges_of(surface: &Surface, p: u32) -> SmallVec<[u32; 4]> {
    let mut own: SmallVec<[u32; 4]> = surface.ring(p).iter().map(|&c| surface.wedge_at(c)).collect();
    own.sort_unstable();
    own.dedup();
    own
}

/// The values inside a face of these wedges, with unit normals.
fn blend_rows(wedges: &Wedges, corners: [u32; 3], weights: [f32; 3]) -> Row {
    let rows = corners.map(|w| wedges.row(w));
    let mut row: Row = (0..wedges.stride())
        .map(|i| rows[0][i] * weights[0] + rows[1][i] * weights[1] + rows[2][i] * weights[2])
        .collect();
    for column in wedges.columns().iter().filter(|c| c.semantic == Semantic::Normal && c.width == 3) {
        let normal = &mut row[column.offset..column.offset + 3];
        Vec3::from_slice(normal).normalize_or_zero().write_to_slice(normal);
    }
    row
}

/// Puts back the texture coordinates that the point has, where those in `row` would turn a face over in the texture.
fn keep_charts(surface: &Surface, p: u32, row: &mut [f32]) {
    let wedges = &surface.wedges;
    for offset in wedges.tex_coords() {
        let at = |row: &[f32]| Vec2::from_slice(&row[offset..]);
        let turns = |&corner: &u32| {
            let [b, c] = surface.opposite_wedges(corner).map(|w| at(wedges.row(w)));
            let (old, new) = (at(wedges.row(surface.wedge_at(corner))), at(row));
            let (before, after) = ((b - old).perp_dot(c - old), (b - new).perp_dot(c - new));
            turns_over([b, c], old, new) || after.abs() > MOST_GROWTH * before.abs()
        };
        if let Some(&corner) = surface.ring(p).first()
            && surface.ring(p).iter().any(turns)
        {
            let range = offset..offset + 2;
            row[range.clone()].copy_from_slice(&wedges.row(surface.wedge_at(corner))[range]);
        }
    }
}
