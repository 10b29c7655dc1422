//! The same kind of surfaces, stored in every way glTF allows.

use super::File;
use super::builder::{Builder, Component, Use};
use super::png::checkerboard;
use super::shape::Shape;
use super::surfaces::{bumpy_sphere, ring_normals, rounded_box, terrain, torus_knot, vase_rings};
use glam::DVec3;
use serde_json::json;

pub fn files() -> Vec<File> {
    let mut files = vec![
        ("storage/non_indexed_facets.glb", non_indexed_facets()),
        ("storage/strip_and_fans.glb", strip_and_fans()),
        ("storage/quantized_interleaved.glb", quantized_interleaved()),
        ("storage/sparse_positions.glb", sparse_positions()),
        ("storage/indices_u8.glb", narrow_indices()),
        ("storage/indices_u32.glb", wide_indices()),
        ("storage/data_uri.gltf", data_uri()),
    ];
    files.extend(external_files());
    files
}

/// No indices, a flat normal for each face: every edge is a hard one.
fn non_indexed_facets() -> Vec<u8> {
    let mut file = Builder::new();
    let shape = bumpy_sphere(30, 15, 0.3, 41).faceted();
    let attributes = json!({
        "POSITION": file.positions(&shape.positions),
        "NORMAL": file.floats(&shape.normals),
        "TEXCOORD_0": file.floats(&shape.uvs),
    });
    file.show("Low-poly rock", json!({"attributes": attributes, "mode": 4}));
    file.glb()
}

/// A closed vase: the wall one triangle strip, foot and lid a fan each, in two materials.
fn strip_and_fans() -> Vec<u8> {
    let mut file = Builder::new();
    let rings = vase_rings(30, 24);
    let columns = rings[0].len();
    let wall = json!({
        "POSITION": file.positions(&rings.concat()),
        "NORMAL": file.floats(&ring_normals(&rings).concat()),
    });
    let wall_indices = file.indices(&wall_strip(rings.len(), columns));
    let clay = file.material("Clay", [0.6, 0.35, 0.2, 1.0]);
    let wood = file.material("Wood", [0.4, 0.25, 0.1, 1.0]);
    let mut primitives = vec![json!({"attributes": wall, "indices": wall_indices, "mode": 5, "material": clay})];
    for (ring, up, material) in [(&rings[0], -1.0, clay), (&rings[rings.len() - 1], 1.0, wood)] {
        let mut rim = ring.clone();
        if up < 0.0 {
            rim.reverse();
        }
        rim.push(rim[0]);
        rim.insert(0, [0.0, rim[0][1], 0.0]);
        let attributes =
            json!({"POSITION": file.positions(&rim), "NORMAL": file.floats(&vec![[0.0, up, 0.0]; rim.len()])});
        primitives.push(json!({"attributes": attributes, "mode": 6, "material": material}));
    }
    let mesh = file.mesh("Vase", &primitives);
    let node = file.push("nodes", json!({"name": "Vase", "mesh": mesh}));
    file.scene(&[node]);
    file.glb()
}

/// One strip around every row of the wall, joined by degenerate triangles.
fn wall_strip(rows: usize, columns: usize) -> Vec<u32> {
    let mut strip = Vec::new();
    for row in 0..rows - 1 {
        let at = |row: usize, column: usize| (row * columns + column % columns) as u32;
        if row > 0 {
            // The last vertex of the row above and the first of this one twice: four triangles without area.
            let last = strip[strip.len() - 1];
            strip.extend([last, at(row + 1, 0)]);
        }
        strip.extend((0..=columns).flat_map(|column| [at(row + 1, column), at(row, column)]));
    }
    strip
}

/// KHR_mesh_quantization: 16-bit positions, 8-bit normals, 16-bit UVs, interleaved in 16 bytes a vertex.
fn quantized_interleaved() -> Vec<u8> {
    const STEPS: f64 = 16_000.0;
    let mut file = Builder::new();
    let shape = rounded_box(DVec3::new(1.0, 0.5, 0.7), 0.25, 10);
    let integers = |p: [f32; 3]| p.map(|x| (f64::from(x) * STEPS).round() as i16);
    let mut bytes = Vec::new();
    for ((&p, n), uv) in shape.positions.iter().zip(&shape.normals).zip(&shape.uvs) {
        integers(p).iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([0; 2]);
        n.iter().for_each(|x| bytes.extend(((f64::from(*x) * 127.0).round() as i8).to_le_bytes()));
        bytes.push(0);
        uv.iter().for_each(|x| bytes.extend(((f64::from(*x) * 65535.0).round() as u16).to_le_bytes()));
    }
    let (view, count) = (file.view(&bytes, Use::Vertices(16)), shape.positions.len());
    let position = file.accessor(view, Component::I16, "VEC3", count);
    let bound = |choose: fn(i16, i16) -> i16| {
        [0, 1, 2].map(|k| shape.positions.iter().map(|&p| integers(p)[k]).reduce(choose).unwrap_or(0))
    };
    file.amend_accessor(position, "min", json!(bound(i16::min)));
    file.amend_accessor(position, "max", json!(bound(i16::max)));
    let normal = file.accessor(view, Component::I8, "VEC3", count);
    let uv = file.accessor(view, Component::U16, "VEC2", count);
    for (accessor, offset) in [(normal, 8), (uv, 12)] {
        file.amend_accessor(accessor, "byteOffset", json!(offset));
        file.amend_accessor(accessor, "normalized", json!(true));
    }
    let indices = file.indices(shape.triangles.as_flattened());
    file.uses("KHR_mesh_quantization");
    file.root()["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let attributes = json!({"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv});
    let mesh = file.mesh("Soap", &[json!({"attributes": attributes, "indices": indices})]);
    let scale = [1.0 / STEPS; 3];
    let node = file.push("nodes", json!({"name": "Soap", "mesh": mesh, "scale": scale}));
    file.scene(&[node]);
    file.glb()
}

/// A flat plate whose hill is a sparse substitution.
fn sparse_positions() -> Vec<u8> {
    let mut file = Builder::new();
    let flat = terrain(28, 0.0, 0);
    let hill = |p: DVec3| p + DVec3::Y * 0.8 * (0.6 - p.x * p.x - p.z * p.z).max(0.0);
    let raised = flat.moved(hill);
    let position = file.positions(&flat.positions);
    let moved: Vec<u16> =
        (0..flat.positions.len()).filter(|&v| flat.positions[v] != raised.positions[v]).map(|v| v as u16).collect();
    let index_bytes: Vec<u8> = moved.iter().flat_map(|v| v.to_le_bytes()).collect();
    let value_bytes: Vec<u8> =
        moved.iter().flat_map(|&v| raised.positions[usize::from(v)]).flat_map(f32::to_le_bytes).collect();
    let (indices, values) = (file.view(&index_bytes, Use::Other), file.view(&value_bytes, Use::Other));
    let sparse = json!({
        "count": moved.len(),
        "indices": {"bufferView": indices, "componentType": 5123},
        "values": {"bufferView": values},
    });
    file.amend_accessor(position, "sparse", sparse);
    let highest = raised.positions.iter().fold(0.0_f32, |h, p| h.max(p[1]));
    file.root()["accessors"][position]["max"][1] = json!(highest);
    let attributes =
        json!({"POSITION": position, "NORMAL": file.floats(&raised.normals), "TEXCOORD_0": file.floats(&raised.uvs)});
    let indices = file.indices(flat.triangles.as_flattened());
    file.show("Hill", json!({"attributes": attributes, "indices": indices}));
    file.glb()
}

fn narrow_indices() -> Vec<u8> {
    with_indices("Pebble", &bumpy_sphere(16, 13, 0.3, 51), Component::U8)
}

/// 32-bit indices although 16 bits would do.
fn wide_indices() -> Vec<u8> {
    with_indices("Cushion", &rounded_box(DVec3::new(1.0, 0.3, 1.0), 0.28, 9), Component::U32)
}

fn with_indices(name: &str, shape: &Shape, component: Component) -> Vec<u8> {
    let mut file = Builder::new();
    let mut primitive = file.primitive(shape);
    let flat = shape.triangles.as_flattened();
    let bytes: Vec<u8> = match component {
        Component::U8 => flat.iter().map(|&i| u8::try_from(i).expect("less than 256 vertices")).collect(),
        _ => flat.iter().flat_map(|i| i.to_le_bytes()).collect(),
    };
    let view = file.view(&bytes, Use::Indices);
    primitive["indices"] = json!(file.accessor(view, component, "SCALAR", flat.len()));
    file.show(name, primitive);
    file.glb()
}

fn data_uri() -> Vec<u8> {
    let mut file = Builder::new();
    let primitive = file.bare_primitive(&torus_knot(8, 60).welded());
    file.show("Embedded knot", primitive);
    file.gltf_with_data_uri()
}

/// Spaces, letters beyond ASCII and a literal `%20` in the names of the file, its buffer and its pictures. URIs name
/// them percent-encoded and as plain Unicode.
fn external_files() -> Vec<File> {
    let mut file = Builder::new();
    let mut primitives = [bumpy_sphere(28, 14, 0.2, 61), bumpy_sphere(20, 10, 0.2, 62).moved(|p| p + DVec3::X * 2.5)]
        .map(|shape| file.primitive(&shape));
    for (primitive, uri) in primitives.iter_mut().zip(["Bilder/K%C3%B6rnung%20%231.png", "Bilder/größe♻.png"]) {
        let image = file.push("images", json!({"uri": uri}));
        primitive["material"] = json!(file.material_of_image("Granit", image));
    }
    let mesh = file.mesh("Zwei Steine", &primitives);
    let node = file.push("nodes", json!({"name": "Zwei Steine", "mesh": mesh}));
    file.scene(&[node]);
    let (text, bin) = file.gltf("Steine%20f%C3%BCr%2520alle.bin");
    vec![
        ("paths/Große Steine/Steine ❤ 1.gltf", text),
        ("paths/Große Steine/Steine für%20alle.bin", bin),
        ("paths/Große Steine/Bilder/Körnung #1.png", checkerboard(16, 8, [90, 90, 90, 255], [140, 138, 130, 255])),
        ("paths/Große Steine/Bilder/größe♻.png", checkerboard(16, 2, [120, 80, 60, 255], [160, 150, 140, 255])),
    ]
}
