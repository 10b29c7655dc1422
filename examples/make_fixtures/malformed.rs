//! Files for `tests/bad/`: each is a small sphere with one thing wrong, which its name says.

use super::File;
use super::builder::Builder;
use super::png::checkerboard;
use super::surfaces::bumpy_sphere;
use serde_json::{Value, json};

pub fn files() -> Vec<File> {
    [containers(), texts(), references(), numbers(), graphs(), outside()].concat()
}

/// A good file: accessor 0 is POSITION, 1 the indices, 2 NORMAL; node 0 draws mesh 0.
fn sphere() -> Builder {
    Builder::showing("Sphere", &bumpy_sphere(10, 6, 0.1, 101))
}

fn good() -> Vec<u8> {
    sphere().glb()
}

/// The good file with the JSON value at `pointer` replaced.
fn with(pointer: &str, value: Value) -> Vec<u8> {
    let mut file = sphere();
    set(file.root(), pointer, value);
    file.glb()
}

/// The same as text with the buffer inside.
fn text_with(pointer: &str, value: Value) -> Vec<u8> {
    let mut root: Value = serde_json::from_slice(&sphere().gltf_with_data_uri()).expect("the builder writes JSON");
    set(&mut root, pointer, value);
    root.to_string().into_bytes()
}

fn set(root: &mut Value, pointer: &str, value: Value) {
    let (parent, member) = pointer.rsplit_once('/').expect("a JSON pointer");
    let parent = root.pointer_mut(parent).expect("the parent exists");
    match (parent, member.parse::<usize>()) {
        (Value::Array(list), Ok(index)) => list[index] = value,
        (parent, _) => parent[member] = value,
    }
}

/// The good file with bytes replaced, counted from its end where `offset` is negative.
fn patched(offset: isize, bytes: &[u8]) -> Vec<u8> {
    let mut file = good();
    let start = if offset < 0 { file.len() - offset.unsigned_abs() } else { offset.unsigned_abs() };
    file[start..start + bytes.len()].copy_from_slice(bytes);
    file
}

/// Bytes of the binary chunk behind its header.
fn binary_start(file: &[u8]) -> usize {
    let json_length = u32::from_le_bytes([file[12], file[13], file[14], file[15]]) as usize;
    12 + 8 + json_length + 8
}

/// The good file with a float of the first position replaced.
fn with_coordinate(value: f32) -> Vec<u8> {
    patched(binary_start(&good()) as isize, &value.to_le_bytes())
}

fn containers() -> Vec<File> {
    let huge = 0xffff_fff0_u32.to_le_bytes();
    let mut short = good();
    short.truncate(short.len() - 64);
    let total = (short.len() as u32).to_le_bytes();
    short[8..12].copy_from_slice(&total);
    let bin_header = binary_start(&short) - 8;
    let left = (short.len() - bin_header - 8) as u32;
    short[bin_header..bin_header + 4].copy_from_slice(&left.to_le_bytes());
    vec![
        ("glb_empty.glb", Vec::new()),
        ("glb_is_a_picture.glb", checkerboard(4, 2, [0; 4], [255; 4])),
        ("glb_header_cut.glb", good()[..10].to_vec()),
        ("glb_chunk_header_cut.glb", good()[..16].to_vec()),
        ("glb_cut_in_the_middle.glb", good()[..good().len() / 2].to_vec()),
        ("glb_version_1.glb", patched(4, &1_u32.to_le_bytes())),
        ("glb_length_past_end.glb", patched(8, &huge)),
        ("glb_json_chunk_past_end.glb", patched(12, &huge)),
        ("glb_first_chunk_is_no_json.glb", patched(16, b"BIN\0")),
        ("glb_buffer_shorter_than_stated.glb", short),
    ]
}

fn texts() -> Vec<File> {
    let nested = [vec![b'['; 2_000], vec![b']'; 2_000]].concat();
    vec![
        ("json_syntax.gltf", b"{\"asset\": {\"version\": \"2.0\"} \"nodes\": []}\n".to_vec()),
        ("json_cut.gltf", sphere().gltf_with_data_uri()[..500].to_vec()),
        ("json_is_a_list.gltf", b"[]\n".to_vec()),
        (
            "json_nested_deeply.gltf",
            [b"{\"asset\": {\"version\": \"2.0\"}, \"extras\": ".to_vec(), nested, b"}".to_vec()].concat(),
        ),
        ("json_not_utf8.gltf", b"{\"asset\": {\"version\": \"2.0\", \"generator\": \"\xff\xfe\"}}\n".to_vec()),
        ("json_number_too_large.gltf", b"{\"asset\": {\"version\": \"2.0\"}, \"scene\": 1e999}\n".to_vec()),
        ("asset_is_missing.gltf", b"{\"nodes\": []}\n".to_vec()),
        ("asset_version_3.gltf", b"{\"asset\": {\"version\": \"3.0\", \"minVersion\": \"3.0\"}}\n".to_vec()),
        ("nodes_are_no_list.gltf", b"{\"asset\": {\"version\": \"2.0\"}, \"nodes\": {\"0\": {}}}\n".to_vec()),
    ]
}

fn references() -> Vec<File> {
    vec![
        ("indices_accessor_absent.glb", with("/meshes/0/primitives/0/indices", json!(99))),
        ("position_accessor_absent.glb", with("/meshes/0/primitives/0/attributes/POSITION", json!(99))),
        ("buffer_view_absent.glb", with("/accessors/0/bufferView", json!(99))),
        ("buffer_absent.glb", with("/bufferViews/0/buffer", json!(7))),
        ("mesh_absent.glb", with("/nodes/0/mesh", json!(3))),
        ("scene_node_absent.glb", with("/scenes/0/nodes", json!([42]))),
        ("level_node_absent.glb", with("/nodes/0/extensions", json!({"MSFT_lod": {"ids": [5]}}))),
        ("view_past_buffer.glb", with("/bufferViews/0/byteLength", json!(1_000_000))),
        ("accessor_past_view.glb", with("/accessors/0/count", json!(100_000))),
        ("vertex_index_out_of_range.glb", {
            let mut file = sphere();
            let indices: Vec<u32> = (0..300).map(|i| if i == 200 { 60_000 } else { i % 50 }).collect();
            let indices = file.indices(&indices);
            set(file.root(), "/meshes/0/primitives/0/indices", json!(indices));
            file.glb()
        }),
        ("sparse_index_out_of_range.glb", sparse(&[0, 5, 60_000])),
    ]
}

/// Sparse substitutions at these vertices; their values are the accessor's own first ones.
fn sparse(places: &[u16]) -> Vec<u8> {
    let mut file = sphere();
    let bytes: Vec<u8> = places.iter().flat_map(|place| place.to_le_bytes()).collect();
    let indices = file.view(&bytes, super::builder::Use::Other);
    let values = file.view(&vec![0; places.len() * 12], super::builder::Use::Other);
    let sparse = json!({
        "count": places.len(),
        "indices": {"bufferView": indices, "componentType": 5123},
        "values": {"bufferView": values},
    });
    file.amend_accessor(0, "sparse", sparse);
    file.glb()
}

fn numbers() -> Vec<File> {
    vec![
        ("position_nan.glb", with_coordinate(f32::NAN)),
        ("position_infinite.glb", with_coordinate(f32::INFINITY)),
        ("count_negative.glb", with("/accessors/0/count", json!(-1))),
        ("count_fraction.glb", with("/accessors/0/count", json!(12.5))),
        ("count_is_text.glb", with("/accessors/0/count", json!("70"))),
        ("count_absurd.glb", with("/accessors/0/count", json!(9_000_000_000_000_000_000_u64))),
        ("count_absurd_without_data.glb", {
            let mut file = sphere();
            let zeros = json!({"componentType": 5126, "type": "VEC3", "count": 4_000_000_000_000_u64});
            let zeros = file.push("accessors", zeros);
            set(file.root(), "/meshes/0/primitives/0/attributes/NORMAL", json!(zeros));
            file.glb()
        }),
        ("offset_overflows.glb", with("/bufferViews/0/byteOffset", json!(u64::MAX - 3))),
        ("attribute_counts_differ.glb", with("/accessors/2/count", json!(10))),
        ("component_type_unknown.glb", with("/accessors/0/componentType", json!(5130))),
        ("accessor_type_unknown.glb", with("/accessors/0/type", json!("VEC5"))),
        ("indices_are_floats.glb", with("/meshes/0/primitives/0/indices", json!(0))),
        ("mode_unknown.glb", with("/meshes/0/primitives/0/mode", json!(9))),
        ("morph_counts_differ.glb", {
            let mut file = sphere();
            let short = file.positions(&[[0.0; 3]; 4]);
            set(file.root(), "/meshes/0/primitives/0/targets", json!([{"POSITION": short}]));
            file.glb()
        }),
    ]
}

fn graphs() -> Vec<File> {
    let nodes = |nodes: Value| text_with("/nodes", nodes);
    vec![
        ("node_is_its_own_child.gltf", nodes(json!([{"mesh": 0, "children": [0]}]))),
        ("node_cycle.gltf", nodes(json!([{"mesh": 0, "children": [1]}, {"children": [2]}, {"children": [0]}]))),
        ("node_with_two_parents.gltf", nodes(json!([{"children": [2]}, {"children": [2]}, {"mesh": 0}]))),
        ("node_child_absent.gltf", nodes(json!([{"mesh": 0, "children": [8]}]))),
    ]
}

fn outside() -> Vec<File> {
    let uri = |uri: &str| text_with("/buffers/0/uri", json!(uri));
    vec![
        ("buffer_file_absent.gltf", uri("nowhere.bin")),
        ("buffer_file_short.gltf", uri("short.bin")),
        ("short.bin", vec![0; 16]),
        ("buffer_is_a_directory.gltf", uri(".")),
        ("buffer_uri_climbs_out.gltf", uri("../../../../../../../../etc/passwd")),
        ("buffer_uri_climbs_out_encoded.gltf", uri("%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/etc/passwd")),
        ("buffer_uri_absolute.gltf", uri("/etc/passwd")),
        ("buffer_uri_scheme_file.gltf", uri("file:///etc/passwd")),
        ("buffer_uri_scheme_https.gltf", uri("https://example.com/sphere.bin")),
        ("data_uri_not_base64.gltf", uri("data:application/octet-stream;base64,@@@@")),
        ("data_uri_short.gltf", uri("data:application/octet-stream;base64,AAAA")),
    ]
}
