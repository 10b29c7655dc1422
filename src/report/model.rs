//! The report's data. Field order is the key order of the JSON.

use crate::error::{Error, Kind};
use crate::measure::Measurement;
use crate::simplify::{Refusals, Stop};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Distances below this share of the diagonal are nothing in ratios: rounding of 32-bit positions, and a thousandth of a pixel on a mesh
/// that fills the screen.
const NOTHING: f64 = 1e-6;

/// Everything about one run.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// `gltf-lod`.
    pub tool: &'static str,
    /// Version of the tool.
    pub version: &'static str,
    /// Version of this format; grows when a key changes its meaning.
    pub format: u32,
    /// Whether nothing was written.
    pub dry_run: bool,
    /// Sums over all files.
    pub totals: Totals,
    /// Troubles that belong to no asset: unreadable directories, files that could not be copied.
    pub problems: Vec<Problem>,
    /// One for each asset, in the order of the inputs.
    pub files: Vec<FileReport>,
    /// Time of the whole run, if the observer kept time. In JSON it stands under `times`.
    #[serde(skip)]
    pub elapsed: Option<Duration>,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Everything was processed and no gate failed.
    Fine,
    /// A gate with severity `fail` is broken.
    GateFailed,
    /// Some input could not be processed; all others were.
    Trouble,
    /// A preset is wrong.
    Preset,
}

/// Sums over all files.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Totals {
    /// Assets found.
    pub files: usize,
    /// Assets that got levels.
    pub with_levels: usize,
    /// Assets that went through unchanged.
    pub unchanged: usize,
    /// Assets that could not be processed.
    pub failed: usize,
    /// Files that are not glTF and were copied because a preset asks for it.
    pub copied: usize,
    /// Levels made.
    pub levels: usize,
    /// Triangles of the meshes that got levels.
    pub source_triangles: usize,
    /// Triangles of all levels together.
    pub level_triangles: usize,
    /// Open gap edges over all levels.
    pub gap_edges: usize,
    /// Broken gates that only warn.
    pub gates_warned: usize,
    /// Broken gates that fail the build.
    pub gates_failed: usize,
    /// Geometric mean of the levels' figures relative to meshoptimizer's.
    pub vs_meshopt: Option<Ratio>,
}

/// Our figure relative to meshoptimizer's at the same triangle count: below 1 ours is nearer to the source.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Ratio {
    /// Two-sided RMS distance.
    pub rms: f64,
    /// Two-sided Hausdorff distance.
    pub hausdorff: f64,
}

/// A problem with its place.
#[derive(Debug, Clone, Serialize)]
pub struct Problem {
    /// `io`, `malformed`, `unsupported`, `limit`, `preset` or `internal`.
    pub kind: &'static str,
    /// The file, relative to its input root.
    pub file: Option<String>,
    /// JSON pointer, byte offset, or line and column.
    pub place: Option<String>,
    /// What is wrong.
    pub message: String,
    /// The way out.
    pub help: Option<String>,
    /// The error itself, with the file's path as the user gave it.
    #[serde(skip)]
    pub error: Error,
}

/// What became of an asset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Written with levels.
    Levels,
    /// No mesh got levels: written as it was.
    Unchanged,
    /// Not written.
    Failed,
}

/// One asset.
#[derive(Debug, Clone, Serialize)]
pub struct FileReport {
    /// Relative to its input root, with `/`.
    pub path: String,
    /// What became of it.
    pub status: Status,
    /// BLAKE3 of the presets in effect.
    pub preset_hash: String,
    /// Bytes of the file itself in the source (without external buffers and images).
    pub source_bytes: u64,
    /// Bytes of everything written for it, copies of unchanged resources apart; 0 for a failed file.
    pub written_bytes: u64,
    /// Its meshes, in the document's order.
    pub meshes: Vec<MeshReport>,
    /// Broken gates.
    pub gates: Vec<BrokenGate>,
    /// What the user should know: arrangements not every loader handles, what was left out and why.
    pub notes: Vec<String>,
    /// Troubles that stopped nothing.
    pub warnings: Vec<Problem>,
    /// Why it failed.
    pub errors: Vec<Problem>,
    /// The files written for it.
    #[serde(skip)]
    pub written: Vec<PathBuf>,
    /// Time spent on it, if the observer kept time. In JSON it stands under `times`.
    #[serde(skip)]
    pub elapsed: Option<Duration>,
}

/// One glTF mesh.
#[derive(Debug, Clone, Serialize)]
pub struct MeshReport {
    /// Index into `meshes`.
    pub mesh: usize,
    /// Its name.
    pub name: Option<String>,
    /// Nodes that draw it.
    pub nodes: usize,
    /// Triangles of the source; 0 when they were not decoded.
    pub triangles: usize,
    /// Vertices of the source, as stored.
    pub vertices: usize,
    /// Diagonal of its bounding box, object units.
    pub diagonal: f64,
    /// Radius of its bounding sphere, object units.
    pub radius: f64,
    /// Why it has no levels.
    pub skipped: Option<String>,
    /// Its levels, finest first.
    pub levels: Vec<LevelReport>,
    /// Levels asked for that were not worth keeping.
    pub dropped: Vec<DroppedLevel>,
    /// `MSFT_screencoverage`: where LOD0 and each level end.
    pub coverage: Vec<f64>,
    /// What coverage measures: `height` or `area` (shares of the screen's).
    pub basis: &'static str,
    /// Primitives passed over and other remarks.
    pub notes: Vec<String>,
}

/// One level.
#[derive(Debug, Clone, Serialize)]
pub struct LevelReport {
    /// 1 for the finest generated level.
    pub level: usize,
    /// What was asked for.
    pub target: TargetReport,
    /// Triangles.
    pub triangles: usize,
    /// Vertices, as stored.
    pub vertices: usize,
    /// What ended it: `target`, `error` or `stuck`.
    pub stop: &'static str,
    /// Refused collapses by cause.
    pub refusals: RefusalCounts,
    /// Distance from the source.
    pub error: ErrorFigures,
    /// Pixels that the Hausdorff distance shows at the switch-in coverage.
    pub pixels_at_switch: f64,
    /// Coverage at which it takes over from the level above.
    pub switch_in: f64,
    /// Mean angle between face normals, degrees.
    pub normal_deg: f64,
    /// 95th percentile of that angle.
    pub normal_p95_deg: f64,
    /// Mean angle between vertex normals, degrees.
    pub shading_deg: Option<f64>,
    /// Mean distance of UV set 0, UV units.
    pub uv_mean: Option<f64>,
    /// 95th percentile of that distance.
    pub uv_p95: Option<f64>,
    /// Share of triangles with an angle below 5°.
    pub slivers5: f64,
    /// Share of triangles with an angle below 10°.
    pub slivers10: f64,
    /// Faces that look the other way than the source does there.
    pub flipped: usize,
    /// Faces without area.
    pub degenerate: usize,
    /// Edges of more than two faces.
    pub nonmanifold_edges: usize,
    /// Open edges that the source does not have: cracks.
    pub gap_edges: usize,
    /// Distance from the source in the asset's own poses.
    pub posed: Option<PosedFigures>,
    /// meshoptimizer at the same triangle count by the same ruler.
    pub baseline: Option<BaselineReport>,
}

/// A level's target: the first that binds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TargetReport {
    /// Share of the source's triangles.
    pub ratio: Option<f64>,
    /// Triangles.
    pub triangles: Option<usize>,
    /// Largest error, object units (percent and pixels converted).
    pub error: Option<f64>,
}

/// Collapses refused since the level before, by cause.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct RefusalCounts {
    /// The surface would fold onto itself or change its topology.
    pub link: u64,
    /// A face would turn over.
    pub flip: u64,
    /// A face would become a needle.
    pub needle: u64,
    /// A border vertex would leave the border, or is locked.
    pub border: u64,
    /// A seam or material border would break, or is locked.
    pub seam: u64,
}

/// Two-sided distances between level and source.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct ErrorFigures {
    /// Largest distance, object units.
    pub hausdorff: f64,
    /// Root mean square, object units.
    pub rms: f64,
    /// Mean, object units.
    pub mean: f64,
    /// Largest distance in percent of the source's diagonal.
    pub hausdorff_percent: f64,
    /// Root mean square in percent of the source's diagonal.
    pub rms_percent: f64,
    /// Mean in percent of the source's diagonal.
    pub mean_percent: f64,
}

/// Distances between level and source in the same poses: moments of the asset's animations, each morph target alone. Percent of the source's
/// diagonal.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct PosedFigures {
    /// Poses that were measured.
    pub poses: usize,
    /// Largest distance in any of them.
    pub hausdorff_percent: f64,
    /// Root mean square over all of them.
    pub rms_percent: f64,
}

/// meshoptimizer's result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BaselineReport {
    /// The settings that gave it.
    pub settings: String,
    /// Its triangles.
    pub triangles: usize,
    /// Whether it met the count; if not, the ratio compares unequal counts.
    pub reached: bool,
    /// Its distance from the source.
    pub error: ErrorFigures,
    /// Mean angle between face normals, degrees.
    pub normal_deg: f64,
    /// Mean distance of UV set 0, UV units.
    pub uv_mean: Option<f64>,
    /// Open edges that the source does not have.
    pub gap_edges: usize,
    /// Its distance from the source in the asset's own poses.
    pub posed: Option<PosedFigures>,
    /// Ours relative to it.
    pub ratio: Ratio,
}

/// A level asked for that was not kept.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DroppedLevel {
    /// Its position in the preset's list, from 1.
    pub requested: usize,
    /// The triangles it had.
    pub triangles: usize,
    /// Why it was dropped.
    pub why: String,
}

/// A gate that a level broke.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BrokenGate {
    /// Index of the mesh.
    pub mesh: usize,
    /// The level, from 1.
    pub level: usize,
    /// The preset key that sets the gate: `gates.max_error`.
    pub key: &'static str,
    /// What the gate allows, in its own unit.
    pub limit: f64,
    /// What the level has, in the same unit.
    pub found: f64,
    /// Whether it fails the build.
    pub fails: bool,
    /// The same in words.
    pub message: String,
}

impl Report {
    /// Sums up `files`.
    pub fn new(files: Vec<FileReport>, problems: Vec<Problem>, copied: usize, dry_run: bool) -> Self {
        let totals = Totals { copied, ..Totals::of(&files) };
        let version = env!("CARGO_PKG_VERSION");
        Self { tool: "gltf-lod", version, format: 1, dry_run, totals, problems, files, elapsed: None }
    }

    /// All errors, those of files in their order first.
    pub fn errors(&self) -> impl Iterator<Item = &Problem> {
        self.files.iter().flat_map(|file| &file.errors).chain(&self.problems)
    }

    /// How the run ended; the worst that happened.
    pub fn outcome(&self) -> Outcome {
        if self.errors().any(|problem| problem.error.kind == Kind::Preset) {
            Outcome::Preset
        } else if self.errors().next().is_some() {
            Outcome::Trouble
        } else if self.totals.gates_failed > 0 {
            Outcome::GateFailed
        } else {
            Outcome::Fine
        }
    }
}

impl Totals {
    fn of(files: &[FileReport]) -> Self {
        let with = |status| files.iter().filter(|file| file.status == status).count();
        let meshes = || files.iter().flat_map(|file| &file.meshes).filter(|mesh| !mesh.levels.is_empty());
        let levels = || meshes().flat_map(|mesh| &mesh.levels);
        let gates = |fails| files.iter().flat_map(|file| &file.gates).filter(|gate| gate.fails == fails).count();
        Self {
            files: files.len(),
            with_levels: with(Status::Levels),
            unchanged: with(Status::Unchanged),
            failed: with(Status::Failed),
            copied: 0,
            levels: levels().count(),
            source_triangles: meshes().map(|mesh| mesh.triangles).sum(),
            level_triangles: levels().map(|level| level.triangles).sum(),
            gap_edges: levels().map(|level| level.gap_edges).sum(),
            gates_warned: gates(false),
            gates_failed: gates(true),
            vs_meshopt: Ratio::geometric_mean(levels()),
        }
    }
}

impl FileReport {
    /// A file about which nothing is known yet but its name.
    pub fn new(path: String, source_bytes: u64, preset_hash: String) -> Self {
        Self {
            path,
            status: Status::Failed,
            preset_hash,
            source_bytes,
            written_bytes: 0,
            meshes: Vec::new(),
            gates: Vec::new(),
            notes: Vec::new(),
            warnings: Vec::new(),
            errors: Vec::new(),
            written: Vec::new(),
            elapsed: None,
        }
    }
}

impl MeshReport {
    /// `meshes[mesh]`, drawn by so many nodes, about which nothing else is known yet.
    pub fn new(mesh: usize, name: Option<String>, nodes: usize, basis: &'static str) -> Self {
        Self {
            mesh,
            name,
            nodes,
            triangles: 0,
            vertices: 0,
            diagonal: 0.0,
            radius: 0.0,
            skipped: None,
            levels: Vec::new(),
            dropped: Vec::new(),
            coverage: Vec::new(),
            basis,
            notes: Vec::new(),
        }
    }
}

impl Ratio {
    /// Geometric means over the levels whose baseline met the triangle count; `None` without any.
    pub fn geometric_mean<'a>(levels: impl Iterator<Item = &'a LevelReport>) -> Option<Self> {
        let comparable = levels.filter_map(|level| level.baseline.as_ref()).filter(|baseline| baseline.reached);
        let ratios: Vec<Self> = comparable.map(|baseline| baseline.ratio).collect();
        let mean = |pick: fn(&Self) -> f64| {
            (ratios.iter().map(|ratio| pick(ratio).ln()).sum::<f64>() / ratios.len() as f64).exp()
        };
        (!ratios.is_empty()).then(|| Self { rms: mean(|r| r.rms), hausdorff: mean(|r| r.hausdorff) })
    }

    /// `ours` relative to `theirs`; distances that are only rounding count as equal.
    pub fn of(ours: &Measurement, theirs: &Measurement) -> Self {
        let floor = (NOTHING * ours.diagonal).max(f64::MIN_POSITIVE);
        let ratio = |ours: f64, theirs: f64| ours.max(floor) / theirs.max(floor);
        Self { rms: ratio(ours.rms(), theirs.rms()), hausdorff: ratio(ours.hausdorff(), theirs.hausdorff()) }
    }
}

impl ErrorFigures {
    /// The distances of a measurement.
    pub fn of(measured: &Measurement) -> Self {
        let percent = |distance: f64| if measured.diagonal > 0.0 { distance / measured.diagonal * 100.0 } else { 0.0 };
        let (hausdorff, rms, mean) = (measured.hausdorff(), measured.rms(), measured.mean());
        Self {
            hausdorff,
            rms,
            mean,
            hausdorff_percent: percent(hausdorff),
            rms_percent: percent(rms),
            mean_percent: percent(mean),
        }
    }
}

impl From<Refusals> for RefusalCounts {
    fn from(refusals: Refusals) -> Self {
        let Refusals { link, flip, needle, border, seam } = refusals;
        Self { link, flip, needle, border, seam }
    }
}

impl Problem {
    /// An error about a file below `root`, whose name is given relative to it so that reports are the same on every machine.
    pub fn new(error: Error, root: &Path) -> Self {
        let kind = match error.kind {
            Kind::Io => "io",
            Kind::Malformed => "malformed",
            Kind::Unsupported => "unsupported",
            Kind::Limit => "limit",
            Kind::Preset => "preset",
            Kind::Internal => "internal",
        };
        Self {
            kind,
            file: error.file.as_deref().map(|file| relative_name(file.strip_prefix(root).unwrap_or(file))),
            place: error.place.clone(),
            message: error.message.clone(),
            help: error.help.clone(),
            error,
        }
    }
}

/// The name that a report gives to what ended a level.
pub(crate) fn name_stop(stop: Stop) -> &'static str {
    match stop {
        Stop::Target => "target",
        Stop::Floor => "floor",
        Stop::Error => "error",
        Stop::Stuck => "stuck",
    }
}

impl PosedFigures {
    /// The distances of a measurement in poses, if there are poses.
    pub fn of(measured: &Measurement) -> Option<Self> {
        let posed = measured.posed?;
        let percent = |distance: f64| if measured.diagonal > 0.0 { distance / measured.diagonal * 100.0 } else { 0.0 };
        Some(Self { poses: posed.poses, hausdorff_percent: percent(posed.hausdorff), rms_percent: percent(posed.rms) })
    }
}

impl LevelReport {
    /// A level as measured; switch and baseline are filled in later.
    pub fn new(level: usize, target: TargetReport, stop: Stop, refusals: Refusals, measured: &Measurement) -> Self {
        Self {
            level,
            target,
            triangles: measured.triangles,
            vertices: measured.vertices,
            stop: name_stop(stop),
            refusals: refusals.into(),
            error: ErrorFigures::of(measured),
            pixels_at_switch: 0.0,
            switch_in: 0.0,
            normal_deg: measured.normal_deg,
            normal_p95_deg: measured.normal_p95_deg,
            shading_deg: measured.shading_deg,
            uv_mean: measured.uv_mean,
            uv_p95: measured.uv_p95,
            slivers5: measured.slivers5,
            slivers10: measured.slivers10,
            flipped: measured.flipped,
            degenerate: measured.degenerate,
            nonmanifold_edges: measured.nonmanifold_edges,
            gap_edges: measured.gap_edges,
            posed: PosedFigures::of(measured),
            baseline: None,
        }
    }
}

impl BaselineReport {
    /// The baseline as measured, compared with our level.
    pub fn new(settings: String, reached: bool, theirs: &Measurement, ours: &Measurement) -> Self {
        Self {
            settings,
            triangles: theirs.triangles,
            reached,
            error: ErrorFigures::of(theirs),
            normal_deg: theirs.normal_deg,
            uv_mean: theirs.uv_mean,
            gap_edges: theirs.gap_edges,
            posed: PosedFigures::of(theirs),
            ratio: Ratio::of(ours, theirs),
        }
    }
}

/// A relative path with `/` on every machine.
pub fn relative_name(path: &Path) -> String {
    let parts: Vec<_> = path.components().map(|part| part.as_os_str().to_string_lossy()).collect();
    if path.is_absolute() { PathBuf::from(path).to_string_lossy().into_owned() } else { parts.join("/") }
}
