//! Reads valid glTF files plainly: JSON, buffers, accessors as numbers. Panics on anything odd.

use super::{index, items, maybe_index};
use base64::{Engine, prelude::BASE64_STANDARD};
use serde_json::Value;
use std::path::Path;

/// Type and payload of a GLB chunk.
pub type Chunk = ([u8; 4], Vec<u8>);

/// A glTF file.
pub struct Gltf {
    /// The document.
    pub json: Value,
    /// The bytes of each buffer; empty where they are missing.
    pub buffers: Vec<Vec<u8>>,
    /// GLB chunks after JSON.
    pub chunks: Vec<Chunk>,
}

impl Gltf {
    /// Reads `path`.
    pub fn open(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let (text, chunks) = if bytes.starts_with(b"glTF") { split_glb(&bytes) } else { (bytes, Vec::new()) };
        let json: Value = serde_json::from_slice(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let read = |(i, buffer): (usize, &Value)| {
            let bin = chunks.iter().find(|(kind, _)| i == 0 && kind == b"BIN\0");
            let mut data = match buffer["uri"].as_str() {
                Some(uri) => read_uri(path.parent().expect("a file has a directory"), uri),
                None => bin.map(|(_, data)| data.clone()).unwrap_or_default(),
            };
            data.truncate(index(&buffer["byteLength"]));
            data
        };
        let buffers = items(&json["buffers"]).iter().enumerate().map(read).collect();
        Self { json, buffers, chunks }
    }

    /// The elements of a top-level list.
    pub fn list(&self, name: &str) -> &[Value] {
        items(&self.json[name])
    }

    /// An accessor's elements as numbers, sparse parts and normalisation applied.
    pub fn elements(&self, accessor: usize) -> Vec<Vec<f64>> {
        let object = &self.list("accessors")[accessor];
        let (count, width) = (index(&object["count"]), width_of(&object["type"]));
        let component = index(&object["componentType"]);
        let normalized = object["normalized"] == true;
        let mut out = match maybe_index(&object["bufferView"]) {
            Some(view) => self.read_view(view, offset_of(object), component, width, count),
            None => vec![vec![0.0; width]; count],
        };
        let sparse = &object["sparse"];
        if !sparse.is_null() {
            let count = index(&sparse["count"]);
            let part = |part: &Value, component, width| {
                self.read_view(index(&part["bufferView"]), offset_of(part), component, width, count)
            };
            let places = part(&sparse["indices"], index(&sparse["indices"]["componentType"]), 1);
            for (place, value) in places.iter().zip(part(&sparse["values"], component, width)) {
                out[place[0] as usize] = value;
            }
        }
        if normalized {
            out.iter_mut().flatten().for_each(|x| *x = (*x / largest_of(component)).max(-1.0));
        }
        out
    }

    /// Vertex indices of a primitive's triangles, strips and fans unrolled; none for points and lines.
    pub fn triangle_indices(&self, primitive: &Value) -> Vec<[usize; 3]> {
        let indices: Vec<usize> = match maybe_index(&primitive["indices"]) {
            Some(accessor) => self.elements(accessor).iter().map(|i| i[0] as usize).collect(),
            None => (0..self.vertex_count(primitive)).collect(),
        };
        match primitive["mode"].as_u64().unwrap_or(4) {
            4 => indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
            5 => indices
                .windows(3)
                .enumerate()
                .map(|(i, t)| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[0], t[2], t[1]] })
                .collect(),
            6 => indices[1..].windows(2).map(|t| [t[0], t[1], indices[0]]).collect(),
            _ => Vec::new(),
        }
    }

    /// Triangles of a primitive as positions.
    pub fn triangles(&self, primitive: &Value) -> Vec<[[f64; 3]; 3]> {
        let positions = self.elements(index(&primitive["attributes"]["POSITION"]));
        let at = |v: usize| [positions[v][0], positions[v][1], positions[v][2]];
        self.triangle_indices(primitive).into_iter().map(|t| t.map(at)).collect()
    }

    /// Triangles of all primitives of a mesh as positions.
    pub fn mesh_triangles(&self, mesh: usize) -> Vec<[[f64; 3]; 3]> {
        items(&self.list("meshes")[mesh]["primitives"]).iter().flat_map(|p| self.triangles(p)).collect()
    }

    /// Whether this reader can decode all of a mesh: not if it is compressed or its data is missing.
    pub fn is_readable(&self, mesh: usize) -> bool {
        items(&self.list("meshes")[mesh]["primitives"]).iter().all(|primitive| {
            let compressed = ["KHR_draco_mesh_compression"].iter().any(|e| !primitive["extensions"][*e].is_null());
            let used = primitive["attributes"].as_object().into_iter().flat_map(|a| a.values());
            !compressed && used.chain(primitive.get("indices")).all(|accessor| self.has_plain_data(index(accessor)))
        })
    }

    fn has_plain_data(&self, accessor: usize) -> bool {
        let Some(view) = maybe_index(&self.list("accessors")[accessor]["bufferView"]) else { return true };
        let view = &self.list("bufferViews")[view];
        let buffer = &self.buffers[index(&view["buffer"])];
        let compressed =
            ["EXT_meshopt_compression", "KHR_meshopt_compression"].iter().any(|e| !view["extensions"][*e].is_null());
        !compressed && offset_of(view) + index(&view["byteLength"]) <= buffer.len()
    }

    /// Vertices of a primitive.
    pub fn vertex_count(&self, primitive: &Value) -> usize {
        index(&self.list("accessors")[index(&primitive["attributes"]["POSITION"])]["count"])
    }

    fn read_view(&self, view: usize, offset: usize, component: usize, width: usize, count: usize) -> Vec<Vec<f64>> {
        let view = &self.list("bufferViews")[view];
        let size = size_of(component);
        let stride = maybe_index(&view["byteStride"]).unwrap_or(size * width);
        let start = offset_of(view) + offset;
        let bytes = &self.buffers[index(&view["buffer"])];
        let number = |element: usize, k: usize| read_number(&bytes[start + element * stride + k * size..], component);
        (0..count).map(|element| (0..width).map(|k| number(element, k)).collect()).collect()
    }
}

fn split_glb(bytes: &[u8]) -> (Vec<u8>, Vec<Chunk>) {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize;
    assert_eq!(word(4), 2, "GLB version");
    assert_eq!(word(8), bytes.len(), "GLB length");
    let (mut at, mut chunks) = (12, Vec::new());
    while at < bytes.len() {
        let (length, kind) = (word(at), bytes[at + 4..at + 8].try_into().expect("four bytes"));
        chunks.push((kind, bytes[at + 8..at + 8 + length].to_vec()));
        at += 8 + length;
    }
    let json = chunks.remove(0);
    assert_eq!(&json.0, b"JSON");
    (json.1, chunks)
}

fn read_uri(directory: &Path, uri: &str) -> Vec<u8> {
    match uri.strip_prefix("data:") {
        Some(data) => BASE64_STANDARD.decode(data.split_once(";base64,").expect("base64").1).expect("valid base64"),
        None => {
            let name = percent_encoding::percent_decode_str(uri).decode_utf8().expect("UTF-8");
            std::fs::read(directory.join(&*name)).unwrap_or_default()
        }
    }
}

fn offset_of(object: &Value) -> usize {
    maybe_index(&object["byteOffset"]).unwrap_or(0)
}

fn width_of(kind: &Value) -> usize {
    match kind.as_str().expect("a type") {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" => 4,
        "MAT4" => 16,
        other => panic!("no test needs {other}"),
    }
}

fn size_of(component: usize) -> usize {
    match component {
        5120 | 5121 => 1,
        5122 | 5123 => 2,
        _ => 4,
    }
}

fn largest_of(component: usize) -> f64 {
    match component {
        5120 => 127.0,
        5121 => 255.0,
        5122 => 32767.0,
        5123 => 65535.0,
        other => panic!("{other} cannot be normalised"),
    }
}

fn read_number(bytes: &[u8], component: usize) -> f64 {
    let two = || [bytes[0], bytes[1]];
    let four = || [bytes[0], bytes[1], bytes[2], bytes[3]];
    match component {
        5120 => f64::from(bytes[0] as i8),
        5121 => f64::from(bytes[0]),
        5122 => f64::from(i16::from_le_bytes(two())),
        5123 => f64::from(u16::from_le_bytes(two())),
        5125 => f64::from(u32::from_le_bytes(four())),
        5126 => f64::from(f32::from_le_bytes(four())),
        other => panic!("{other} is no component type"),
    }
}
