//! The chain: one run from fine to coarse, a snapshot at each target.

use super::options::{Options, Schedule, Target};
use super::reducer::Reducer;
use super::{Chain, Level, Refusals, Stop, passes, queue};
use crate::error::Result;
use crate::mesh::Mesh;

/// Simplifies `mesh` to every target of `options`, each level from the one before.
///
/// # Errors
/// [`Kind::Malformed`](crate::Kind::Malformed) when an index is out of range, an array has the wrong length or a position is not finite.
pub fn simplify(mesh: &Mesh, options: &Options) -> Result<Chain> {
    mesh.validate()?;
    let mut reducer = Reducer::new(mesh, options);
    let source = mesh.triangles.len();
    let mut levels = Vec::with_capacity(options.levels.len());
    for target in &options.levels {
        reducer.refusals = Refusals::default();
        let stop = reduce(&mut reducer, options, triangle_target(target, source, options.min_triangles));
        levels.push(Level { mesh: reducer.surface.to_mesh(), stop, refusals: reducer.refusals });
    }
    Ok(Chain { levels })
}

fn reduce(reducer: &mut Reducer, options: &Options, target: usize) -> Stop {
    match options.schedule {
        Schedule::Passes => passes::run(reducer, target),
        Schedule::Queue => queue::run(reducer, target),
    }
}

/// The fewest triangles that the counting rules ask for: the first rule that binds on the way down is the largest number.
fn triangle_target(target: &Target, source: usize, least: usize) -> usize {
    let ratio = target.ratio.map(|r| (source as f64 * r).round() as usize);
    let count = [ratio, target.triangles].into_iter().flatten().max();
    let floor = if target.error.is_some() { least } else { source };
    count.unwrap_or(floor).clamp(least.min(source), source)
}
