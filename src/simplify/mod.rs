//! The simplifier: one run from fine to coarse, a snapshot at each target.

mod appearance;
mod buckets;
mod cards;
mod constraints;
mod cost;
mod deviation;
mod ends;
mod enhanced;
mod fan;
mod fms;
mod guard;
mod levels;
mod melax;
mod normals;
mod options;
mod paper;
mod passes;
mod placement;
mod prune;
mod qfvp;
mod quadric;
mod queue;
mod reducer;
mod refine;
mod shading;
mod split;
#[cfg(test)]
mod tests;
mod vertices;

pub use levels::simplify;
pub use options::{
    Algorithm, AttributeWeights, EdgePolicy, Effort, FeatureWeight, Mode, NormalUpdate, Options, Placement, Schedule,
    Target,
};
pub(crate) use queue::record;

use crate::mesh::Mesh;

/// The levels of one mesh, finest first, one for each target.
#[derive(Debug, Clone)]
pub struct Chain {
    /// One for each of [`Options::levels`], in their order.
    pub levels: Vec<Level>,
}

/// One level of detail.
#[derive(Debug, Clone)]
pub struct Level {
    /// The simplified mesh: attributes and skin in the source's layout, no unused vertices.
    pub mesh: Mesh,
    /// With [`Placement::Subset`], for each vertex of `mesh` the vertex of the source that it is, with all its attributes; else `None`.
    pub source_vertices: Option<Vec<u32>>,
    /// Why it has the triangles it has.
    pub stop: Stop,
    /// Collapses refused since the level before, by cause.
    pub refusals: Refusals,
}

/// What ended a level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The triangle target (± 1) is met.
    Target,
    /// [`Options::min_triangles`] is met; the target asks for fewer.
    Floor,
    /// One more step would break the error target.
    Error,
    /// No edge may collapse any more; the refusals say why.
    Stuck,
}

/// Refused collapses by cause. All but flips are refused at their cost only: they may happen later, for a fine, so that targets are reached.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Refusals {
    /// The link condition: the surface would fold onto itself or change its topology; or a piece would vanish, which has its own price.
    pub link: u64,
    /// A face would turn over.
    pub flip: u64,
    /// A face would become a needle.
    pub needle: u64,
    /// Two borders would be pinched together, or both ends are locked.
    pub border: u64,
    /// A seam or material border would end inside the surface.
    pub seam: u64,
}
