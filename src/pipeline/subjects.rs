//! The meshes of a run one at a time, for who wants to do something else with them than `build` does.

use super::asset::describe_panic;
use super::mesh::{Prepared, Subject, Task};
use super::{BuildOptions, Job, Observer, blame_preset, name_below_inputs, resolve_presets, run_on_threads};
use crate::asset::Asset;
use crate::discover::{Destination, discover};
use crate::error::{Error, Result};
use crate::preset::Presets;
use crate::report::{MeshReport, Problem, relative_name};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What came of the meshes that were not visited.
#[derive(Debug, Default)]
pub(crate) struct Visited {
    /// With the file: meshes that `build` makes no levels of.
    pub(crate) skipped: Vec<(String, MeshReport)>,
    /// Files and meshes that could not be read or that `visit` failed for.
    pub(crate) problems: Vec<Problem>,
    /// Threads of the run.
    pub(crate) threads: usize,
}

/// Calls `visit` for every mesh of the inputs that `build` makes levels of, with the name of its file: one after the
/// other, on the run's threads. A file that fails costs itself.
///
/// # Errors
/// As [`build`](super::build); nothing is written, so that outputs do not matter.
pub(crate) fn visit_subjects(
    options: &BuildOptions,
    observer: &dyn Observer,
    mut visit: impl FnMut(&str, Subject) -> Result<()> + Send,
) -> Result<Visited> {
    let presets = Presets::new(&options.flags).map_err(blame_preset)?;
    let found = discover(&options.inputs, &Destination::Sources)?;
    let jobs = resolve_presets(&found, &presets)?;
    observer.found(jobs.len(), jobs.iter().map(|job| job.source.bytes).sum());
    run_on_threads(options.jobs, || {
        let mut visited = Visited { threads: rayon::current_num_threads(), ..Visited::default() };
        for job in &jobs {
            let visit = AssertUnwindSafe(|| visit_asset(job, options, observer, &mut visit, &mut visited));
            let errors = catch_unwind(visit).unwrap_or_else(|panic| vec![describe_panic(panic.as_ref())]);
            let name = |error: Error| Problem::new(error.in_file(&job.source.path), &job.source.root);
            visited.problems.extend(errors.into_iter().map(name));
            observer.asset_benched(&relative_name(&job.source.relative), job.source.bytes);
        }
        visited.problems.extend(found.troubles.iter().map(|error| name_below_inputs(error.clone(), options)));
        visited
    })
}

fn visit_asset(
    job: &Job<'_>,
    options: &BuildOptions,
    observer: &dyn Observer,
    visit: &mut impl FnMut(&str, Subject) -> Result<()>,
    visited: &mut Visited,
) -> Vec<Error> {
    let file = relative_name(&job.source.relative);
    observer.asset_started(&file);
    let asset = match Asset::read(&job.source.path, &job.source.root, &options.limits) {
        Ok(asset) => asset,
        Err(error) => return vec![error],
    };
    let scene = asset.scene();
    let animations = asset.animations(&scene);
    let (presets, limits) = (&job.presets, &options.limits);
    let task = Task { asset: &asset, scene: &scene, animations: &animations, presets, limits, file: &file, observer };
    let visit_mesh = |index| {
        match task.prepare(index)? {
            Prepared::Skipped(report) => visited.skipped.push((file.clone(), report)),
            Prepared::Ready(subject) => {
                let triangles = subject.report.triangles;
                visit(&file, *subject)?;
                observer.mesh_finished(triangles);
            }
        }
        Ok(())
    };
    (0..asset.document.array("meshes").len()).map(visit_mesh).filter_map(Result::err).collect()
}
