//! Small glTF assets made in code, written to a directory and read back as any other.

use crate::asset::{Asset, Container, Limits};
use crate::emit::{Existing, Layout, LodLevel, MeshLods, Options, Output, emit, round_to_storage, verify, write};
use crate::mesh::Mesh;
use serde_json::{Value, json};
use std::path::Path;
use tempfile::TempDir;

/// How an asset is packed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Form {
    Glb,
    Embedded,
    External,
}

/// An asset in the making.
pub struct Sketch {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl Sketch {
    /// One scene and nothing in it.
    pub fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
            "accessors": [], "bufferViews": [], "buffers": [{"byteLength": 0}],
        });
        Self { json, bin: Vec::new() }
    }

    pub fn push(&mut self, array: &str, element: Value) -> usize {
        let object = self.json.as_object_mut().unwrap();
        let list = object.entry(array).or_insert_with(|| json!([])).as_array_mut().unwrap();
        list.push(element);
        list.len() - 1
    }

    /// A node that is a root of the scene.
    pub fn root(&mut self, node: Value) -> usize {
        let index = self.push("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(index.into());
        index
    }

    /// An accessor of tightly packed elements; `extra` adds members such as `min`.
    pub fn accessor(&mut self, bytes: &[u8], component: u32, count: usize, shape: &str, extra: Value) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()});
        self.bin.extend_from_slice(bytes);
        let view = self.push("bufferViews", view);
        let mut json = json!({"bufferView": view, "componentType": component, "count": count, "type": shape});
        json.as_object_mut().unwrap().extend(extra.as_object().cloned().unwrap_or_default());
        self.push("accessors", json)
    }

    pub fn floats(&mut self, values: &[f32], width: usize, extra: Value) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        let shape = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][width];
        self.accessor(&bytes, 5126, values.len() / width, shape, extra)
    }

    /// A bumpy grid of 2·side² triangles as a primitive with POSITION and NORMAL.
    pub fn grid(&mut self, side: usize) -> Value {
        let n = side + 1;
        let height = |x: usize, y: usize| ((x * 7 + y * 3) % 5) as f32 * 0.1;
        let positions: Vec<f32> =
            (0..n * n).flat_map(|i| [(i % n) as f32, (i / n) as f32, height(i % n, i / n)]).collect();
        let normals: Vec<f32> = (0..n * n).flat_map(|_| [0.0, 0.0, 1.0]).collect();
        let mut indices: Vec<u16> = Vec::new();
        for corner in (0..side * n).filter(|i| i % n < side).map(|i| i as u16) {
            let above = corner + n as u16;
            indices.extend([corner, corner + 1, above, above, corner + 1, above + 1]);
        }
        let bounds = json!({"min": [0, 0, 0], "max": [side, side, 0.4]});
        let position = self.floats(&positions, 3, bounds);
        let normal = self.floats(&normals, 3, json!({}));
        let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let indices = self.accessor(&bytes, 5123, indices.len(), "SCALAR", json!({}));
        json!({"attributes": {"POSITION": position, "NORMAL": normal}, "indices": indices})
    }

    /// A mesh of one grid.
    pub fn grid_mesh(&mut self, name: &str) -> usize {
        let primitive = self.grid(4);
        self.push("meshes", json!({"name": name, "primitives": [primitive]}))
    }

    /// A mesh of one grid with two morph targets.
    pub fn morph_mesh(&mut self) -> usize {
        let mut primitive = self.grid(4);
        let targets: Vec<Value> = [0.5f32, -0.25]
            .into_iter()
            .map(|z| {
                let deltas: Vec<f32> = (0..25).flat_map(|i| [0.0, 0.0, z * i as f32]).collect();
                let bounds = json!({"min": [0, 0, (z * 24.0).min(0.0)], "max": [0, 0, (z * 24.0).max(0.0)]});
                json!({"POSITION": self.floats(&deltas, 3, bounds)})
            })
            .collect();
        primitive["targets"] = json!(targets);
        let extras = json!({"targetNames": ["up", "down"]});
        self.push("meshes", json!({"name": "face", "primitives": [primitive], "weights": [0.25, 0], "extras": extras}))
    }

    /// Lets all vertices of the mesh's first primitive hang on joint 0 of a new skin with that one joint.
    pub fn skin(&mut self, mesh: usize, joint: usize) -> usize {
        let joints = self.accessor(&[0; 100], 5121, 25, "VEC4", json!({}));
        let weights: Vec<u8> = (0..25).flat_map(|_| [255, 0, 0, 0]).collect();
        let weights = self.accessor(&weights, 5121, 25, "VEC4", json!({"normalized": true}));
        let attributes = &mut self.json["meshes"][mesh]["primitives"][0]["attributes"];
        attributes["JOINTS_0"] = json!(joints);
        attributes["WEIGHTS_0"] = json!(weights);
        self.push("skins", json!({"joints": [joint]}))
    }

    /// An animation of one channel with two keys.
    pub fn animate(&mut self, target: Value, values: &[f32], width: usize) -> usize {
        let input = self.floats(&[0.0, 1.0], 1, json!({"min": [0], "max": [1]}));
        let output = self.floats(values, width, json!({}));
        let channel = json!({"sampler": 0, "target": target});
        self.push("animations", json!({"channels": [channel], "samplers": [{"input": input, "output": output}]}))
    }

    pub fn animate_weights(&mut self, node: usize) -> usize {
        self.animate(json!({"node": node, "path": "weights"}), &[0.0, 1.0, 1.0, 0.0], 1)
    }

    /// Writes the asset into `directory` and reads it.
    pub fn read(mut self, directory: &Path, name: &str, form: Form) -> Asset {
        let path = directory.join(name);
        self.json["buffers"][0]["byteLength"] = self.bin.len().into();
        let bytes = match form {
            Form::Glb => {
                let others = vec![crate::asset::Chunk { kind: *b"TEST", data: vec![1, 2, 3, 4], before_bin: false }];
                Container::Glb { others }.pack(self.json.to_string().as_bytes(), Some(&self.bin)).unwrap()
            }
            Form::Embedded => {
                use base64::Engine;
                let data = base64::engine::general_purpose::STANDARD.encode(&self.bin);
                self.json["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{data}").into();
                serde_json::to_vec_pretty(&self.json).unwrap()
            }
            Form::External => {
                std::fs::write(directory.join("my data.bin"), &self.bin).unwrap();
                self.json["buffers"][0]["uri"] = "my%20data.bin".into();
                self.json.to_string().into_bytes()
            }
        };
        std::fs::write(&path, bytes).unwrap();
        Asset::read(&path, directory, &Limits::default()).unwrap()
    }
}

/// Options as the presets' defaults are.
pub fn options() -> Options {
    Options { layout: Layout::Append, naming: "{name}_LOD{level}".into(), existing: Existing::Keep }
}

/// Stands in for the simplifier: level i keeps every 2ⁱ-th triangle.
pub fn fake_lods(asset: &Asset, mesh: usize, levels: usize) -> MeshLods {
    let geometry = asset.geometry(mesh, &Limits::default()).unwrap();
    let thin = |level: usize| {
        let keep = |t: &usize| t.is_multiple_of(1 << level);
        let kept: Vec<usize> = (0..geometry.mesh.triangles.len()).filter(keep).collect();
        let mut mesh = Mesh {
            triangles: kept.iter().map(|&t| geometry.mesh.triangles[t]).collect(),
            groups: kept.iter().map(|&t| geometry.mesh.group(t)).collect(),
            ..geometry.mesh.clone()
        };
        round_to_storage(&mut mesh, &geometry);
        LodLevel { mesh, source_vertices: None }
    };
    MeshLods {
        mesh,
        levels: (1..=levels).map(thin).collect(),
        coverage: (1..=levels).map(|level| 0.5f64.powi(level as i32)).chain([0.0]).collect(),
        extras: json!({"basis": "height"}),
        geometry,
    }
}

/// An asset with levels, read back from the disk.
pub struct Built {
    pub source: Asset,
    pub output: Output,
    pub written: Asset,
    _directory: TempDir,
}

impl Built {
    /// Two levels for every mesh; checks the result against the source in memory and on the disk.
    pub fn of(sketch: Sketch, form: Form, options: &Options) -> Self {
        let directory = TempDir::new().unwrap();
        let name = if form == Form::Glb { "asset.glb" } else { "my asset.gltf" };
        let source = sketch.read(directory.path(), name, form);
        Self::build(source, directory, options)
    }

    pub fn build(source: Asset, directory: TempDir, options: &Options) -> Self {
        let meshes = source.document.array("meshes").len();
        let lods: Vec<MeshLods> = (0..meshes).map(|mesh| fake_lods(&source, mesh, 2)).collect();
        let output = emit(&source, &lods, options).unwrap();
        verify::check_output(&source, &output).unwrap();
        let out = directory.path().join("out");
        write(&output, &out).unwrap();
        let path = out.join(source.path.file_name().unwrap());
        let written = Asset::read(&path, &out, &Limits::default()).unwrap();
        verify::check(&source, &written).unwrap();
        Self { source, output, written, _directory: directory }
    }

    pub fn root(&self) -> &Value {
        self.written.document.root()
    }

    /// The value at a JSON pointer of the result; null when absent.
    pub fn at(&self, place: &str) -> Value {
        self.root().pointer(place).cloned().unwrap_or_default()
    }

    pub fn ids(&self, node: usize) -> Vec<usize> {
        let ids = self.at(&format!("/nodes/{node}/extensions/MSFT_lod/ids"));
        ids.as_array().map(|ids| ids.iter().map(|id| id.as_u64().unwrap() as usize).collect()).unwrap_or_default()
    }
}

pub fn build(sketch: Sketch) -> Built {
    Built::of(sketch, Form::Glb, &options())
}
