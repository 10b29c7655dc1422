//! Attributes after points have moved: looked up on the source at the closest point, not averaged along the way.
//!
//! Only points without a seam are looked up. Where the source's value cannot be that of the place (another group, another chart), what the
//! collapses have solved stays.

use super::level::Level;
use super::source::closest_point;
use crate::mesh::Semantic;
use crate::mesh::surface::Surface;
use crate::mesh::wedges::Wedges;
use glam::Vec2;
use smallvec::SmallVec;

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
        surface.wedges.has_data().then(|| Self { wedges: surface.wedges.clone(), corners })
    }
}

/// Looks up the attributes of all points that are not `fixed`.
pub(super) fn look_up(level: &mut Level, attributes: &SourceAttributes, fixed: &[bool]) {
    for p in 0..level.surface.points.len() as u32 {
        if !fixed[p as usize] && !level.surface.ring(p).is_empty() {
            look_up_point(level, attributes, p);
        }
    }
}

fn look_up_point(level: &mut Level, attributes: &SourceAttributes, p: u32) {
    let foot = level.foot(p);
    let Some(corners) = attributes.corners.get(foot.face as usize) else { return };
    let (_, weights, _) = closest_point(level.source.triangle(foot.face), foot.point);
    let mut own: SmallVec<[u32; 4]> = level.surface.ring(p).iter().map(|&c| level.surface.wedge_at(c)).collect();
    own.sort_unstable();
    own.dedup();
    if own.iter().any(|&w| level.surface.wedges.group(w) != attributes.wedges.group(corners[0])) {
        return;
    }
    let mut row: SmallVec<[f32; 16]> = blend_rows(&attributes.wedges, *corners, weights);
    keep_charts(level.surface, p, &mut row);
    let influences = attributes.wedges.blend_influences(*corners, weights);
    for wedge in own {
        level.surface.wedges.row_mut(wedge).copy_from_slice(&row);
        if !influences.is_empty() {
            level.surface.wedges.set_influences(wedge, &influences);
        }
    }
}

/// The values inside a face of these wedges.
fn blend_rows(wedges: &Wedges, corners: [u32; 3], weights: [f32; 3]) -> SmallVec<[f32; 16]> {
    let rows = corners.map(|w| wedges.row(w));
    let largest = (0..3).max_by(|&a, &b| weights[a].total_cmp(&weights[b])).unwrap_or(0);
    let mut row = SmallVec::from_slice(rows[largest]);
    for column in wedges.columns() {
        for i in column.offset..column.offset + column.width {
            let is_sign = column.semantic == Semantic::Tangent && i == column.offset + 3;
            if column.semantic != Semantic::Id && !is_sign {
                row[i] = rows[0][i] * weights[0] + rows[1][i] * weights[1] + rows[2][i] * weights[2];
            }
        }
    }
    row
}

/// Puts back the texture coordinates that the point has, where those in `row` would turn a face over in the texture: they are of another chart.
fn keep_charts(surface: &Surface, p: u32, row: &mut [f32]) {
    let wedges = &surface.wedges;
    for column in wedges.columns().iter().filter(|c| matches!(c.semantic, Semantic::TexCoord(_))) {
        let at = |row: &[f32]| Vec2::new(row[column.offset], row[column.offset + 1]);
        let turns = |&corner: &u32| {
            let [b, c] = surface.opposite_wedges(corner).map(|w| at(wedges.row(w)));
            let (old, new) = (at(wedges.row(surface.wedge_at(corner))), at(row));
            let (before, after) = ((b - old).perp_dot(c - old), (b - new).perp_dot(c - new));
            before * after < 0.0 || after.abs() > MOST_GROWTH * before.abs()
        };
        if surface.ring(p).iter().any(turns)
            && let Some(&corner) = surface.ring(p).first()
        {
            let old = wedges.row(surface.wedge_at(corner));
            row[column.offset..column.offset + column.width]
                .copy_from_slice(&old[column.offset..column.offset + column.width]);
        }
    }
}

/// A face's area in the texture may grow by this factor.
const MOST_GROWTH: f32 = 8.0;
