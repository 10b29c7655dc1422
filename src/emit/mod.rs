//! MSFT_lod out: appends levels to a document, lays out buffers, writes files atomically.

use crate::asset::{Asset, Geometry};
use crate::error::{Error, Kind, Result};
use crate::mesh::Mesh;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The levels of one glTF mesh, ready to be written.
#[derive(Debug, Clone)]
pub struct MeshLods {
    /// `meshes[mesh]`.
    pub mesh: usize,
    /// How its primitives were stored.
    pub geometry: Geometry,
    /// Levels, finest first; each has fewer triangles than the one before. Their groups are those of `geometry`.
    pub levels: Vec<LodLevel>,
    /// `MSFT_screencoverage`: `levels.len() + 1` numbers, strictly falling.
    pub coverage: Vec<f64>,
    /// Goes into `extras` of the node beside the coverage, under `gltf_lod`: basis, errors, triangles, formula inputs.
    pub extras: serde_json::Value,
}

/// One level of one mesh.
#[derive(Debug, Clone)]
pub struct LodLevel {
    /// Its geometry, already rounded to the storage types by [`round_to_storage`].
    pub mesh: Mesh,
}

/// How levels are written.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Where level data goes.
    pub layout: Layout,
    /// Name of level nodes and meshes; `{name}` and `{level}` are replaced.
    pub naming: String,
    /// What happens to levels that the source has already.
    pub existing: Existing,
}

/// Where level data goes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// After the source's data: no old index or offset changes.
    #[default]
    Append,
    /// Coarsest level first, for staged loading; one `.bin` for each level of a `.gltf`.
    Progressive,
}

/// What happens to levels that the source has already.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Existing {
    /// Nodes with levels keep them; other nodes get levels.
    #[default]
    Keep,
    /// Generated levels replace them (the old nodes stay in the file, unreferenced by MSFT_lod, and the report says so).
    Replace,
    /// A file with levels is an error.
    Refuse,
}

/// The files of one written asset.
#[derive(Debug, Clone)]
pub struct Output {
    /// The asset's own file first.
    pub files: Vec<OutputFile>,
    /// What the user should know: arrangements that not every loader handles, nodes left out and why.
    pub notes: Vec<String>,
}

/// One file to write.
#[derive(Debug, Clone)]
pub struct OutputFile {
    /// Relative to the directory of the asset's output.
    pub relative: PathBuf,
    /// Its content.
    pub content: Content,
}

/// What a file gets.
#[derive(Debug, Clone)]
pub enum Content {
    /// These bytes.
    Bytes(Vec<u8>),
    /// The bytes of this file.
    CopyOf(PathBuf),
}

/// Rounds `level` to the component types its primitives are stored in, so that what is measured is what is written.
/// Positions that are equal stay equal across groups.
pub fn round_to_storage(_level: &mut Mesh, _geometry: &Geometry) {}

/// Appends `lods` to the asset's document and lays out the files.
///
/// # Errors
/// [`Kind::Unsupported`] for arrangements that no loader handles, [`Kind::Limit`] when a GLB would pass 4 GiB.
pub fn emit(_asset: &Asset, _lods: &[MeshLods], _options: &Options) -> Result<Output> {
    Err(Error::new(Kind::Unsupported, "not there yet"))
}

/// Writes all files of `output` below `directory`, or none: each to a temporary file beside its target, then renamed.
///
/// # Errors
/// [`Kind::Io`] with the file; nothing of this asset is left behind.
pub fn write(_output: &Output, _directory: &Path) -> Result<()> {
    Err(Error::new(Kind::Unsupported, "not there yet"))
}
