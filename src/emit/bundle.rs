//! All of an asset in one GLB: what is kept of its buffers, its images, new levels, and at the very end what may be missing.

use super::accessors::{EncodedLevel, pad};
use super::primitives::level_views;
use super::progressive::{names_ranges, ranges_of_view};
use super::replace::Views;
use super::{Content, Output, OutputFile};
use crate::asset::{Asset, Container, Document};
use crate::error::{Error, Result};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// What goes into the GLB besides what is kept of the asset.
pub(super) struct Load<'a> {
    /// The levels that have [`Views::new`].
    pub levels: &'a [&'a EncodedLevel],
    /// Buffer views of the end, in order, with their bytes.
    pub tail: Vec<(usize, &'a [u8])>,
}

/// Packs `document`, made from the asset's, as the file `name`. Files that cannot be taken in are copied beside it, with a note.
pub(super) fn bundle(
    asset: &Asset,
    mut document: Document,
    views: &Views,
    load: &Load,
    name: PathBuf,
) -> Result<Output> {
    if names_ranges(&asset.document) {
        let error = Error::unsupported("", "an extension names a range of a buffer by itself, which would move");
        return Err(error.in_file(&asset.path));
    }
    let (mut bin, moved) = keep_live_data(asset, &document, views, load);
    embed_images(asset, &mut document, &mut bin)?;
    for (level, new) in load.levels.iter().zip(&views.new) {
        pad(&mut bin, 4);
        for (&index, view) in new.iter().zip(level_views(level, 0, bin.len())) {
            document.replace(&format!("/bufferViews/{index}"), view);
        }
        bin.extend_from_slice(&level.bytes);
    }
    for &(index, bytes) in &load.tail {
        let view = json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() });
        document.replace(&format!("/bufferViews/{index}"), view);
        bin.extend_from_slice(bytes);
    }
    for &index in &views.free {
        document.replace(&format!("/bufferViews/{index}"), json!({ "buffer": 0, "byteLength": bin.len().min(1) }));
    }
    move_views(&mut document, &moved);
    join_buffers(asset, &mut document, bin.len());

    let container = match &asset.container {
        glb @ Container::Glb { .. } => glb.clone(),
        Container::Gltf => Container::Glb { others: Vec::new() },
    };
    // Indentation that suits a file of its own is waste here.
    let json = document.root().to_string().into_bytes();
    let bin = (!bin.is_empty()).then_some(bin);
    let mut files =
        vec![OutputFile { relative: name, content: Content::Bytes(container.pack(&json, bin.as_deref())?) }];
    let mut notes = Vec::new();
    files.extend(files_outside(asset, &document, &mut notes));
    Ok(Output { files, notes })
}

/// A place in the document that names a range of a buffer, and where the range is now.
struct Moved {
    place: String,
    buffer: usize,
    offset: usize,
}

/// The bytes that old buffer views still name, in their order; those that overlap stay together.
fn keep_live_data(asset: &Asset, document: &Document, views: &Views, load: &Load) -> (Vec<u8>, Vec<Moved>) {
    let old = asset.document.array("bufferViews").len();
    let new = views.new.iter().flatten().chain(&views.free).chain(load.tail.iter().map(|(view, _)| view));
    let new: BTreeSet<&usize> = new.collect();
    let mut ranges: Vec<(usize, Range<usize>, String)> = Vec::new();
    for index in (0..old).filter(|index| !new.contains(index)) {
        for (place, object) in ranges_of_view(index, &document.array("bufferViews")[index]) {
            let number = |member: &str| object.get(member).and_then(Value::as_u64).unwrap_or(0) as usize;
            let (buffer, start) = (number("buffer"), number("byteOffset"));
            ranges.push((buffer, start..start + number("byteLength"), place));
        }
    }
    ranges.sort_by(|a, b| (a.0, a.1.start, &a.2).cmp(&(b.0, b.1.start, &b.2)));
    let (mut bin, mut moved) = (Vec::new(), Vec::new());
    // Buffer, end of what is copied of it, and where its byte 0 would be.
    let mut run = (usize::MAX, 0, 0);
    for (buffer, range, place) in ranges {
        let Some(Some(bytes)) = asset.buffers.get(buffer) else {
            // A fallback without data: its views stay where they are in it.
            moved.push(Moved { place, buffer: fallback_index(asset, buffer), offset: range.start });
            continue;
        };
        if run.0 != buffer || range.start > run.1 {
            pad(&mut bin, 4);
            bin.resize(bin.len() + range.start % 4, 0);
            run = (buffer, range.start, bin.len() as isize - range.start as isize);
        }
        if range.end > run.1 {
            bin.extend_from_slice(&bytes[run.1..range.end]);
            run.1 = range.end;
        }
        moved.push(Moved { place, buffer: 0, offset: (range.start as isize + run.2) as usize });
    }
    (bin, moved)
}

fn move_views(document: &mut Document, moved: &[Moved]) {
    for Moved { place, buffer, offset } in moved {
        let object = document.root().pointer(place);
        let number = |member: &str| object.and_then(|o| o.get(member)).and_then(Value::as_u64);
        let (old_buffer, old_offset) = (number("buffer"), number("byteOffset").unwrap_or(0));
        if old_buffer != Some(*buffer as u64) {
            document.set(place, "buffer", (*buffer).into());
        }
        if old_offset != *offset as u64 {
            document.set(place, "byteOffset", (*offset).into());
        }
    }
}

/// Where a buffer without data goes: behind the one that has all.
fn fallback_index(asset: &Asset, buffer: usize) -> usize {
    1 + asset.buffers.iter().take(buffer).filter(|b| b.is_none()).count()
}

/// One buffer with all data, then those that never had any.
fn join_buffers(asset: &Asset, document: &mut Document, length: usize) {
    let old = document.array("buffers").to_vec();
    let mut first =
        old.first().filter(|_| matches!(asset.buffers.first(), Some(Some(_)))).cloned().unwrap_or(json!({}));
    if let Some(object) = first.as_object_mut() {
        object.shift_remove("uri");
        object.insert("byteLength".into(), length.into());
    }
    let empty = old.into_iter().zip(&asset.buffers).filter(|(_, data)| data.is_none()).map(|(buffer, _)| buffer);
    let buffers: Vec<Value> = (length > 0).then_some(first).into_iter().chain(empty).collect();
    if !buffers.is_empty() {
        document.set("", "buffers", buffers.into());
    }
}

/// Takes in the images that are files of a known kind.
fn embed_images(asset: &Asset, document: &mut Document, bin: &mut Vec<u8>) -> Result<()> {
    let directory = asset.path.parent().unwrap_or(Path::new(""));
    for resource in asset.resources.iter().filter(|r| r.exists && r.pointer.starts_with("/images/")) {
        let path = directory.join(&resource.relative);
        let bytes = std::fs::read(&path).map_err(|error| Error::io(&path, &error))?;
        let uri = document.root().pointer(&resource.pointer).and_then(|image| image.get("uri")).cloned();
        let Some((uri, kind)) = uri.zip(find_kind(&bytes)) else { continue };
        pad(bin, 4);
        let view = json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() });
        bin.extend_from_slice(&bytes);
        let view = document.push("bufferViews", view);
        // Several images may be one file.
        for index in 0..document.array("images").len() {
            let place = format!("/images/{index}");
            if document.array("images")[index].get("uri") == Some(&uri) {
                document.take(&place, "uri");
                document.set(&place, "bufferView", view.into());
                if document.array("images")[index].get("mimeType").is_none() {
                    document.set(&place, "mimeType", kind.into());
                }
            }
        }
    }
    Ok(())
}

/// The files that the document still names.
fn files_outside(asset: &Asset, document: &Document, notes: &mut Vec<String>) -> Vec<OutputFile> {
    let directory = asset.path.parent().unwrap_or(Path::new(""));
    let is_file = |image: &Value| image.get("uri").and_then(Value::as_str).is_some_and(|uri| !uri.starts_with("data:"));
    let images_left = document.array("images").iter().any(is_file);
    let is_needed =
        |pointer: &str| !pointer.starts_with("/buffers/") && (!pointer.starts_with("/images/") || images_left);
    let mut files = Vec::new();
    for resource in asset.resources.iter().filter(|r| r.exists && is_needed(&r.pointer)) {
        notes.push(format!("{}: {} stays a file of its own", resource.pointer, resource.relative.display()));
        let content = Content::CopyOf(directory.join(&resource.relative));
        files.push(OutputFile { relative: resource.relative.clone(), content });
    }
    files
}

/// The media type of an image by its first bytes.
fn find_kind(bytes: &[u8]) -> Option<&'static str> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => Some("image/png"),
        [0xFF, 0xD8, 0xFF, ..] => Some("image/jpeg"),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some("image/webp"),
        [0xAB, b'K', b'T', b'X', b' ', b'2', b'0', ..] => Some("image/ktx2"),
        [b'D', b'D', b'S', b' ', ..] => Some("image/vnd-ms.dds"),
        _ => None,
    }
}
