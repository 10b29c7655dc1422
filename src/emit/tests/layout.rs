//! Where level data goes, and that nothing else changes.

use super::sketch::{Built, Form, Sketch, options};
use crate::asset::{Asset, Container, Limits};
use crate::emit::{Content, Layout, Options, emit, verify, write};
use serde_json::{Value, json};
use std::path::Path;

/// Two meshes with levels, an image between their data, an external image, things that nobody knows.
fn scene() -> Sketch {
    let mut sketch = Sketch::new();
    let first = sketch.grid_mesh("first");
    let image = sketch.accessor(&[7; 30], 5121, 30, "SCALAR", json!({}));
    let view = sketch.json["accessors"].as_array_mut().unwrap().pop().unwrap()["bufferView"].clone();
    assert_eq!(image, 3);
    let second = sketch.grid_mesh("second");
    sketch.root(json!({"name": "a", "mesh": first, "scale": [1.0, 1e-7, 123456789.0]}));
    sketch.root(json!({"name": "b", "mesh": second}));
    sketch.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
    sketch.json["extensionsUsed"] = json!(["XY_unknown"]);
    sketch.json["extensions"] = json!({"XY_unknown": {"node": 1, "value": 0.1}});
    sketch
}

fn relative_names(built: &Built) -> Vec<&str> {
    built.output.files.iter().map(|file| file.relative.to_str().unwrap()).collect()
}

#[test]
fn a_glb_grows_at_its_end_and_keeps_unknown_chunks() {
    let built = Built::of(scene(), Form::Glb, &options());
    assert_eq!(relative_names(&built), ["asset.glb"]);
    assert_eq!(built.written.container, built.source.container);
    let (before, after) = (built.source.buffers[0].as_ref().unwrap(), built.written.buffers[0].as_ref().unwrap());
    assert!(after.len() > before.len() && after.starts_with(before));
    let views = built.source.document.array("bufferViews").len();
    assert_eq!(built.written.document.array("bufferViews")[..views], *built.source.document.array("bufferViews"));
    // Vertices of one level share a view, which has to say its stride then; indices have their own.
    assert_eq!(built.at(&format!("/bufferViews/{views}/byteStride")), 12);
    assert_eq!(built.at(&format!("/bufferViews/{views}/target")), 34962);
    assert_eq!(built.at(&format!("/bufferViews/{}/target", views + 1)), 34963);
}

#[test]
fn level_accessors_have_small_indices_and_exact_bounds() {
    let built = Built::of(scene(), Form::Glb, &options());
    let level = built.written.geometry(2, &Limits::default()).unwrap();
    let primitive = built.at("/meshes/2/primitives/0");
    let accessor = |index: &Value| built.at(&format!("/accessors/{index}"));
    assert_eq!(accessor(&primitive["indices"])["componentType"], 5123);
    assert_eq!(accessor(&primitive["indices"])["count"], 3 * 16);
    let position = accessor(&primitive["attributes"]["POSITION"]);
    let (low, high) = level.mesh.bounds();
    let numbers = |member: &str| -> Vec<f32> {
        position[member].as_array().unwrap().iter().map(|x| x.as_f64().unwrap() as f32).collect()
    };
    assert_eq!(numbers("min"), low.to_array());
    assert_eq!(numbers("max"), high.to_array());
    assert_eq!(position["max"].to_string(), "[4,4,0.4]");
}

#[test]
fn a_gltf_with_files_gets_one_more_and_the_old_ones_are_copied() {
    let built = Built::of(scene(), Form::External, &options());
    assert_eq!(relative_names(&built), ["my asset.gltf", "my asset_lod.bin", "my data.bin"]);
    assert_eq!(built.at("/buffers/1/uri"), "my%20asset_lod.bin");
    assert!(matches!(&built.output.files[2].content, Content::CopyOf(_)));
    assert_eq!(built.written.buffers[0], built.source.buffers[0]);
    // As the source: on one line.
    assert!(!text_of(&built).contains('\n'));
}

#[test]
fn a_new_file_takes_no_name_that_the_directory_has() {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("my asset_lod.bin"), b"a neighbour's").unwrap();
    let source = scene().read(directory.path(), "my asset.gltf", Form::External);
    let built = Built::build(source, directory, &options());
    assert_eq!(relative_names(&built)[1], "my asset_lod_2.bin");
}

#[test]
fn a_self_contained_gltf_stays_so_and_keeps_its_style() {
    let built = Built::of(scene(), Form::Embedded, &options());
    assert_eq!(relative_names(&built), ["my asset.gltf"]);
    assert!(built.at("/buffers/1/uri").as_str().unwrap().starts_with("data:"));
    assert!(text_of(&built).starts_with("{\n  \"asset\": {\n    \"version\""));
    assert_eq!(built.at("/nodes/0/scale").to_string(), "[1.0,1e-7,123456789.0]");
}

fn text_of(built: &Built) -> String {
    std::fs::read_to_string(&built.written.path).unwrap()
}

#[test]
fn progressive_glb_holds_the_coarsest_level_before_finer_ones() {
    let progressive = Options { layout: Layout::Progressive, ..options() };
    let built = Built::of(scene(), Form::Glb, &progressive);
    // LOD0 of both meshes, then each mesh's levels 1 and 2; the image is needed from the start.
    let range = |primitive: &Value| {
        let accessors = primitive["attributes"].as_object().unwrap().values().chain([&primitive["indices"]]);
        let views = accessors.map(|a| built.at(&format!("/accessors/{a}/bufferView")));
        let offsets = views.map(|v| built.at(&format!("/bufferViews/{v}/byteOffset")).as_u64().unwrap_or(0));
        let offsets: Vec<u64> = offsets.collect();
        (*offsets.iter().min().unwrap(), *offsets.iter().max().unwrap())
    };
    let ranges: Vec<_> = (0..6).map(|m| range(&built.at(&format!("/meshes/{m}/primitives/0")))).collect();
    let [first0, second0, first1, first2, second1, second2] = ranges[..] else { panic!("six meshes") };
    let image = built.at("/images/0/bufferView");
    let image = built.at(&format!("/bufferViews/{image}/byteOffset")).as_u64().unwrap_or(0);
    assert!(image < first2.0 && first2.1 < second2.0, "{ranges:?}");
    assert!(second2.1 < first1.0 && first1.1 < second1.0 && second1.1 < first0.0.min(second0.0), "{ranges:?}");
}

#[test]
fn progressive_gltf_has_one_file_for_each_level() {
    let progressive = Options { layout: Layout::Progressive, ..options() };
    let built = Built::of(scene(), Form::External, &progressive);
    assert_eq!(relative_names(&built), ["my asset.gltf", "my asset_lod2.bin", "my asset_lod1.bin", "my data.bin"]);
    let buffer_of = |mesh: usize| {
        let accessor = built.at(&format!("/meshes/{mesh}/primitives/0/indices"));
        let view = built.at(&format!("/accessors/{accessor}/bufferView"));
        let buffer = built.at(&format!("/bufferViews/{view}/buffer"));
        built.at(&format!("/buffers/{buffer}/uri"))
    };
    assert_eq!(
        [2, 3, 4, 5].map(buffer_of),
        ["my%20asset_lod1.bin", "my%20asset_lod2.bin", "my%20asset_lod1.bin", "my%20asset_lod2.bin"]
    );
}

#[test]
fn an_extension_that_names_buffer_ranges_stops_reordering() {
    let mut sketch = scene();
    sketch.json["extensions"]["XY_unknown"]["blob"] = json!({"buffer": 0, "byteOffset": 0, "byteLength": 4});
    let built = Built::of(sketch, Form::Glb, &Options { layout: Layout::Progressive, ..options() });
    assert!(built.written.buffers[0].as_ref().unwrap().starts_with(built.source.buffers[0].as_ref().unwrap()));
    assert_eq!(built.output.notes.len(), 1);
}

#[test]
fn a_glb_whose_first_buffer_is_external_keeps_its_data_outside() {
    let directory = tempfile::tempdir().unwrap();
    let gltf = scene().read(directory.path(), "a.gltf", Form::External);
    let glb = Container::Glb { others: Vec::new() }.pack(&gltf.document.to_json(), None).unwrap();
    let path = directory.path().join("a.glb");
    std::fs::write(&path, glb).unwrap();
    let source = Asset::read(&path, directory.path(), &Limits::default()).unwrap();
    let built = Built::build(source, directory, &options());
    assert_eq!(relative_names(&built), ["a.glb", "a_lod.bin", "my data.bin"]);
}

#[test]
fn without_levels_the_file_is_copied_byte_for_byte() {
    let directory = tempfile::tempdir().unwrap();
    let source = scene().read(directory.path(), "a.glb", Form::Glb);
    let output = emit(&source, &[], &options()).unwrap();
    let out = directory.path().join("out");
    write(&output, &out).unwrap();
    let read = |path: &Path| std::fs::read(path).unwrap();
    assert_eq!(read(&out.join("a.glb")), read(&source.path));
}

#[test]
fn levels_without_fewer_triangles_are_left_out_with_their_coverage() {
    let directory = tempfile::tempdir().unwrap();
    let source = scene().read(directory.path(), "a.glb", Form::Glb);
    let mut lods = super::sketch::fake_lods(&source, 0, 4);
    lods.levels[1] = lods.levels[0].clone();
    lods.levels[3].mesh.triangles.clear();
    lods.levels[3].mesh.groups.clear();
    let output = emit(&source, &[lods], &options()).unwrap();
    verify::check_output(&source, &output).unwrap();
    assert_eq!(output.notes.len(), 2, "{:?}", output.notes);
    let Content::Bytes(glb) = &output.files[0].content else { panic!("a new file") };
    let json: Value = serde_json::from_slice(&Container::unpack(glb.clone()).unwrap().json).unwrap();
    assert_eq!(json["nodes"][0]["extras"]["MSFT_screencoverage"], json!([0.5, 0.125, 0.0]));
}

#[test]
fn the_checker_finds_what_is_broken() {
    let built = Built::of(scene(), Form::Glb, &options());
    let breaks = |edit: &dyn Fn(&mut Value), place: &str| {
        let mut broken = built.written.clone();
        let mut root = broken.document.root().clone();
        edit(&mut root);
        broken.document = crate::asset::Document::new(root);
        let errors = verify::check(&built.source, &broken).expect_err(place);
        let places: Vec<_> = errors.iter().filter_map(|e| e.place.as_deref()).collect();
        assert!(places.contains(&place), "{place} in {errors:#?}");
    };
    let ids = built.ids(0);
    breaks(&|r| r["extensions"]["XY_unknown"]["value"] = json!(0.2), "/extensions/XY_unknown/value");
    breaks(&|r| r["nodes"][1]["name"] = json!("c"), "/nodes/1/name");
    breaks(&|r| r["accessors"][0]["count"] = json!(24), "/accessors/0/count");
    breaks(&|r| r["bufferViews"][0]["byteLength"] = json!(4), "/bufferViews/0/byteLength");
    breaks(&|r| r["scenes"][0]["nodes"] = json!([0, 1, ids[0]]), "/nodes/0");
    breaks(&|r| r["nodes"][ids[1]]["mesh"] = json!(0), "/nodes/0");
    breaks(&|r| r["nodes"][ids[0]]["scale"] = json!([1, 1, 1]), "/nodes/0");
    breaks(
        &|r| r["nodes"][0]["extras"]["MSFT_screencoverage"] = json!([0.5, 0.5, 0]),
        "/nodes/0/extras/MSFT_screencoverage",
    );
    breaks(&|r| r["nodes"][0]["extensions"]["MSFT_lod"]["ids"] = json!([ids[1], ids[0]]), "/nodes/0");
    breaks(&|r| r["extensionsUsed"] = json!(["XY_unknown"]), "/extensionsUsed");
    breaks(&|r| r["extensionsRequired"] = json!(["MSFT_lod"]), "/extensionsRequired");
    breaks(&|r| r["meshes"][2]["primitives"][0]["material"] = json!(0), "/meshes/2/primitives/0");

    let mut broken = built.written.clone();
    broken.buffers[0].as_mut().unwrap()[0] ^= 1;
    let errors = verify::check(&built.source, &broken).unwrap_err();
    assert_eq!(errors[0].place.as_deref(), Some("/bufferViews/0"));
}
