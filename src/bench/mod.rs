//! The bench: our chains against meshoptimizer's, in time, memory and nearness to the source.
//!
//! Everything runs in one process, meshes one after the other. Triangle counts are those that ours reached; the ruler
//! is the same for all. The library reads no clock: the program brings [`Instruments`].

mod quality;
mod report;
mod summary;
mod text;
mod timing;

pub use quality::{Figures, LevelRow, Rival};
pub use report::{BenchReport, MeshBench, OurTime, RivalTime, SkippedMesh, Times};
pub use summary::{AgainstAttributes, ModeSummary, Ratios, Summary};
pub use text::describe_bench;

use crate::asset::Limits;
use crate::baseline::{Prepared, Settings};
use crate::error::{Error, Kind, Result};
use crate::pipeline::{BuildOptions, Observer, Subject, visit_subjects};
use crate::preset::{Flags, Maker};
use crate::simplify::simplify;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Duration;

/// The shares of the triangles that are made when none are asked for.
pub const DEFAULT_LEVELS: [f64; 4] = [0.5, 0.25, 0.125, 0.0625];

/// What to measure.
#[derive(Debug, Clone, Default)]
pub struct BenchOptions {
    /// `.glb` and `.gltf` files, and directories that are walked for them.
    pub inputs: Vec<PathBuf>,
    /// Presets and levels asked for on the command line; [`DEFAULT_LEVELS`] if there are no levels among them.
    pub flags: Flags,
    /// Bounds on what is read.
    pub limits: Limits,
    /// Threads for ours; `None` takes one for each processor.
    pub jobs: Option<usize>,
    /// Rounds of timing, each of which times every competitor once; `None`: until the minima settle.
    pub runs: Option<usize>,
}

/// Clocks and memory of the process. Called from one thread, while nothing else of the bench runs.
pub trait Instruments: Sync {
    /// Time since some fixed moment.
    fn wall(&self) -> Duration;
    /// Processor time that the process has used so far, all threads together.
    fn cpu(&self) -> Duration;
    /// Runs `work` and gives the bytes by which the memory of the process was larger at its peak than before; `None`
    /// where that cannot be had.
    fn peak_memory(&self, work: &mut dyn FnMut()) -> Option<u64> {
        work();
        None
    }
}

/// A mode of meshoptimizer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mode {
    /// Its settings.
    pub settings: Settings,
    /// Whether each level is made from the one before instead of the source.
    pub chained: bool,
}

impl Mode {
    /// `simplify` of the source: what quality is compared with.
    pub const PLAIN: Self = Self {
        settings: Settings { attributes: false, permissive: false, prune: false, lock_border: false, update: false },
        chained: false,
    };

    /// All modes that differ for a mesh: attribute modes only where attributes count.
    pub fn all(with_attributes: bool) -> Vec<Self> {
        let kinds =
            if with_attributes { &[(false, false), (true, false), (true, true)][..] } else { &[(false, false)] };
        let mut modes = Vec::new();
        for &(attributes, permissive) in kinds {
            for update in [false, true] {
                let settings = Settings { attributes, permissive, update, ..Settings::default() };
                modes.extend([false, true].map(|chained| Self { settings, chained }));
            }
        }
        modes
    }

    /// What the mode is called: `update`, `attributes+permissive chained`.
    pub fn name(self) -> String {
        self.settings.name() + if self.chained { " chained" } else { "" }
    }

    /// The same settings, chained.
    pub fn chained(self) -> Self {
        Self { chained: true, ..self }
    }
}

impl Serialize for Mode {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.name())
    }
}

/// Measures every mesh of the inputs that `build` would make levels of.
///
/// # Errors
/// As [`build`](crate::build). What keeps a file from being measured is part of the report ([`BenchReport::problems`]).
pub fn bench(options: &BenchOptions, instruments: &dyn Instruments, observer: &dyn Observer) -> Result<BenchReport> {
    if options.runs == Some(0) {
        return Err(Error::new(Kind::Preset, "no rounds of timing").help("give at least one run"));
    }
    let levels = options.flags.levels.clone().unwrap_or(DEFAULT_LEVELS.to_vec());
    let build = BuildOptions {
        inputs: options.inputs.clone(),
        flags: Flags { levels: Some(levels.clone()), ..options.flags.clone() },
        limits: options.limits,
        jobs: options.jobs,
        ..BuildOptions::default()
    };
    let mut meshes = Vec::new();
    let visited = visit_subjects(&build, observer, |file, subject| {
        meshes.push(measure_mesh(file, subject, options, instruments)?);
        Ok(())
    })?;
    Ok(BenchReport::new(levels, options, meshes, visited))
}

fn measure_mesh(
    file: &str,
    subject: Subject,
    options: &BenchOptions,
    instruments: &dyn Instruments,
) -> Result<MeshBench> {
    if subject.settings.maker == Maker::Meshopt {
        let error = Error::new(Kind::Preset, "`algorithm = \"meshopt\"` would be compared with itself");
        return Err(error.help("choose one of our own algorithms"));
    }
    let source = &subject.geometry.mesh;
    let mut chain = None;
    let peak = instruments.peak_memory(&mut || chain = Some(simplify(source, &subject.options)));
    let chain = chain.ok_or_else(|| Error::new(Kind::Internal, "the instruments ran nothing"))??;
    let counts: Vec<usize> = chain.levels.iter().map(|level| level.mesh.triangles.len()).collect();

    let prepared = Prepared::new(source)?;
    let modes = Mode::all(prepared.has_attributes());
    let race = timing::Race { source, options: &subject.options, prepared: &prepared, modes: &modes, counts: &counts };
    let (our_times, rival_times) = race.run(options.runs, instruments)?;
    let levels = quality::compare_levels(&chain, &prepared, &modes, &subject.ruler)?;
    let (triangles, vertices) = (source.triangles.len(), source.positions.len());
    Ok(MeshBench {
        file: file.to_owned(),
        mesh: subject.report.mesh,
        name: subject.report.name,
        triangles,
        vertices,
        has_attributes: prepared.has_attributes(),
        ours: OurTime::new(our_times, triangles, vertices, peak),
        meshopt: rival_times,
        levels,
    })
}
