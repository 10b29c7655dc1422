//! Arguments and help.

use clap::{Args, Parser, Subcommand};
use gltf_lod::preset::Flags;
use std::path::PathBuf;

const EXIT_CODES: &str = "\
Exit codes:
  0  everything was processed
  1  a gate of a preset failed (the results are written)
  2  wrong usage, or a wrong preset
  3  some input could not be processed; all others were";

const MAIN_HELP: &str = "\
Examples:
  gltf-lod build assets -o build/assets           all .glb and .gltf files below assets, as a mirrored tree
  gltf-lod build chair.glb -o out --levels 0.5,0.1
  gltf-lod inspect out/chair.glb                  what is in the file, and its levels
  gltf-lod compare chair.glb                      our levels against meshoptimizer's at equal triangle counts
  gltf-lod init                                   a commented gltf-lod.toml to start from";

const BUILD_HELP: &str = "\
Presets, later wins: built-in, every gltf-lod.toml from the input directory down to the asset's, --config, these flags.

Examples:
  gltf-lod build assets -o build/assets
  gltf-lod build assets -o build/assets --preset mobile --report build/lods.json
  gltf-lod build assets -o build/assets --dry-run -v     show every mesh, write nothing
  gltf-lod build assets --in-place                       overwrite the sources (keep them in version control)";

/// Builds measured levels of detail into glTF files (MSFT_lod).
const BENCH_HELP: &str = "\
Levels are 0.5,0.25,0.125,0.0625 unless --levels says otherwise; presets decide about the rest.
Ours is timed from mesh to levels on all threads, meshoptimizer by its library calls alone, each on
the source, or `chained`: each on what the one before left. Of several rounds the minimum counts.
Figures are over those of meshoptimizer's plain simplify of the source; below 1, ours is better.

Examples:
  gltf-lod bench models --effort fast
  gltf-lod bench bunny.glb --levels 0.5,0.1,0.01 --runs 20 --json";

#[derive(Debug, Parser)]
#[command(name = "gltf-lod", version, after_help = format!("{MAIN_HELP}\n\n{EXIT_CODES}"))]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write assets with levels of detail
    ///
    /// Walks the inputs for .glb and .gltf files, makes a chain of levels for every mesh, measures each against its source and against
    /// meshoptimizer, and writes the files with MSFT_lod. Nothing else in a file changes.
    #[command(after_help = format!("{BUILD_HELP}\n\n{EXIT_CODES}"))]
    Build(Build),
    /// Show a file's meshes and the levels it has
    Inspect(Inspect),
    /// Compare our levels of a file with meshoptimizer's, without writing anything
    ///
    /// Both are made at the same triangle counts and measured by the same ruler: two-sided distance to the source surface. Ratios below 1
    /// mean that ours is nearer.
    #[command(after_help = EXIT_CODES)]
    Compare(Compare),
    /// Make the meshes of a file progressive: coarse at first, finer with every byte that follows
    ///
    /// Writes one GLB. Any viewer shows the coarse base; gltf-lod rebuild and js/gltf-lod-progressive.mjs make any resolution of it up to the
    /// source's own triangles, from as much of the file as there is (extension GLTFLOD_mesh_progressive).
    #[command(after_help = EXIT_CODES)]
    Progressive(Progressive),
    /// Make a plain file of any resolution from a progressive one
    #[command(after_help = EXIT_CODES)]
    Rebuild(Rebuild),
    /// Time our chains against meshoptimizer's and measure both
    ///
    /// Every mesh that `build` would make levels of: time from mesh to all levels, memory, and at equal triangle counts the distances,
    /// angles and slivers of ours and of every mode of meshoptimizer. Close other programs meanwhile.
    #[command(after_help = format!("{BENCH_HELP}\n\n{EXIT_CODES}"))]
    Bench(Bench),
    /// Write a commented gltf-lod.toml
    Init(Init),
    /// List the built-in presets
    Presets,
    /// Train the net that chooses QFVP's w (`qfvp_w = "auto"`)
    ///
    /// Reduces models by random ratios with w = 0, 0.5, 1, 1.5 and 2, measures what is left, and trains two small neural nets to name the best w:
    /// one that goes by triangle counts, as in the paper, and one that also looks at the shape. The weights in config/ are compiled in: build
    /// again after training.
    #[command(after_help = EXIT_CODES)]
    TrainW(TrainW),
    /// Make the tables of the papers behind the algorithms again, and check their claims
    ///
    /// Reduces the papers' models (cow.glb and stanford-bunny.glb in DIR, and spot.glb, fandisk.glb and rocker-arm.glb) with each algorithm in
    /// its paper's order, and prints our figures beside theirs. Made models stand in for the papers' where they are missing.
    #[command(after_help = EXIT_CODES)]
    Papers(Papers),
}

#[derive(Debug, Args)]
pub struct Build {
    /// .glb or .gltf files, and directories that are walked for them
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Directory for the results; mirrors the input tree
    #[arg(short, long, value_name = "DIR", required_unless_present = "in_place")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub preset: PresetArgs,
    /// Write the report as JSON
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Leave times out of the report: the same input then gives the same bytes
    #[arg(long, requires = "report")]
    pub no_times: bool,
    /// Do everything but write
    #[arg(long)]
    pub dry_run: bool,
    /// Allow sources to be overwritten
    #[arg(long)]
    pub in_place: bool,
    #[command(flatten)]
    pub run: RunArgs,
}

#[derive(Debug, Args)]
pub struct Inspect {
    /// A .glb or .gltf file
    pub file: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Compare {
    /// A .glb or .gltf file
    pub file: PathBuf,
    #[command(flatten)]
    pub preset: PresetArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub run: RunArgs,
}

#[derive(Debug, Args)]
pub struct Progressive {
    /// A .glb or .gltf file
    pub file: PathBuf,
    /// The .glb to write
    #[arg(short, long, value_name = "OUT.glb")]
    pub output: PathBuf,
    /// Triangles of the base as a share of the source's
    #[arg(long, value_name = "RATIO", default_value_t = 0.05)]
    pub base: f64,
    /// A preset file that goes over all gltf-lod.toml files
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// A built-in preset (see `gltf-lod presets`) or one that a preset file defines
    #[arg(long, value_name = "NAME")]
    pub preset: Option<String>,
    /// Algorithm that says in which order edges collapse
    #[arg(long, value_name = "NAME")]
    pub algorithm: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Threads [default: one for each processor]; the results are the same for any number
    #[arg(short, long, value_name = "N", value_parser = parse_jobs)]
    pub jobs: Option<usize>,
}

#[derive(Debug, Args)]
pub struct Rebuild {
    /// A file that gltf-lod progressive has written, or the beginning of one
    pub file: PathBuf,
    /// The .glb to write
    #[arg(short, long, value_name = "OUT.glb")]
    pub output: PathBuf,
    /// Triangles of all progressive meshes together [default: all there are]
    #[arg(long, value_name = "N")]
    pub triangles: Option<usize>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Threads [default: one for each processor]; the results are the same for any number
    #[arg(short, long, value_name = "N", value_parser = parse_jobs)]
    pub jobs: Option<usize>,
}

#[derive(Debug, Args)]
pub struct TrainW {
    /// .glb or .gltf files; each of their meshes is a model
    #[arg(value_name = "MESHES")]
    pub meshes: Vec<PathBuf>,
    /// Models made by formulas, besides the files
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub generated: usize,
    /// Random reductions of each model
    #[arg(long, value_name = "N", default_value_t = 40)]
    pub reductions: usize,
    /// What random numbers start from
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// The weights, as JSON
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Write the labelled samples too, as CSV
    #[arg(long, value_name = "FILE")]
    pub samples: Option<PathBuf>,
    /// Train with the samples of an earlier run instead of labelling
    #[arg(long, value_name = "FILE", conflicts_with_all = ["meshes", "generated", "samples"])]
    pub from_samples: Option<PathBuf>,
    #[command(flatten)]
    pub run: RunArgs,
}

#[derive(Debug, Args)]
pub struct Bench {
    /// .glb or .gltf files, and directories that are walked for them
    #[arg(required = true, value_name = "FILE")]
    pub inputs: Vec<PathBuf>,
    #[command(flatten)]
    pub preset: PresetArgs,
    /// Rounds of timing [default: until the minima settle]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub runs: Option<u16>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub run: RunArgs,
}

#[derive(Debug, Args)]
pub struct Papers {
    /// Directory with the models
    #[arg(long, value_name = "DIR")]
    pub models: Option<PathBuf>,
    /// Rounds of timing, of which the fastest counts
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub runs: usize,
    /// Leave out models with more triangles
    #[arg(long, value_name = "N", default_value_t = usize::MAX, hide_default_value = true)]
    pub most_triangles: usize,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Print errors only
    #[arg(short, long)]
    pub quiet: bool,
}

#[derive(Debug, Args)]
pub struct Init {
    /// Directory that gets the file
    #[arg(default_value = ".")]
    pub directory: PathBuf,
    /// Replace a file that is there
    #[arg(long)]
    pub force: bool,
}

#[derive(Debug, Args)]
pub struct PresetArgs {
    /// A preset file that goes over all gltf-lod.toml files
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// A built-in preset (see `gltf-lod presets`) or one that a preset file defines
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    /// Levels as shares of the source's triangles, e.g. 0.5,0.25,0.125
    #[arg(long, value_name = "RATIOS", value_delimiter = ',')]
    levels: Option<Vec<f64>>,
    /// esqem, qem, qfvp, fms, melax or meshopt
    #[arg(long, value_name = "NAME")]
    algorithm: Option<String>,
    /// Time for quality: fast, default or best
    #[arg(long, value_name = "EFFORT")]
    effort: Option<String>,
}

#[derive(Debug, Args)]
pub struct RunArgs {
    /// Threads [default: one for each processor]; the results are the same for any number
    #[arg(short, long, value_name = "N", value_parser = parse_jobs)]
    pub jobs: Option<usize>,
    /// Print errors only
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Show every mesh and all notes
    #[arg(short, long)]
    pub verbose: bool,
}

impl PresetArgs {
    pub fn flags(&self) -> Flags {
        Flags {
            config: self.config.clone(),
            preset: self.preset.clone(),
            levels: self.levels.clone(),
            algorithm: self.algorithm.clone(),
            effort: self.effort.clone(),
        }
    }
}

fn parse_jobs(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(jobs @ 1..=1024) => Ok(jobs),
        _ => Err("give a number from 1 to 1024".to_owned()),
    }
}
