//! Which collapses may not happen, or only at a higher cost, and why: turned faces, link condition, needles, torn seams.

use super::Refusals;
use super::cost::{Candidate, Cost};
use crate::mesh::edges::{EdgeKind, edge_kind};
use crate::mesh::surface::Surface;
use crate::mesh::surgery::Merge;
use glam::DVec3;

/// Cosine of the largest angle by which a collapse may turn a face.
const FLIP_COSINE: f64 = 0.2;

/// Why a collapse was refused or fined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    Vanish,
    Link,
    Flip,
    Needle,
    Border,
    Seam,
    /// A wedge has none of its group to become.
    Unpaired,
}

impl Refusals {
    pub(crate) fn count(&mut self, cause: Cause) {
        *match cause {
            Cause::Link | Cause::Vanish => &mut self.link,
            Cause::Flip => &mut self.flip,
            Cause::Needle => &mut self.needle,
            Cause::Border => &mut self.border,
            Cause::Seam | Cause::Unpaired => &mut self.seam,
        } += 1;
    }
}

impl Cause {
    /// What the collapse pays if it may happen all the same; `None` if it may not.
    fn fine(self) -> Option<f64> {
        match self {
            Self::Needle => Some(4.0),
            // What closes a handle or flattens a plank to a card: better than losing the plank.
            Self::Link => Some(8.0),
            Self::Seam => Some(16.0),
            Self::Border => Some(32.0),
            Self::Flip | Self::Vanish | Self::Unpaired => None,
        }
    }

    /// `candidate`'s cost with the fine, for an edge of this length; `None` if no fine buys the collapse. Where the surface is flat and the cost
    /// nothing, the fine is still something: as much as a shape error of a hundredth of the length.
    pub fn fined(self, cost: &dyn Cost, candidate: Candidate, length_squared: f64) -> Option<f64> {
        let least = cost.weigh(length_squared, 1e-4 * length_squared);
        self.fine().map(|factor| factor * (candidate.cost + least))
    }
}

/// Checks that something is left of the piece.
pub(crate) fn check_remains(merge: &Merge) -> Result<(), Cause> {
    // Whole pieces go at a price of their own, see `prune`.
    if merge.spokes.is_empty() { Err(Cause::Vanish) } else { Ok(()) }
}

/// A set of points that is emptied at no cost.
#[derive(Debug, Default)]
pub(crate) struct Marks {
    round: u32,
    marks: Vec<u32>,
}

impl Marks {
    /// Two fresh marks.
    fn begin(&mut self, points: usize) -> [u32; 2] {
        if self.marks.len() < points || self.round > u32::MAX - 4 {
            self.marks.clear();
            self.marks.resize(points, 0);
            self.round = 0;
        }
        self.round += 2;
        [self.round - 1, self.round]
    }

    fn set(&mut self, point: u32, mark: u32) {
        self.marks[point as usize] = mark;
    }

    fn has(&self, point: u32, mark: u32) -> bool {
        self.marks[point as usize] == mark
    }
}

/// Checks topology: the collapse must not join sheets or close holes (link condition). `border`: which points lie on an open edge.
pub(crate) fn check_topology(
    surface: &Surface,
    merge: &Merge,
    border: &[bool],
    marks: &mut Marks,
) -> Result<(), Cause> {
    let [near, across] = marks.begin(surface.points.len());
    for &corner in merge.spokes_of_kept() {
        surface.opposite(corner).iter().for_each(|&p| marks.set(p, near));
    }
    merge.across(surface).for_each(|p| marks.set(p, across));
    let far = merge.spokes_of_gone().iter().flat_map(|&c| surface.opposite(c));
    if far.into_iter().any(|p| marks.has(p, near)) {
        return Err(Cause::Link);
    }
    // Faces over the same points across the edge, one at either end, would lie on each other (the tetrahedron).
    let over_across = |&&c: &&u32| surface.opposite(c).iter().all(|&p| marks.has(p, across));
    if merge.spokes.iter().filter(over_across).count() > 1 {
        return Err(Cause::Link);
    }
    if border[merge.kept as usize] && border[merge.gone as usize] && merge.faces.len() == 2 {
        let kind = edge_kind(surface, merge.kept, merge.gone).unwrap_or_default();
        if !kind.has(EdgeKind::COMPLEX) {
            return Err(Cause::Border);
        }
    }
    Ok(())
}

/// Checks the faces that survive: none may turn by more than the limit, and none of a [quality](face_quality) below `needle` become worse than the
/// worst that was there.
pub(crate) fn check_shape(surface: &Surface, merge: &Merge, position: DVec3, needle: f64) -> Result<(), Cause> {
    let mut worst = f64::INFINITY;
    for &corner in &merge.spokes {
        let [p, q] = surface.opposite(corner).map(|p| surface.points[p as usize]);
        let apex = surface.points[surface.point_at(corner) as usize];
        let (old, new) = ((p - apex).cross(q - apex), (p - position).cross(q - position));
        let turn = new.dot(old);
        let least = FLIP_COSINE * FLIP_COSINE * new.length_squared() * old.length_squared();
        if (turn <= 0.0 || turn * turn < least) && old != DVec3::ZERO {
            return Err(Cause::Flip);
        }
        let edges = p.distance_squared(position) + q.distance_squared(position) + p.distance_squared(q);
        worst = worst.min(squared_quality(new.length_squared(), edges));
    }
    let is_worse = |c| {
        let [a, b, c] = surface.triangle(Surface::face_of(c));
        let edges = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
        squared_quality((b - a).cross(c - a).length_squared(), edges) <= worst
    };
    if worst < needle * needle && !merge.corners(surface).any(is_worse) {
        return Err(Cause::Needle);
    }
    Ok(())
}

/// The square of 4√3 · area / Σ edge² (1 for an equilateral triangle, 0 for a degenerate one), from |2 · area|² and Σ edge².
fn squared_quality(double_area_squared: f64, edges: f64) -> f64 {
    if edges > 0.0 { 12.0 * double_area_squared / (edges * edges) } else { 0.0 }
}
