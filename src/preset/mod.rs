//! TOML presets: files → layers → the settings of one mesh.
//!
//! [`Presets`] holds the layers of a run, [`AssetPresets`] those of one file, [`Settings`] what they come to for one mesh.
//! Defaults stand in one place only: `config/default.toml`. Errors point into the file with line, column and caret.
//!
//! ```
//! use gltf_lod::preset::{Flags, MeshNames, Presets};
//! use std::path::Path;
//!
//! let flags = Flags { preset: Some("mobile".into()), ..Flags::default() };
//! let presets = Presets::new(&flags)?.for_asset(Path::new("assets"), Path::new("props/chair.glb"))?;
//! let settings = presets.settings(&MeshNames { mesh: Some("chair"), ..MeshNames::default() })?;
//! assert_eq!(settings.levels[0].ratio, Some(0.4));
//! # Ok::<(), gltf_lod::Error>(())
//! ```

mod builtin;
mod expand;
mod file;
mod layers;
mod level;
mod model;
mod number;
mod pattern;
mod schema;
mod settings;
mod source;
mod value;

#[cfg(test)]
mod tests;

pub use builtin::{PresetInfo, init_text, list};
pub use layers::{AssetPresets, FILE_NAME, Flags, MeshNames, Presets};
pub use schema::schema_text;

use crate::emit::{Existing, Layout};
use crate::simplify;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Everything that decides about one mesh, after all layers and rules.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// `Some(reason)`: leave this mesh alone.
    pub skip: Option<String>,
    /// Who makes the levels.
    pub maker: Maker,
    /// Algorithm, policies, weights. Of these [`Maker::Meshopt`] heeds `border` and `min_triangles`. Its `levels` are empty; see `levels`.
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

impl Default for Settings {
    /// What `config/default.toml` says.
    fn default() -> Self {
        settings::resolve(&builtin::default_keys()).unwrap_or_else(|error| panic!("{error}"))
    }
}

/// Who makes the levels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Maker {
    /// This crate's simplifier.
    #[default]
    Simplify,
    /// meshoptimizer (`algorithm = "meshopt"`).
    Meshopt,
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
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Says so.
    Warn,
    /// Exit code 1.
    Fail,
}
