//! Bad input: every file of `tests/bad` gives the error that `expected.toml` states, and no mutation of a good
//! file makes reading panic.

use gltf_lod::asset::{Asset, Limits};
use gltf_lod::error::{Kind, Result};
use proptest::prelude::*;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn bad() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad")
}

/// Small enough that a mutated count which were believed would be noticed.
const LIMITS: Limits = Limits { file_bytes: 1 << 20, vertices: 1 << 20, mesh_bytes: 1 << 24 };

/// Reads a file and all its geometry; the number of triangles.
fn read(path: &Path, root: &Path, limits: &Limits) -> Result<usize> {
    let asset = Asset::read(path, root, limits)?;
    let _ = asset.scene();
    let mut triangles = 0;
    for mesh in 0..asset.document.array("meshes").len() {
        triangles += asset.geometry(mesh, limits)?.mesh.triangles.len();
    }
    Ok(triangles)
}

#[test]
fn every_bad_file_gives_its_error() {
    let expected = std::fs::read_to_string(bad().join("expected.toml")).unwrap();
    let expected: BTreeMap<String, String> = toml::from_str(&expected).unwrap();
    let mut wrong = Vec::new();
    for (name, fragment) in &expected {
        let path = bad().join(name);
        match read(&path, &bad(), &Limits::default()) {
            Ok(triangles) => wrong.push(format!("{name}: read without error, {triangles} triangles")),
            Err(error) if !error.to_string().contains(fragment) => {
                wrong.push(format!("{fragment:?} is not in {error}"))
            }
            Err(error) => assert_eq!(error.file.as_deref(), Some(&*path), "{error}"),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let assets = std::fs::read_dir(bad()).unwrap().map(|entry| entry.unwrap().path());
    let assets = assets.filter(|p| p.extension().is_some_and(|e| e == "gltf" || e == "glb"));
    let unlisted: Vec<_> =
        assets.filter(|p| !expected.contains_key(p.file_name().unwrap().to_str().unwrap())).collect();
    assert!(unlisted.is_empty(), "not in expected.toml: {unlisted:?}");
}

#[test]
fn what_is_no_file_and_what_is_too_large_is_refused() {
    assert_eq!(read(&bad(), &bad(), &LIMITS).unwrap_err().kind, Kind::Io);
    assert_eq!(read(&bad().join("none.glb"), &bad(), &LIMITS).unwrap_err().kind, Kind::Io);
    let file = tempfile::Builder::new().suffix(".glb").tempfile().unwrap();
    std::fs::write(file.path(), good(&positions())).unwrap();
    let root = file.path().parent().unwrap();
    assert_eq!(read(file.path(), root, &LIMITS).unwrap(), 2);
    for limits in
        [Limits { file_bytes: 100, ..LIMITS }, Limits { vertices: 3, ..LIMITS }, Limits { mesh_bytes: 100, ..LIMITS }]
    {
        assert_eq!(read(file.path(), root, &limits).unwrap_err().kind, Kind::Limit, "{limits:?}");
    }
}

/// A GLB of `document` and `bin`.
fn pack(document: &Value, bin: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json.as_slice()), (b"BIN\0", bin)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

fn positions() -> Value {
    json!({"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"})
}

/// The JSON of a GLB made by [`pack`].
fn unpack(glb: &[u8]) -> (Value, Vec<u8>) {
    let end = 20 + u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    (serde_json::from_slice(&glb[20..end]).unwrap(), glb[end + 8..].to_vec())
}

/// JSON pointers to every value below `value`.
fn list_pointers(value: &Value, place: &str, out: &mut Vec<String>) {
    out.push(place.to_owned());
    match value {
        Value::Object(members) => members.iter().for_each(|(k, v)| list_pointers(v, &format!("{place}/{k}"), out)),
        Value::Array(list) => {
            (0..).zip(list).for_each(|(i, v): (u32, _)| list_pointers(v, &format!("{place}/{i}"), out))
        }
        _ => {}
    }
}

#[test]
fn any_value_may_stand_anywhere() {
    let (document, bin) = unpack(&good(&positions()));
    let mut pointers = Vec::new();
    list_pointers(&document, "", &mut pointers);
    let strange = json!([
        null,
        true,
        "",
        "x",
        [],
        [0, 0],
        {},
        0,
        1,
        2,
        3,
        5,
        255,
        5121,
        5126,
        -1,
        0.5,
        1e300,
        4294967295_u64,
        9223372036854775807_u64,
        18446744073709551615_u64
    ]);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("m.glb");
    let (mut read_well, mut refused) = (0, 0);
    for pointer in &pointers {
        for value in strange.as_array().unwrap() {
            let mut document = document.clone();
            *document.pointer_mut(pointer).unwrap() = value.clone();
            std::fs::write(&path, pack(&document, &bin)).unwrap();
            match read(&path, directory.path(), &LIMITS) {
                Ok(_) => read_well += 1,
                Err(error) => {
                    assert!(error.kind != Kind::Internal && error.place.is_some(), "{pointer} = {value}: {error}");
                    refused += 1;
                }
            }
        }
    }
    assert!(refused > read_well && read_well > 0, "{refused} refused, {read_well} read");
}

/// Two triangles with the given position accessor; joints, weights, a sparse morph target, a strip, a skin, levels.
fn good(positions: &Value) -> Vec<u8> {
    let mut bin = Vec::new();
    for x in [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0] {
        bin.extend(x.to_le_bytes());
    }
    bin.extend([0, 0, 1, 0, 2, 0, 3, 0]);
    bin.extend([0; 16]);
    bin.extend([255, 0, 0, 0].repeat(4));
    let document = json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": bin.len()}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 8},
            {"buffer": 0, "byteOffset": 56, "byteLength": 32, "byteStride": 4},
        ],
        "accessors": [
            positions,
            {"bufferView": 1, "componentType": 5123, "count": 4, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5121, "count": 4, "type": "VEC4"},
            {"bufferView": 2, "byteOffset": 16, "componentType": 5121, "normalized": true, "count": 4, "type": "VEC4"},
            {"componentType": 5126, "count": 4, "type": "VEC3", "sparse": {"count": 2,
                "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 0}}},
        ],
        "meshes": [{"primitives": [{"mode": 5, "indices": 1, "targets": [{"POSITION": 4}],
            "attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3, "_ID": 2}}]}],
        "skins": [{"joints": [1]}],
        "nodes": [{"mesh": 0, "skin": 0, "children": [1]}, {"extensions": {"MSFT_lod": {"ids": [2]}}}, {}],
        "scenes": [{"nodes": [0]}],
        "animations": [{"samplers": [{"input": 1, "output": 0}],
            "channels": [{"sampler": 0, "target": {"node": 1, "path": "scale"}}]}],
    });
    pack(&document, &bin)
}

/// One change to a file.
#[derive(Debug, Clone)]
enum Mutation {
    /// Another byte here.
    Byte(prop::sample::Index, u8),
    /// Nothing from here on.
    Cut(prop::sample::Index),
    /// This text in place of a digit: numbers are where documents lie.
    Digit(prop::sample::Index, &'static str),
}

const NUMBERS: [&str; 11] =
    ["9", "99", "-1", "1e9", "4294967295", "18446744073709551615", "0.5", "null", "\"x\"", "[]", "{}"];

fn mutations() -> impl Strategy<Value = Vec<Mutation>> {
    let mutation = prop_oneof![
        4 => (any::<prop::sample::Index>(), any::<u8>()).prop_map(|(at, byte)| Mutation::Byte(at, byte)),
        1 => any::<prop::sample::Index>().prop_map(Mutation::Cut),
        8 => (any::<prop::sample::Index>(), prop::sample::select(&NUMBERS[..])).prop_map(|(at, text)| Mutation::Digit(at, text)),
    ];
    prop::collection::vec(mutation, 1..4)
}

fn mutate(mut bytes: Vec<u8>, mutations: &[Mutation]) -> Vec<u8> {
    for mutation in mutations {
        match mutation {
            _ if bytes.is_empty() => {}
            Mutation::Byte(at, byte) => *at.get_mut(&mut bytes) = *byte,
            Mutation::Cut(at) => bytes.truncate(at.index(bytes.len())),
            Mutation::Digit(at, text) => {
                let digits: Vec<_> = (20..bytes.len()).filter(|i| bytes[*i].is_ascii_digit()).collect();
                if !digits.is_empty() {
                    let at = *at.get(&digits);
                    bytes.splice(at..=at, text.bytes());
                    fix_lengths(&mut bytes, text.len() as u32 - 1);
                }
            }
        }
    }
    bytes
}

/// The JSON grew: without true lengths nothing past the container would be tried.
fn fix_lengths(bytes: &mut [u8], grown: u32) {
    for at in [8, 12] {
        if let Some(field) = bytes.get_mut(at..at + 4) {
            let length = u32::from_le_bytes(field.try_into().unwrap());
            field.copy_from_slice(&length.wrapping_add(grown).to_le_bytes());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_mutation_makes_reading_panic(mutations in mutations(), quantised in any::<bool>()) {
        let positions = if quantised {
            json!({"bufferView": 0, "componentType": 5122, "count": 4, "type": "VEC3", "normalized": true})
        } else {
            positions()
        };
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("m.glb");
        std::fs::write(&path, mutate(good(&positions), &mutations)).unwrap();
        match read(&path, directory.path(), &LIMITS) {
            Ok(triangles) => prop_assert!(triangles <= LIMITS.vertices),
            Err(error) => prop_assert!(error.kind != Kind::Internal && error.file.is_some(), "{}", error),
        }
    }
}
