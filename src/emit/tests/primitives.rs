//! What level primitives take over, and how numbers are stored.

use super::sketch::{Built, Form, Sketch, build, fake_lods, options};
use crate::asset::{AttributeLayout, Channel, Component, Geometry, Limits, PrimitiveLayout, Shape};
use crate::emit::round_to_storage;
use crate::mesh::{Attribute, Mesh, Semantic, Skin};
use proptest::prelude::*;
use serde_json::json;

#[test]
fn promises_about_the_source_triangles_stay_with_them() {
    let mut sketch = Sketch::new();
    let mut primitive = sketch.grid(4);
    let variants = json!({"mappings": [{"variants": [0], "material": 0}]});
    primitive["material"] = json!(0);
    primitive["mode"] = json!(4);
    primitive["extras"] = json!({"tag": 1});
    primitive["extensions"] = json!({
        "KHR_materials_variants": variants,
        "FB_ngon_encoding": {},
        "EXT_mesh_manifold": {},
        "EXT_structural_metadata": {"propertyTextures": [0], "propertyAttributes": [0]},
        "EXT_mesh_features": {"featureIds": [{"featureCount": 2, "attribute": 0}]},
        "XY_unknown": {"kept": true},
    });
    let mut implicit = primitive.clone();
    implicit["extensions"] =
        json!({"EXT_mesh_features": {"featureIds": [{"featureCount": 25}]}, "FB_ngon_encoding": {}});
    sketch.push("materials", json!({}));
    let mesh = sketch.push("meshes", json!({"primitives": [primitive, implicit]}));
    sketch.root(json!({"mesh": mesh}));
    let built = build(sketch);
    assert_eq!(
        built.at("/meshes/1/primitives/0/extensions"),
        json!({
            "KHR_materials_variants": variants,
            "EXT_structural_metadata": {"propertyTextures": [0]},
            "EXT_mesh_features": {"featureIds": [{"featureCount": 2, "attribute": 0}]},
            "XY_unknown": {"kept": true},
        })
    );
    assert_eq!(built.at("/meshes/1/primitives/0/extras"), json!({"tag": 1}));
    assert_eq!(built.at("/meshes/1/primitives/0/material"), 0);
    assert_eq!(built.at("/meshes/1/primitives/1/extensions"), json!(null));
}

#[test]
fn points_are_carried_and_empty_primitives_left_out() {
    let mut sketch = Sketch::new();
    let grid = sketch.grid(4);
    let small = sketch.grid(1);
    let points = json!({"attributes": {"POSITION": grid["attributes"]["POSITION"]}, "mode": 0});
    let mesh = sketch.push("meshes", json!({"primitives": [grid, points, small]}));
    sketch.root(json!({"mesh": mesh}));
    let directory = tempfile::tempdir().unwrap();
    let source = sketch.read(directory.path(), "a.glb", Form::Glb);
    let mut lods = fake_lods(&source, 0, 1);
    let level = &mut lods.levels[0].mesh;
    let kept: Vec<usize> = (0..level.triangles.len()).filter(|&t| level.group(t) == 0).collect();
    level.triangles = kept.iter().map(|&t| level.triangles[t]).collect();
    level.groups = vec![0; kept.len()];
    let output = crate::emit::emit(&source, &[lods], &options()).unwrap();
    crate::emit::verify::check_output(&source, &output).unwrap();
    crate::emit::write(&output, &directory.path().join("out")).unwrap();
    let written = crate::asset::Asset::read(&directory.path().join("out/a.glb"), directory.path(), &Limits::default());
    let primitives = written.unwrap().document.array("meshes")[1]["primitives"].clone();
    assert_eq!(primitives.as_array().unwrap().len(), 2);
    assert_eq!(primitives[1], json!({"attributes": {"POSITION": 0}, "mode": 0}));
}

#[test]
fn quantised_attributes_come_back_exactly_as_they_were_rounded() {
    let mut sketch = Sketch::new();
    let mut primitive = sketch.grid(4);
    let positions: Vec<u8> =
        (0..25i16).flat_map(|i| [i % 5 * 1000, i / 5 * 1000 - 2000, i * 7, 0]).flat_map(i16::to_le_bytes).collect();
    let position =
        sketch.accessor(&positions, 5122, 25, "VEC3", json!({"min": [0, -2000, 0], "max": [4000, 2000, 168]}));
    let view = sketch.json["accessors"][position]["bufferView"].as_u64().unwrap() as usize;
    sketch.json["bufferViews"][view]["byteStride"] = json!(8);
    let normals: Vec<u8> = (0..25).flat_map(|_| [73u8, 73, 73, 0]).collect();
    let normal = sketch.accessor(&normals, 5120, 25, "VEC3", json!({"normalized": true}));
    let view = sketch.json["accessors"][normal]["bufferView"].as_u64().unwrap() as usize;
    sketch.json["bufferViews"][view]["byteStride"] = json!(4);
    let uvs: Vec<u8> = (0..25u16).flat_map(|i| [i * 2621, 65535 - i]).flat_map(u16::to_le_bytes).collect();
    let uv = sketch.accessor(&uvs, 5123, 25, "VEC2", json!({"normalized": true}));
    primitive["attributes"] = json!({"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv});
    sketch.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    sketch.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let mesh = sketch.push("meshes", json!({"primitives": [primitive]}));
    sketch.root(json!({"mesh": mesh}));
    let built = build(sketch);

    let source = built.source.geometry(0, &Limits::default()).unwrap();
    let level = built.written.geometry(1, &Limits::default()).unwrap();
    assert_eq!(level.primitives[0].attributes, source.primitives[0].attributes);
    let tuple = |mesh: &Mesh, v: u32| -> Vec<u32> {
        let of = |a: &Attribute| a.values[v as usize * a.width..][..a.width].to_vec();
        let values = mesh.positions[v as usize].into_iter().chain(mesh.attributes.iter().flat_map(of));
        values.map(f32::to_bits).collect()
    };
    let corners = |mesh: &Mesh| {
        let mut corners: Vec<_> = mesh.triangles.iter().flatten().map(|&v| tuple(mesh, v)).collect();
        corners.sort();
        corners
    };
    let every_second = fake_lods(&built.source, 0, 1).levels.remove(0).mesh;
    assert_eq!(corners(&level.mesh), corners(&every_second));
    assert_eq!(built.at("/accessors/6/min").to_string(), "[0,-2000,0]");
    let views = built.written.document.array("bufferViews");
    assert!(views[6..].iter().all(|view| view["byteOffset"].as_u64().unwrap() % 4 == 0));
}

fn layout(name: &str, component: Component, normalized: bool, shape: Shape, channel: Channel) -> AttributeLayout {
    AttributeLayout { name: name.into(), component, normalized, shape, channel }
}

/// One triangle in each of as many groups as there are layouts.
fn geometry(layouts: Vec<Vec<AttributeLayout>>) -> Geometry {
    let primitive = |(primitive, attributes): (usize, Vec<AttributeLayout>)| {
        let first = 3 * primitive as u32;
        PrimitiveLayout { primitive, vertices: first..first + 3, elements: None, attributes, targets: Vec::new() }
    };
    Geometry {
        mesh: Mesh::default(),
        primitives: layouts.into_iter().enumerate().map(primitive).collect(),
        passed_over: Vec::new(),
        warnings: Vec::new(),
    }
}

fn triangles(groups: u32) -> Mesh {
    Mesh {
        positions: (0..groups).flat_map(|_| [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).collect(),
        triangles: (0..groups).map(|g| [3 * g, 3 * g + 1, 3 * g + 2]).collect(),
        groups: (0..groups).collect(),
        ..Mesh::default()
    }
}

#[test]
fn groups_whose_positions_are_stored_differently_stay_closed() {
    let position = |component| vec![layout("POSITION", component, false, Shape::Vec3, Channel::Position)];
    let mut mesh = triangles(2);
    mesh.positions[1] = [10.4, 0.0, 0.0];
    mesh.positions[4] = [10.4, 0.0, 0.0];
    let mut same = mesh.clone();
    round_to_storage(&mut same, &geometry(vec![position(Component::I16), position(Component::I16)]));
    assert_eq!([same.positions[1][0], same.positions[4][0]], [10.0, 10.0]);
    let mut mixed = mesh.clone();
    round_to_storage(&mut mixed, &geometry(vec![position(Component::I16), position(Component::F32)]));
    assert_eq!(mixed, mesh);
}

#[test]
fn vanished_normals_and_tangents_take_the_direction_of_their_faces() {
    let attribute = |semantic, width| Attribute { semantic, width, values: vec![0.0; 3 * width] };
    let mut mesh = triangles(1);
    mesh.attributes = vec![attribute(Semantic::Normal, 3), attribute(Semantic::Tangent, 4)];
    mesh.attributes[0].values[..3].copy_from_slice(&[0.0, 3.0, 4.0]);
    let layouts = vec![
        layout("NORMAL", Component::F32, false, Shape::Vec3, Channel::Attribute(0)),
        layout("TANGENT", Component::F32, false, Shape::Vec4, Channel::Attribute(1)),
    ];
    round_to_storage(&mut mesh, &geometry(vec![layouts]));
    assert_eq!(mesh.attributes[0].values, [0.0, 0.6, 0.8, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let tangent = glam::Vec4::from_slice(&mesh.attributes[1].values);
    assert_eq!((tangent.truncate().length(), tangent.z, tangent.w), (1.0, 0.0, 1.0));
}

#[test]
fn colours_stay_within_what_gltf_and_the_source_allow() {
    let colours = |values: [f32; 3]| Attribute { semantic: Semantic::Color(0), width: 3, values: values.repeat(3) };
    let layout = layout("COLOR_0", Component::F32, false, Shape::Vec3, Channel::Attribute(0));
    let mut geometry = geometry(vec![vec![layout]]);
    geometry.mesh = Mesh { attributes: vec![colours([0.5, 4.0, 0.0])], ..triangles(1) };
    let mut mesh = Mesh { attributes: vec![colours([-0.25, 3.0, 5.0])], ..triangles(1) };
    round_to_storage(&mut mesh, &geometry);
    assert_eq!(mesh.attributes[0].values[..3], [0.0, 3.0, 4.0]);
}

fn skinned(component: Component, joints: Vec<u16>, weights: Vec<f32>) -> (Mesh, Geometry) {
    let sets = joints.len() / 4;
    let mut mesh = triangles(1);
    let three = |values: &[f32]| values.repeat(3);
    mesh.skin = Some(Skin { influences: 4 * sets, joints: joints.repeat(3), weights: three(&weights) });
    let layouts = (0..sets).flat_map(|set| {
        let joints = layout(&format!("JOINTS_{set}"), Component::U16, false, Shape::Vec4, Channel::Joints(set));
        let weights = layout(&format!("WEIGHTS_{set}"), component, true, Shape::Vec4, Channel::Weights(set));
        [joints, weights]
    });
    (mesh, geometry(vec![layouts.collect()]))
}

#[test]
fn equal_joints_merge_and_weightless_ones_clear() {
    let (mut mesh, geometry) = skinned(Component::U8, vec![5, 7, 5, 9], vec![0.3, 0.4, 0.3, 0.0]);
    round_to_storage(&mut mesh, &geometry);
    let skin = mesh.skin.unwrap();
    assert_eq!(skin.joints[..4], [5, 7, 0, 0]);
    assert_eq!(skin.weights[..4], [153.0 / 255.0, 102.0 / 255.0, 0.0, 0.0]);
}

proptest! {
    #[test]
    fn integer_weights_sum_to_exactly_one(raw in prop::collection::vec(0.0f32..1.0, 8), wide: bool) {
        prop_assume!(raw.iter().sum::<f32>() > 0.1);
        let (component, steps) = if wide { (Component::U16, 65535.0) } else { (Component::U8, 255.0) };
        let (mut mesh, geometry) = skinned(component, (1..=8).collect(), raw);
        round_to_storage(&mut mesh, &geometry);
        let once = mesh.clone();
        let weights = &mesh.skin.as_ref().unwrap().weights[..8];
        prop_assert_eq!(weights.iter().map(|w| (f64::from(*w) * steps).round()).sum::<f64>(), steps);
        round_to_storage(&mut mesh, &geometry);
        prop_assert_eq!(mesh, once);
    }

    #[test]
    fn rounding_twice_is_rounding_once(x in -2.0f32..2.0, y in -2.0f32..2.0, z in -2.0f32..2.0, index in 0usize..4) {
        let component = [Component::I8, Component::I16, Component::U8, Component::U16][index];
        let signed = matches!(component, Component::I8 | Component::I16);
        let mut mesh = triangles(1);
        let semantics = [(Semantic::Normal, "NORMAL", signed), (Semantic::Color(0), "COLOR_0", true), (Semantic::Generic, "_X", false)];
        mesh.attributes = semantics.map(|(semantic, ..)| Attribute { semantic, width: 3, values: [x, y, z].repeat(3) }).to_vec();
        let layouts = semantics.into_iter().enumerate().filter(|(_, (_, name, on))| *on || *name != "NORMAL");
        let layouts = layouts.map(|(i, (_, name, normalized))| layout(name, component, normalized, Shape::Vec3, Channel::Attribute(i)));
        let geometry = geometry(vec![layouts.collect()]);
        round_to_storage(&mut mesh, &geometry);
        let once = mesh.clone();
        round_to_storage(&mut mesh, &geometry);
        prop_assert_eq!(mesh, once);
    }
}

#[test]
fn a_large_level_has_wide_indices_and_never_the_restart_value() {
    let mut sketch = Sketch::new();
    // 65 535 vertices would still fit: 0..=65534.
    let count = 65_538;
    let positions: Vec<f32> = (0..count).flat_map(|i| [(i % 300) as f32, (i / 300) as f32, (i % 7) as f32]).collect();
    let position = sketch.floats(&positions, 3, json!({"min": [0, 0, 0], "max": [299, 218, 6]}));
    let mesh = sketch.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}}]}));
    sketch.root(json!({"mesh": mesh}));
    let directory = tempfile::tempdir().unwrap();
    let source = sketch.read(directory.path(), "a.glb", Form::Glb);
    let mut lods = fake_lods(&source, 0, 1);
    let component = |triangles: usize, lods: &mut crate::emit::MeshLods| {
        lods.levels[0].mesh.triangles = lods.geometry.mesh.triangles[..triangles].to_vec();
        lods.levels[0].mesh.groups.clear();
        let encoded = crate::emit::encode_level(&lods.levels[0].mesh, &lods.geometry);
        encoded.accessors.last().unwrap().json["componentType"].clone()
    };
    assert_eq!(component(21_845, &mut lods), 5123);
    assert_eq!(component(21_846, &mut lods), 5125);
}

/// The form matters to buffers only: the same document otherwise.
#[test]
fn every_form_gives_the_same_levels() {
    let levels = [Form::Glb, Form::Embedded, Form::External].map(|form| {
        let mut sketch = Sketch::new();
        let mesh = sketch.grid_mesh("m");
        sketch.root(json!({"mesh": mesh}));
        Built::of(sketch, form, &options()).written.geometry(1, &Limits::default()).unwrap().mesh
    });
    assert_eq!(levels[0], levels[1]);
    assert_eq!(levels[0], levels[2]);
}
