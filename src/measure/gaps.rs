//! Cracks: open edges of a level that are not the source's border.
//!
//! A border may move as much as simplification moves it, so a level's open edge counts as border if all of it lies
//! within a tolerance of the source's open edges. The tolerance is [`SLACK`] times the smaller of two measures of how
//! far the border went: the Hausdorff distance of the surfaces (a border that retreats or advances by s uncovers or
//! adds surface up to s away), and the largest distance from the source's border to the level's open edges, which
//! stays small where the border was kept, however far the rest moved.
//!
//! Limits: a crack nearer to the border than that is not seen.

use super::topology::Topology;
use crate::bvh::Bvh;
use crate::mesh::Mesh;
use glam::DVec3;

/// Where an open edge is looked at.
const POINTS: [f64; 5] = [0.0, 1.0, 0.5, 0.25, 0.75];

/// Neither measure is an exact bound in this direction: a corner of the level's border can be farther from the source's
/// border than that is from any edge of the level. Seen on borders without cracks: 2.5. Cracks lie much farther off.
const SLACK: f64 = 4.0;

/// Rounding of positions, as a share of the diagonal.
const ROUNDING: f64 = 1e-6;

/// The tree of a mesh's open edges; `None` if it has none.
pub fn grow_border_tree(mesh: &Mesh, topology: &Topology) -> Option<Bvh> {
    let segments: Vec<[u32; 3]> = topology.open_edges.iter().map(|&[a, b]| [a, b, b]).collect();
    (!segments.is_empty()).then(|| Bvh::new(&mesh.positions, &segments))
}

/// Open edges of `level` that have no counterpart in the source's border. `border` are points on that border and
/// `border_tree` its tree.
pub fn count_gaps(
    border: &[DVec3],
    border_tree: Option<&Bvh>,
    level: &Mesh,
    topology: &Topology,
    hausdorff: f64,
    diagonal: f64,
) -> usize {
    let Some(level_tree) = grow_border_tree(level, topology) else { return 0 };
    let Some(border_tree) = border_tree else { return topology.open_edges.len() };
    let moved = level_tree.largest_distance(border, 0.0);
    let tolerance = SLACK * hausdorff.min(moved) + ROUNDING * diagonal;
    let point = |v: u32| DVec3::from(level.positions[v as usize].map(f64::from));
    let strays = |&[a, b]: &[u32; 2]| {
        POINTS.iter().any(|&t| border_tree.closest_beyond(point(a).lerp(point(b), t), tolerance).is_some())
    };
    topology.open_edges.iter().filter(|edge| strays(edge)).count()
}
