//! A glTF file under construction: JSON lists, one binary buffer, and what packs them.

use super::shape::Shape;
use serde_json::{Value, json};

/// glTF component types.
#[derive(Clone, Copy)]
pub enum Component {
    I8 = 5120,
    U8 = 5121,
    I16 = 5122,
    U16 = 5123,
    U32 = 5125,
    F32 = 5126,
}

/// What a buffer view is for.
#[derive(Clone, Copy)]
pub enum Use {
    /// Vertex attributes with this stride.
    Vertices(usize),
    Indices,
    /// Animation data, matrices, images, sparse parts.
    Other,
}

/// A glTF file under construction. Lists grow by [`Builder::push`]; binary data goes into one buffer.
pub struct Builder {
    root: Value,
    bin: Vec<u8>,
}

impl Builder {
    pub fn new() -> Self {
        let asset = json!({"version": "2.0", "generator": "gltf-lod make_fixtures", "copyright": "CC0-1.0"});
        Self { root: json!({"asset": asset, "scene": 0}), bin: Vec::new() }
    }

    /// A file that shows `shape` with all its attributes, under one node.
    pub fn showing(name: &str, shape: &Shape) -> Self {
        let mut file = Self::new();
        let primitive = file.primitive(shape);
        file.show(name, primitive);
        file
    }

    /// Adds a mesh of one primitive, a node for it and the scene.
    pub fn show(&mut self, name: &str, primitive: Value) {
        let mesh = self.mesh(name, &[primitive]);
        let node = self.push("nodes", json!({"name": name, "mesh": mesh}));
        self.scene(&[node]);
    }

    /// Appends to a top-level list and returns the index.
    pub fn push(&mut self, list: &str, value: Value) -> usize {
        let list = &mut self.root[list];
        if list.is_null() {
            *list = json!([]);
        }
        let list = list.as_array_mut().expect("top-level lists are arrays");
        list.push(value);
        list.len() - 1
    }

    /// The document, for members that no method makes.
    pub fn root(&mut self) -> &mut Value {
        &mut self.root
    }

    /// Names `extension` in `extensionsUsed`.
    pub fn uses(&mut self, extension: &str) {
        self.push("extensionsUsed", json!(extension));
    }

    /// Adds data to the buffer, aligned to 4 bytes.
    pub fn view(&mut self, bytes: &[u8], usage: Use) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()});
        match usage {
            Use::Vertices(stride) => {
                view["byteStride"] = json!(stride);
                view["target"] = json!(34962);
            }
            Use::Indices => view["target"] = json!(34963),
            Use::Other => {}
        }
        self.bin.extend(bytes);
        self.push("bufferViews", view)
    }

    /// An accessor over a whole view.
    pub fn accessor(&mut self, view: usize, component: Component, kind: &str, count: usize) -> usize {
        let accessor = json!({"bufferView": view, "componentType": component as u32, "type": kind, "count": count});
        self.push("accessors", accessor)
    }

    /// Changes an accessor that is there already.
    pub fn amend_accessor(&mut self, accessor: usize, member: &str, value: Value) {
        self.root["accessors"][accessor][member] = value;
    }

    /// Float vertex attribute.
    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let view = self.view(&float_bytes(values), Use::Vertices(4 * N));
        self.accessor(view, Component::F32, kind_of(N), values.len())
    }

    /// Float vertex attribute with `min` and `max`, as POSITION must have.
    pub fn positions(&mut self, values: &[[f32; 3]]) -> usize {
        let accessor = self.floats(values);
        self.bound(accessor, values);
        accessor
    }

    /// Floats for animations and skins: times (with bounds), keyframe values, matrices.
    pub fn keys<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let view = self.view(&float_bytes(values), Use::Other);
        let accessor = self.accessor(view, Component::F32, kind_of(N), values.len());
        if N == 1 {
            self.bound(accessor, values);
        }
        accessor
    }

    /// Triangle indices, 16 bits wide.
    pub fn indices(&mut self, indices: &[u32]) -> usize {
        let narrow = |&i: &u32| u16::try_from(i).expect("fixtures are small").to_le_bytes();
        let view = self.view(&indices.iter().flat_map(narrow).collect::<Vec<u8>>(), Use::Indices);
        self.accessor(view, Component::U16, "SCALAR", indices.len())
    }

    /// An indexed triangle primitive with positions, normals and UVs.
    pub fn primitive(&mut self, shape: &Shape) -> Value {
        let mut primitive = self.bare_primitive(shape);
        primitive["attributes"]["NORMAL"] = json!(self.floats(&shape.normals));
        primitive["attributes"]["TEXCOORD_0"] = json!(self.floats(&shape.uvs));
        primitive
    }

    /// An indexed triangle primitive with positions only.
    pub fn bare_primitive(&mut self, shape: &Shape) -> Value {
        let position = self.positions(&shape.positions);
        let indices = self.indices(shape.triangles.as_flattened());
        json!({"attributes": {"POSITION": position}, "indices": indices})
    }

    pub fn mesh(&mut self, name: &str, primitives: &[Value]) -> usize {
        self.push("meshes", json!({"name": name, "primitives": primitives}))
    }

    pub fn scene(&mut self, nodes: &[usize]) {
        self.push("scenes", json!({"name": "Scene", "nodes": nodes}));
    }

    /// A rough, non-metallic material.
    pub fn material(&mut self, name: &str, color: [f64; 4]) -> usize {
        let pbr = json!({"baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": 0.8});
        self.push("materials", json!({"name": name, "pbrMetallicRoughness": pbr}))
    }

    /// A material with an embedded picture as its base colour.
    pub fn textured_material(&mut self, name: &str, png: &[u8]) -> usize {
        let view = self.view(png, Use::Other);
        let image = self.push("images", json!({"name": name, "mimeType": "image/png", "bufferView": view}));
        self.material_of_image(name, image)
    }

    /// A material with `images[image]` as its base colour.
    pub fn material_of_image(&mut self, name: &str, image: usize) -> usize {
        let texture = self.push("textures", json!({"source": image}));
        let pbr = json!({"baseColorTexture": {"index": texture}, "metallicFactor": 0.0, "roughnessFactor": 0.9});
        self.push("materials", json!({"name": name, "pbrMetallicRoughness": pbr}))
    }

    /// An animation that moves `path` of `node` through `values` at `times` (seconds).
    pub fn animate<const N: usize>(&mut self, name: &str, node: usize, path: &str, times: &[f32], values: &[[f32; N]]) {
        let input = self.keys(&times.iter().map(|&t| [t]).collect::<Vec<_>>());
        let output = self.keys(values);
        let animation = json!({
            "name": name,
            "samplers": [{"input": input, "interpolation": "LINEAR", "output": output}],
            "channels": [{"sampler": 0, "target": {"node": node, "path": path}}],
        });
        self.push("animations", animation);
    }

    /// The file as GLB.
    pub fn glb(mut self) -> Vec<u8> {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.root["buffers"] = json!([{"byteLength": self.bin.len()}]);
        let mut text = self.root.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let word = |n: usize| u32::try_from(n).expect("fixtures are small").to_le_bytes();
        [
            b"glTF".as_slice(),
            &word(2),
            &word(12 + 8 + text.len() + 8 + self.bin.len()),
            &word(text.len()),
            b"JSON",
            &text,
            &word(self.bin.len()),
            b"BIN\0",
            &self.bin,
        ]
        .concat()
    }

    /// The file as glTF text and the bytes of its buffer, which it names `uri`.
    pub fn gltf(mut self, uri: &str) -> (Vec<u8>, Vec<u8>) {
        self.root["buffers"] = json!([{"uri": uri, "byteLength": self.bin.len()}]);
        (pretty(&self.root), self.bin)
    }

    /// The file as glTF text with its buffer inside.
    pub fn gltf_with_data_uri(mut self) -> Vec<u8> {
        use base64::{Engine, prelude::BASE64_STANDARD};
        let uri = format!("data:application/octet-stream;base64,{}", BASE64_STANDARD.encode(&self.bin));
        self.root["buffers"] = json!([{"uri": uri, "byteLength": self.bin.len()}]);
        pretty(&self.root)
    }

    fn bound<const N: usize>(&mut self, accessor: usize, values: &[[f32; N]]) {
        let pick = |choose: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..N).map(|k| values.iter().map(|v| v[k]).reduce(choose).expect("no accessor is empty")).collect()
        };
        let (min, max) = (pick(f32::min), pick(f32::max));
        self.amend_accessor(accessor, "min", json!(min));
        self.amend_accessor(accessor, "max", json!(max));
    }
}

fn pretty(root: &Value) -> Vec<u8> {
    let mut text = serde_json::to_vec_pretty(root).expect("a JSON value is always writable");
    text.push(b'\n');
    text
}

fn float_bytes<const N: usize>(values: &[[f32; N]]) -> Vec<u8> {
    values.iter().flatten().flat_map(|x| x.to_le_bytes()).collect()
}

fn kind_of(width: usize) -> &'static str {
    match width {
        1 => "SCALAR",
        2 => "VEC2",
        3 => "VEC3",
        4 => "VEC4",
        _ => "MAT4",
    }
}
