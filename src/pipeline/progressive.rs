//! Progressive meshes: a file with records out of one without, and a plain file of any resolution back.

use super::mesh::Names;
use super::{blame_preset, run_on_threads};
use crate::asset::{Asset, Geometry, Limits, Scene};
use crate::discover::{directory_of, is_asset, resolve};
use crate::emit::{self, Content, Output, ProgressiveMesh, Refining};
use crate::error::{Error, Kind, Result};
use crate::preset::{AssetPresets, Flags, Presets};
use crate::report::{ProgressiveMeshReport, ProgressiveReport, RebuildReport, RebuiltMeshReport, relative_name};
use crate::simplify::{self, Effort, Options, Schedule, Target};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// What to make progressive.
#[derive(Debug, Clone)]
pub struct ProgressiveOptions {
    /// A `.glb` or `.gltf` file.
    pub input: PathBuf,
    /// The `.glb` to write.
    pub output: PathBuf,
    /// Triangles of the base as a share of the source's, in (0, 1].
    pub base: f64,
    /// Presets and algorithm asked for on the command line.
    pub flags: Flags,
    /// Bounds on what is read.
    pub limits: Limits,
    /// Threads; `None` takes one for each processor. The results are the same for any number.
    pub jobs: Option<usize>,
}

/// What to rebuild.
#[derive(Debug, Clone)]
pub struct RebuildOptions {
    /// A file with progressive meshes, or as much of its beginning as there is.
    pub input: PathBuf,
    /// The `.glb` to write.
    pub output: PathBuf,
    /// Triangles of all progressive meshes together; `None` for all there are. Each mesh gets the same share of what its base lacks.
    pub triangles: Option<usize>,
    /// Bounds on what is read.
    pub limits: Limits,
    /// Threads; `None` takes one for each processor. The results are the same for any number.
    pub jobs: Option<usize>,
}

/// Writes the asset as one GLB whose meshes are coarse, followed by the records that make them fine (`GLTFLOD_mesh_progressive`).
/// Meshes that cannot be made progressive go through unchanged; the report says why.
///
/// # Errors
/// [`Kind::Preset`] for a wrong preset or output, and everything that keeps the file from being read or written.
pub fn progressive(options: &ProgressiveOptions) -> Result<ProgressiveReport> {
    let (directory, name) = check_paths(&options.input, &options.output)?;
    if !(options.base > 0.0 && options.base <= 1.0) {
        return Err(Error::new(Kind::Preset, format!("a base of {} is not in (0, 1]", options.base)));
    }
    let root = directory_of(&options.input);
    let below = Path::new(options.input.file_name().unwrap_or_default());
    let presets = Presets::new(&options.flags).and_then(|presets| presets.for_asset(root, below));
    let presets = presets.map_err(blame_preset)?;
    let asset = Asset::read(&options.input, root, &options.limits)?;
    let scene = asset.scene();
    let task = Task { asset: &asset, scene: &scene, presets: &presets, options };
    let made = run_on_threads(options.jobs, || {
        let meshes = 0..asset.document.array("meshes").len();
        meshes.into_par_iter().map(|mesh| task.make(mesh)).collect::<Result<Vec<_>>>()
    })??;
    let (meshes, made): (Vec<_>, Vec<_>) = made.into_iter().unzip();
    let made: Vec<ProgressiveMesh> = made.into_iter().flatten().collect();
    let output = emit::write_progressive(&asset, &made, name)?;
    emit::write(&output, directory)?;
    Ok(ProgressiveReport {
        file: relative_name(&options.output),
        source_bytes: count_source_bytes(&asset),
        written_bytes: count_made_bytes(&output),
        meshes,
        notes: output.notes,
        warnings: asset.warnings.iter().map(ToString::to_string).collect(),
    })
}

/// Writes the asset as a plain GLB with its progressive meshes refined as far as asked for, or as there are records.
///
/// # Errors
/// [`Kind::Preset`] for a wrong output, [`Kind::Malformed`] with its place for what is wrong with the records, [`Kind::Unsupported`] for a
/// file without progressive meshes.
pub fn rebuild(options: &RebuildOptions) -> Result<RebuildReport> {
    let (directory, name) = check_paths(&options.input, &options.output)?;
    let (asset, ends_early) = Asset::read_prefix(&options.input, directory_of(&options.input), &options.limits)?;
    let (output, meshes) = run_on_threads(options.jobs, || {
        let (refined, reports) = refine_all(&asset, options, ends_early)?;
        Ok((emit::write_rebuilt(&asset, &refined, name)?, reports))
    })?
    .map_err(|error: Error| error.in_file(&options.input))?;
    emit::write(&output, directory)?;
    Ok(RebuildReport {
        file: relative_name(&options.output),
        written_bytes: count_made_bytes(&output),
        meshes,
        notes: output.notes,
        warnings: asset.warnings.iter().map(ToString::to_string).collect(),
    })
}

/// The directory and the name of the output.
fn check_paths<'a>(input: &Path, output: &'a Path) -> Result<(&'a Path, PathBuf)> {
    if !is_asset(input) {
        return Err(Error::new(Kind::Preset, "is not named .glb or .gltf").in_file(input));
    }
    let is_glb = output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("glb"));
    let Some(name) = output.file_name().filter(|_| is_glb) else {
        return Err(Error::new(Kind::Preset, "is not named .glb").in_file(output).help("name a .glb file with -o"));
    };
    if resolve(input) == resolve(output) {
        return Err(Error::new(Kind::Preset, "is the input").in_file(output).help("name another file with -o"));
    }
    Ok((directory_of(output), name.into()))
}

/// What all meshes of an asset share.
struct Task<'a> {
    asset: &'a Asset,
    scene: &'a Scene,
    presets: &'a AssetPresets,
    options: &'a ProgressiveOptions,
}

impl Task<'_> {
    fn make(&self, mesh: usize) -> Result<(ProgressiveMeshReport, Option<ProgressiveMesh>)> {
        let names = Names::of(self.asset, self.scene, mesh);
        let settings = self.presets.settings(&names.borrow())?;
        let mut geometry = self.asset.geometry(mesh, &self.options.limits)?;
        let triangles = geometry.mesh.triangles.len();
        let mut report = ProgressiveMeshReport { mesh, name: names.mesh.clone(), triangles, ..Default::default() };
        let skip = settings.skip.as_ref().map(|reason| format!("skipped by the preset: {reason}"));
        report.skipped = skip.or_else(|| emit::find_obstacle(self.asset, mesh, &geometry));
        if report.skipped.is_some() {
            return Ok((report, None));
        }
        let target = (triangles as f64 * self.options.base).ceil() as usize;
        let (log, surface) = simplify::record(&geometry.mesh, &settings.simplify, target)?;
        if surface.face_count() == 0 || log.is_empty() {
            report.skipped = Some("nothing of it can collapse".to_owned());
            return Ok((report, None));
        }
        report.source_bytes = emit::count_bytes(&geometry.mesh, &geometry);
        report.chain_bytes = count_chain_bytes(&geometry, &settings.simplify)?;
        if geometry.mesh.skin.is_some() {
            // What was put right for the simplifier is put back: the full mesh is the file's own.
            geometry.mesh.skin = self.asset.stored_geometry(mesh, &self.options.limits)?.mesh.skin;
        }
        let made = emit::encode_progressive(mesh, &geometry, log, &surface);
        drop(surface);
        report.base_triangles = made.size.base_triangles;
        report.records = made.size.records;
        report.base_bytes = made.size.base_bytes;
        report.record_bytes = made.size.record_bytes;
        Ok((report, Some(made)))
    }
}

/// Bytes of what `build` would add with levels of 50, 25 and 12.5 %.
fn count_chain_bytes(geometry: &Geometry, options: &Options) -> Result<usize> {
    let levels = [0.5, 0.25, 0.125].map(Target::ratio).to_vec();
    let options = Options { levels, effort: Effort::Fast, schedule: Schedule::Passes, ..options.clone() };
    let chain = simplify::simplify(&geometry.mesh, &options)?;
    Ok(chain.levels.iter().map(|level| emit::count_bytes(&level.mesh, geometry)).sum())
}

/// All progressive meshes, each refined by the same share of what its base lacks.
fn refine_all<'a>(
    asset: &'a Asset,
    options: &RebuildOptions,
    ends_early: bool,
) -> Result<(Vec<Refining<'a>>, Vec<RebuiltMeshReport>)> {
    let meshes = 0..asset.document.array("meshes").len();
    let open = |mesh| Ok(Refining::open(asset, mesh, &options.limits, ends_early)?.map(|refining| (mesh, refining)));
    let opened = meshes.into_par_iter().map(open).collect::<Result<Vec<_>>>()?;
    let opened: Vec<(usize, Refining<'_>)> = opened.into_iter().flatten().collect();
    if opened.is_empty() {
        let error = Error::unsupported("/meshes", "no mesh of the file is progressive");
        return Err(error.help("make such a file with `gltf-lod progressive`"));
    }
    let share = options.triangles.map(|triangles| find_share(&opened, triangles));
    let refine = |(mesh, mut refining): (usize, Refining<'a>)| {
        let (base, full) = (refining.triangles(), refining.full_triangles());
        // A hair more, so that rounding takes no triangle from a single mesh.
        let of_share = |share: f64| base + (share * full.saturating_sub(base) as f64 + 1e-6).floor() as usize;
        let target = share.map_or(usize::MAX, of_share);
        let ended_early = refining.refine(target)?;
        let triangles = refining.triangles();
        let report = RebuiltMeshReport { mesh, base_triangles: base, triangles, full_triangles: full, ended_early };
        Ok((refining, report))
    };
    let refined = opened.into_par_iter().map(refine).collect::<Result<Vec<_>>>()?;
    Ok(refined.into_iter().unzip())
}

/// How much of what the bases lack makes `triangles` in all.
fn find_share(opened: &[(usize, Refining<'_>)], triangles: usize) -> f64 {
    let base: usize = opened.iter().map(|(_, refining)| refining.triangles()).sum();
    let full = opened.iter().fold(0usize, |sum, (_, refining)| sum.saturating_add(refining.full_triangles()));
    let lack = full.saturating_sub(base).max(1);
    (triangles.saturating_sub(base) as f64 / lack as f64).min(1.0)
}

fn count_source_bytes(asset: &Asset) -> u64 {
    let directory = directory_of(&asset.path);
    let resources = asset.resources.iter().filter(|r| r.exists).map(|r| directory.join(&r.relative));
    let files = std::iter::once(asset.path.clone()).chain(resources);
    files.filter_map(|file| std::fs::metadata(file).ok()).map(|metadata| metadata.len()).sum()
}

fn count_made_bytes(output: &Output) -> u64 {
    let made = output.files.iter().filter_map(|file| match &file.content {
        Content::Bytes(bytes) => Some(bytes.len() as u64),
        Content::CopyOf(_) => None,
    });
    made.sum()
}
