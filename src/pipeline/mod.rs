//! A whole run: inputs → presets → each asset on its own → report.
//!
//! Assets run in parallel, and meshes and levels inside them; nothing that is written depends on the order in which they finish.
//! An asset that fails, for whatever reason, costs that asset alone.

mod asset;
mod claims;
mod foreign;
mod gates;
mod inspect;
mod levels;
mod mesh;
mod papers;
mod progressive;
mod subjects;
mod train;

pub use inspect::inspect;
pub(crate) use mesh::Subject;
pub use papers::{Clock, PapersOptions, papers};
pub use progressive::{ProgressiveOptions, RebuildOptions, progressive, rebuild};
pub(crate) use subjects::{Visited, visit_subjects};
pub use train::{TrainOptions, TrainOutcome, train_w};

use crate::asset::Limits;
use crate::discover::{Destination, Found, Source, discover, is_asset};
use crate::emit::{self, Content, Output, OutputFile};
use crate::error::{Error, Kind, Result};
use crate::preset::{AssetPresets, Flags, Presets};
use crate::report::{FileReport, Problem, Report};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What to build.
#[derive(Debug, Clone, Default)]
pub struct BuildOptions {
    /// `.glb` and `.gltf` files, and directories that are walked for them.
    pub inputs: Vec<PathBuf>,
    /// Directory of the results. Needed unless `in_place`.
    pub output: Option<PathBuf>,
    /// Allows results to overwrite sources; without `output` they are written beside, that is over, their sources.
    pub in_place: bool,
    /// Presets and levels asked for on the command line.
    pub flags: Flags,
    /// Bounds on what is read.
    pub limits: Limits,
    /// Threads; `None` takes one for each processor. The results are the same for any number.
    pub jobs: Option<usize>,
    /// Does everything but write.
    pub dry_run: bool,
}

/// Is told how a run goes on; may be called from several threads at once. The library neither prints nor reads a clock: a program
/// that wants either brings an observer.
pub trait Observer: Sync {
    /// The run is about `files` assets with `bytes` bytes (external buffers and images apart).
    fn found(&self, _files: usize, _bytes: u64) {}
    /// The asset named is being read.
    fn asset_started(&self, _path: &str) {}
    /// A mesh of the asset named is being simplified.
    fn mesh_started(&self, _path: &str, _mesh: &str, _triangles: usize) {}
    /// A mesh of so many source triangles is done.
    fn mesh_finished(&self, _triangles: usize) {}
    /// An asset is done, or has failed.
    fn asset_finished(&self, _report: &FileReport) {}
    /// An asset's meshes have been timed and measured by [`bench`](crate::bench::bench).
    fn asset_benched(&self, _path: &str, _bytes: u64) {}
    /// Time since some fixed moment. `None` leaves times out of the report.
    fn elapsed(&self) -> Option<Duration> {
        None
    }
}

/// An observer that does not look.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unobserved;

impl Observer for Unobserved {}

/// Builds levels of detail for every asset of the inputs.
///
/// Trouble with an asset is part of the report ([`Report::errors`], [`Report::outcome`]); all other assets are still built, and nothing
/// is written for the one that failed.
///
/// # Errors
/// [`Kind::Preset`] when nothing could be started: a missing input, an output that would overwrite a source, a preset that is wrong.
/// [`Kind::Io`] when the threads cannot be started.
///
/// # Example
/// ```
/// use gltf_lod::{BuildOptions, Unobserved};
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let model = directory.path().join("triangle.gltf");
/// # std::fs::write(&model, r#"{ "asset": { "version": "2.0" } }"#).unwrap();
/// let options = BuildOptions {
///     inputs: vec![model],
///     output: Some("target/lods".into()),
///     dry_run: true,
///     ..BuildOptions::default()
/// };
/// let report = gltf_lod::build(&options, &Unobserved)?;
/// for file in &report.files {
///     for level in file.meshes.iter().flat_map(|mesh| &mesh.levels) {
///         println!("{}: {} triangles, off by {} units", file.path, level.triangles, level.error.hausdorff);
///     }
/// }
/// # assert_eq!(report.files.len(), 1);
/// # Ok::<(), gltf_lod::Error>(())
/// ```
pub fn build(options: &BuildOptions, observer: &dyn Observer) -> Result<Report> {
    let start = observer.elapsed();
    let destination = choose_destination(options)?;
    let presets = Presets::new(&options.flags).map_err(blame_preset)?;
    let found = discover(&options.inputs, &destination)?;
    let jobs = resolve_presets(&found, &presets)?;
    observer.found(jobs.len(), jobs.iter().map(|job| job.source.bytes).sum());

    let mut report = run_on_threads(options.jobs, || {
        let refused = claims::find_clashes(&found.assets, &options.limits);
        let work = |(index, job): (usize, &Job<'_>)| process_job(job, refused.get(&index), options, observer);
        let files: Vec<FileReport> = jobs.par_iter().enumerate().map(work).collect();
        let (copied, mut problems) = copy_others(&found, &presets, &files, options.dry_run);
        problems.extend(found.troubles.iter().map(|error| name_below_inputs(error.clone(), options)));
        Report::new(files, problems, copied, options.dry_run)
    })?;
    report.elapsed = time_since(start, observer);
    Ok(report)
}

/// Makes the levels of one file without writing anything: the figures of [`FileReport`] compare them with meshoptimizer's.
///
/// # Errors
/// As [`build`], and everything that keeps the file from being processed.
pub fn compare(file: &Path, options: &BuildOptions, observer: &dyn Observer) -> Result<FileReport> {
    if !is_asset(file) {
        let error = Error::new(Kind::Preset, "is not named .glb or .gltf");
        return Err(error.in_file(file));
    }
    // Beside the source and never written: the destination that needs no directory.
    let options =
        BuildOptions { inputs: vec![file.to_owned()], output: None, in_place: true, dry_run: true, ..options.clone() };
    let report = build(&options, observer)?;
    let error = report.errors().next().map(|problem| problem.error.clone());
    match (error, report.files.into_iter().next()) {
        (None, Some(file)) => Ok(file),
        (error, _) => Err(error.unwrap_or_else(|| Error::new(Kind::Preset, "is a directory").in_file(file))),
    }
}

/// An asset and the presets that apply to it.
struct Job<'a> {
    source: &'a Source,
    presets: AssetPresets,
}

fn choose_destination(options: &BuildOptions) -> Result<Destination> {
    if options.inputs.is_empty() {
        return Err(Error::new(Kind::Preset, "no input given").help("give .glb or .gltf files, or directories"));
    }
    match (&options.output, options.in_place) {
        (Some(out), false) => Ok(Destination::Directory(out.clone())),
        (Some(out), true) => Ok(Destination::DirectoryInPlace(out.clone())),
        (None, true) => Ok(Destination::Sources),
        (None, false) => Err(Error::new(Kind::Preset, "no output directory given")
            .help("choose one with -o, or overwrite with --in-place")),
    }
}

/// A wrong preset stops the run before anything is written: half a tree built with other presets than meant helps nobody.
fn resolve_presets<'a>(found: &'a Found, presets: &Presets) -> Result<Vec<Job<'a>>> {
    let resolve = |source: &'a Source| {
        let presets = presets.for_asset(&source.root, &source.relative).map_err(blame_preset)?;
        Ok(Job { source, presets })
    };
    found.assets.iter().map(resolve).collect()
}

/// A preset file that cannot be read stops a run as one that is wrong does.
fn blame_preset(error: Error) -> Error {
    Error { kind: Kind::Preset, ..error }
}

fn run_on_threads<T: Send>(jobs: Option<usize>, work: impl FnOnce() -> T + Send) -> Result<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs.unwrap_or(0)).build();
    let pool = pool.map_err(|error| Error::new(Kind::Io, format!("cannot start threads: {error}")))?;
    Ok(pool.install(work))
}

fn process_job(job: &Job<'_>, refused: Option<&Error>, options: &BuildOptions, observer: &dyn Observer) -> FileReport {
    let start = observer.elapsed();
    let mut report = match refused {
        Some(error) => asset::report_failure(job, vec![error.clone()]),
        None => asset::process(job, options, observer),
    };
    report.elapsed = time_since(start, observer);
    observer.asset_finished(&report);
    report
}

fn time_since(start: Option<Duration>, observer: &dyn Observer) -> Option<Duration> {
    Some(observer.elapsed()?.saturating_sub(start?))
}

/// Copies the files that presets want copied, unless an asset has written them already. Gives their number and what went wrong.
fn copy_others(found: &Found, presets: &Presets, files: &[FileReport], dry_run: bool) -> (usize, Vec<Problem>) {
    let written: BTreeSet<&Path> = files.iter().flat_map(|file| &file.written).map(PathBuf::as_path).collect();
    let is_wanted = |source: &Source| {
        let presets = presets.for_asset(&source.root, &source.relative).map_err(blame_preset)?;
        let is_new = source.path != source.output && !written.contains(source.output.as_path());
        Ok(is_new && presets.copies(&source.relative))
    };
    let copy = |source: &Source| match is_wanted(source) {
        Ok(true) if !dry_run => copy_file(source).map(|()| true),
        known => known,
    };
    let results: Vec<Result<bool>> = found.others.par_iter().map(copy).collect();
    let copied = results.iter().filter(|result| matches!(result, Ok(true))).count();
    let failed = results.into_iter().zip(&found.others).filter_map(|(result, source)| Some((result.err()?, source)));
    (copied, failed.map(|(error, source)| Problem::new(error, &source.root)).collect())
}

fn copy_file(source: &Source) -> Result<()> {
    let (Some(directory), Some(name)) = (source.output.parent(), source.output.file_name()) else { return Ok(()) };
    let file = OutputFile { relative: name.into(), content: Content::CopyOf(source.path.clone()) };
    emit::write(&Output { files: vec![file], notes: Vec::new() }, directory)
}

fn name_below_inputs(error: Error, options: &BuildOptions) -> Problem {
    let file = error.file.clone().unwrap_or_default();
    let root = options.inputs.iter().find(|input| file.starts_with(input) && **input != file);
    Problem::new(error, root.map_or(Path::new(""), PathBuf::as_path))
}
