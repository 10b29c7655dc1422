//! What the bench found out. Field order is the key order of the JSON.

use super::quality::LevelRow;
use super::summary::Summary;
use super::{BenchOptions, Mode};
use crate::error::Kind;
use crate::pipeline::Visited;
use crate::report::{MeshReport, Outcome, Problem};
use serde::Serialize;

/// Everything about one run of the bench.
#[derive(Debug, Clone, Serialize)]
pub struct BenchReport {
    /// `gltf-lod`.
    pub tool: &'static str,
    /// Version of the tool.
    pub version: &'static str,
    /// Version of this format; grows when a key changes its meaning.
    pub format: u32,
    /// Shares of the triangles asked for.
    pub levels: Vec<f64>,
    /// The preset asked for, if not `default`.
    pub preset: Option<String>,
    /// The algorithm asked for, if not the preset's.
    pub algorithm: Option<String>,
    /// The effort asked for, if not the preset's.
    pub effort: Option<String>,
    /// Threads that ours ran on.
    pub threads: usize,
    /// All meshes together.
    pub summary: Summary,
    /// One for each mesh, in the order of the inputs.
    pub meshes: Vec<MeshBench>,
    /// Meshes that get no levels.
    pub skipped: Vec<SkippedMesh>,
    /// What could not be read or measured.
    pub problems: Vec<Problem>,
}

/// A mesh that was left out.
#[derive(Debug, Clone, Serialize)]
pub struct SkippedMesh {
    /// Its file, relative to its input root.
    pub file: String,
    /// Its index in the file.
    pub mesh: usize,
    /// Why.
    pub why: String,
}

/// One mesh.
#[derive(Debug, Clone, Serialize)]
pub struct MeshBench {
    /// Its file, relative to its input root.
    pub file: String,
    /// Its index in the file.
    pub mesh: usize,
    /// Its name.
    pub name: Option<String>,
    /// Triangles of the source.
    pub triangles: usize,
    /// Vertices of the source, as stored.
    pub vertices: usize,
    /// Whether it has normals, UVs or colours: only then are there attribute modes.
    pub has_attributes: bool,
    /// Time and memory of our whole chain.
    pub ours: OurTime,
    /// Time of meshoptimizer's calls for the same counts, in every mode.
    pub meshopt: Vec<RivalTime>,
    /// Figures of every level.
    pub levels: Vec<LevelRow>,
}

/// Seconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Times {
    /// Processor time, all threads together: minimum.
    pub cpu: f64,
    /// Its median.
    pub cpu_median: f64,
    /// Time on the wall: minimum.
    pub wall: f64,
    /// Its median.
    pub wall_median: f64,
    /// How often it was measured.
    pub runs: usize,
}

/// Time and memory of our chain.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct OurTime {
    /// From mesh to all levels.
    #[serde(flatten)]
    pub times: Times,
    /// Triangles of the source a second on the wall.
    pub triangles_per_second: f64,
    /// Memory at the peak beyond that before, levels included, source not; `None` where it cannot be had.
    pub peak_bytes: Option<u64>,
    /// The same for each vertex of the source.
    pub peak_bytes_per_vertex: Option<f64>,
}

/// Time of a mode.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct RivalTime {
    /// The mode.
    pub mode: Mode,
    /// All levels together.
    #[serde(flatten)]
    pub times: Times,
}

impl OurTime {
    pub(super) fn new(times: Times, triangles: usize, vertices: usize, peak_bytes: Option<u64>) -> Self {
        let triangles_per_second = if times.wall > 0.0 { triangles as f64 / times.wall } else { 0.0 };
        let peak_bytes_per_vertex = peak_bytes.map(|bytes| bytes as f64 / vertices.max(1) as f64);
        Self { times, triangles_per_second, peak_bytes, peak_bytes_per_vertex }
    }
}

impl MeshBench {
    /// The times of `mode`, if the mesh has it.
    pub fn times(&self, mode: Mode) -> Option<&Times> {
        self.meshopt.iter().find(|rival| rival.mode == mode).map(|rival| &rival.times)
    }
}

impl BenchReport {
    /// How the run ended.
    pub fn outcome(&self) -> Outcome {
        if self.problems.iter().any(|problem| problem.error.kind == Kind::Preset) {
            Outcome::Preset
        } else if self.problems.is_empty() {
            Outcome::Fine
        } else {
            Outcome::Trouble
        }
    }

    pub(super) fn new(levels: Vec<f64>, options: &BenchOptions, meshes: Vec<MeshBench>, visited: Visited) -> Self {
        let skip = |(file, mesh): (String, MeshReport)| SkippedMesh {
            file,
            mesh: mesh.mesh,
            why: mesh.skipped.unwrap_or_default(),
        };
        Self {
            tool: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            format: 1,
            levels,
            preset: options.flags.preset.clone(),
            algorithm: options.flags.algorithm.clone(),
            effort: options.flags.effort.clone(),
            threads: visited.threads,
            summary: Summary::of(&meshes),
            meshes,
            skipped: visited.skipped.into_iter().map(skip).collect(),
            problems: visited.problems,
        }
    }
}
