//! The extension `GLTFLOD_mesh_progressive` of a mesh: what its records are about, and where they are.

use super::accessor::View;
use super::cursor::Cursor;
use super::{Asset, Document};
use crate::error::{Error, Kind, Result};
use serde_json::Value;
use std::collections::BTreeMap;

/// Name of the extension. `docs/GLTFLOD_mesh_progressive.md` describes it.
pub const PROGRESSIVE: &str = "GLTFLOD_mesh_progressive";

/// The progressive part of a mesh.
#[derive(Debug, Clone)]
pub struct Progressive<'a> {
    /// JSON pointer to the extension.
    pub place: String,
    /// Triangles of the full mesh.
    pub triangles: usize,
    /// Its triangle primitives, as the records count them.
    pub groups: Vec<ProgressiveGroup>,
    /// The records, coarse to fine.
    pub chunks: Vec<RecordChunk<'a>>,
}

/// One primitive of a progressive mesh.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgressiveGroup {
    /// JSON pointer to what says so.
    pub place: String,
    /// Index into `meshes[m].primitives`.
    pub primitive: usize,
    /// Whether its only triangle stands in for none.
    pub empty: bool,
    /// Its attributes in the order of a row.
    pub attributes: Vec<RowAttribute>,
    /// Those of its morph targets.
    pub targets: Vec<Vec<RowAttribute>>,
}

/// One attribute of a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RowAttribute {
    /// glTF name.
    pub name: String,
    /// Exponent of the step of the grid that floats which are not the source's lie on.
    pub step: Option<i8>,
}

/// Records that lie together.
#[derive(Debug, Clone, Copy)]
pub struct RecordChunk<'a> {
    /// `bufferViews[view]`.
    pub view: usize,
    /// What there is of it.
    pub bytes: &'a [u8],
    /// Number of records.
    pub records: usize,
    /// Triangles of the mesh after them.
    pub triangles: usize,
    /// CRC-32 of the bytes; none if it is not known or not all of them are there.
    pub checksum: Option<u32>,
}

impl Asset {
    /// What makes `meshes[index]` progressive, if anything does.
    ///
    /// # Errors
    /// [`Kind::Malformed`] with the place in the extension, [`Kind::Unsupported`] for another version of it.
    pub fn progressive(&self, index: usize) -> Result<Option<Progressive<'_>>> {
        let Some(mesh) = Cursor::top(self.document.root(), "meshes", index) else { return Ok(None) };
        let Some(extension) = mesh.extension(PROGRESSIVE) else { return Ok(None) };
        self.read_progressive(&extension).map(Some).map_err(|error| error.in_file(&self.path))
    }

    fn read_progressive(&self, extension: &Cursor) -> Result<Progressive<'_>> {
        let version = extension.need("version")?;
        if version.integer()? != 1 {
            return Err(Error { kind: Kind::Unsupported, ..version.expected("version 1") }
                .help("the file was written by another version of gltf-lod"));
        }
        let chunks = extension.need("chunks")?.elements()?.map(|chunk| self.read_chunk(&chunk));
        Ok(Progressive {
            place: extension.place.clone(),
            triangles: extension.need("triangles")?.integer()?,
            groups: extension.need("primitives")?.elements()?.map(|g| read_group(&g)).collect::<Result<_>>()?,
            chunks: chunks.collect::<Result<_>>()?,
        })
    }

    fn read_chunk(&self, chunk: &Cursor) -> Result<RecordChunk<'_>> {
        let member = chunk.need("bufferView")?;
        let index = member.index("bufferViews", self.document.array("bufferViews").len())?;
        let view = Cursor::top(self.document.root(), "bufferViews", index);
        let view = view.map(|view| View::parse(&view)).transpose()?;
        let bytes = view.and_then(|view| {
            let buffer = self.buffers.get(view.buffer)?.as_deref()?;
            buffer.get(view.offset..view.offset.checked_add(view.length)?)
        });
        Ok(RecordChunk {
            view: index,
            bytes: bytes.ok_or_else(|| member.error("the bytes of the records are not there"))?,
            records: chunk.need("records")?.integer()?,
            triangles: chunk.need("triangles")?.integer()?,
            checksum: chunk.get("crc32").map(|sum| read_checksum(&sum)).transpose()?,
        })
    }
}

fn read_checksum(sum: &Cursor) -> Result<u32> {
    let number = sum.value.as_u64().and_then(|number| u32::try_from(number).ok());
    number.ok_or_else(|| sum.expected("a whole number below 2^32"))
}

fn read_group(group: &Cursor) -> Result<ProgressiveGroup> {
    let attributes = |list: &Cursor| list.elements()?.map(|a| read_attribute(&a)).collect::<Result<Vec<_>>>();
    let targets = group.get("targets").map(|t| t.elements()?.map(|t| attributes(&t)).collect()).transpose()?;
    Ok(ProgressiveGroup {
        place: group.place.clone(),
        primitive: group.need("primitive")?.integer()?,
        empty: group.get("empty").map_or(Ok(false), |empty| empty.boolean())?,
        attributes: attributes(&group.need("attributes")?)?,
        targets: targets.unwrap_or_default(),
    })
}

fn read_attribute(attribute: &Cursor) -> Result<RowAttribute> {
    let step = attribute.get("step").map(|step| {
        let exponent = step.value.as_i64().and_then(|e| i8::try_from(e).ok()).filter(|e| e.abs() <= 100);
        exponent.ok_or_else(|| step.expected("a whole number from -100 to 100"))
    });
    Ok(RowAttribute { name: attribute.need("name")?.string()?.to_owned(), step: step.transpose()? })
}

/// Fits a document to a file that ends early: the buffer views of records end where `available` bytes of buffer 0 do, and those that are cut have no
/// checksum.
///
/// # Errors
/// [`Kind::Malformed`] if something else is missing too.
pub(super) fn fit_to_prefix(document: &mut Document, available: usize) -> Result<()> {
    let root = document.root();
    let promised = Cursor::top(root, "buffers", 0).map(|b| b.need("byteLength")?.integer()).transpose()?.unwrap_or(0);
    let records = places_of_chunks(document);
    let mut edits = Vec::new();
    for (index, _) in document.array("bufferViews").iter().enumerate() {
        let Some(cursor) = Cursor::top(root, "bufferViews", index) else { continue };
        let view = View::parse(&cursor)?;
        if view.buffer != 0 || view.offset.saturating_add(view.length) <= available {
            continue;
        }
        let Some(chunk) = records.get(&index) else {
            let message =
                format!("the file ends after {available} of {promised} bytes of its buffer, before this view");
            return Err(cursor.error(message).help("fetch more of the file: at least up to its first records"));
        };
        let offset = view.offset.min(available);
        edits.push((cursor.place, chunk.clone(), offset, (available - offset).min(view.length)));
    }
    for (place, chunk, offset, length) in edits {
        document.take(&chunk, "crc32");
        document.set(&place, "byteOffset", Value::from(offset));
        document.set(&place, "byteLength", Value::from(length));
    }
    document.set("/buffers/0", "byteLength", Value::from(promised.min(available)));
    Ok(())
}

/// JSON pointers to all chunks of records, by their buffer view.
fn places_of_chunks(document: &Document) -> BTreeMap<usize, String> {
    let mut places = BTreeMap::new();
    for (mesh, value) in document.array("meshes").iter().enumerate() {
        let chunks = value.pointer(&format!("/extensions/{PROGRESSIVE}/chunks")).and_then(Value::as_array);
        for (index, chunk) in chunks.into_iter().flatten().enumerate() {
            let view = chunk.get("bufferView").and_then(Value::as_u64).and_then(|view| usize::try_from(view).ok());
            let place = format!("/meshes/{mesh}/extensions/{PROGRESSIVE}/chunks/{index}");
            places.extend(view.map(|view| (view, place)));
        }
    }
    places
}
