//! Meshes that move: skins with four and eight influences, morph targets, both at once.

use super::File;
use super::builder::{Builder, Component, Use};
use super::portable::cos_sin;
use super::shape::{Shape, from_f32, to_f32};
use super::surfaces::{cylinder, head};
use glam::DVec3;
use serde_json::{Value, json};

pub fn files() -> Vec<File> {
    vec![
        ("skinned/bending_cylinder.glb", bending_cylinder()),
        ("skinned/tentacle_eight_influences.glb", tentacle()),
        ("skinned/skin_and_morph.glb", skin_and_morph()),
        ("morph/talking_head.glb", talking_head()),
        ("morph/sparse_targets.glb", sparse_targets()),
    ]
}

/// Four influences: 8-bit joints, float weights.
fn bending_cylinder() -> Vec<u8> {
    let mut file = Builder::new();
    let (primitive, joints) = arm(&mut file);
    let mesh = file.mesh("Arm", &[primitive]);
    show_skinned(&mut file, mesh, &joints);
    bend(&mut file, joints[1]);
    file.glb()
}

/// Eight influences in two sets; weights are normalised bytes that sum to 255 exactly.
fn tentacle() -> Vec<u8> {
    const JOINTS: usize = 12;
    const LENGTH: f64 = 4.0;
    let mut file = Builder::new();
    let shape = cylinder(18, 44, LENGTH, |v| 0.05 + 0.4 * (1.0 - v));
    let mut primitive = file.primitive(&shape);
    let influences = shape.per_vertex(|p| eight_influences(p.y / LENGTH * (JOINTS - 1) as f64, JOINTS));
    for set in 0..2 {
        let part = |pick: fn(&Influences) -> &[u8; 8]| -> Vec<u8> {
            influences.iter().flat_map(|i| pick(i)[4 * set..4 * set + 4].to_vec()).collect()
        };
        let (joints, weights) = (part(|i| &i.joints), part(|i| &i.weights));
        primitive["attributes"][format!("JOINTS_{set}")] = json!(bytes_of_four(&mut file, &joints, false));
        primitive["attributes"][format!("WEIGHTS_{set}")] = json!(bytes_of_four(&mut file, &weights, true));
    }
    let joints = joint_chain(&mut file, JOINTS, LENGTH / (JOINTS - 1) as f64);
    let mesh = file.mesh("Tentacle", &[primitive]);
    show_skinned(&mut file, mesh, &joints);
    bend(&mut file, joints[5]);
    file.glb()
}

/// Eight joints of a vertex and their weights, in 255ths.
struct Influences {
    joints: [u8; 8],
    weights: [u8; 8],
}

/// Weights of a smooth falloff around `at` on the chain, largest first.
fn eight_influences(at: f64, joints: usize) -> Influences {
    let first = (at.floor() as usize).saturating_sub(3).min(joints - 8);
    let falloff = |k: usize| {
        let x = (1.0 - ((first + k) as f64 - at).abs() / 4.5).max(0.0);
        x * x
    };
    let sum: f64 = (0..8).map(falloff).sum();
    let mut pairs: Vec<(u8, u8)> =
        (0..8).map(|k| ((first + k) as u8, (255.0 * falloff(k) / sum).floor() as u8)).collect();
    pairs.sort_by_key(|&(joint, weight)| (std::cmp::Reverse(weight), joint));
    let total: u8 = pairs.iter().map(|p| p.1).sum();
    pairs[0].1 += 255 - total;
    let pick = |k: usize| if pairs[k].1 == 0 { 0 } else { pairs[k].0 };
    Influences { joints: std::array::from_fn(pick), weights: std::array::from_fn(|k| pairs[k].1) }
}

/// Animated joints and animated morph weights on one node.
fn skin_and_morph() -> Vec<u8> {
    let mut file = Builder::new();
    let (mut primitive, joints) = arm(&mut file);
    let shape = arm_shape();
    let swollen = shape.moved(|p| p * DVec3::new(1.3, 1.0, 1.3));
    primitive["targets"] = json!([target(&mut file, &shape, &swollen)]);
    let mesh = file.mesh("Arm", &[primitive]);
    file.root()["meshes"][mesh]["weights"] = json!([0.25]);
    let node = show_skinned(&mut file, mesh, &joints);
    bend(&mut file, joints[1]);
    file.animate("flex", node, "weights", &[0.0, 1.0, 2.0], &[[0.0], [1.0], [0.0]]);
    file.glb()
}

/// Three targets with normals, one of them with names, driven by an animation.
fn talking_head() -> Vec<u8> {
    let mut file = Builder::new();
    let shape = head(40, 28);
    let mut primitive = file.primitive(&shape);
    let poses: [fn(DVec3) -> DVec3; 3] = [
        |p| if p.y < -0.3 && p.z > 0.0 { p + DVec3::new(0.0, 0.25 * (p.y + 0.3), 0.0) } else { p },
        |p| p * DVec3::new(1.15, 0.95, 1.05),
        |p| if p.y > 0.0 { p + DVec3::Y * 0.3 * p.y * p.y } else { p },
    ];
    primitive["targets"] = poses.iter().map(|pose| target(&mut file, &shape, &shape.moved(pose))).collect();
    let mesh = file.mesh("Head", &[primitive]);
    file.root()["meshes"][mesh]["weights"] = json!([0.0, 0.0, 0.5]);
    file.root()["meshes"][mesh]["extras"] = json!({"targetNames": ["jaw", "puff", "brow"]});
    let node = file.push("nodes", json!({"name": "Head", "mesh": mesh, "weights": [0.1, 0.0, 0.5]}));
    file.scene(&[node]);
    let weights: Vec<[f32; 1]> = [0.0, 0.0, 0.5, 1.0, 0.2, 0.5, 0.0, 0.6, 0.5].map(|w| [w]).to_vec();
    file.animate("talk", node, "weights", &[0.0, 0.5, 1.0], &weights);
    file.glb()
}

/// Targets in sparse accessors without a buffer view: only the moved vertices are stored.
fn sparse_targets() -> Vec<u8> {
    let mut file = Builder::new();
    let shape = head(32, 24);
    let mut primitive = file.primitive(&shape);
    let nose = |p: DVec3| if p.z > 0.9 { p + DVec3::Z * 2.0 * (p.z - 0.9) } else { p };
    let crown = |p: DVec3| if p.y > 0.8 { p + DVec3::Y * (p.y - 0.8) } else { p };
    let targets = [sparse_target(&mut file, &shape, nose), sparse_target(&mut file, &shape, crown)];
    primitive["targets"] = json!(targets.map(|position| json!({"POSITION": position})));
    let mesh = file.mesh("Jester", &[primitive]);
    file.root()["meshes"][mesh]["weights"] = json!([0.5, 0.0]);
    let node = file.push("nodes", json!({"name": "Jester", "mesh": mesh}));
    file.scene(&[node]);
    file.glb()
}

fn sparse_target(file: &mut Builder, shape: &Shape, pose: impl Fn(DVec3) -> DVec3) -> usize {
    let moves = shape.per_vertex(|p| to_f32(pose(p) - p));
    let moved: Vec<u16> = (0..moves.len() as u16).filter(|&v| moves[usize::from(v)] != [0.0; 3]).collect();
    let index_bytes: Vec<u8> = moved.iter().flat_map(|v| v.to_le_bytes()).collect();
    let value_bytes: Vec<u8> =
        moved.iter().flat_map(|&v| moves[usize::from(v)]).flat_map(|x: f32| x.to_le_bytes()).collect();
    let (indices, values) = (file.view(&index_bytes, Use::Other), file.view(&value_bytes, Use::Other));
    let bound = |choose: fn(f32, f32) -> f32| [0, 1, 2].map(|k| moves.iter().fold(0.0, |b, m| choose(b, m[k])));
    file.push(
        "accessors",
        json!({
            "componentType": 5126, "type": "VEC3", "count": moves.len(), "min": bound(f32::min), "max": bound(f32::max),
            "sparse": {
                "count": moved.len(),
                "indices": {"bufferView": indices, "componentType": 5123},
                "values": {"bufferView": values},
            },
        }),
    )
}

/// A dense morph target from `rest` to `pose`.
fn target(file: &mut Builder, rest: &Shape, pose: &Shape) -> Value {
    let difference = |from: &[[f32; 3]], to: &[[f32; 3]]| -> Vec<[f32; 3]> {
        from.iter().zip(to).map(|(&a, &b)| to_f32(from_f32(b) - from_f32(a))).collect()
    };
    let position = file.positions(&difference(&rest.positions, &pose.positions));
    let normal = file.floats(&difference(&rest.normals, &pose.normals));
    json!({"POSITION": position, "NORMAL": normal})
}

fn arm_shape() -> Shape {
    cylinder(20, 32, 3.0, |v| 0.4 + 0.12 * cos_sin(1.5 * v).0)
}

/// An arm with three joints, each vertex between two of them.
fn arm(file: &mut Builder) -> (Value, Vec<usize>) {
    let shape = arm_shape();
    let mut primitive = file.primitive(&shape);
    let lower = |p: DVec3| p.y.clamp(0.0, 1.999).floor();
    let joints = shape.per_vertex(|p| [lower(p) as u8, lower(p) as u8 + 1, 0, 0]);
    let weights = shape.per_vertex(|p| {
        let x = (p.y - lower(p)).clamp(0.0, 1.0);
        let upper = (x * x * (3.0 - 2.0 * x)) as f32;
        [1.0 - upper, upper, 0.0, 0.0]
    });
    // A joint without weight must be 0.
    let joints: Vec<u8> = joints
        .iter()
        .zip(&weights)
        .flat_map(|(j, w)| [0, 1, 2, 3].map(|k| if w[k] > 0.0 { j[k] } else { 0 }))
        .collect();
    primitive["attributes"]["JOINTS_0"] = json!(bytes_of_four(file, &joints, false));
    primitive["attributes"]["WEIGHTS_0"] = json!(file.floats(&weights));
    (primitive, joint_chain(file, 3, 1.0))
}

fn bytes_of_four(file: &mut Builder, bytes: &[u8], normalized: bool) -> usize {
    let view = file.view(bytes, Use::Vertices(4));
    let accessor = file.accessor(view, Component::U8, "VEC4", bytes.len() / 4);
    if normalized {
        file.amend_accessor(accessor, "normalized", json!(true));
    }
    accessor
}

/// Joints along +y, each the child of the one before.
fn joint_chain(file: &mut Builder, count: usize, spacing: f64) -> Vec<usize> {
    let joints: Vec<usize> = (0..count).map(|k| file.push("nodes", json!({"name": format!("joint_{k}")}))).collect();
    for pair in joints.windows(2) {
        file.root()["nodes"][pair[0]]["children"] = json!([pair[1]]);
        file.root()["nodes"][pair[1]]["translation"] = json!([0.0, spacing, 0.0]);
    }
    let matrices: Vec<[f32; 16]> = (0..count)
        .map(|k| {
            let mut matrix = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
            matrix[13] = (-(k as f64) * spacing) as f32 + 0.0;
            matrix
        })
        .collect();
    let matrices = file.keys(&matrices);
    file.push(
        "skins",
        json!({"name": "Rig", "joints": joints, "skeleton": joints[0], "inverseBindMatrices": matrices}),
    );
    joints
}

fn show_skinned(file: &mut Builder, mesh: usize, joints: &[usize]) -> usize {
    let name = file.root()["meshes"][mesh]["name"].clone();
    let node = file.push("nodes", json!({"name": name, "mesh": mesh, "skin": 0}));
    file.scene(&[node, joints[0]]);
    node
}

/// Turns a joint by a sixth of a turn and back.
fn bend(file: &mut Builder, joint: usize) {
    let (w, z) = cos_sin(1.0 / 12.0);
    let bent = [0.0, 0.0, z as f32, w as f32];
    file.animate("bend", joint, "rotation", &[0.0, 1.0, 2.0], &[[0.0, 0.0, 0.0, 1.0], bent, [0.0, 0.0, 0.0, 1.0]]);
}
