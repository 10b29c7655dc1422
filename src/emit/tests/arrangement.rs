//! One test for each arrangement of nodes that loaders ask for.

use super::sketch::{Built, Form, Sketch, build, options};
use crate::emit::Existing;
use serde_json::json;

#[test]
fn a_plain_node_carries_its_levels_itself() {
    let mut sketch = Sketch::new();
    let mesh = sketch.grid_mesh("chair");
    let node = json!({"name": "Seat", "mesh": mesh, "translation": [1, 2, 3], "extras": {"note": "mine"}});
    sketch.root(node.clone());
    let built = build(sketch);
    assert_eq!(built.at("/nodes/0/mesh"), 0);
    assert_eq!(built.ids(0), [1, 2]);
    assert_eq!(built.at("/nodes/1"), json!({"name": "Seat_LOD1", "mesh": 1, "translation": [1, 2, 3]}));
    assert_eq!(built.at("/nodes/2"), json!({"name": "Seat_LOD2", "mesh": 2, "translation": [1, 2, 3]}));
    assert_eq!(
        built.at("/nodes/0/extras"),
        json!({"note": "mine", "MSFT_screencoverage": [0.5, 0.25, 0.0], "gltf_lod": {"basis": "height"}})
    );
    assert_eq!(built.at("/meshes/1/name"), "chair_LOD1");
    assert_eq!(built.at("/extensionsUsed"), json!(["MSFT_lod"]));
    assert_eq!(built.at("/scenes/0/nodes"), json!([0]));
    assert_eq!(built.output.notes, [""; 0]);
}

#[test]
fn nodes_that_share_a_mesh_share_its_levels_but_no_level_node() {
    let mut sketch = Sketch::new();
    let mesh = sketch.grid_mesh("lamp");
    for _ in 0..3 {
        sketch.root(json!({"mesh": mesh}));
    }
    let built = build(sketch);
    assert_eq!([built.ids(0), built.ids(1), built.ids(2)], [[3, 4], [5, 6], [7, 8]]);
    for (node, (mesh, name)) in [(3, (1, "lamp_LOD1")), (5, (1, "lamp_LOD1_2")), (8, (2, "lamp_LOD2_3"))] {
        assert_eq!(built.at(&format!("/nodes/{node}")), json!({"name": name, "mesh": mesh}));
    }
    assert_eq!(built.at("/meshes").as_array().unwrap().len(), 3);
}

/// Adds a node with the mesh and returns it.
type Make<'a> = &'a dyn Fn(&mut Sketch, usize) -> usize;

#[test]
fn what_else_hangs_on_a_node_moves_the_mesh_to_a_leaf() {
    let with_child = |sketch: &mut Sketch, mesh| {
        let child = sketch.push("nodes", json!({"name": "child"}));
        sketch.root(json!({"name": "N", "mesh": mesh, "children": [child], "translation": [1, 0, 0]}))
    };
    let with_camera = |sketch: &mut Sketch, mesh| {
        sketch.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}));
        sketch.root(json!({"name": "N", "mesh": mesh, "camera": 0}))
    };
    let with_light = |sketch: &mut Sketch, mesh| {
        sketch.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
        sketch.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point"}]}});
        sketch.root(json!({"name": "N", "mesh": mesh, "extensions": {"KHR_lights_punctual": {"light": 0}}}))
    };
    let moving = |sketch: &mut Sketch, mesh| {
        let node = sketch.root(json!({"name": "N", "mesh": mesh}));
        sketch.animate(json!({"node": node, "path": "translation"}), &[0.0; 6], 3);
        node
    };
    let joint = |sketch: &mut Sketch, mesh| {
        let node = sketch.root(json!({"name": "N", "mesh": mesh}));
        sketch.push("skins", json!({"joints": [node]}));
        node
    };
    let pointed_at = |sketch: &mut Sketch, mesh| {
        let node = sketch.root(json!({"name": "N", "mesh": mesh}));
        sketch.json["extensionsUsed"] = json!(["KHR_animation_pointer"]);
        let pointer = json!({"KHR_animation_pointer": {"pointer": format!("/nodes/{node}/rotation")}});
        sketch.animate(json!({"path": "pointer", "extensions": pointer}), &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], 4);
        node
    };
    let cases: [Make; 6] = [&with_child, &with_camera, &with_light, &moving, &joint, &pointed_at];
    for (case, make) in cases.iter().enumerate() {
        let mut sketch = Sketch::new();
        let mesh = sketch.grid_mesh("m");
        let node = make(&mut sketch, mesh);
        let before = sketch.json["nodes"].as_array().unwrap().len();
        let children = sketch.json["nodes"][node]["children"].as_array().map_or(0, Vec::len);
        let built = build(sketch);
        assert_eq!(built.at(&format!("/nodes/{node}/mesh")), json!(null), "case {case}");
        assert_eq!(built.at(&format!("/nodes/{node}/children/{children}")), json!(before), "case {case}");
        assert_eq!(built.at(&format!("/nodes/{before}/name")), "N_LOD0");
        assert_eq!(built.at(&format!("/nodes/{before}/mesh")), 0);
        assert_eq!(built.at(&format!("/nodes/{before}/translation")), json!(null));
        assert_eq!(built.ids(before), [before + 1, before + 2]);
        assert_eq!(built.at(&format!("/nodes/{}", before + 1)), json!({"name": "N_LOD1", "mesh": 1}));
    }
}

#[test]
fn skinned_levels_name_the_same_skin_and_a_skinned_leaf_is_not_split() {
    let mut sketch = Sketch::new();
    let mesh = sketch.grid_mesh("body");
    let joint = sketch.root(json!({"name": "hip"}));
    let skin = sketch.skin(mesh, joint);
    let node = sketch.root(json!({"name": "Body", "mesh": mesh, "skin": skin}));
    sketch.animate(json!({"node": node, "path": "translation"}), &[0.0; 6], 3);
    let built = build(sketch);
    assert_eq!(built.ids(1), [2, 3]);
    assert_eq!(built.at("/nodes/2"), json!({"name": "Body_LOD1", "mesh": 1, "skin": 0}));
    let attributes = built.at("/meshes/1/primitives/0/attributes");
    let accessor = |name: &str| built.at(&format!("/accessors/{}", attributes[name]));
    assert_eq!(accessor("JOINTS_0")["componentType"], 5121);
    assert_eq!(accessor("WEIGHTS_0")["normalized"], true);
}

#[test]
fn a_skinned_root_with_children_gets_its_leaf_beside_it() {
    let mut sketch = Sketch::new();
    let mesh = sketch.grid_mesh("body");
    let joint = sketch.push("nodes", json!({"name": "hip"}));
    let skin = sketch.skin(mesh, joint);
    sketch.root(json!({"name": "Body", "mesh": mesh, "skin": skin, "children": [joint]}));
    let built = build(sketch);
    assert_eq!(built.at("/scenes/0/nodes"), json!([1, 2]));
    assert_eq!(built.at("/nodes/1"), json!({"name": "Body", "children": [0]}));
    assert_eq!(built.at("/nodes/2/skin"), 0);
    assert_eq!(built.ids(2), [3, 4]);
}

#[test]
fn animated_weights_put_a_switch_above_and_reach_every_level() {
    let mut sketch = Sketch::new();
    let mesh = sketch.morph_mesh();
    let group = sketch.root(json!({"name": "head"}));
    let node = sketch.push("nodes", json!({"name": "Face", "mesh": mesh, "weights": [0, 1], "translation": [0, 1, 0]}));
    sketch.json["nodes"][group]["children"] = json!([node]);
    sketch.animate_weights(node);
    let built = build(sketch);
    assert_eq!(built.at("/nodes/0/children"), json!([2]));
    assert_eq!(built.at("/nodes/1"), json!({"name": "Face", "mesh": 0, "weights": [0, 1], "translation": [0, 1, 0]}));
    assert_eq!(built.at("/nodes/2/children"), json!([1]));
    assert_eq!(built.at("/nodes/2/mesh"), json!(null));
    assert_eq!(built.ids(2), [4, 6]);
    let level = json!({"name": "Face_LOD1_mesh", "mesh": 1, "weights": [0, 1], "translation": [0, 1, 0]});
    assert_eq!(built.at("/nodes/3"), level);
    assert_eq!(built.at("/nodes/4"), json!({"name": "Face_LOD1", "children": [3]}));
    let targets: Vec<_> = built
        .at("/animations/0/channels")
        .as_array()
        .unwrap()
        .iter()
        .map(|c| (c["sampler"].clone(), c["target"].clone()))
        .collect();
    let weights = |node: usize| (json!(0), json!({"node": node, "path": "weights"}));
    assert_eq!(targets, [weights(1), weights(3), weights(5)]);
    assert_eq!(built.at("/meshes/1/weights"), json!([0.25, 0]));
    assert_eq!(built.at("/meshes/2/extras"), json!({"targetNames": ["up", "down"]}));
    assert_eq!(built.at("/meshes/2/primitives/0/targets").as_array().unwrap().len(), 2);
}

#[test]
fn a_moving_morphing_node_keeps_its_transform_and_hands_its_weights_over() {
    let mut sketch = Sketch::new();
    let mesh = sketch.morph_mesh();
    let node = sketch.root(json!({"name": "Face", "mesh": mesh}));
    sketch.animate(json!({"node": node, "path": "scale"}), &[1.0; 6], 3);
    sketch.animate_weights(node);
    let built = build(sketch);
    // 0 moves · 1 draws · 2 switches · 3, 4 are the levels.
    assert_eq!(built.at("/nodes/0"), json!({"name": "Face", "children": [2]}));
    assert_eq!(built.at("/nodes/1"), json!({"name": "Face_LOD0", "mesh": 0}));
    assert_eq!(built.at("/nodes/2/children"), json!([1]));
    assert_eq!(built.ids(2), [3, 4]);
    assert_eq!(built.at("/animations/0/channels/0/target/node"), 0);
    let targets = [0, 1, 2].map(|c| built.at(&format!("/animations/1/channels/{c}/target/node")));
    assert_eq!(targets, [json!(1), json!(3), json!(4)]);
}

#[test]
fn skinned_and_morphing_at_once_is_said_to_have_no_good_arrangement() {
    let mut sketch = Sketch::new();
    let mesh = sketch.morph_mesh();
    let joint = sketch.root(json!({"name": "hip"}));
    let skin = sketch.skin(mesh, joint);
    let node = sketch.root(json!({"mesh": mesh, "skin": skin}));
    sketch.animate_weights(node);
    let built = build(sketch);
    assert_eq!(built.ids(node), [2, 3]);
    assert_eq!(built.at("/animations/0/channels").as_array().unwrap().len(), 3);
    assert!(
        built.output.notes[0].starts_with("/nodes/1: skinned with animated morph weights"),
        "{:?}",
        built.output.notes
    );
}

#[test]
fn pointers_to_weights_of_nodes_and_meshes_are_followed() {
    let mut sketch = Sketch::new();
    let mesh = sketch.morph_mesh();
    let node = sketch.root(json!({"mesh": mesh, "camera": 0}));
    sketch.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}));
    sketch.json["extensionsUsed"] = json!(["KHR_animation_pointer"]);
    let aim =
        |pointer: String| json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}});
    sketch.animate(aim(format!("/nodes/{node}/weights")), &[0.0; 4], 1);
    sketch.animate(aim(format!("/meshes/{mesh}/weights/1")), &[0.0; 2], 1);
    let built = build(sketch);
    let pointer = |a: usize, c: usize| {
        built.at(&format!("/animations/{a}/channels/{c}/target/extensions/KHR_animation_pointer/pointer"))
    };
    assert_eq!([0, 1, 2].map(|c| pointer(0, c)), ["/nodes/1/weights", "/nodes/3/weights", "/nodes/4/weights"]);
    assert_eq!([0, 1, 2].map(|c| pointer(1, c)), ["/meshes/0/weights/1", "/meshes/1/weights/1", "/meshes/2/weights/1"]);
}

#[test]
fn instances_go_to_every_level_and_with_the_mesh() {
    for child in [false, true] {
        let mut sketch = Sketch::new();
        let mesh = sketch.grid_mesh("grass");
        let places = sketch.floats(&[0.0, 0.0, 0.0, 9.0, 0.0, 0.0], 3, json!({}));
        let instancing = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}});
        sketch.json["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
        let node = sketch.root(json!({"name": "Field", "mesh": mesh, "extensions": instancing}));
        if child {
            let below = sketch.push("nodes", json!({}));
            sketch.json["nodes"][node]["children"] = json!([below]);
        }
        let built = build(sketch);
        let carrier = if child { 2 } else { 0 };
        for id in built.ids(carrier) {
            assert_eq!(built.at(&format!("/nodes/{id}/extensions")), instancing);
        }
        assert_eq!(
            built.at(&format!("/nodes/{carrier}/extensions/EXT_mesh_gpu_instancing")),
            instancing["EXT_mesh_gpu_instancing"]
        );
        assert_eq!(built.at("/nodes/0/extensions").is_null(), child);
        assert_eq!(built.at("/extensionsUsed"), json!(["EXT_mesh_gpu_instancing", "MSFT_lod"]));
    }
}

#[test]
fn extras_that_are_no_object_stay_and_leave_no_place_for_coverage() {
    let mut sketch = Sketch::new();
    let mesh = sketch.grid_mesh("m");
    sketch.root(json!({"mesh": mesh, "extras": "text"}));
    let built = build(sketch);
    assert_eq!(built.at("/nodes/0/extras"), "text");
    assert_eq!(built.ids(0), [1, 2]);
    assert!(built.output.notes[0].contains("extras is not an object"));
}

/// Node 0 has levels of its own, below it is node 1; node 3 has none. Node 2 is the level of node 0.
fn with_levels() -> Sketch {
    let mut sketch = Sketch::new();
    let meshes = ["a", "a_low", "b", "c"].map(|name| sketch.grid_mesh(name));
    sketch.json["extensionsUsed"] = json!(["MSFT_lod"]);
    let lod = json!({"MSFT_lod": {"ids": [2]}});
    let extras = json!({"MSFT_screencoverage": [0.5, 0.1], "mine": 1});
    sketch.root(json!({"name": "a", "mesh": meshes[0], "children": [1], "extensions": lod, "extras": extras}));
    sketch.push("nodes", json!({"name": "b", "mesh": meshes[2]}));
    sketch.push("nodes", json!({"name": "a_LOD1", "mesh": meshes[1]}));
    sketch.root(json!({"name": "c", "mesh": meshes[3]}));
    sketch
}

#[test]
fn levels_of_the_source_are_kept_and_never_nested() {
    let built = Built::of(with_levels(), Form::Glb, &options());
    assert_eq!(built.at("/nodes/0"), built.source.document.array("nodes")[0]);
    assert_eq!(built.at("/nodes/1"), built.source.document.array("nodes")[1]);
    assert_eq!(built.at("/nodes/2"), built.source.document.array("nodes")[2]);
    assert_eq!(built.ids(3), [4, 5]);
    assert_eq!(built.output.notes.len(), 3, "{:?}", built.output.notes);
}

#[test]
fn levels_of_the_source_are_replaced_on_demand_and_said_to_be() {
    let built = Built::of(with_levels(), Form::Glb, &crate::emit::Options { existing: Existing::Replace, ..options() });
    // Node 0 has a child: its mesh and its levels are on a leaf now.
    assert_eq!(built.at("/nodes/0"), json!({"name": "a", "children": [1, 4], "extras": {"mine": 1}}));
    assert_eq!(built.ids(4), [5, 6]);
    assert_eq!(built.ids(1).len(), 2);
    assert_eq!(built.ids(2), [0; 0]);
    assert!(built.output.notes.iter().any(|n| n.starts_with("/nodes/0: levels of the source are replaced")));
}

#[test]
fn levels_of_the_source_can_be_refused() {
    let directory = tempfile::tempdir().unwrap();
    let source = with_levels().read(directory.path(), "a.glb", Form::Glb);
    let error =
        crate::emit::emit(&source, &[], &crate::emit::Options { existing: Existing::Refuse, ..options() }).unwrap_err();
    assert_eq!(error.place.as_deref(), Some("/nodes/0/extensions/MSFT_lod"));
}
