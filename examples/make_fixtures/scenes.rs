//! Arrangements of nodes that decide where MSFT_lod may stand, and things that must come through untouched.

use super::File;
use super::builder::{Builder, Component, Use};
use super::portable::{cos_sin, random};
use super::shape::Shape;
use super::surfaces::{bumpy_sphere, gear, head, rounded_box, torus_knot};
use glam::DVec3;
use serde_json::{Value, json};

pub fn files() -> Vec<File> {
    vec![
        ("nodes/children_and_camera.glb", children_and_camera()),
        ("nodes/animated_transform.glb", animated_transform()),
        ("nodes/shared_mesh.glb", shared_mesh()),
        ("nodes/gpu_instancing.glb", gpu_instancing()),
        ("nodes/points_and_lines.glb", points_and_lines()),
        ("passthrough/unknown_extensions.gltf", unknown_extensions()),
    ]
}

fn add_mesh(file: &mut Builder, name: &str, shape: &Shape) -> usize {
    let primitive = file.primitive(shape);
    file.mesh(name, &[primitive])
}

/// A node with a mesh, a camera and children of its own: they must stay when its mesh changes level.
fn children_and_camera() -> Vec<u8> {
    let mut file = Builder::new();
    let body = add_mesh(&mut file, "Body", &rounded_box(DVec3::new(1.2, 0.5, 0.7), 0.2, 10));
    let turret = add_mesh(&mut file, "Turret", &bumpy_sphere(28, 14, 0.1, 71));
    let camera = file.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}));
    let child = file.push(
        "nodes",
        json!({"name": "Turret", "mesh": turret, "translation": [0.2, 0.8, 0.0], "scale": [0.4, 0.4, 0.4]}),
    );
    let (w, y) = cos_sin(1.0 / 16.0);
    let root = json!({
        "name": "Tank", "mesh": body, "camera": camera, "children": [child], "rotation": [0.0, y, 0.0, w],
        "extras": {"crew": 3},
    });
    let root = file.push("nodes", root);
    file.scene(&[root]);
    file.glb()
}

fn animated_transform() -> Vec<u8> {
    let mut file = Builder::new();
    let mesh = add_mesh(&mut file, "Wheel", &gear(12));
    let node = file.push("nodes", json!({"name": "Wheel", "mesh": mesh, "translation": [0.0, 1.0, 0.0]}));
    file.scene(&[node]);
    let turns: Vec<[f32; 4]> = [0.0, 0.25, 0.5, 0.75, 1.0]
        .map(|turn| cos_sin(turn / 2.0))
        .map(|(w, z)| [0.0, 0.0, z as f32, w as f32])
        .to_vec();
    file.animate("spin", node, "rotation", &[0.0, 1.0, 2.0, 3.0, 4.0], &turns);
    file.glb()
}

/// Five nodes draw one mesh; each needs level nodes of its own, all share the level meshes. One uses a matrix.
fn shared_mesh() -> Vec<u8> {
    let mut file = Builder::new();
    let mesh = add_mesh(&mut file, "Column", &torus_knot(10, 72));
    let mut nodes: Vec<usize> = (0..4)
        .map(|k| file.push("nodes", json!({"name": format!("Column.{k}"), "mesh": mesh, "translation": [7 * k, 0, 0]})))
        .collect();
    let matrix = [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 12, 1];
    nodes.push(file.push("nodes", json!({"mesh": mesh, "matrix": matrix})));
    file.scene(&nodes);
    file.glb()
}

fn gpu_instancing() -> Vec<u8> {
    const COUNT: u32 = 24;
    let mut file = Builder::new();
    let mesh = add_mesh(&mut file, "Rock", &bumpy_sphere(30, 15, 0.35, 81));
    let place = |k: u32| [k % 6, k / 6].map(|i| i as f32 * 3.0);
    let translations: Vec<[f32; 3]> = (0..COUNT).map(|k| [place(k)[0], 0.0, place(k)[1]]).collect();
    let rotations: Vec<[f32; 4]> =
        (0..COUNT).map(|k| cos_sin(random(k, 5) / 2.0)).map(|(w, y)| [0.0, y as f32, 0.0, w as f32]).collect();
    let scales: Vec<[f32; 3]> = (0..COUNT).map(|k| [(0.5 + random(k, 6)) as f32; 3]).collect();
    let attributes = json!({
        "TRANSLATION": file.keys(&translations), "ROTATION": file.keys(&rotations), "SCALE": file.keys(&scales),
    });
    file.uses("EXT_mesh_gpu_instancing");
    let extensions = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
    let node = file.push("nodes", json!({"name": "Rocks", "mesh": mesh, "extensions": extensions}));
    file.scene(&[node]);
    file.glb()
}

/// A buoy with its outline as lines and its lights as points, in one mesh.
fn points_and_lines() -> Vec<u8> {
    let mut file = Builder::new();
    let triangles = file.primitive(&bumpy_sphere(32, 16, 0.1, 91));
    let ring: Vec<[f32; 3]> =
        (0..48).map(|k| cos_sin(f64::from(k) / 48.0)).map(|(c, s)| [1.3 * c as f32, 0.0, 1.3 * s as f32]).collect();
    let lights: Vec<[f32; 3]> = (0..6).map(|k| [0.0, 1.2 + 0.1 * k as f32, 0.0]).collect();
    let loop_of_lines = json!({"attributes": {"POSITION": file.positions(&ring)}, "mode": 2});
    let points = json!({"attributes": {"POSITION": file.positions(&lights)}, "mode": 0});
    let mesh = file.mesh("Buoy", &[loop_of_lines, triangles, points]);
    let node = file.push("nodes", json!({"name": "Buoy", "mesh": mesh}));
    file.scene(&[node]);
    file.glb()
}

/// Unknown extensions, extras and members that look like ours wherever glTF has room; indices hidden in them must
/// stay right. A number that needs all its digits, and an `extras` that is no object.
fn unknown_extensions() -> Vec<u8> {
    let mut file = Builder::new();
    let mut primitive = file.primitive(&head(28, 20));
    let material = file.material("Plaster", [0.8, 0.78, 0.75, 1.0]);
    primitive["material"] = json!(material);
    let ids: Vec<u8> = (0..4).collect();
    let view = file.view(&ids, Use::Other);
    let spare = file.accessor(view, Component::U8, "SCALAR", ids.len());
    let mesh = file.mesh("Bust", &[primitive]);
    let bust = file.push("nodes", json!({"name": "Bust", "mesh": mesh}));
    let twin =
        file.push("nodes", json!({"name": "Twin", "mesh": mesh, "translation": [3, 0, 0], "extras": "a string"}));
    let anchor = file.push("nodes", json!({"name": "Anchor"}));
    file.scene(&[bust, twin, anchor]);
    file.animate("lift", anchor, "translation", &[0.0, 1.0], &[[0.0; 3], [0.0, 1.0, 0.0]]);
    file.uses("FB_unknown_gadget");
    let gadget = json!({"FB_unknown_gadget": {
        "node": bust, "mesh": mesh, "accessor": spare, "pointer": "/nodes/1/mesh",
        "exact": 0.30000000000000004, "large": 9_007_199_254_740_993_u64, "nested": [null, true, {"": []}],
    }});
    let extras = json!({"note": "Größe ❤ \"quoted\" \\ / \u{1}", "ids": [1, 2, 3]});
    mark(file.root(), &gadget, &extras);
    file.gltf_with_data_uri()
}

/// Adds both members to every object that may have them.
fn mark(root: &mut Value, extensions: &Value, extras: &Value) {
    let places = [
        "",
        "/asset",
        "/scenes/0",
        "/nodes/0",
        "/nodes/2",
        "/meshes/0",
        "/meshes/0/primitives/0",
        "/materials/0",
        "/materials/0/pbrMetallicRoughness",
        "/accessors/0",
        "/bufferViews/0",
        "/animations/0",
        "/animations/0/channels/0",
        "/animations/0/channels/0/target",
        "/animations/0/samplers/0",
    ];
    for place in places {
        let object = root.pointer_mut(place).expect("all places exist");
        object["extensions"] = extensions.clone();
        object["extras"] = extras.clone();
    }
}
