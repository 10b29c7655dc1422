//! Attributes after points have moved: fitted to the source, not averaged along the way.
//!
//! The values at the points are those whose interpolation over the faces is nearest to the source's values at all samples (least squares, by
//! damped Jacobi steps from what the collapses have solved). One place alone would have the source's noise, and it is between the points that
//! shading and textures go wrong. Joint influences are looked up at the closest point of the source.
//!
//! Samples of another group or another chart do not count. Points on seams have too few samples on either side: their values go on linearly
//! where they go.

use super::level::Level;
use super::source::{Source, closest_point};
use crate::attributes::{is_displacement, turns_over};
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

    /// The group of a face of the source.
    pub fn group(&self, face: u32) -> u32 {
        self.wedges.group(self.corners[face as usize][0])
    }

    /// The values at a sample, with unit normals.
    pub fn row_at(&self, source: &Source, sample: u32) -> Row {
        let sample = &source.samples[sample as usize];
        let (_, weights, _) = closest_point(source.triangle(sample.face), sample.position);
        blend_rows(&self.wedges, self.corners[sample.face as usize], weights)
    }
}

/// Fits the attributes of all points that nothing holds.
pub(super) fn fit(level: &mut Level, attributes: &SourceAttributes) {
    let free: Vec<u32> = (0..level.surface.points.len() as u32).filter(|&p| level.is_free(p)).collect();
    if attributes.wedges.stride() > 0 {
        let wishes = Wishes::of_samples(level, attributes);
        for _ in 0..ROUNDS {
            let pulls = wishes.pull(level.surface);
            free.iter().for_each(|&p| pulls.apply(level.surface, p));
        }
    }
    for p in free {
        look_up_influences(level, attributes, p);
    }
}

/// What samples want of the faces that they are on, which is found once, as no point moves meanwhile. With `b` the barycentric weights of samples
/// and `v` their values, a face needs `Mₖₗ = Σ w bₖ bₗ` and `Sₖ = Σ w bₖ v` alone: its corners are pulled by `Sₖ − Σ Mₖₗ vₗ`.
struct Wishes {
    stride: usize,
    columns: Vec<Column>,
    /// Of each face, by column, as samples may count for some columns only: M, row by row.
    moments: Vec<[[f32; 3]; 3]>,
    /// Of each face: S of its three corners, a row each.
    sums: Vec<f32>,
}

impl Wishes {
    fn of_samples(level: &Level, attributes: &SourceAttributes) -> Self {
        let (stride, columns) = (attributes.wedges.stride(), level.surface.wedges.columns().to_vec());
        let slots = level.surface.face_slots();
        let (moments, sums) = (vec![[[0.0; 3]; 3]; slots * columns.len()], vec![0.0; slots * 3 * stride]);
        let mut wishes = Self { stride, columns, moments, sums };
        for face in level.surface.live_faces() {
            let triangle = level.triangle(face);
            let wedges = level.surface.face_wedges(face);
            let group = level.surface.wedges.group(wedges[0]);
            for s in level.lists.samples(face) {
                let sample = &level.source.samples[s as usize];
                if attributes.group(sample.face) != group {
                    continue;
                }
                let (_, shares, _) = closest_point(triangle, sample.position);
                let wanted = attributes.row_at(level.source, s);
                wishes.add(level.surface, face, (shares, sample.weight), &wanted);
            }
        }
        wishes
    }

    fn add(&mut self, surface: &Surface, face: usize, (shares, weight): ([f32; 3], f32), wanted: &[f32]) {
        let heavy = shares.map(|share| share * weight);
        for (c, column) in self.columns.iter().enumerate() {
            if let Semantic::TexCoord(_) = column.semantic
                && is_other_chart(surface, face, column.offset, shares, wanted)
            {
                continue;
            }
            for (k, heavy) in heavy.into_iter().enumerate() {
                let moments = &mut self.moments[face * self.columns.len() + c][k];
                moments.iter_mut().zip(shares).for_each(|(sum, share)| *sum += heavy * share);
                let range = column.offset..column.offset + column.width;
                let sums = &mut self.sums[(3 * face + k) * self.stride..][range.clone()];
                sums.iter_mut().zip(&wanted[range]).for_each(|(sum, value)| *sum += heavy * value);
            }
        }
    }

    fn pull(&self, surface: &Surface) -> Pulls<'_> {
        let (points, count) = (surface.points.len(), self.columns.len());
        let (sums, weights) = (vec![0.0; points * self.stride], vec![0.0; points * count]);
        let mut pulls = Pulls { stride: self.stride, sums, weights, columns: &self.columns };
        for face in surface.live_faces() {
            let rows = surface.face_wedges(face).map(|wedge| surface.wedges.row(wedge));
            for (k, p) in surface.face(face).into_iter().enumerate() {
                let sums = &mut pulls.sums[p as usize * self.stride..][..self.stride];
                let wanted = &self.sums[(3 * face + k) * self.stride..][..self.stride];
                for (c, column) in self.columns.iter().enumerate() {
                    let [x, y, z] = self.moments[face * count + c][k];
                    pulls.weights[p as usize * count + c] += x + y + z;
                    for i in column.offset..column.offset + column.width {
                        sums[i] += wanted[i] - (x * rows[0][i] + y * rows[1][i] + z * rows[2][i]);
                    }
                }
            }
        }
        pulls
    }
}

/// What the samples around each point would add to its values.
struct Pulls<'a> {
    stride: usize,
    sums: Vec<f32>,
    /// By column.
    weights: Vec<f32>,
    columns: &'a [Column],
}

impl Pulls<'_> {
    fn apply(&self, surface: &mut Surface, p: u32) {
        let own = wedges_of(surface, p);
        let Some(&first) = own.first() else { return };
        let mut row: Row = SmallVec::from_slice(surface.wedges.row(first));
        for (c, column) in self.columns.iter().enumerate() {
            let weight = self.weights[p as usize * self.columns.len() + c];
            if weight <= 0.0 || column.semantic == Semantic::Id {
                continue;
            }
            change(&surface.wedges, &mut row, column, |i| self.sums[p as usize * self.stride + i] / weight);
        }
        for &wedge in &own {
            keep_charts(surface, p, wedge, &mut row);
        }
        for wedge in own {
            surface.wedges.row_mut(wedge).copy_from_slice(&row);
        }
    }
}

/// Gives the wedges of a point the values that their own faces have, or would have, where it goes by `step`: linearly, as those faces do.
/// Displacements and what belongs to the point as a whole stay.
pub(super) fn go_along(surface: &mut Surface, p: u32, step: Vec3) {
    if surface.wedges.stride() == 0 {
        return;
    }
    for wedge in wedges_of(surface, p) {
        let mut row: Row = SmallVec::from_slice(surface.wedges.row(wedge));
        let along = change_along(surface, p, wedge, step);
        let stays = |column: &Column| column.semantic == Semantic::Id || is_displacement(column.semantic);
        for column in surface.wedges.columns().iter().filter(|column| !stays(column)) {
            change(&surface.wedges, &mut row, column, |i| along[i]);
        }
        keep_charts(surface, p, wedge, &mut row);
        surface.wedges.row_mut(wedge).copy_from_slice(&row);
    }
}

/// Adds `by` to the values of a column; normals stay of unit length, and a tangent's handedness what it is.
fn change(wedges: &Wedges, row: &mut Row, column: &Column, by: impl Fn(usize) -> f32) {
    let count = if column.semantic == Semantic::Tangent { column.width.min(3) } else { column.width };
    let range = column.offset..column.offset + count;
    let is_normal = column.semantic == Semantic::Normal && column.width == 3;
    let old = is_normal.then(|| Vec3::from_slice(&row[range.clone()]));
    for i in range.clone() {
        row[i] = wedges.within_range(i, row[i] + by(i));
    }
    if let Some(old) = old {
        Vec3::from_slice(&row[range.clone()]).try_normalize().unwrap_or(old).write_to_slice(&mut row[range]);
    }
}

/// By how much the values of a wedge change along `step`: the mean over its faces by area. Faces that are thin in that direction tell nothing.
fn change_along(surface: &Surface, p: u32, wedge: u32, step: Vec3) -> Row {
    let mut change: Row = SmallVec::from_elem(0.0, surface.wedges.stride());
    let mut whole = 0.0;
    for &corner in surface.ring(p).iter().filter(|&&c| surface.wedge_at(c) == wedge) {
        let at = |q: u32| (surface.points[q as usize] - surface.points[p as usize]).as_vec3();
        let [first, second] = surface.opposite(corner).map(at);
        let normal = first.cross(second);
        let shares = [step.cross(second), first.cross(step)].map(|c| c.dot(normal) / normal.length_squared());
        if !shares.iter().all(|share| share.abs() < 1.0) {
            continue;
        }
        let area = normal.length();
        whole += area;
        let here = surface.wedges.row(wedge);
        for (w, share) in surface.opposite_wedges(corner).into_iter().zip(shares) {
            let there = surface.wedges.row(w);
            change.iter_mut().zip(here.iter().zip(there)).for_each(|(sum, (h, t))| *sum += area * share * (t - h));
        }
    }
    if whole > 0.0 {
        change.iter_mut().for_each(|sum| *sum /= whole);
    }
    change
}

/// Whether a sample's texture coordinates cannot be those of a face, at the place with these barycentric weights.
fn is_other_chart(surface: &Surface, face: usize, offset: usize, shares: [f32; 3], wanted: &[f32]) -> bool {
    let at = |row: &[f32]| Vec2::new(row[offset], row[offset + 1]);
    let [a, b, c] = surface.face_wedges(face).map(|w| at(surface.wedges.row(w)));
    let now = a * shares[0] + b * shares[1] + c * shares[2];
    let extent = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    now.distance_squared(at(wanted)) > SAME_CHART * SAME_CHART * extent
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
pub(super) fn blend_rows(wedges: &Wedges, corners: [u32; 3], weights: [f32; 3]) -> Row {
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

/// Puts back the texture coordinates that a wedge of a point has, where those in `row` would turn a face over in the texture.
fn keep_charts(surface: &Surface, p: u32, wedge: u32, row: &mut [f32]) {
    let wedges = &surface.wedges;
    for offset in wedges.tex_coords() {
        let at = |row: &[f32]| Vec2::from_slice(&row[offset..]);
        let (old, new) = (at(wedges.row(wedge)), at(row));
        let turns = |corner: u32| {
            let [b, c] = surface.opposite_wedges(corner).map(|w| at(wedges.row(w)));
            let (before, after) = ((b - old).perp_dot(c - old), (b - new).perp_dot(c - new));
            turns_over([b, c], old, new) || after.abs() > MOST_GROWTH * before.abs()
        };
        if surface.ring(p).iter().any(|&corner| surface.wedge_at(corner) == wedge && turns(corner)) {
            old.write_to_slice(&mut row[offset..offset + 2]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{two_charts, uv_of_two_charts};
    use super::*;
    use crate::mesh::Mesh;

    fn uvs(mesh: &Mesh, step: Vec3) -> Vec<([f32; 2], Vec<f32>)> {
        let mut surface = Surface::new(mesh);
        // The middle of the seam; the unit frame is twice as large as the sheet, or less.
        let step_there = step * surface.frame.scale() as f32;
        go_along(&mut surface, 12, step_there);
        let x = Vec3::from(mesh.positions[12]) + step;
        let of_wedge = |w: u32| {
            let is_upper = surface.wedges.row(w)[0] > 4.0;
            (uv_of_two_charts(x, is_upper), surface.wedges.row(w).to_vec())
        };
        wedges_of(&surface, 12).into_iter().map(of_wedge).collect()
    }

    #[test]
    fn either_side_of_a_seam_goes_on_linearly() {
        for step in [Vec3::X * 0.1, Vec3::X * -0.2, Vec3::Z * 0.3, Vec3::new(0.05, 0.0, 0.1)] {
            let found = uvs(&two_charts(), step);
            assert_eq!(found.len(), 2, "two wedges");
            for (expected, is) in found {
                assert!((0..2).all(|k| (is[k] - expected[k]).abs() < 1e-5), "{step}: {is:?} for {expected:?}");
            }
        }
    }

    #[test]
    fn a_step_that_would_turn_a_chart_over_leaves_its_place_there() {
        let mut mesh = two_charts();
        // The point above the seam's middle is beside it in the texture: a small step goes past it.
        let [at, near] = [27, 17].map(|v| 2 * v);
        let values = &mut mesh.attributes[0].values;
        let here = [values[at], values[at + 1]];
        (values[near], values[near + 1]) = (here[0] + 0.01, here[1] + 0.001);
        let before = uvs(&mesh, Vec3::ZERO);
        let after = uvs(&mesh, Vec3::X * 0.2);
        let upper = |found: &[([f32; 2], Vec<f32>)]| found.iter().map(|(_, row)| row.clone()).find(|row| row[0] > 4.0);
        assert_eq!(upper(&before), upper(&after));
    }
}
