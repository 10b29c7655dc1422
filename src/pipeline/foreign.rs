//! Levels made by meshoptimizer (`algorithm = "meshopt"`), under the same rules as our own.
//!
//! Each level comes from the source, not from the level above, as that is what is nearest to it.

use crate::baseline::{self, Baseline};
use crate::error::Result;
use crate::measure::Ruler;
use crate::mesh::Mesh;
use crate::simplify::{EdgePolicy, Level, Options, Refusals, Stop, Target};
use rayon::prelude::*;

/// Between two counts nearer than this share the search for an error target ends.
const SEARCH_STEP: f64 = 0.02;

/// One level for each target of `options`; `ruler` is the source's.
pub(super) fn make_levels(source: &Mesh, options: &Options, ruler: &Ruler) -> Result<Vec<Level>> {
    let maker = LevelMaker { source, options, ruler };
    options.levels.par_iter().map(|target| maker.make_level(target)).collect()
}

struct LevelMaker<'a> {
    source: &'a Mesh,
    options: &'a Options,
    ruler: &'a Ruler,
}

impl LevelMaker<'_> {
    fn make_level(&self, target: &Target) -> Result<Level> {
        let triangles = self.source.triangles.len();
        let least = self.options.min_triangles.clamp(1, triangles.max(1));
        let wanted = target.count(triangles, least);
        let (mesh, mut stop) = match target.error {
            Some(error) => self.search(wanted.max(least), error)?,
            None => describe(self.reduce(wanted.max(least))?),
        };
        if stop == Stop::Target && wanted < least {
            stop = Stop::Floor;
        }
        Ok(Level { mesh, source_vertices: None, stop, refusals: Refusals::default() })
    }

    fn reduce(&self, triangles: usize) -> Result<Baseline> {
        baseline::simplify_by(self.source, triangles, self.ruler, self.options.border == EdgePolicy::Lock)
    }

    /// The fewest triangles, but no fewer than `least`, whose measured distance stays below `error`.
    fn search(&self, least: usize, error: f64) -> Result<(Mesh, Stop)> {
        let is_near = |mesh: &Mesh| self.ruler.measure(mesh).hausdorff() <= error;
        let coarsest = self.reduce(least)?;
        if is_near(&coarsest.mesh) {
            return Ok(describe(coarsest));
        }
        let mut best = self.source.clone();
        let (mut too_few, mut enough) = (least, best.triangles.len());
        while too_few + 1 < enough && enough as f64 > too_few as f64 * (1.0 + SEARCH_STEP) {
            let middle = ((too_few as f64 * enough as f64).sqrt().round() as usize).clamp(too_few + 1, enough - 1);
            let tried = self.reduce(middle)?.mesh;
            if is_near(&tried) {
                (best, enough) = (tried, middle);
            } else {
                too_few = middle;
            }
        }
        Ok((best, Stop::Error))
    }
}

fn describe(baseline: Baseline) -> (Mesh, Stop) {
    let stop = if baseline.reached { Stop::Target } else { Stop::Stuck };
    (baseline.mesh, stop)
}
