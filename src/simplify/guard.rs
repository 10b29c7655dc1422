//! Which collapses may not happen, or only at a higher cost, and why: turned faces, link condition, needles, torn seams.

use super::Refusals;
use super::cost::{Candidate, Cost};
use super::fan::is_any_poor;
use super::options::{Algorithm, Effort, Mode, Options, Placement};
use crate::mesh::edges::{EdgeKind, edge_kind};
use crate::mesh::surface::Surface;
use crate::mesh::surgery::{Merge, holds};
use smallvec::SmallVec;

/// Variance of the normals around a point from which the surface counts as bent.
const BENT: f64 = 1e-5;

/// Why a collapse was refused or fined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    Vanish,
    /// The last four faces of a piece would become two, back to back.
    Flatten,
    Link,
    Flip,
    Needle,
    /// A face would be a line: no price buys that.
    Line,
    Border,
    Seam,
    /// A wedge has none of its group to become.
    Unpaired,
    /// A face would turn over in a texture.
    Chart,
}

impl Refusals {
    pub(crate) fn add(&mut self, other: Self) {
        self.link += other.link;
        self.flip += other.flip;
        self.needle += other.needle;
        self.border += other.border;
        self.seam += other.seam;
    }

    pub(crate) fn count(&mut self, cause: Cause) {
        *match cause {
            Cause::Link | Cause::Flatten | Cause::Vanish => &mut self.link,
            Cause::Flip => &mut self.flip,
            Cause::Needle | Cause::Line => &mut self.needle,
            Cause::Border => &mut self.border,
            Cause::Seam | Cause::Unpaired | Cause::Chart => &mut self.seam,
        } += 1;
    }
}

impl Cause {
    /// What the collapse pays if it may happen all the same; `None` if it may not.
    fn fine(self) -> Option<f64> {
        match self {
            // The next thing to happen to it is that it goes as a whole.
            Self::Flatten => Some(1.0),
            Self::Needle => Some(4.0),
            // What closes a handle or flattens a plank to a card: better than losing the plank.
            Self::Link => Some(8.0),
            Self::Seam => Some(16.0),
            Self::Border => Some(32.0),
            Self::Flip | Self::Line | Self::Vanish | Self::Unpaired | Self::Chart => None,
        }
    }

    /// `candidate`'s cost with the fine, for an edge of this length; `None` if no fine buys the collapse. Where the surface is flat and the cost
    /// nothing, the fine is still something. Where the surface [bends](Cost::bend), less: along a cylinder needles are the faces that fit, and a thin tube
    /// is better a flat one than a shorter one.
    pub fn fined(
        self,
        cost: &dyn Cost,
        candidate: Candidate,
        length_squared: f64,
        needles: Needles,
        bend: f64,
    ) -> Option<f64> {
        let slope = if self == Self::Needle { needles.slope_squared } else { SLOPE_SQUARED };
        let least = cost.weigh(length_squared, slope / (1.0 + bend / BENT).powi(2) * length_squared);
        self.fine().map(|factor| factor * (candidate.cost + least))
    }
}

/// Square of the height, relative to the edge, of an error that a fine is like at least.
const SLOPE_SQUARED: f64 = 1e-4;

/// Quality below which a face is a line: its normal is rounding.
const LINE: f32 = 1e-5;

/// Which faces are needles, and what they are fined for at least.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Needles {
    /// Quality below which a face is one.
    quality: f32,
    slope_squared: f64,
}

impl Needles {
    /// The papers know no needles, and only the worst are kept from them.
    pub fn of(options: &Options) -> Self {
        let (quality, slope_squared) = match (options.algorithm, options.placement, options.effort) {
            (Algorithm::Esqem(Mode::Enhanced), Placement::Subset, _) => (0.18, SLOPE_SQUARED),
            (Algorithm::Esqem(Mode::Enhanced), _, Effort::Fast) => (0.16, SLOPE_SQUARED),
            // More faces are needles, so flat parts must not become dear.
            (Algorithm::Esqem(Mode::Enhanced), ..) => (0.28, 1e-5),
            _ => (0.06, SLOPE_SQUARED),
        };
        Self { quality, slope_squared }
    }
}

/// Checks what is left of the piece.
pub(crate) fn check_remains(merge: &Merge, paid: bool) -> Result<(), Cause> {
    match (merge.spokes().len(), merge.across.len()) {
        // Whole pieces go at a price of their own, see `prune`.
        (0, _) => Err(Cause::Vanish),
        (2, 2) if !paid && merge.rims()[0] == [merge.rims()[1][1], merge.rims()[1][0]] => Err(Cause::Flatten),
        _ => Ok(()),
    }
}

/// Checks topology: the collapse must not join sheets or close holes (link condition). `border`: which points lie on an open edge.
pub(crate) fn check_topology(surface: &Surface, merge: &Merge, border: &[bool]) -> Result<(), Cause> {
    let across: SmallVec<[u32; 4]> = merge.across.iter().map(|across| across.0).collect();
    let (near, far) = merge.rims().split_at(merge.spokes_of_kept().len());
    let is_near = |p: &u32| holds(near.as_flattened(), *p) && !holds(&across, *p);
    if far.as_flattened().iter().any(is_near) {
        return Err(Cause::Link);
    }
    // Faces over the same points across the edge, one at either end, would lie on each other (the tetrahedron).
    let over_across = |rim: &&[u32; 2]| holds(&across, rim[0]) && holds(&across, rim[1]);
    if merge.rims().iter().filter(over_across).count() > 1 {
        return Err(Cause::Link);
    }
    if border[merge.kept as usize] && border[merge.gone as usize] && merge.across.len() == 2 {
        let kind = edge_kind(surface, merge.kept, merge.gone).unwrap_or_default();
        if !kind.has(EdgeKind::COMPLEX) {
            return Err(Cause::Border);
        }
    }
    Ok(())
}

/// Checks the shapes of the faces that survive: none of a [quality](super::fan::Fan::look) below that of a needle may become worse than the worst that
/// was there, unless the source [is slender](Cost::is_slender). `worst`: the least quality after the collapse. Lines may not even come of paid
/// collapses.
pub(crate) fn check_needles(
    surface: &Surface,
    merge: &Merge,
    cost: &dyn Cost,
    worst: f32,
    needles: Needles,
    paid: bool,
) -> Result<(), Cause> {
    let is_spared = || !paid && worst >= LINE && cost.is_slender(merge.kept, merge.gone);
    let was_worse = || {
        let corners = [surface.ring(merge.kept), merge.spokes_of_gone()];
        corners.into_iter().any(|corners| is_any_poor(surface, corners, worst))
    };
    let (limit, cause) = if paid { (LINE, Cause::Line) } else { (needles.quality, Cause::Needle) };
    if worst < limit && !is_spared() && !was_worse() { Err(cause) } else { Ok(()) }
}
