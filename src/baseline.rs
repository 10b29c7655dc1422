//! meshoptimizer at the same triangle count: what every level of ours is compared with.

use crate::error::{Error, Kind, Result};
use crate::mesh::Mesh;

/// meshoptimizer's result for one target.
#[derive(Debug, Clone)]
pub struct Baseline {
    /// The simplified mesh.
    pub mesh: Mesh,
    /// The settings that gave it, e.g. `attributes` or `attributes+permissive+prune`.
    pub settings: &'static str,
    /// Whether the triangle target was met (within 1 % + 2 triangles).
    pub reached: bool,
}

/// Simplifies the whole of `mesh` (all groups as one index buffer, so that group borders are seams) to `triangles` by
/// meshoptimizer's best comparable settings.
///
/// # Errors
/// [`Kind::Malformed`] when an index of `mesh` is out of range or an array has the wrong length.
pub fn simplify(_mesh: &Mesh, _triangles: usize) -> Result<Baseline> {
    Err(Error::new(Kind::Unsupported, "not there yet"))
}
