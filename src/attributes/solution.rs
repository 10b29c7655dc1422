//! The new values of the wedges of a joined point.

use super::metric::{Extended, Metric};
use super::{distinct_wedges, is_displacement, turns_over};
use crate::mesh::Semantic;
use crate::mesh::surface::Surface;
use crate::mesh::surgery::Merge;
use crate::mesh::wedges::Wedges;
use glam::{DVec3, Vec2, Vec3};
use smallvec::SmallVec;

/// Rows of attribute values in work; inline for the usual normal + tangent + UV.
type Row = SmallVec<[f32; 16]>;

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
    /// Of the faces that it stands for.
    area: f32,
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
            let mut extended = metric.extend(wedge, off_kept);
            for &partner in &partners {
                extended.join(&metric.extend(partner, off_gone));
            }
            let end = partners.first().copied();
            self.classes.push(Class::new(surface, metric, &extended, [wedge, wedge, end.unwrap_or(wedge)], t));
            self.follow_edge(surface, [wedge, end.unwrap_or(any_gone)], t);
        }
        for &wedge in at_gone.iter().filter(|&&w| merge.pairs.iter().all(|pair| pair.1 != w)) {
            let extended = metric.extend(wedge, off_gone);
            self.classes.push(Class::new(surface, metric, &extended, [wedge; 3], t));
            self.follow_edge(surface, [any_kept, wedge], t);
        }
        self.share_displacements(surface);
    }

    /// Whether a face around the joined point would turn over in a texture. Wedges that were not solved stay as they are.
    pub fn turns_charts(&self, surface: &Surface, merge: &Merge) -> bool {
        let wedges = &surface.wedges;
        wedges.tex_coords().any(|offset| {
            let at = |row: &[f32]| Vec2::from_slice(&row[offset..]);
            merge.spokes().iter().any(|&corner| {
                let old = surface.wedge_at(corner);
                let stays = merge.target(old);
                let base = surface.opposite_wedges(corner).map(|w| at(wedges.row(w)));
                let solved = self.classes.iter().find(|class| class.wedge == stays);
                let new = solved.map_or(wedges.row(stays), |class| &class.row);
                turns_over(base, at(wedges.row(old)), at(new))
            })
        })
    }

    /// Gives all wedges the same displacements, so that posed surfaces stay closed.
    fn share_displacements(&mut self, surface: &Surface) {
        for column in surface.wedges.columns().iter().filter(|c| is_displacement(c.semantic)) {
            for i in column.offset..column.offset + column.width {
                let total: f32 = self.classes.iter().map(|class| class.area).sum();
                let even = 1.0 / self.classes.len() as f32;
                let share = |class: &Class| if total > 0.0 { class.area / total } else { even };
                let mean: f32 = self.classes.iter().map(|class| share(class) * class.row[i]).sum();
                self.classes.iter_mut().for_each(|class| class.row[i] = mean);
            }
        }
    }

    /// Gives the last class the influences halfway (`t`) between a wedge at either end: continuous over seams.
    fn follow_edge(&mut self, surface: &Surface, [start, end]: [u32; 2], t: f32) {
        let (Some(class), wedges) = (self.classes.last_mut(), &surface.wedges) else { return };
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
        metric.write(extended, wedges, &mut row);
        normalize_normals(wedges, &mut row);
        Self { wedge: id, area: extended.area, row, influences: Vec::new() }
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
