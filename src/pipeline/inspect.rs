//! What a file holds, read from its document; geometry is not decoded, so that compressed files can be inspected too.

use crate::asset::{Asset, Component, Container, Limits, Scene};
use crate::discover::directory_of;
use crate::error::Result;
use crate::report::{InspectedLevel, InspectedLod, InspectedMesh, InspectedPrimitive, Inspection, relative_name};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// Looks at the asset at `file`.
///
/// # Errors
/// Everything that keeps the file from being read.
pub fn inspect(file: &Path, limits: &Limits) -> Result<Inspection> {
    let asset = Asset::read(file, directory_of(file), limits).map_err(|error| error.in_file(file))?;
    let scene = asset.scene();
    let view = View { asset: &asset, scene: &scene };
    Ok(Inspection {
        file: relative_name(file.file_name().map_or(file, Path::new)),
        container: if asset.container == Container::Gltf { "gltf" } else { "glb" },
        bytes: std::fs::metadata(file).map_or(0, |metadata| metadata.len()),
        extensions: list_strings(asset.document.root().get("extensionsUsed")),
        meshes: (0..asset.document.array("meshes").len()).map(|index| view.inspect_mesh(index)).collect(),
        lods: scene.existing.iter().map(|(node, ids)| view.inspect_lod(*node, ids)).collect(),
        warnings: asset.warnings.iter().map(ToString::to_string).collect(),
    })
}

struct View<'a> {
    asset: &'a Asset,
    scene: &'a Scene,
}

/// Element counts and sizes of some accessors.
#[derive(Debug, Clone, Copy, Default)]
struct Size {
    count: u64,
    bytes: u64,
}

impl View<'_> {
    fn object(&self, array: &str, index: usize) -> &Value {
        self.asset.document.array(array).get(index).unwrap_or(&Value::Null)
    }

    fn inspect_mesh(&self, index: usize) -> InspectedMesh {
        let mesh = self.object("meshes", index);
        InspectedMesh {
            mesh: index,
            name: read_name(mesh),
            nodes: self.scene.uses.get(index).map(|mesh_use| mesh_use.nodes.clone()).unwrap_or_default(),
            primitives: list(mesh.get("primitives"))
                .iter()
                .map(|primitive| self.inspect_primitive(primitive))
                .collect(),
            targets: list(mesh.get("primitives")).first().map_or(0, |primitive| list(primitive.get("targets")).len()),
        }
    }

    fn inspect_primitive(&self, primitive: &Value) -> InspectedPrimitive {
        let (mode, triangles_of) = describe_mode(primitive.get("mode").and_then(Value::as_u64).unwrap_or(4));
        let attributes = primitive.get("attributes").and_then(Value::as_object);
        let vertices = attributes.and_then(|a| a.get("POSITION")).map_or(0, |accessor| self.size(accessor).count);
        let indices = primitive.get("indices").map(|accessor| self.size(accessor));
        let corners = indices.map_or(vertices, |indices| indices.count);
        InspectedPrimitive {
            mode,
            triangles: triangles_of(corners),
            vertices,
            attributes: attributes.map(|a| a.keys().cloned().collect()).unwrap_or_default(),
            material: primitive.get("material").map(|material| self.name_material(material)),
            extensions: primitive
                .get("extensions")
                .and_then(Value::as_object)
                .map(|e| e.keys().cloned().collect())
                .unwrap_or_default(),
            index_bytes: indices.map_or(0, |indices| indices.bytes),
            vertex_bytes: vertex_accessors(primitive).into_iter().map(|accessor| self.size(accessor).bytes).sum(),
        }
    }

    fn name_material(&self, material: &Value) -> String {
        let index = material.as_u64().unwrap_or(0);
        read_name(self.object("materials", index as usize)).unwrap_or_else(|| format!("material {index}"))
    }

    fn size(&self, accessor: &Value) -> Size {
        let accessor = self.object("accessors", read_index(accessor).unwrap_or(usize::MAX));
        let count = accessor.get("count").and_then(Value::as_u64).unwrap_or(0);
        let component = accessor.get("componentType").and_then(Value::as_u64).and_then(Component::from_code);
        let width = match accessor.get("type").and_then(Value::as_str) {
            Some("SCALAR") => 1,
            Some("VEC2") => 2,
            Some("VEC3") => 3,
            Some("VEC4" | "MAT2") => 4,
            Some("MAT3") => 9,
            Some("MAT4") => 16,
            _ => 0,
        };
        Size { count, bytes: count.saturating_mul(width * component.map_or(0, Component::size) as u64) }
    }

    fn inspect_lod(&self, node: usize, ids: &[usize]) -> InspectedLod {
        let value = self.object("nodes", node);
        let extras = value.get("extras");
        let coverage = list(extras.and_then(|extras| extras.get("MSFT_screencoverage")));
        let made_by = extras.and_then(|extras| extras.get("gltf_lod"));
        let errors = list(made_by.and_then(|made_by| made_by.get("levels")));
        let levels = std::iter::once(&node).chain(ids).enumerate().map(|(level, &node)| InspectedLevel {
            coverage: coverage.get(level).and_then(Value::as_f64),
            error: errors.get(level).and_then(|level| level.get("error")?.as_f64()),
            ..self.inspect_level(level, node)
        });
        let levels: Vec<InspectedLevel> = levels.collect();
        let coverage_complete = coverage.len() == levels.len();
        InspectedLod { node, name: read_name(value), levels, coverage_complete, made_by: made_by.cloned() }
    }

    fn inspect_level(&self, level: usize, node: usize) -> InspectedLevel {
        let meshes = self.meshes_below(node);
        let mut found =
            InspectedLevel { level, node, meshes, triangles: 0, vertices: 0, bytes: 0, coverage: None, error: None };
        let mut accessors = BTreeSet::new();
        for &mesh in &found.meshes {
            for primitive in list(self.object("meshes", mesh).get("primitives")) {
                let inspected = self.inspect_primitive(primitive);
                found.triangles = found.triangles.saturating_add(inspected.triangles);
                found.vertices = found.vertices.saturating_add(inspected.vertices);
                accessors.extend(
                    vertex_accessors(primitive).into_iter().chain(primitive.get("indices")).filter_map(Value::as_u64),
                );
            }
        }
        found.bytes =
            accessors.into_iter().map(|accessor| self.size(&accessor.into()).bytes).fold(0, u64::saturating_add);
        found
    }

    /// Meshes of the node and of everything below it, each once.
    fn meshes_below(&self, node: usize) -> Vec<usize> {
        let (mut meshes, mut seen, mut open) = (BTreeSet::new(), BTreeSet::new(), vec![node]);
        while let Some(node) = open.pop() {
            if !seen.insert(node) {
                continue;
            }
            let value = self.object("nodes", node);
            meshes.extend(value.get("mesh").and_then(read_index));
            open.extend(list(value.get("children")).iter().filter_map(read_index));
        }
        meshes.into_iter().collect()
    }
}

/// Attributes and morph targets.
fn vertex_accessors(primitive: &Value) -> Vec<&Value> {
    let attributes = primitive.get("attributes").into_iter().chain(list(primitive.get("targets")));
    attributes.filter_map(Value::as_object).flat_map(serde_json::Map::values).collect()
}

fn describe_mode(mode: u64) -> (&'static str, fn(u64) -> u64) {
    match mode {
        0 => ("points", |_| 0),
        1 => ("lines", |_| 0),
        2 => ("line loop", |_| 0),
        3 => ("line strip", |_| 0),
        4 => ("triangles", |corners| corners / 3),
        5 => ("triangle strip", |corners| corners.saturating_sub(2)),
        6 => ("triangle fan", |corners| corners.saturating_sub(2)),
        _ => ("unknown mode", |_| 0),
    }
}

fn list(value: Option<&Value>) -> &[Value] {
    value.and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

fn list_strings(value: Option<&Value>) -> Vec<String> {
    list(value).iter().filter_map(Value::as_str).map(str::to_owned).collect()
}

fn read_name(value: &Value) -> Option<String> {
    value.get("name").and_then(Value::as_str).map(str::to_owned)
}

fn read_index(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|index| usize::try_from(index).ok())
}
