//! One glTF mesh: settings → geometry → levels → figures → switches → gates.

use super::Observer;
use super::foreign::make_levels;
use super::gates::check_gates;
use super::levels::{choose_options, keep_levels, report_target};
use crate::asset::{Animations, Asset, Geometry, Limits, Scene};
use crate::baseline;
use crate::coverage::{pixels_of_error, place_switches, to_height};
use crate::emit::{self, Existing, LodLevel, MeshLods};
use crate::error::Result;
use crate::measure::{Measurement, Ruler, Sampling};
use crate::mesh::{Attribute, Mesh, Pose, choose_poses};
use crate::preset::{AssetPresets, Basis, Maker, MeshNames, Settings};
use crate::report::{BaselineReport, BrokenGate, LevelReport, MeshReport};
use crate::simplify::{self, EdgePolicy, Level};
use rayon::prelude::*;
use serde_json::{Value, json};

/// Poses that levels are measured in.
const MEASURED_POSES: usize = 8;
/// The first of them, as far as joints make them, count in the simplifier; morph targets count there anyway.
const GUIDES: usize = 4;
/// Share of the diagonal by which a pose has to differ.
const LEAST_POSE: f64 = 1e-3;

/// What all meshes of an asset share.
pub(super) struct Task<'a> {
    pub(super) asset: &'a Asset,
    pub(super) scene: &'a Scene,
    pub(super) animations: &'a Animations,
    pub(super) presets: &'a AssetPresets,
    pub(super) limits: &'a Limits,
    pub(super) file: &'a str,
    pub(super) observer: &'a dyn Observer,
}

/// A mesh with its levels, if it got any.
pub(super) struct BuiltMesh {
    pub(super) report: MeshReport,
    pub(super) gates: Vec<BrokenGate>,
    pub(super) lods: Option<MeshLods>,
}

/// A mesh ready to be simplified.
pub(crate) struct Subject {
    /// What is known of it so far.
    pub(crate) report: MeshReport,
    pub(crate) geometry: Geometry,
    pub(crate) ruler: Ruler,
    pub(crate) settings: Settings,
    pub(crate) options: simplify::Options,
}

/// What becomes of a mesh.
pub(super) enum Prepared {
    Ready(Box<Subject>),
    Skipped(MeshReport),
}

impl Prepared {
    fn skipped(report: MeshReport, why: impl Into<String>) -> Self {
        Self::Skipped(MeshReport { skipped: Some(why.into()), ..report })
    }
}

impl BuiltMesh {
    fn skipped(report: MeshReport) -> Self {
        Self { report, gates: Vec::new(), lods: None }
    }
}

impl Task<'_> {
    /// Builds the levels of `meshes[index]`.
    pub(super) fn build(&self, index: usize) -> Result<BuiltMesh> {
        let built = match self.prepare(index)? {
            Prepared::Skipped(report) => return Ok(BuiltMesh::skipped(report)),
            Prepared::Ready(subject) => build_levels(*subject)?,
        };
        self.observer.mesh_finished(built.report.triangles);
        Ok(built)
    }

    /// Reads `meshes[index]` and resolves its settings, unless it gets no levels.
    pub(super) fn prepare(&self, index: usize) -> Result<Prepared> {
        let names = Names::of(self.asset, self.scene, index);
        let settings = self.presets.settings(&names.borrow())?;
        let mut report = MeshReport::new(index, names.mesh.clone(), names.users, name_basis(settings.basis));
        if let Some(why) = find_reason_to_skip(self.scene, index, &settings) {
            return Ok(Prepared::skipped(report, why));
        }
        let mut geometry = self.asset.geometry(index, self.limits)?;
        describe_geometry(&mut report, &geometry);
        if let Some(why) = find_reason_in_geometry(&geometry, &settings) {
            return Ok(Prepared::skipped(report, why));
        }
        self.observer.mesh_started(self.file, names.mesh.as_deref().unwrap_or(""), report.triangles);
        let ruler = Ruler::new(&geometry.mesh, choose_sampling(settings.samples, report.triangles));
        let poses = self.poses(index, &geometry.mesh, ruler.diagonal());
        let guides = poses.iter().filter(|pose| !pose.joints.is_empty()).take(GUIDES).zip(0..);
        let guides: Vec<Attribute> = guides.map(|(pose, k)| pose.attribute(&geometry.mesh, k)).collect();
        let ruler = ruler.with_poses(&geometry.mesh, poses);
        geometry.mesh.attributes.extend(guides);
        (report.diagonal, report.radius) = (ruler.diagonal(), ruler.bounding_radius());
        let options = choose_options(&settings, report.diagonal, report.radius);
        Ok(Prepared::Ready(Box::new(Subject { report, geometry, ruler, settings, options })))
    }

    /// The poses in which levels of `meshes[index]` are measured, those that differ most first.
    fn poses(&self, index: usize, mesh: &Mesh, diagonal: f64) -> Vec<Pose> {
        let poses = self.animations.poses(self.asset, self.scene, index).into_iter();
        let aligned = poses.map(|pose| pose.aligned(mesh)).collect();
        choose_poses(mesh, aligned, MEASURED_POSES, LEAST_POSE * diagonal)
    }
}

/// Names that rules go by.
pub(super) struct Names {
    pub(super) mesh: Option<String>,
    nodes: Vec<String>,
    materials: Vec<String>,
    users: usize,
}

impl Names {
    pub(super) fn of(asset: &Asset, scene: &Scene, index: usize) -> Self {
        let name = |value: &Value| value.get("name").and_then(Value::as_str).map(str::to_owned);
        let mesh = asset.document.array("meshes").get(index);
        let users = scene.uses.get(index).map_or(&[][..], |mesh_use| &mesh_use.nodes);
        let primitives = mesh.and_then(|mesh| mesh.get("primitives")).and_then(Value::as_array);
        let materials = primitives.into_iter().flatten().filter_map(|p| p.get("material")?.as_u64());
        let mut materials: Vec<String> =
            materials.filter_map(|m| asset.document.array("materials").get(m as usize).and_then(name)).collect();
        materials.sort();
        materials.dedup();
        Self {
            mesh: mesh.and_then(name),
            nodes: users.iter().filter_map(|&node| asset.document.array("nodes").get(node).and_then(name)).collect(),
            materials,
            users: users.len(),
        }
    }

    pub(super) fn borrow(&self) -> MeshNames<'_> {
        MeshNames { mesh: self.mesh.as_deref(), nodes: &self.nodes, materials: &self.materials }
    }
}

fn name_basis(basis: Basis) -> &'static str {
    match basis {
        Basis::Height => "height",
        Basis::Area => "area",
    }
}

fn find_reason_to_skip(scene: &Scene, index: usize, settings: &Settings) -> Option<String> {
    let users = scene.uses.get(index).map_or(&[][..], |mesh_use| &mesh_use.nodes);
    if let Some(reason) = &settings.skip {
        Some(format!("skipped by the preset: {reason}"))
    } else if users.is_empty() {
        Some("no node draws it".to_owned())
    } else if users.iter().all(|node| scene.lower.contains(node)) {
        Some("it is a lower level already".to_owned())
    } else if settings.existing == Existing::Keep && users.iter().all(|&node| belongs_to_levels(scene, node)) {
        Some("it has levels already".to_owned())
    } else {
        None
    }
}

/// Whether the node carries levels, is one, or hangs below one that does.
fn belongs_to_levels(scene: &Scene, node: usize) -> bool {
    let carries =
        |node: usize| scene.lower.contains(&node) || scene.existing.iter().any(|(carrier, _)| *carrier == node);
    let parent = |node: &usize| scene.parent.get(*node).copied().flatten();
    // The document was checked to be a forest; the bound only keeps a bug there from hanging here.
    std::iter::successors(Some(node), parent).take(scene.parent.len() + 1).any(carries)
}

fn describe_geometry(report: &mut MeshReport, geometry: &Geometry) {
    report.triangles = geometry.mesh.triangles.len();
    report.vertices = geometry.mesh.positions.len();
    let passed_over = geometry.passed_over.iter();
    report.notes.extend(passed_over.map(|p| format!("primitive {} goes through unchanged: {}", p.primitive, p.why)));
}

fn find_reason_in_geometry(geometry: &Geometry, settings: &Settings) -> Option<String> {
    let triangles = geometry.mesh.triangles.len();
    if let Some(whole) = geometry.passed_over.iter().find(|passed_over| !passed_over.carried) {
        Some(whole.why.clone())
    } else if triangles == 0 {
        Some("no triangles".to_owned())
    } else if triangles < settings.min_source_triangles {
        Some(format!("fewer than {} triangles", settings.min_source_triangles))
    } else {
        None
    }
}

fn build_levels(subject: Subject) -> Result<BuiltMesh> {
    let Subject { mut report, geometry, ruler, settings, options } = subject;
    let levels = match settings.maker {
        Maker::Simplify => simplify::simplify(&geometry.mesh, &options)?.levels,
        Maker::Meshopt => make_levels(&geometry.mesh, &options, &ruler)?,
    };
    let (mut kept, dropped) = keep_levels(levels, report.triangles, settings.min_saving);
    report.dropped = dropped;
    if kept.is_empty() {
        let why = report.dropped.first().map_or("the preset asks for no level", |_| "no level saves enough triangles");
        return Ok(BuiltMesh::skipped(MeshReport { skipped: Some(why.to_owned()), ..report }));
    }
    // Source vertices are stored already.
    let own_vertices = kept.par_iter_mut().filter(|(_, level)| level.source_vertices.is_none());
    own_vertices.for_each(|(_, level)| emit::round_to_storage(&mut level.mesh, &geometry));
    report.levels = measure_levels(&geometry.mesh, &ruler, &kept, &options);
    switch_levels(&mut report, &kept, &settings)?;
    let gates = check_gates(&report, &settings.gates);
    let extras = describe_for_extras(&report, &settings);
    let to_lod = |(_, level): (usize, Level)| LodLevel { mesh: level.mesh, source_vertices: level.source_vertices };
    let levels = kept.into_iter().map(to_lod).collect();
    let lods = MeshLods { mesh: report.mesh, geometry, levels, coverage: report.coverage.clone(), extras };
    Ok(BuiltMesh { report, gates, lods: Some(lods) })
}

/// `samples` is what a large mesh gets; a small one has the same noise with fewer.
fn choose_sampling(samples: usize, triangles: usize) -> Sampling {
    let (full, enough) = (Sampling::default(), Sampling::for_triangles(triangles));
    let share = enough.samples as f64 / full.samples as f64;
    Sampling { samples: (samples as f64 * share).ceil() as usize, ..full }
}

/// Every level and its baseline, measured by the same ruler.
fn measure_levels(
    source: &Mesh,
    ruler: &Ruler,
    levels: &[(usize, Level)],
    options: &simplify::Options,
) -> Vec<LevelReport> {
    let lock_border = options.border == EdgePolicy::Lock;
    let measure = |(position, (requested, level)): (usize, &(usize, Level))| {
        let ours = ruler.measure(&level.mesh);
        let target = report_target(&options.levels[*requested]);
        let mut report = LevelReport::new(position + 1, target, level.stop, level.refusals, &ours);
        report.baseline = measure_baseline(source, ruler, &ours, lock_border);
        report
    };
    levels.par_iter().enumerate().map(measure).collect()
}

/// The source has been simplified already, so that the baseline has nothing to object to; if it has, there is nothing to compare with.
fn measure_baseline(source: &Mesh, ruler: &Ruler, ours: &Measurement, lock_border: bool) -> Option<BaselineReport> {
    let baseline = baseline::simplify_by(source, ours.triangles, ruler, lock_border).ok()?;
    let theirs = ruler.measure(&baseline.mesh);
    Some(BaselineReport::new(baseline.settings, baseline.reached, &theirs, ours))
}

/// Puts the switches into the report: where each level takes over, and how many pixels its error shows there.
fn switch_levels(report: &mut MeshReport, levels: &[(usize, Level)], settings: &Settings) -> Result<()> {
    let radius = report.radius;
    let errors: Vec<f64> = report.levels.iter().map(|level| level.error.hausdorff).collect();
    let requested: Vec<usize> = levels.iter().map(|(requested, _)| *requested).collect();
    let switches = place_switches(&errors, &requested, radius, settings)?;
    for (level, &switch_in) in report.levels.iter_mut().zip(&switches.values) {
        let height = to_height(switch_in, settings.basis);
        level.switch_in = switch_in;
        level.pixels_at_switch = pixels_of_error(level.error.hausdorff, radius, height, settings.screen_height);
    }
    report.coverage = switches.values;
    report.notes.extend(switches.notes);
    Ok(())
}

/// What a loader or tool needs to make switches of its own: nobody agrees on what coverage means.
fn describe_for_extras(report: &MeshReport, settings: &Settings) -> Value {
    let source = json!({ "triangles": report.triangles, "error": 0.0, "rms": 0.0 });
    let level = |level: &LevelReport| json!({ "triangles": level.triangles, "error": level.error.hausdorff, "rms": level.error.rms });
    let levels: Vec<Value> = std::iter::once(source).chain(report.levels.iter().map(level)).collect();
    json!({
        "generator": concat!("gltf-lod ", env!("CARGO_PKG_VERSION")),
        "basis": report.basis,
        "boundingRadius": report.radius,
        "screenHeight": settings.screen_height,
        "pixelTolerance": settings.pixel_tolerance,
        "levels": levels,
    })
}
