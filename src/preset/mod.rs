//! TOML presets: files → layers → the settings of one mesh.

use crate::emit::{Existing, Layout};
use crate::error::{Error, Kind, Result};
use crate::simplify;
use std::path::{Path, PathBuf};

/// Everything that decides about one mesh, after all layers and rules.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// `Some(reason)`: leave this mesh alone.
    pub skip: Option<String>,
    /// Algorithm, policies, weights. Its `levels` are empty; see `levels`.
    pub simplify: simplify::Options,
    /// The levels asked for, finest first.
    pub levels: Vec<LevelTarget>,
    /// Meshes with fewer triangles get no levels.
    pub min_source_triangles: usize,
    /// A level is dropped unless it has at most this share of the triangles of the level above.
    pub min_saving: f64,
    /// Screen height in pixels that switch values are made for.
    pub screen_height: f64,
    /// Error on screen that is tolerated at a switch, pixels.
    pub pixel_tolerance: f64,
    /// Coverage: from the measured error, or these numbers.
    pub coverage: Coverage,
    /// What the coverage numbers measure.
    pub basis: Basis,
    /// Coverage below which nothing is drawn; 0 keeps the last level for ever.
    pub cull_coverage: f64,
    /// Gates.
    pub gates: Gates,
    /// Buffer layout.
    pub layout: Layout,
    /// Policy for levels in the source.
    pub existing: Existing,
    /// Name of level nodes: `{name}_LOD{level}`.
    pub naming: String,
    /// Samples of the ruler.
    pub samples: usize,
}

/// When a level ends: the first rule that binds.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LevelTarget {
    /// Share of the source's triangles.
    pub ratio: Option<f64>,
    /// Triangles.
    pub triangles: Option<usize>,
    /// Largest error.
    pub error: Option<ErrorBound>,
    /// Largest error on screen, in pixels, when the mesh's bounding sphere covers the share `at` of the screen's height.
    pub pixels: Option<PixelBound>,
}

/// A bound on the distance from the source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ErrorBound {
    /// In object units.
    Units(f64),
    /// In percent of the bounding box's diagonal.
    Percent(f64),
}

/// A bound on the error on screen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelBound {
    /// Pixels.
    pub pixels: f64,
    /// Coverage (share of the screen's height) at which they are counted.
    pub at: f64,
}

/// Where switch values come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Coverage {
    /// From each level's measured error, the screen height and the pixel tolerance.
    Auto,
    /// These, one for each level; the cull coverage follows.
    Explicit(Vec<f64>),
}

/// What a coverage number measures.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Basis {
    /// Diameter of the bounding sphere over the height of the screen.
    #[default]
    Height,
    /// Area of the bounding sphere's disc over the area of a 16:9 screen.
    Area,
}

/// Checks that can fail a build.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gates {
    /// Largest Hausdorff distance allowed, and what happens above it.
    pub max_error: Option<(ErrorBound, Severity)>,
    /// Largest RMS relative to meshoptimizer's at the same triangle count.
    pub max_rms_vs_meshopt: Option<(f64, Severity)>,
    /// Most open gap edges.
    pub max_gap_edges: Option<(usize, Severity)>,
}

/// What a broken gate does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// Says so.
    Warn,
    /// Exit code 1.
    Fail,
}

/// All preset layers of a run: built-in → every `gltf-lod.toml` from the input root down to the asset's directory →
/// `--config` → flags; later wins.
#[derive(Debug)]
pub struct Presets {}

/// What the command line says about presets.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Flags {
    /// `--config FILE`.
    pub config: Option<PathBuf>,
    /// `--preset NAME`: a built-in preset or one that a config file defines.
    pub preset: Option<String>,
    /// `--levels 0.5,0.25`: replaces the levels of every layer.
    pub levels: Option<Vec<f64>>,
    /// `--algorithm NAME`.
    pub algorithm: Option<String>,
}

/// The layers that apply to one asset, read and checked.
#[derive(Debug, Clone)]
pub struct AssetPresets {}

/// The names that rules match.
#[derive(Debug, Clone, Copy, Default)]
pub struct MeshNames<'a> {
    /// Name of the mesh, if it has one.
    pub mesh: Option<&'a str>,
    /// Names of the nodes that draw it.
    pub nodes: &'a [String],
    /// Names of its materials.
    pub materials: &'a [String],
}

impl Presets {
    /// Reads `--config` and checks the flags.
    ///
    /// # Errors
    /// [`Kind::Preset`] with file, line, column, a caret and a suggestion.
    pub fn new(_flags: &Flags) -> Result<Self> {
        Err(Error::new(Kind::Preset, "not there yet"))
    }

    /// The layers for the asset at `asset`, below the input root `root`. Files are read once per run.
    ///
    /// # Errors
    /// As [`Presets::new`], for the `gltf-lod.toml` files on the way.
    pub fn for_asset(&self, _root: &Path, _asset: &Path) -> Result<AssetPresets> {
        Err(Error::new(Kind::Preset, "not there yet"))
    }
}

impl AssetPresets {
    /// The settings of one mesh after all rules.
    pub fn settings(&self, _names: &MeshNames<'_>) -> Result<Settings> {
        Err(Error::new(Kind::Preset, "not there yet"))
    }

    /// BLAKE3 of the effective layers (not of file formatting), hex: part of the report and of cache keys.
    pub fn hash(&self) -> String {
        String::new()
    }

    /// Globs (relative to the root) of files that are not glTF and are copied to the output.
    pub fn copies(&self, _relative: &Path) -> bool {
        false
    }
}
