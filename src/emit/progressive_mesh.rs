//! `GLTFLOD_mesh_progressive` out: bases and records into a file, and levels made of them back into plain meshes.

use super::Output;
use super::accessors::{EncodedLevel, encode_in_order, encode_level};
use super::bundle::{Load, bundle};
use super::primitives::find_bound_extension;
use super::replace::{Replacement, replace_triangles};
use super::rows::{
    RowChannel, empty_state, groups_without_faces, node_rows, row, row_width, source_channels, stored_channels, to_mesh,
};
use crate::asset::{Asset, Geometry, Limits, PROGRESSIVE, PrimitiveLayout, Progressive};
use crate::error::{Error, Result};
use crate::mesh::Mesh;
use crate::mesh::surface::Surface;
use crate::progressive::{Chunk, Log, Most, State, Steps, Stop, checksum, encode, refine};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// A mesh ready to be written progressively.
#[derive(Debug)]
pub(crate) struct ProgressiveMesh {
    mesh: usize,
    base: EncodedLevel,
    chunks: Vec<Chunk>,
    payload: Value,
    /// What it takes up.
    pub size: ProgressiveSize,
}

/// What a progressive mesh takes up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct ProgressiveSize {
    /// Triangles of the base.
    pub base_triangles: usize,
    /// Triangles of the full mesh.
    pub triangles: usize,
    /// Number of records.
    pub records: usize,
    /// Bytes of the base.
    pub base_bytes: usize,
    /// Bytes of all records.
    pub record_bytes: usize,
}

/// Why `meshes[index]` cannot become progressive, if it cannot.
pub(crate) fn find_obstacle(asset: &Asset, index: usize, geometry: &Geometry) -> Option<String> {
    let mesh = asset.document.array("meshes").get(index)?;
    if mesh.pointer(&format!("/extensions/{PROGRESSIVE}")).is_some() {
        return Some("it is progressive already".to_owned());
    }
    if let Some(whole) = geometry.passed_over.iter().find(|passed_over| !passed_over.carried) {
        return Some(whole.why.clone());
    }
    if geometry.mesh.triangles.is_empty() {
        return Some("no triangles".to_owned());
    }
    let primitives = mesh.get("primitives").and_then(Value::as_array).into_iter().flatten();
    let bound = std::iter::once(mesh).chain(primitives).find_map(find_bound_extension);
    bound.map(|name| format!("{name} names the source's own triangles"))
}

/// Encodes what `log` saw of the mesh on the way to `surface`, which has a face left. `geometry` is the mesh as it is stored.
pub(crate) fn encode_progressive(mesh: usize, geometry: &Geometry, mut log: Log, surface: &Surface) -> ProgressiveMesh {
    let channels = source_channels(geometry, &Steps::of(&geometry.mesh));
    let nodes = node_rows(geometry, &channels, &mut log);
    let encoded = encode(&log, surface, &nodes);
    drop(nodes);
    let empty = groups_without_faces(&encoded.base);
    let base = encode_in_order(&to_mesh(&encoded.base, geometry, &channels, &stand_ins(geometry, &channels)), geometry);
    let records = encoded.chunks.iter().map(|c| c.records).sum();
    let size = ProgressiveSize {
        base_triangles: encoded.base.faces().len(),
        triangles: encoded.chunks.last().map_or(encoded.base.faces().len(), |c| c.triangles),
        records,
        base_bytes: base.bytes.len(),
        record_bytes: encoded.chunks.iter().map(|c| c.bytes.len()).sum(),
    };
    let vertices = encoded.chunks.last().map_or(encoded.base.vertex_count(), |c| c.vertices);
    let payload = json!({
        "version": 1,
        "triangles": size.triangles,
        "vertices": vertices,
        "records": records,
        "primitives": describe_groups(geometry, &channels, &empty),
    });
    ProgressiveMesh { mesh, base, chunks: encoded.chunks, payload, size }
}

/// A row for each group from its own vertices; zeros for a strip that makes no triangle.
fn stand_ins(geometry: &Geometry, channels: &[Vec<RowChannel>]) -> Vec<Vec<i32>> {
    let first = |(primitive, channels): (&PrimitiveLayout, &Vec<RowChannel>)| match primitive.vertices.is_empty() {
        true => vec![0; row_width(channels)],
        false => row(&geometry.mesh, channels, primitive.vertices.start),
    };
    geometry.primitives.iter().zip(channels).map(first).collect()
}

fn describe_groups(geometry: &Geometry, channels: &[Vec<RowChannel>], empty: &[u32]) -> Vec<Value> {
    let describe = |(group, (primitive, channels)): (u32, (&PrimitiveLayout, &Vec<RowChannel>))| {
        let attribute = |channel: &RowChannel| match channel.step {
            Some(step) => json!({ "name": channel.layout.name, "step": step }),
            None => json!({ "name": channel.layout.name }),
        };
        let of = |target| channels.iter().filter(|c| c.target == target).map(attribute).collect::<Vec<_>>();
        let mut described = json!({ "primitive": primitive.primitive, "attributes": of(None) });
        if empty.contains(&group) {
            described["empty"] = true.into();
        }
        if !primitive.targets.is_empty() {
            described["targets"] = (0..primitive.targets.len()).map(|t| of(Some(t))).collect();
        }
        described
    };
    (0..).zip(geometry.primitives.iter().zip(channels)).map(describe).collect()
}

/// The asset as a GLB of this name with these meshes progressive.
pub(crate) fn write_progressive(asset: &Asset, meshes: &[ProgressiveMesh], name: PathBuf) -> Result<Output> {
    let mut document = asset.document.clone();
    let replacements: Vec<_> = meshes.iter().map(|m| Replacement { mesh: m.mesh, level: &m.base }).collect();
    let mut views = replace_triangles(&mut document, &replacements, BTreeSet::new());
    let mut tail = Vec::new();
    let mut descriptions = vec![Vec::new(); meshes.len()];
    for (index, chunk) in by_fineness(meshes) {
        let view = views.take(&mut document);
        tail.push((view, chunk.bytes.as_slice()));
        descriptions[index].push(json!({
            "bufferView": view,
            "records": chunk.records,
            "triangles": chunk.triangles,
            "vertices": chunk.vertices,
            "crc32": checksum(&chunk.bytes),
        }));
    }
    for (mesh, chunks) in meshes.iter().zip(descriptions) {
        let mut payload = mesh.payload.clone();
        payload["chunks"] = chunks.into();
        document.set_extension(&format!("/meshes/{}", mesh.mesh), PROGRESSIVE, payload);
    }
    if !meshes.is_empty() {
        document.add_extension_used(PROGRESSIVE);
    }
    let levels: Vec<_> = meshes.iter().map(|m| &m.base).collect();
    bundle(asset, document, &views, &Load { levels: &levels, tail }, name)
}

/// All meshes become finer together: the chunks after which there are fewer halvings to go come later.
fn by_fineness(meshes: &[ProgressiveMesh]) -> Vec<(usize, &Chunk)> {
    let mut chunks: Vec<_> =
        meshes.iter().enumerate().flat_map(|(i, m)| m.chunks.iter().map(move |c| (i, c))).collect();
    chunks.sort_by_key(|(_, chunk)| std::cmp::Reverse(chunk.halvings));
    chunks
}

/// A progressive mesh that was read, being refined.
#[derive(Debug)]
pub(crate) struct Refining<'a> {
    mesh: usize,
    geometry: Geometry,
    progressive: Progressive<'a>,
    channels: Vec<Vec<RowChannel>>,
    stand_ins: Vec<Vec<i32>>,
    state: State,
    /// The chunk that comes next, and how many of its bytes and records are done.
    next: usize,
    done: (usize, usize),
    /// Whether records are missing at the end.
    ends_early: bool,
    /// Numbers that its vertices may have.
    most_numbers: usize,
}

impl<'a> Refining<'a> {
    /// `meshes[index]` as coarse as it is stored; `None` if it is not progressive. `ends_early` if the file does.
    ///
    /// # Errors
    /// What is wrong with its geometry or with the extension, and where.
    pub fn open(asset: &'a Asset, index: usize, limits: &Limits, ends_early: bool) -> Result<Option<Self>> {
        let Some(progressive) = asset.progressive(index)? else { return Ok(None) };
        let geometry = asset.stored_geometry(index, limits)?;
        let channels = stored_channels(&geometry, &progressive).map_err(|error| error.in_file(&asset.path))?;
        let stand_ins = stand_ins(&geometry, &channels);
        let mut state = empty_state(&channels);
        let is_empty = |group: usize| progressive.groups[group].empty;
        let mut vertex_of = Vec::new();
        for (group, primitive) in geometry.primitives.iter().enumerate() {
            for v in primitive.vertices.clone() {
                let row = || row(&geometry.mesh, &channels[group], v);
                vertex_of.push(if is_empty(group) { None } else { Some(state.add_vertex(group as u32, &row())) });
            }
        }
        for triangle in &geometry.mesh.triangles {
            if let [Some(a), Some(b), Some(c)] = triangle.map(|v| vertex_of[v as usize]) {
                state.add_face([a, b, c]);
            }
        }
        Ok(Some(Self {
            mesh: index,
            geometry,
            progressive,
            channels,
            stand_ins,
            state,
            next: 0,
            done: (0, 0),
            ends_early,
            most_numbers: usize::try_from(limits.mesh_bytes / 4).unwrap_or(usize::MAX),
        }))
    }

    /// Triangles now.
    pub fn triangles(&self) -> usize {
        self.state.faces().len()
    }

    /// Triangles when all records are applied, as the file says.
    pub fn full_triangles(&self) -> usize {
        self.progressive.triangles
    }

    /// Applies records for as long as there are no more than `triangles` triangles. Tells whether records were missing.
    ///
    /// # Errors
    /// [`Kind::Malformed`] with the chunk and the record; the mesh is of no use then.
    pub fn refine(&mut self, triangles: usize) -> Result<bool> {
        while let Some(chunk) = self.progressive.chunks.get(self.next) {
            let wrong = |what: String| {
                let place = format!("{}/chunks/{}", self.progressive.place, self.next);
                Err(Error::malformed(place, what).help("the file is damaged: export or copy it again"))
            };
            if self.done == (0, 0) && chunk.checksum.is_some_and(|sum| sum != checksum(chunk.bytes)) {
                return wrong("the checksum of the records is another one".to_owned());
            }
            let rest = chunk.bytes.get(self.done.0..).unwrap_or_default();
            let end = refine(&mut self.state, rest, Most { triangles, numbers: self.most_numbers });
            self.done = (self.done.0 + end.bytes, self.done.1 + end.records);
            let (bytes, records) = self.done;
            match end.stop {
                Stop::Target => return Ok(false),
                Stop::Malformed(what) => {
                    return wrong(format!("record {records}, at byte {bytes} of the chunk: {what}"));
                }
                Stop::Truncated | Stop::Bytes if self.ends_early && records < chunk.records => return Ok(true),
                Stop::Truncated => return wrong(format!("the bytes end inside record {records} of {}", chunk.records)),
                Stop::Bytes if (records, self.state.faces().len()) != (chunk.records, chunk.triangles) => {
                    let found = format!("{records} records up to {} triangles", self.state.faces().len());
                    return wrong(format!(
                        "{} records up to {} triangles are promised, there are {found}",
                        chunk.records, chunk.triangles
                    ));
                }
                Stop::Bytes => (self.next, self.done) = (self.next + 1, (0, 0)),
            }
        }
        Ok(false)
    }

    /// The mesh as it is now.
    pub fn level(&self) -> Mesh {
        to_mesh(&self.state, &self.geometry, &self.channels, &self.stand_ins)
    }
}

/// The asset as a GLB of this name with these meshes as they are, plain.
pub(crate) fn write_rebuilt(asset: &Asset, meshes: &[Refining<'_>], name: PathBuf) -> Result<Output> {
    let encode = |mesh: &Refining<'_>| encode_level(&mesh.level(), &mesh.geometry);
    let levels: Vec<EncodedLevel> = meshes.par_iter().map(encode).collect();
    let mut document = asset.document.clone();
    let mut released = BTreeSet::new();
    for mesh in meshes {
        document.take_extension(&format!("/meshes/{}", mesh.mesh), PROGRESSIVE);
        released.extend(mesh.progressive.chunks.iter().map(|chunk| chunk.view));
    }
    document.remove_extension_used(PROGRESSIVE);
    let replacements: Vec<_> =
        meshes.iter().zip(&levels).map(|(m, level)| Replacement { mesh: m.mesh, level }).collect();
    let views = replace_triangles(&mut document, &replacements, released);
    let levels: Vec<_> = levels.iter().collect();
    bundle(asset, document, &views, &Load { levels: &levels, tail: Vec::new() }, name)
}
