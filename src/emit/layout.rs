//! Where level data lies: in the GLB's own buffer, in files beside the asset, or inside a self-contained `.gltf`.
//!
//! *Append* puts it behind the source's data, so that no old offset changes. *Progressive* is for staged loading: a
//! loader fetches for each level, coarsest first, one range of a GLB from the first to the last byte it needs. So the
//! BIN chunk begins with what every level needs (images, animations, other meshes) and the coarsest level, and ends with
//! the finest levels' vertices, the source's own. A `.gltf` gets one file for each level instead.

use super::accessors::{EncodedLevel, pad};
use super::progressive::{Levelled, can_reorder, ranges_of_view, split_source};
use super::{Content, Layout, OutputFile};
use crate::asset::{Asset, Container, Document};
use crate::error::{Error, Result};
use base64::Engine;
use serde_json::{Value, json};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// One level and when a staged loader wants it.
pub(super) struct Block {
    /// The mesh it is a level of.
    pub mesh: usize,
    pub level: EncodedLevel,
    /// 0 for the coarsest level of its mesh, counting up to the finest.
    pub stage: usize,
}

/// Where a block has gone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Placement {
    pub buffer: usize,
    pub offset: usize,
}

/// The level data, placed.
pub(super) struct Placed {
    /// One for each block.
    pub placements: Vec<Placement>,
    /// The BIN chunk of a GLB.
    pub bin: Option<Vec<u8>>,
    /// New files beside the asset.
    pub files: Vec<OutputFile>,
}

/// Places all blocks and describes their buffers in the document.
pub(super) fn place_blocks(
    asset: &Asset,
    document: &mut Document,
    blocks: &[Block],
    layout: Layout,
    notes: &mut Vec<String>,
) -> Result<Placed> {
    match home_of(asset) {
        Home::Bin { source } => Ok(place_in_bin(document, source, blocks, layout, notes)),
        Home::NewBin => {
            document.push("buffers", json!({ "byteLength": 0 }));
            Ok(place_in_bin(document, &[], blocks, layout, notes))
        }
        Home::File => place_in_new_buffers(asset, document, blocks, layout, true),
        Home::DataUri => place_in_new_buffers(asset, document, blocks, layout, false),
    }
}

/// What takes up level data.
enum Home<'a> {
    /// The GLB's BIN chunk, which is `buffers[0]`.
    Bin { source: &'a [u8] },
    /// A GLB without buffers gets a BIN chunk.
    NewBin,
    /// Files beside the asset, as the source has.
    File,
    /// The document itself, as in the source.
    DataUri,
}

fn home_of(asset: &Asset) -> Home<'_> {
    let buffers = asset.document.array("buffers");
    let uri = |buffer: &'_ Value| buffer.get("uri").and_then(Value::as_str).map(str::to_owned);
    if matches!(asset.container, Container::Glb { .. }) {
        match (buffers.first(), asset.buffers.first()) {
            (None, _) => return Home::NewBin,
            (Some(first), Some(Some(source))) if uri(first).is_none() => return Home::Bin { source },
            _ => {}
        }
    }
    let external = buffers.iter().filter_map(uri).any(|uri| !uri.starts_with("data:"));
    if external { Home::File } else { Home::DataUri }
}

/// A piece of a buffer that is put together anew.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Part {
    /// Bytes of the source's buffer.
    Source(Range<usize>),
    /// `blocks[i]`.
    Block(usize),
}

/// A buffer put together from parts.
struct Composed {
    bytes: Vec<u8>,
    /// Offset of each block that is in it.
    blocks: Vec<(usize, usize)>,
    /// Source ranges and where they begin now.
    moved: Vec<(Range<usize>, usize)>,
}

/// Offsets keep their remainder modulo 4, which is all the alignment that glTF knows.
fn compose(source: &[u8], blocks: &[Block], parts: &[Part]) -> Composed {
    let mut composed = Composed { bytes: Vec::new(), blocks: Vec::new(), moved: Vec::new() };
    for part in parts {
        pad(&mut composed.bytes, 4);
        match part {
            Part::Block(index) => {
                composed.blocks.push((*index, composed.bytes.len()));
                composed.bytes.extend_from_slice(&blocks[*index].level.bytes);
            }
            Part::Source(range) => {
                composed.bytes.resize(composed.bytes.len() + range.start % 4, 0);
                composed.moved.push((range.clone(), composed.bytes.len()));
                composed.bytes.extend_from_slice(&source[range.clone()]);
            }
        }
    }
    composed
}

fn place_in_bin(
    document: &mut Document,
    source: &[u8],
    blocks: &[Block],
    layout: Layout,
    notes: &mut Vec<String>,
) -> Placed {
    let progressive = layout == Layout::Progressive && can_reorder(document, notes);
    let parts = if progressive {
        let [sharing, own] = [true, false]
            .map(|shared| blocks.iter().filter(|b| b.level.shares_vertices() == shared).map(|b| b.mesh).collect());
        let split = split_source(document, &Levelled { own, sharing }, source.len());
        let staged = by_stage(blocks).into_iter().flatten().map(Part::Block);
        split
            .shared
            .into_iter()
            .map(Part::Source)
            .chain(staged)
            .chain(split.finest.into_iter().map(Part::Source))
            .collect()
    } else {
        let blocks = (0..blocks.len()).map(Part::Block);
        std::iter::once(Part::Source(0..source.len())).chain(blocks).collect::<Vec<_>>()
    };
    let composed = compose(source, blocks, &parts);
    move_views(document, &composed.moved);
    document.set("/buffers/0", "byteLength", composed.bytes.len().into());
    let placements = placements(blocks.len(), 0, &composed.blocks);
    Placed { placements, bin: Some(composed.bytes), files: Vec::new() }
}

fn placements(count: usize, buffer: usize, offsets: &[(usize, usize)]) -> Vec<Placement> {
    let mut placements = vec![Placement { buffer, offset: 0 }; count];
    for &(index, offset) in offsets {
        placements[index].offset = offset;
    }
    placements
}

/// Blocks of each stage, coarsest first.
fn by_stage(blocks: &[Block]) -> Vec<Vec<usize>> {
    let stages = blocks.iter().map(|b| b.stage + 1).max().unwrap_or(0);
    (0..stages).map(|stage| (0..blocks.len()).filter(|&i| blocks[i].stage == stage).collect()).collect()
}

/// Gives the buffer views of buffer 0 their new offsets.
fn move_views(document: &mut Document, moved: &[(Range<usize>, usize)]) {
    let new_offset = |offset: usize| {
        let (range, start) = moved.iter().find(|(range, _)| range.contains(&offset))?;
        Some(start + (offset - range.start))
    };
    let mut edits = Vec::new();
    for (index, view) in document.array("bufferViews").iter().enumerate() {
        for (place, object) in ranges_of_view(index, view) {
            let offset = object.get("byteOffset").and_then(Value::as_u64).unwrap_or(0) as usize;
            if object.get("buffer").and_then(Value::as_u64) == Some(0) {
                edits.extend(new_offset(offset).filter(|&new| new != offset).map(|new| (place, new)));
            }
        }
    }
    for (place, offset) in edits {
        document.set(&place, "byteOffset", offset.into());
    }
}

fn place_in_new_buffers(
    asset: &Asset,
    document: &mut Document,
    blocks: &[Block],
    layout: Layout,
    as_files: bool,
) -> Result<Placed> {
    let groups = match layout {
        Layout::Append => vec![("_lod".to_owned(), (0..blocks.len()).collect())],
        Layout::Progressive => {
            let stages = by_stage(blocks);
            let finest = stages.len();
            // Named as the levels of the mesh that has most of them are.
            stages
                .into_iter()
                .enumerate()
                .map(|(s, blocks)| (format!("_lod{}", finest - s), blocks))
                .collect::<Vec<_>>()
        }
    };
    let mut placed =
        Placed { placements: vec![Placement { buffer: 0, offset: 0 }; blocks.len()], bin: None, files: Vec::new() };
    for (suffix, members) in groups {
        let composed = compose(&[], blocks, &members.iter().map(|&i| Part::Block(i)).collect::<Vec<_>>());
        let length = composed.bytes.len();
        let uri = if as_files {
            let name = free_name(asset, &placed.files, &suffix)?;
            placed.files.push(OutputFile { relative: PathBuf::from(&name), content: Content::Bytes(composed.bytes) });
            encode_uri(&name)
        } else {
            let data = base64::engine::general_purpose::STANDARD.encode(&composed.bytes);
            format!("data:application/octet-stream;base64,{data}")
        };
        let buffer = document.push("buffers", json!({ "uri": uri, "byteLength": length }));
        for (index, offset) in composed.blocks {
            placed.placements[index] = Placement { buffer, offset };
        }
    }
    Ok(placed)
}

/// `<stem><suffix>.bin`, or with a number, so that it is neither one of the asset's files nor a neighbour's.
fn free_name(asset: &Asset, new_files: &[OutputFile], suffix: &str) -> Result<String> {
    let stem = asset.path.file_stem().and_then(|s| s.to_str());
    let stem = stem
        .ok_or_else(|| Error::new(crate::Kind::Unsupported, "the file's name is not Unicode").in_file(&asset.path))?;
    let directory = asset.path.parent().unwrap_or(Path::new(""));
    // Without regard to case, as file systems may be.
    let same = |path: &Path, name: &str| path.to_string_lossy().to_lowercase() == name.to_lowercase();
    let is_free = |name: &String| {
        !asset.resources.iter().any(|r| same(&r.relative, name))
            && !new_files.iter().any(|f| same(&f.relative, name))
            && !directory.join(name).exists()
    };
    let numbered = (2u32..).map(|i| format!("{stem}{suffix}_{i}.bin"));
    let name = std::iter::once(format!("{stem}{suffix}.bin")).chain(numbered).find(is_free);
    name.ok_or_else(|| Error::new(crate::Kind::Internal, "no free file name").in_file(&asset.path))
}

/// A file name as a URI: everything but unreserved ASCII is percent-encoded UTF-8 (RFC 3986).
fn encode_uri(name: &str) -> String {
    use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
    const RESERVED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'.').remove(b'_').remove(b'~');
    utf8_percent_encode(name, RESERVED).to_string()
}
