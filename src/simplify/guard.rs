//! Which collapses may not happen, and why: link condition, turned faces, needles.

use super::Refusals;
use crate::curvature::normal_and_area;
use crate::mesh::edges::{EdgeKind, edge_kind};
use crate::mesh::surface::Surface;
use crate::mesh::surgery::Merge;
use glam::DVec3;
use smallvec::SmallVec;

/// Cosine of the largest angle by which a collapse may turn a face.
const FLIP_COSINE: f64 = 0.2;
/// Quality (4√3·area / Σ edge²: 1 equilateral, 0 degenerate) below which a face is a needle and may only get better.
const NEEDLE_QUALITY: f64 = 0.06;

/// Why a collapse was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    Link,
    Flip,
    Needle,
    Border,
    Seam,
}

impl Refusals {
    pub(crate) fn count(&mut self, cause: Cause) {
        *match cause {
            Cause::Link => &mut self.link,
            Cause::Flip => &mut self.flip,
            Cause::Needle => &mut self.needle,
            Cause::Border => &mut self.border,
            Cause::Seam => &mut self.seam,
        } += 1;
    }
}

/// How much is forbidden. Each step down is taken only when the one before leaves nothing to collapse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Strictness {
    /// Topology, seams and shape are kept.
    Full,
    /// Seams may end inside the surface and needles may appear.
    Seams,
    /// Handles and holes may close.
    Topology,
}

/// Checks topology: the collapse must not join sheets, close holes or leave nothing behind (link condition).
pub(crate) fn check_topology(surface: &Surface, merge: &Merge, on_border: (bool, bool)) -> Result<(), Cause> {
    let neighbours = |point: u32| {
        let mut found: SmallVec<[u32; 16]> = SmallVec::new();
        for &corner in surface.ring(point) {
            for p in surface.opposite(corner) {
                if !found.contains(&p) {
                    found.push(p);
                }
            }
        }
        found
    };
    let (near, far) = (neighbours(merge.kept), neighbours(merge.gone));
    let across: SmallVec<[u32; 4]> =
        merge.faces.iter().flat_map(|&f| surface.face(f)).filter(|&p| p != merge.kept && p != merge.gone).collect();
    let common = |p: &u32| far.contains(p);
    if near.iter().filter(|p| common(p)).any(|p| !across.contains(p)) {
        return Err(Cause::Link);
    }
    if on_border.0 && on_border.1 {
        let kind = edge_kind(surface, merge.kept, merge.gone).unwrap_or_default();
        if !kind.has(EdgeKind::BORDER) && !kind.has(EdgeKind::COMPLEX) {
            return Err(Cause::Border);
        }
    }
    check_remains(surface, merge, &across)
}

/// Something must be left of the piece, and no two faces may come to lie on each other (the tetrahedron).
fn check_remains(surface: &Surface, merge: &Merge, across: &[u32]) -> Result<(), Cause> {
    let (mut survivors, mut over_across) = (0, 0);
    for corner in merge.surviving(surface) {
        survivors += 1;
        over_across += usize::from(surface.opposite(corner).iter().all(|p| across.contains(p)));
    }
    if survivors == 0 || over_across > 1 { Err(Cause::Link) } else { Ok(()) }
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

/// Checks the faces that survive: none may turn by more than the limit, none may become a needle that was none.
pub(crate) fn check_shape(surface: &Surface, merge: &Merge, position: DVec3, needles: bool) -> Result<(), Cause> {
    for corner in merge.surviving(surface) {
        let before = surface.triangle(Surface::face_of(corner));
        let mut after = before;
        after[(corner & 3) as usize] = position;
        let ((old, _), (new, _)) = (normal_and_area(before), normal_and_area(after));
        if old != DVec3::ZERO && new.dot(old) < FLIP_COSINE {
            return Err(Cause::Flip);
        }
        if needles {
            let quality = face_quality(after);
            if quality < NEEDLE_QUALITY && quality < face_quality(before) {
                return Err(Cause::Needle);
            }
        }
    }
    Ok(())
}

/// 4√3 · area / Σ edge²: 1 for an equilateral triangle, 0 for a degenerate one.
pub(crate) fn face_quality([a, b, c]: [DVec3; 3]) -> f64 {
    let edges = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
    if edges > 0.0 { 2.0 * 3f64.sqrt() * (b - a).cross(c - a).length() / edges } else { 0.0 }
}
