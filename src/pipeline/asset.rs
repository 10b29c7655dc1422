//! One asset end to end: read → levels of each mesh → document with levels → files.

use super::mesh::{self, BuiltMesh};
use super::{BuildOptions, Job, Observer};
use crate::asset::{Asset, Scene};
use crate::emit::{self, Content, Output};
use crate::error::{Error, Kind, Result};
use crate::preset::{MeshNames, Settings};
use crate::report::{FileReport, Problem, Status, relative_name};
use rayon::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Processes the asset of `job`; whatever happens, the result is a report.
pub(super) fn process(job: &Job<'_>, options: &BuildOptions, observer: &dyn Observer) -> FileReport {
    let name = relative_name(&job.source.relative);
    observer.asset_started(&name);
    // A bug must not end a run of thousands. Nothing that a panic may leave half done is used afterwards.
    match catch_unwind(AssertUnwindSafe(|| process_asset(job, options, observer))) {
        Ok(Ok(report)) => report,
        Ok(Err(errors)) => report_failure(job, errors),
        Err(panic) => report_failure(job, vec![describe_panic(panic.as_ref())]),
    }
}

/// The report of an asset that was not written.
pub(super) fn report_failure(job: &Job<'_>, errors: Vec<Error>) -> FileReport {
    let name_problem = |error: Error| Problem::new(error.in_file(&job.source.path), &job.source.root);
    FileReport { errors: errors.into_iter().map(name_problem).collect(), ..start_report(job) }
}

fn start_report(job: &Job<'_>) -> FileReport {
    FileReport::new(relative_name(&job.source.relative), job.source.bytes, job.presets.hash())
}

pub(super) fn describe_panic(panic: &(dyn Any + Send)) -> Error {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    Error::new(Kind::Internal, format!("a bug in gltf-lod: {}", text.unwrap_or("no message")))
        .help("please report it together with this file; -v shows where it happened")
}

fn process_asset(job: &Job<'_>, options: &BuildOptions, observer: &dyn Observer) -> Result<FileReport, Vec<Error>> {
    let one = |error| vec![error];
    let source = job.source;
    let asset = Asset::read(&source.path, &source.root, &options.limits).map_err(one)?;
    let scene = asset.scene();
    let settings = job.presets.settings(&MeshNames::default()).map_err(one)?;

    let meshes = build_meshes(&asset, &scene, job, options, observer)?;
    let mut report = start_report(job);
    report.warnings =
        asset.warnings.iter().map(|w| Problem::new(w.clone().in_file(&source.path), &source.root)).collect();
    let mut lods = Vec::new();
    for built in meshes {
        report.meshes.push(built.report);
        report.gates.extend(built.gates);
        lods.extend(built.lods);
    }
    let output = emit::emit(&asset, &lods, &choose_emit_options(settings)).map_err(one)?;
    emit::verify::check_output(&asset, &output)?;
    let is_copy = output.files.first().is_some_and(|file| matches!(file.content, Content::CopyOf(_)));
    report.status = if is_copy { Status::Unchanged } else { Status::Levels };
    report.written_bytes = if is_copy { source.bytes } else { count_bytes(&output) };
    if !options.dry_run {
        let directory = source.output.with_file_name("");
        emit::write(&output, &directory).map_err(one)?;
        report.written = output.files.iter().map(|file| directory.join(&file.relative)).collect();
    }
    report.notes = output.notes;
    Ok(report)
}

/// All meshes are tried, so that a user sees all errors of a file at once.
fn build_meshes(
    asset: &Asset,
    scene: &Scene,
    job: &Job<'_>,
    options: &BuildOptions,
    observer: &dyn Observer,
) -> Result<Vec<BuiltMesh>, Vec<Error>> {
    let name = relative_name(&job.source.relative);
    let animations = asset.animations(scene);
    let (presets, limits) = (&job.presets, &options.limits);
    let task = mesh::Task { asset, scene, animations: &animations, presets, limits, file: &name, observer };
    let indices = 0..asset.document.array("meshes").len();
    let results: Vec<_> = indices.into_par_iter().map(|index| task.build(index)).collect();
    let (built, errors): (Vec<_>, Vec<_>) = results.into_iter().partition(Result::is_ok);
    if errors.is_empty() {
        Ok(built.into_iter().filter_map(Result::ok).collect())
    } else {
        Err(errors.into_iter().filter_map(Result::err).collect())
    }
}

fn choose_emit_options(settings: Settings) -> emit::Options {
    emit::Options { layout: settings.layout, naming: settings.naming, existing: settings.existing }
}

/// Bytes that were made: copies of resources are not ours.
fn count_bytes(output: &Output) -> u64 {
    let made = output.files.iter().filter_map(|file| match &file.content {
        Content::Bytes(bytes) => Some(bytes.len() as u64),
        Content::CopyOf(_) => None,
    });
    made.sum()
}
