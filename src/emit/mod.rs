//! MSFT_lod out: appends levels to a document, lays out buffers, writes files atomically.

mod accessors;
mod bundle;
mod channels;
mod layout;
mod lod_extension;
mod names;
mod primitives;
mod progressive;
mod progressive_mesh;
mod replace;
mod rows;
mod storage;
#[cfg(test)]
mod tests;
pub mod verify;
mod write;

pub(crate) use progressive_mesh::{
    ProgressiveMesh, Refining, encode_progressive, find_obstacle, write_progressive, write_rebuilt,
};
pub use storage::round_to_storage;
pub use write::write;

use crate::asset::{Asset, Container, Document, Geometry, Scene};
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use accessors::{encode_indices_only, encode_level};
use channels::Channels;
use layout::{Block, Placement, place_blocks};
use lod_extension::{Arranger, NodeLevels};
use names::Names;
use primitives::{level_accessors, level_mesh, level_views};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
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
    /// The vertex of the source's plain mesh that each vertex is, if all are such: then only indices are written.
    pub source_vertices: Option<Vec<u32>>,
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

/// Bytes of a mesh that is stored as `geometry` says.
pub(crate) fn count_bytes(mesh: &Mesh, geometry: &Geometry) -> usize {
    encode_level(mesh, geometry).bytes.len()
}

/// Appends `lods` to the asset's document and lays out the files.
///
/// Meshes that no node draws, nodes that keep levels of the source, and levels without triangles are left out with a
/// note. When nothing is left to add, the asset's own file is copied byte for byte.
///
/// # Errors
/// [`Kind::Unsupported`](crate::Kind::Unsupported) for arrangements that no loader handles or when levels are refused, [`Kind::Limit`](crate::Kind::Limit) when a GLB
/// would pass 4 GiB.
pub fn emit(asset: &Asset, lods: &[MeshLods], options: &Options) -> Result<Output> {
    add_levels(asset, lods, options).map_err(|error| error.in_file(&asset.path))
}

fn add_levels(asset: &Asset, lods: &[MeshLods], options: &Options) -> Result<Output> {
    let scene = asset.scene();
    refuse_existing(&scene, options.existing)?;
    let mut notes = Vec::new();
    let channels = Channels::of(&asset.document);
    let mut arranger = Arranger::new(asset, &scene, &channels, &options.naming);
    let plans = plan_meshes(asset, &scene, lods, options.existing, &arranger, &mut notes);
    if plans.is_empty() {
        return Ok(Output { files: files_of(asset, Content::CopyOf(asset.path.clone()), Vec::new()), notes });
    }

    let mut document = asset.document.clone();
    let blocks = encode_blocks(&plans);
    let placed = place_blocks(asset, &mut document, &blocks, options.layout, &mut notes)?;
    if options.existing == Existing::Replace {
        remove_existing(&mut document, &scene, &plans, &mut arranger);
    }
    let mut names = Names::new(&options.naming, asset.document.array("meshes"));
    let mut level = blocks.iter().zip(&placed.placements);
    for plan in &plans {
        let saved: usize = level.clone().take(plan.levels.len()).map(|(block, _)| block.level.bytes_saved).sum();
        if saved > 0 {
            notes.push(format!(
                "/meshes/{}: levels share the source's vertices, which saves {saved} bytes",
                plan.lods.mesh
            ));
        }
        let placed_levels = level.by_ref().take(plan.levels.len());
        let meshes = append_level_meshes(&mut document, asset, plan, placed_levels, &mut names);
        for &mesh in &meshes {
            channels.repeat_for_mesh(&mut document, plan.lods.mesh, mesh);
        }
        let levels = NodeLevels { meshes: &meshes, coverage: &plan.coverage, extras: &plan.lods.extras };
        for &node in &plan.nodes {
            arranger.arrange(&mut document, node, &levels);
        }
    }
    document.add_extension_used("MSFT_lod");
    notes.append(&mut arranger.notes);
    note_vrm(&document, &mut notes);

    let main = match &asset.container {
        Container::Gltf => document.to_json(),
        glb @ Container::Glb { .. } => glb.pack(&document.to_json(), placed.bin.as_deref().or(own_bin(asset)))?,
    };
    Ok(Output { files: files_of(asset, Content::Bytes(main), placed.files), notes })
}

/// What one mesh gets.
struct MeshPlan<'a> {
    lods: &'a MeshLods,
    /// Levels that are written, finest first.
    levels: Vec<&'a LodLevel>,
    /// Their coverage.
    coverage: Vec<f64>,
    /// Nodes that get them.
    nodes: Vec<usize>,
}

fn refuse_existing(scene: &Scene, existing: Existing) -> Result<()> {
    match (existing, scene.existing.first()) {
        (Existing::Refuse, Some((node, _))) => {
            let place = format!("/nodes/{node}/extensions/MSFT_lod");
            let error = Error::unsupported(place, "the file has levels already, which the preset refuses");
            Err(error.help("set existing to \"keep\" or \"replace\", or build from the source without levels"))
        }
        _ => Ok(()),
    }
}

fn plan_meshes<'a>(
    asset: &Asset,
    scene: &Scene,
    lods: &'a [MeshLods],
    existing: Existing,
    arranger: &Arranger<'_>,
    notes: &mut Vec<String>,
) -> Vec<MeshPlan<'a>> {
    let mut plans = Vec::new();
    for lods in lods {
        let mesh = lods.mesh;
        if let Some(reason) = lods.geometry.passed_over.iter().find(|p| !p.carried) {
            notes.push(format!(
                "/meshes/{mesh}/primitives/{}: {}, so the mesh gets no levels",
                reason.primitive, reason.why
            ));
            continue;
        }
        let (levels, coverage) = usable_levels(lods, notes);
        let nodes = nodes_to_arrange(scene, mesh, existing, arranger, notes);
        if asset.document.array("meshes").get(mesh).is_some() && !levels.is_empty() && !nodes.is_empty() {
            plans.push(MeshPlan { lods, levels, coverage, nodes });
        }
    }
    plans
}

/// The levels that have triangles, each fewer than the one above. What is drawn where a level is left out is the level
/// above it; after the last one nothing, where the last one would have ended.
fn usable_levels<'a>(lods: &'a MeshLods, notes: &mut Vec<String>) -> (Vec<&'a LodLevel>, Vec<f64>) {
    let mut above = lods.geometry.mesh.triangles.len();
    let mut levels = Vec::new();
    let mut coverage = Vec::new();
    for (index, level) in lods.levels.iter().enumerate() {
        let triangles = level.mesh.triangles.len();
        if triangles == 0 || triangles >= above {
            let place = format!("/meshes/{}", lods.mesh);
            notes.push(format!("{place}: level {} is left out: {triangles} triangles after {above}", index + 1));
            continue;
        }
        above = triangles;
        levels.push(level);
        coverage.extend(lods.coverage.get(index));
    }
    coverage.extend(lods.coverage.get(lods.levels.len()));
    (levels, coverage)
}

/// The nodes that draw the mesh and may have levels: none in or below a level, none below other levels.
fn nodes_to_arrange(
    scene: &Scene,
    mesh: usize,
    existing: Existing,
    arranger: &Arranger<'_>,
    notes: &mut Vec<String>,
) -> Vec<usize> {
    let users = scene.uses.get(mesh).map_or(&[][..], |u| &u.nodes);
    if users.is_empty() {
        notes.push(format!("/meshes/{mesh}: no node draws it, so it gets no levels"));
    }
    let lower = |node: &usize| scene.lower.contains(node);
    if existing == Existing::Keep && users.iter().any(lower) {
        // A mesh that stands at two levels vanishes in Babylon.js.
        notes.push(format!("/meshes/{mesh}: it is a lower level in the source already, so it gets no levels"));
        return Vec::new();
    }
    let mut nodes = Vec::new();
    for &node in users.iter().filter(|node| !lower(node)) {
        match arranger.is_below_levels(node) {
            Some(carrier) if existing == Existing::Keep => {
                notes.push(format!("/nodes/{node}: keeps the levels that /nodes/{carrier} has in the source"));
            }
            _ => nodes.push(node),
        }
    }
    nodes
}

fn encode_blocks(plans: &[MeshPlan<'_>]) -> Vec<Block> {
    let levels: Vec<_> = plans.iter().flat_map(|plan| plan.levels.iter().enumerate().map(move |l| (plan, l))).collect();
    let encode = |&(plan, (index, level)): &(&MeshPlan<'_>, (usize, &&LodLevel))| Block {
        mesh: plan.lods.mesh,
        level: match &level.source_vertices {
            Some(vertices) => encode_indices_only(&level.mesh, vertices, &plan.lods.geometry),
            None => encode_level(&level.mesh, &plan.lods.geometry),
        },
        stage: plan.levels.len() - 1 - index,
    };
    levels.par_iter().map(encode).collect()
}

/// Takes off the source's levels wherever new ones would stand at or below them.
fn remove_existing(document: &mut Document, scene: &Scene, plans: &[MeshPlan<'_>], arranger: &mut Arranger<'_>) {
    let mut carriers = BTreeSet::new();
    for &node in plans.iter().flat_map(|plan| &plan.nodes) {
        let above = std::iter::successors(Some(node), |&n| scene.parent.get(n).copied().flatten());
        carriers.extend(above.take(scene.parent.len() + 1));
    }
    for (carrier, ids) in scene.existing.iter().filter(|(carrier, _)| carriers.contains(carrier)) {
        arranger.remove_levels(document, *carrier, ids);
    }
}

/// Appends buffer views, accessors and the mesh of each level; returns the meshes.
fn append_level_meshes<'b>(
    document: &mut Document,
    asset: &Asset,
    plan: &MeshPlan<'_>,
    levels: impl Iterator<Item = (&'b Block, &'b Placement)>,
    names: &mut Names<'_>,
) -> Vec<usize> {
    let index = plan.lods.mesh;
    let source = &asset.document.array("meshes")[index];
    let name = source.get("name").and_then(serde_json::Value::as_str).filter(|n| !n.is_empty());
    let name = name.map_or_else(|| format!("mesh{index}"), str::to_owned);
    let append = |(number, (block, placement)): (usize, (&Block, &Placement))| {
        let first_view = document.array("bufferViews").len();
        for view in level_views(&block.level, placement.buffer, placement.offset) {
            document.push("bufferViews", view);
        }
        let first_accessor = document.array("accessors").len();
        for accessor in level_accessors(&block.level, first_view) {
            document.push("accessors", accessor);
        }
        let name = names.level(&name, number + 1);
        document.push("meshes", level_mesh(source, &plan.lods.geometry, &block.level, first_accessor, name))
    };
    levels.enumerate().map(append).collect()
}

/// VRM names nodes and meshes for first-person views and expressions; those entries stay with the finest level.
fn note_vrm(document: &Document, notes: &mut Vec<String>) {
    for name in ["VRMC_vrm", "VRM"] {
        if document.root().pointer(&format!("/extensions/{name}")).is_some() {
            notes.push(format!(
                "/extensions/{name}: its expressions and first-person flags reach the finest level only"
            ));
        }
    }
}

/// The BIN chunk of a GLB whose levels went elsewhere.
fn own_bin(asset: &Asset) -> Option<&[u8]> {
    let external = asset.document.array("buffers").first()?.get("uri").is_some();
    if external { None } else { asset.buffers.first()?.as_deref() }
}

/// The asset's own file, new files beside it, and the files it names.
fn files_of(asset: &Asset, main: Content, new_files: Vec<OutputFile>) -> Vec<OutputFile> {
    let name = asset.path.file_name().map(PathBuf::from).unwrap_or_default();
    let mut files = vec![OutputFile { relative: name, content: main }];
    files.extend(new_files);
    let directory = asset.path.parent().unwrap_or(Path::new(""));
    for resource in asset.resources.iter().filter(|r| r.exists) {
        if !files.iter().any(|f| f.relative == resource.relative) {
            let content = Content::CopyOf(directory.join(&resource.relative));
            files.push(OutputFile { relative: resource.relative.clone(), content });
        }
    }
    files
}
