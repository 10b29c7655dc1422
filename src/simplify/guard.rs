//! Which collapses may not happen, or only at a higher cost, and why: turned faces, link condition, needles, torn seams.

use super::Refusals;
use super::cost::{Candidate, Cost};
use crate::curvature::normal_and_area;
use crate::mesh::edges::{EdgeKind, edge_kind};
use crate::mesh::surface::Surface;
use crate::mesh::surgery::Merge;
use glam::DVec3;
use smallvec::SmallVec;

/// Cosine of the largest angle by which a collapse may turn a face.
const FLIP_COSINE: f64 = 0.2;
/// Quality (4√3·area / Σ edge²: 1 equilateral, 0 degenerate) below which a face is a needle.
const NEEDLE_QUALITY: f64 = 0.06;

/// Why a collapse was refused or fined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    Vanish,
    Link,
    Flip,
    Needle,
    Border,
    Seam,
}

impl Refusals {
    pub(crate) fn count(&mut self, cause: Cause) {
        *match cause {
            Cause::Link | Cause::Vanish => &mut self.link,
            Cause::Flip => &mut self.flip,
            Cause::Needle => &mut self.needle,
            Cause::Border => &mut self.border,
            Cause::Seam => &mut self.seam,
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
            Self::Flip | Self::Vanish => None,
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
pub(crate) fn check_remains(surface: &Surface, merge: &Merge) -> Result<(), Cause> {
    // Whole pieces go at a price of their own, see `prune`.
    if merge.surviving(surface).next().is_none() { Err(Cause::Vanish) } else { Ok(()) }
}

/// Checks topology: the collapse must not join sheets or close holes (link condition).
pub(crate) fn check_topology(surface: &Surface, merge: &Merge) -> Result<(), Cause> {
    let (near, far) = (surface.neighbours(merge.kept), surface.neighbours(merge.gone));
    let across: SmallVec<[u32; 4]> =
        merge.faces.iter().flat_map(|&f| surface.face(f)).filter(|&p| p != merge.kept && p != merge.gone).collect();
    if near.iter().any(|p| far.contains(p) && !across.contains(p)) {
        return Err(Cause::Link);
    }
    // Faces over the same points across the edge, one at either end, would lie on each other (the tetrahedron).
    let over_across = |&c: &u32| surface.opposite(c).iter().all(|p| across.contains(p));
    if merge.surviving(surface).filter(over_across).count() > 1 {
        return Err(Cause::Link);
    }
    if is_on_border(surface, merge.kept) && is_on_border(surface, merge.gone) {
        let kind = edge_kind(surface, merge.kept, merge.gone).unwrap_or_default();
        if !kind.has(EdgeKind::BORDER) && !kind.has(EdgeKind::COMPLEX) {
            return Err(Cause::Border);
        }
    }
    Ok(())
}

/// Whether a point lies on an open edge.
pub(crate) fn is_on_border(surface: &Surface, point: u32) -> bool {
    // Each neighbour on a closed fan is met twice; one that is met once ends an open edge.
    let mut once: SmallVec<[u32; 16]> = SmallVec::new();
    for &corner in surface.ring(point) {
        for p in surface.opposite(corner) {
            match once.iter().position(|&q| q == p) {
                Some(at) => {
                    once.swap_remove(at);
                }
                None => once.push(p),
            }
        }
    }
    !once.is_empty()
}

/// Checks the faces that survive: none may turn by more than the limit; with `needles`, none may become a worse needle than was there.
pub(crate) fn check_shape(surface: &Surface, merge: &Merge, position: DVec3, needles: bool) -> Result<(), Cause> {
    let mut worst = f64::INFINITY;
    for corner in merge.surviving(surface) {
        let before = surface.triangle(Surface::face_of(corner));
        let mut after = before;
        after[(corner & 3) as usize] = position;
        let ((old, _), (new, _)) = (normal_and_area(before), normal_and_area(after));
        if old != DVec3::ZERO && new.dot(old) < FLIP_COSINE {
            return Err(Cause::Flip);
        }
        worst = worst.min(face_quality(after));
    }
    let was_worse = || merge.corners(surface).any(|c| face_quality(surface.triangle(Surface::face_of(c))) <= worst);
    if needles && worst < NEEDLE_QUALITY && !was_worse() { Err(Cause::Needle) } else { Ok(()) }
}

/// 4√3 · area / Σ edge²: 1 for an equilateral triangle, 0 for a degenerate one.
pub(crate) fn face_quality([a, b, c]: [DVec3; 3]) -> f64 {
    let edges = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
    if edges > 0.0 { 2.0 * 3f64.sqrt() * (b - a).cross(c - a).length() / edges } else { 0.0 }
}
