//! What a glTF file holds: meshes, primitives, and the levels it carries already.

use super::text::{add_row, count, indent, significant, start_table};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write;

/// A file's meshes and levels.
#[derive(Debug, Clone, Serialize)]
pub struct Inspection {
    /// The file's name.
    pub file: String,
    /// `glb` or `gltf`.
    pub container: &'static str,
    /// Bytes of the file itself.
    pub bytes: u64,
    /// `extensionsUsed`.
    pub extensions: Vec<String>,
    /// Its meshes.
    pub meshes: Vec<InspectedMesh>,
    /// Nodes with `MSFT_lod`.
    pub lods: Vec<InspectedLod>,
    /// What is odd about it.
    pub warnings: Vec<String>,
}

/// A mesh.
#[derive(Debug, Clone, Serialize)]
pub struct InspectedMesh {
    /// Index into `meshes`.
    pub mesh: usize,
    /// Its name.
    pub name: Option<String>,
    /// Nodes that draw it.
    pub nodes: Vec<usize>,
    /// Its primitives.
    pub primitives: Vec<InspectedPrimitive>,
    /// Morph targets.
    pub targets: usize,
}

/// A primitive.
#[derive(Debug, Clone, Default, Serialize)]
pub struct InspectedPrimitive {
    /// `triangles`, `triangle strip`, `points`, …
    pub mode: &'static str,
    /// Triangles; 0 for points and lines.
    pub triangles: u64,
    /// Vertices.
    pub vertices: u64,
    /// Attribute names.
    pub attributes: Vec<String>,
    /// Name of its material, or its index.
    pub material: Option<String>,
    /// Extensions of the primitive.
    pub extensions: Vec<String>,
    /// Bytes of its indices, decoded.
    pub index_bytes: u64,
    /// Bytes of its vertex data, morph targets included, decoded.
    pub vertex_bytes: u64,
}

/// A node with levels.
#[derive(Debug, Clone, Serialize)]
pub struct InspectedLod {
    /// Its index.
    pub node: usize,
    /// Its name.
    pub name: Option<String>,
    /// LOD0 and all lower levels.
    pub levels: Vec<InspectedLevel>,
    /// Whether `MSFT_screencoverage` is there with one number for each level.
    pub coverage_complete: bool,
    /// What gltf-lod noted about them: `extras.gltf_lod`.
    pub made_by: Option<Value>,
}

/// One level of a node.
#[derive(Debug, Clone, Serialize)]
pub struct InspectedLevel {
    /// 0 for the node itself.
    pub level: usize,
    /// Its node.
    pub node: usize,
    /// The meshes below that node, itself included.
    pub meshes: Vec<usize>,
    /// Triangles of those.
    pub triangles: u64,
    /// Vertices of those.
    pub vertices: u64,
    /// Bytes of index and vertex data, each accessor once.
    pub bytes: u64,
    /// Coverage at which it ends.
    pub coverage: Option<f64>,
    /// Largest distance from LOD0 that `extras.gltf_lod` states, object units.
    pub error: Option<f64>,
}

/// The inspection for people.
pub fn describe_inspection(inspection: &Inspection) -> String {
    let mut text = format!("{}: {}, {} bytes\n", inspection.file, inspection.container, inspection.bytes);
    if !inspection.extensions.is_empty() {
        _ = writeln!(text, "extensions: {}", inspection.extensions.join(", "));
    }
    for mesh in &inspection.meshes {
        text += &describe_mesh(mesh);
    }
    for lod in &inspection.lods {
        text += &describe_lod(lod);
    }
    if inspection.lods.is_empty() {
        text += "no levels of detail\n";
    }
    for warning in &inspection.warnings {
        _ = writeln!(text, "warning: {warning}");
    }
    text
}

fn describe_mesh(mesh: &InspectedMesh) -> String {
    let name = mesh.name.as_ref().map(|name| format!(" \"{name}\"")).unwrap_or_default();
    let users = count(mesh.nodes.len(), "node", "nodes");
    let targets = if mesh.targets > 0 {
        format!(", {}", count(mesh.targets, "morph target", "morph targets"))
    } else {
        String::new()
    };
    let mut table = start_table(&["triangles", "vertices", "index bytes", "vertex bytes", "what"]);
    for primitive in &mesh.primitives {
        let material = primitive.material.as_ref().map(|name| format!(", {name}")).unwrap_or_default();
        let extensions: String = primitive.extensions.iter().map(|name| format!(", {name}")).collect();
        let cells = [primitive.triangles, primitive.vertices, primitive.index_bytes, primitive.vertex_bytes];
        let mut cells: Vec<String> = cells.iter().map(u64::to_string).collect();
        cells.push(format!("{}{material}{extensions}: {}", primitive.mode, primitive.attributes.join(" ")));
        add_row(&mut table, &cells);
    }
    format!("mesh {}{name}, {users}{targets}\n{}", mesh.mesh, indent(&table))
}

fn describe_lod(lod: &InspectedLod) -> String {
    let name = lod.name.as_ref().map(|name| format!(" \"{name}\"")).unwrap_or_default();
    let mut table =
        start_table(&["level", "triangles", "vertices", "bytes", "error units", "drawn down to coverage", ""]);
    for level in &lod.levels {
        let or_dash = |value: Option<f64>| value.map_or("-".to_owned(), significant);
        let cells = [level.level as u64, level.triangles, level.vertices, level.bytes].map(|number| number.to_string());
        let rest = [or_dash(level.error), or_dash(level.coverage), format!("node {}", level.node)];
        add_row(&mut table, &[&cells[..], &rest[..]].concat());
    }
    let oddity = if lod.coverage_complete { "" } else { ", without a coverage for each level" };
    format!("levels of node {}{name}{oddity}\n{}", lod.node, indent(&table))
}
