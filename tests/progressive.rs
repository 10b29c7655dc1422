//! Progressive files: the source comes back, any beginning of a file is a level, damage is named, and the JavaScript decoder agrees.

mod support;

use gltf_lod::{Kind, RebuildOptions, asset::Limits, rebuild};
use serde_json::Value;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;
use support::reader::Gltf;
use support::{Run, assets_below, directory_from, fixtures, items, maybe_index};
use tempfile::TempDir;

const EXTENSION: &str = "GLTFLOD_mesh_progressive";

/// A file made progressive.
struct Progressive {
    directory: TempDir,
    source: PathBuf,
}

impl Progressive {
    fn of(source: &Path) -> Self {
        let made = Self { directory: TempDir::new().expect("a temporary directory"), source: source.to_owned() };
        let run = support::run(&["progressive".as_ref(), source.as_os_str(), "-o".as_ref(), made.path().as_os_str()]);
        assert_eq!(run.code, Some(0), "{}: {}", source.display(), run.stderr);
        made
    }

    fn fixture(name: &str) -> Self {
        Self::of(&fixtures().join(name))
    }

    fn path(&self) -> PathBuf {
        self.directory.path().join("progressive.glb")
    }

    fn bytes(&self) -> Vec<u8> {
        std::fs::read(self.path()).expect("the progressive file")
    }

    /// The meshes that have records.
    fn meshes(&self) -> Vec<usize> {
        let gltf = Gltf::open(&self.path());
        let meshes = gltf.list("meshes").iter().enumerate();
        meshes.filter(|(_, mesh)| !mesh["extensions"][EXTENSION].is_null()).map(|(index, _)| index).collect()
    }

    /// Triangles of all bases, and of all full meshes.
    fn counts(&self) -> (usize, usize) {
        let gltf = Gltf::open(&self.path());
        let of = |mesh: &usize| {
            let extension = &gltf.list("meshes")[*mesh]["extensions"][EXTENSION];
            let stand_ins = items(&extension["primitives"]).iter().filter(|p| p["empty"] == true).count();
            let full = extension["triangles"].as_u64().expect("a count") as usize;
            (gltf.mesh_triangles(*mesh).len() - stand_ins, full)
        };
        self.meshes().iter().map(of).fold((0, 0), |sum, of| (sum.0 + of.0, sum.1 + of.1))
    }

    fn try_rebuild(&self, bytes: &[u8], triangles: Option<usize>) -> (Run, PathBuf) {
        let input = self.directory.path().join("part.glb");
        std::fs::write(&input, bytes).expect("a writable directory");
        let output = self.directory.path().join("rebuilt.glb");
        _ = std::fs::remove_file(&output);
        let count = triangles.map(|n| n.to_string());
        let mut arguments = vec!["rebuild".as_ref(), input.as_os_str(), "-o".as_ref(), output.as_os_str()];
        if let Some(count) = &count {
            arguments.extend([OsStr::new("--triangles"), OsStr::new(count)]);
        }
        (support::run(&arguments), output)
    }

    fn rebuild(&self, triangles: Option<usize>) -> Gltf {
        let (run, output) = self.try_rebuild(&self.bytes(), triangles);
        assert_eq!(run.code, Some(0), "{}: {}", self.source.display(), run.stderr);
        Gltf::open(&output)
    }
}

/// A corner's numbers, attribute by attribute in the order of their names, as bits without the sign of zeros.
type Corner = Vec<u64>;

/// Triangles of a mesh with all attributes of their corners: the smallest corner first, sorted. Those of one corner stand in for none.
fn triangles(gltf: &Gltf, mesh: usize) -> Vec<(usize, [Corner; 3])> {
    let mut all = Vec::new();
    for (number, primitive) in items(&gltf.list("meshes")[mesh]["primitives"]).iter().enumerate() {
        if primitive["mode"].as_u64().is_some_and(|mode| mode < 4) {
            continue;
        }
        let corners = corners(gltf, primitive);
        // Those that only steer a strip are no triangles.
        let steers =
            |t: &[usize; 3]| primitive["mode"].as_u64() > Some(4) && (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]);
        for triangle in gltf.triangle_indices(primitive).into_iter().filter(|t| !steers(t)) {
            let mut triangle = triangle.map(|v| corners[v].clone());
            if triangle[0] != triangle[1] || triangle[0] != triangle[2] {
                let first = (0..3).min_by_key(|&k| triangle[k].clone()).expect("three corners");
                triangle.rotate_left(first);
                all.push((number, triangle));
            }
        }
    }
    all.sort();
    all
}

fn corners(gltf: &Gltf, primitive: &Value) -> Vec<Corner> {
    let lists = std::iter::once(&primitive["attributes"]).chain(items(&primitive["targets"]));
    let mut columns = Vec::new();
    for list in lists {
        let mut names: Vec<&String> = list.as_object().expect("attributes").keys().collect();
        names.sort();
        for name in names {
            let mut elements = gltf.elements(maybe_index(&list[name]).expect("an accessor"));
            if let Some(set) = name.strip_prefix("JOINTS_") {
                let weights = gltf.elements(maybe_index(&list[format!("WEIGHTS_{set}")]).expect("weights"));
                // A joint without weight may be any: vertices that differ in nothing else are one.
                for (joint, weight) in elements.iter_mut().flatten().zip(weights.iter().flatten()) {
                    *joint = if *weight == 0.0 { 0.0 } else { *joint };
                }
            }
            columns.push(elements);
        }
    }
    let count = columns.first().map_or(0, Vec::len);
    let bits = |x: &f64| (x + 0.0).to_bits();
    (0..count).map(|v| columns.iter().flat_map(|column| column[v].iter().map(bits)).collect()).collect()
}

fn node_is_missing() -> bool {
    let missing = Command::new("node").arg("--version").output().is_err();
    if missing {
        println!("skipped: the JavaScript decoder needs node");
    }
    missing
}

/// The lines that `tests/progressive.mjs` prints.
fn ask_decoder(mode: &str, file: &Path, numbers: &[usize]) -> Vec<String> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/progressive.mjs");
    let numbers = numbers.iter().map(usize::to_string);
    let run = Command::new("node").arg(script).arg(mode).arg(file).args(numbers).output().expect("node starts");
    assert!(run.status.success(), "{}: {}", file.display(), String::from_utf8_lossy(&run.stderr));
    String::from_utf8(run.stdout).expect("text").lines().map(str::to_owned).collect()
}

/// Everything but geometry: what no collapse touches.
fn rest_of(gltf: &Gltf) -> Value {
    let mut rest = gltf.json.clone();
    let root = rest.as_object_mut().expect("an object");
    for geometry in ["accessors", "bufferViews", "buffers", "extensionsUsed"] {
        root.remove(geometry);
    }
    for image in rest["images"].as_array_mut().into_iter().flatten() {
        let image = image.as_object_mut().expect("an image");
        ["uri", "bufferView", "mimeType"].iter().for_each(|member| drop(image.remove(*member)));
    }
    for mesh in rest["meshes"].as_array_mut().into_iter().flatten() {
        for primitive in mesh["primitives"].as_array_mut().into_iter().flatten() {
            let primitive = primitive.as_object_mut().expect("a primitive");
            ["attributes", "indices", "targets", "mode"].iter().for_each(|member| drop(primitive.remove(*member)));
        }
    }
    rest
}

/// The numbers that animations and skins use.
fn other_numbers(gltf: &Gltf) -> Vec<Vec<Vec<f64>>> {
    let samplers = gltf.list("animations").iter().flat_map(|animation| items(&animation["samplers"]));
    let samplers = samplers.flat_map(|s| [&s["input"], &s["output"]]);
    let skins = gltf.list("skins").iter().map(|skin| &skin["inverseBindMatrices"]);
    samplers.chain(skins).filter_map(maybe_index).map(|accessor| gltf.elements(accessor)).collect()
}

fn image_bytes(gltf: &Gltf, directory: &Path) -> Vec<Vec<u8>> {
    let bytes = |image: &Value| match maybe_index(&image["bufferView"]) {
        Some(view) => {
            let view = &gltf.list("bufferViews")[view];
            let start = maybe_index(&view["byteOffset"]).unwrap_or(0);
            gltf.buffers[maybe_index(&view["buffer"]).expect("a buffer")][start..]
                [..maybe_index(&view["byteLength"]).expect("a length")]
                .to_vec()
        }
        None => {
            let uri = image["uri"].as_str().unwrap_or_default();
            let name = percent_encoding::percent_decode_str(uri).decode_utf8().expect("UTF-8");
            std::fs::read(directory.join(&*name)).unwrap_or_else(|_| uri.as_bytes().to_vec())
        }
    };
    gltf.list("images").iter().map(bytes).collect()
}

fn check_round_trip(source: &Path) {
    let progressive = Progressive::of(source);
    let (before, after) = (Gltf::open(source), progressive.rebuild(None));
    let mut base = Gltf::open(&progressive.path());
    let name = source.display();
    for mesh in progressive.meshes() {
        assert!(triangles(&after, mesh) == triangles(&before, mesh), "{name}: mesh {mesh}");
        assert!(base.mesh_triangles(mesh).len() < before.mesh_triangles(mesh).len(), "{name}: mesh {mesh}");
        let extensions = base.json["meshes"][mesh]["extensions"].as_object_mut().expect("extensions");
        extensions.remove(EXTENSION);
        if extensions.is_empty() {
            base.json["meshes"][mesh].as_object_mut().expect("a mesh").remove("extensions");
        }
    }
    let directory = source.parent().expect("a directory");
    for made in [&base, &after] {
        assert_eq!(rest_of(made), rest_of(&before), "{name}");
        assert_eq!(other_numbers(made), other_numbers(&before), "{name}");
        assert!(image_bytes(made, directory) == image_bytes(&before, directory), "{name}: images");
    }
    assert_eq!(items(&after.json["extensionsUsed"]), items(&before.json["extensionsUsed"]), "{name}");
}

#[test]
fn every_fixture_comes_back_whole() {
    let mut progressive = 0;
    for relative in assets_below(&fixtures()) {
        check_round_trip(&fixtures().join(&relative));
        progressive += 1;
    }
    assert!(progressive > 30, "{progressive} fixtures");
}

#[test]
fn files_of_the_corpus_come_back_whole() {
    let Some(corpus) = directory_from("GLTF_LOD_CORPUS") else { return };
    for name in [
        "attributes/chr_knight/chr_knight.glb",
        "attributes/vive_focus/none.glb",
        "instancing/duplicate_meshes/duplicate_meshes.gltf",
        "modes/mode5_strips/mode5.gltf",
        "morph/MorphStressTest/MorphStressTest.gltf",
        "skinned/CesiumMan/CesiumMan.glb",
        "skinned/KayKit_Knight/Knight.glb",
        "static-pbr/terrain/terrain.glb",
    ] {
        check_round_trip(&corpus.join(name));
    }
}

#[test]
fn any_number_of_triangles_can_be_asked_for() {
    for name in
        ["shapes/gear.glb", "materials/two_primitives.glb", "skinned/skin_and_morph.glb", "nodes/shared_mesh.glb"]
    {
        let progressive = Progressive::fixture(name);
        let (base, full) = progressive.counts();
        assert!(base < full / 4, "{name}: {base} of {full}");
        for step in 0..=4 {
            let asked = base + (full - base) * step / 4;
            let gltf = progressive.rebuild(Some(asked));
            let stand_ins = items(&gltf.json["meshes"]).len() * 2;
            let found: usize = progressive.meshes().iter().map(|&mesh| triangles(&gltf, mesh).len()).sum();
            assert!(found <= asked && found + 2 + stand_ins > asked, "{name}: {found} for {asked}");
        }
        let fewer = progressive.rebuild(Some(1));
        assert_eq!(progressive.meshes().iter().map(|&m| triangles(&fewer, m).len()).sum::<usize>(), base, "{name}");
    }
}

#[test]
fn any_beginning_of_a_file_is_a_level() {
    for name in ["materials/two_primitives.glb", "nodes/shared_mesh.glb", "morph/talking_head.glb"] {
        let progressive = Progressive::fixture(name);
        let bytes = progressive.bytes();
        let (base, full) = progressive.counts();
        let (mut last, mut refused) = (base, 0);
        for step in 0..=20 {
            let length = bytes.len() * step / 20;
            let (run, output) = progressive.try_rebuild(&bytes[..length], None);
            if run.code == Some(3) {
                assert!(last == base, "{name}: {length} bytes: {}", run.stderr);
                assert!(run.stderr.contains("part.glb") && !run.stderr.contains("panicked"), "{}", run.stderr);
                assert!(!output.exists());
                refused += 1;
                continue;
            }
            assert_eq!(run.code, Some(0), "{name}: {length} bytes: {}", run.stderr);
            let gltf = Gltf::open(&output);
            let found: usize = progressive.meshes().iter().map(|&mesh| triangles(&gltf, mesh).len()).sum();
            assert!(found >= last, "{name}: {found} after {last}");
            assert_eq!(run.stdout.contains("the file ends before"), length < bytes.len(), "{}", run.stdout);
            last = found;
        }
        assert!(refused > 0 && last == full, "{name}: {refused} refused, {last} of {full}");
    }
}

#[test]
fn a_wrong_extension_is_named_with_its_place() {
    let progressive = Progressive::fixture("materials/two_primitives.glb");
    let bytes = progressive.bytes();
    let place = format!("/meshes/0/extensions/{EXTENSION}");
    let edits: [(&str, Value, &str); 12] = [
        ("/version", 2.into(), "/version: expected version 1"),
        ("/triangles", "many".into(), "/triangles: expected a whole number"),
        ("/chunks", 3.into(), "/chunks: expected an array"),
        ("/chunks/0/bufferView", 999.into(), "/chunks/0/bufferView: names bufferViews[999]"),
        ("/chunks/0/records", 4_000_000_000u32.into(), "/chunks/0: 4000000000 records"),
        ("/chunks/1/triangles", 1.into(), "/chunks/1: "),
        ("/primitives/0/primitive", 7.into(), "lists the primitives [7, 1]"),
        ("/primitives/1/attributes/0/name", "NORMAL".into(), "/primitives/1: NORMAL is listed, but"),
        ("/primitives/0/attributes/0/name", "_X".into(), "/primitives/0: _X is listed, but"),
        ("/primitives/0/attributes/0/step", 500.into(), "/attributes/0/step: expected a whole number from -100 to 100"),
        ("/primitives/0/attributes/0/step", 3.into(), "/primitives/1: positions are coded otherwise"),
        ("/primitives/0/attributes", Value::Array(Vec::new()), "is not listed"),
    ];
    for (member, value, message) in edits {
        let damaged = edit_json(&bytes, &format!("{place}{member}"), value);
        let (run, output) = progressive.try_rebuild(&damaged, None);
        assert_eq!(run.code, Some(3), "{member}: {}", run.stderr);
        assert!(run.stderr.contains(&place) && run.stderr.contains(message), "{member}: {}", run.stderr);
        assert!(!output.exists());
    }
    let (run, _) = progressive.try_rebuild(&std::fs::read(&progressive.source).expect("the source"), None);
    assert!(run.code == Some(3) && run.stderr.contains("no mesh of the file is progressive"), "{}", run.stderr);
}

/// The GLB with another value at a place of its JSON.
fn edit_json(glb: &[u8], place: &str, value: Value) -> Vec<u8> {
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let mut json: Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
    *json.pointer_mut(place).unwrap_or_else(|| panic!("{place} is there")) = value;
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = (12 + 8 + text.len() + glb.len() - 20 - length) as u32;
    let header = [&glb[..8], &total.to_le_bytes(), &(text.len() as u32).to_le_bytes(), &glb[16..20]].concat();
    [&header, &text[..], &glb[20 + length..]].concat()
}

/// Damages copies of a file in many ways, the same at every run.
struct Damager {
    state: u64,
    directory: TempDir,
}

impl Damager {
    fn new() -> Self {
        Self { state: 1, directory: TempDir::new().expect("a temporary directory") }
    }

    /// A number below `end`.
    fn below(&mut self, end: usize) -> usize {
        self.state = self.state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.state >> 33) as usize % end
    }

    /// The bytes with up to four of them from `start` on changed.
    fn change(&mut self, bytes: &[u8], range: std::ops::Range<usize>) -> Vec<u8> {
        let mut damaged = bytes.to_vec();
        for _ in 0..=self.below(3) {
            let (at, bit) = (range.start + self.below(range.len()), self.below(8));
            damaged[at] ^= if bit % 2 == 0 { 1 << bit } else { 0xFF };
        }
        damaged
    }

    /// Whether the file is refused, by an error that names it; otherwise what comes of it is sound.
    fn is_refused(&self, bytes: &[u8]) -> bool {
        let [input, output] = ["part.glb", "rebuilt.glb"].map(|name| self.directory.path().join(name));
        std::fs::write(&input, bytes).expect("a writable directory");
        let (triangles, limits, jobs) = (None, Limits::default(), Some(1));
        match rebuild(&RebuildOptions { input, output: output.clone(), triangles, limits, jobs }) {
            Ok(report) => {
                let gltf = Gltf::open(&output);
                report.meshes.iter().for_each(|mesh| drop(gltf.mesh_triangles(mesh.mesh)));
                false
            }
            Err(error) => {
                assert!(error.to_string().contains("part.glb"), "{error}");
                assert!(error.kind != Kind::Internal, "{error}");
                true
            }
        }
    }
}

/// Where the JSON and where the records begin, in bytes of the file.
fn find_parts(bytes: &[u8], gltf: &Gltf) -> [usize; 2] {
    let json = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
    let meshes = gltf.list("meshes").iter();
    let chunks = meshes.flat_map(|mesh| items(&mesh["extensions"][EXTENSION]["chunks"]));
    let start = |chunk: &Value| {
        let view = &gltf.list("bufferViews")[maybe_index(&chunk["bufferView"]).expect("a view")];
        maybe_index(&view["byteOffset"]).unwrap_or(0)
    };
    [20, 28 + json + chunks.map(start).min().expect("chunks")]
}

/// The file with checksums by a name that no reader knows.
fn without_checksums(bytes: &[u8]) -> Vec<u8> {
    let mut unchecked = bytes.to_vec();
    for at in 0..bytes.len() - 7 {
        if &bytes[at..at + 7] == b"\"crc32\"" {
            unchecked[at + 5] = b'3';
        }
    }
    assert_ne!(unchecked, bytes);
    unchecked
}

#[test]
fn damage_anywhere_is_named_or_harmless() {
    let mut damager = Damager::new();
    for name in ["materials/two_primitives.glb", "skinned/skin_and_morph.glb", "nodes/shared_mesh.glb"] {
        let progressive = Progressive::fixture(name);
        let bytes = progressive.bytes();
        let [json, records] = find_parts(&bytes, &Gltf::open(&progressive.path()));
        let unchecked = without_checksums(&bytes);
        assert!(!damager.is_refused(&unchecked), "{name}");
        let mut refused = [0; 4];
        for _ in 0..100 {
            let damaged = [
                damager.change(&bytes, records..bytes.len()),
                damager.change(&unchecked, records..bytes.len()),
                damager.change(&unchecked, json..records),
                damager.change(&unchecked, 0..json),
            ];
            for (count, damaged) in refused.iter_mut().zip(damaged) {
                *count += usize::from(damager.is_refused(&damaged));
            }
        }
        // A checksum notices all; without it most changes of numbers give other numbers, but those of counts and references are noticed.
        assert_eq!(refused[0], 100, "{name}");
        assert!(refused[1..].iter().all(|count| *count > 10), "{name}: {refused:?}");
    }
}

#[test]
fn a_file_may_end_at_every_place() {
    let damager = Damager::new();
    let progressive = Progressive::fixture("attributes/custom.glb");
    let bytes = progressive.bytes();
    let [_, records] = find_parts(&bytes, &Gltf::open(&progressive.path()));
    // All of the header, then some of each part, the ends of parts and of records among them.
    let ends = (0..40).chain((40..records).step_by(101)).chain(records - 8..records);
    ends.for_each(|end| assert!(damager.is_refused(&bytes[..end]), "{end} of {records}"));
    let ends = (records..records + 60).chain((records + 60..bytes.len()).step_by(499));
    ends.for_each(|end| assert!(!damager.is_refused(&bytes[..end]), "{end} of {}", bytes.len()));
}

#[test]
fn what_cannot_be_progressive_goes_through_with_the_reason() {
    let Some(corpus) = directory_from("GLTF_LOD_CORPUS") else { return };
    let source = corpus.join("compressed/pirate/pirate.glb");
    let progressive = Progressive::of(&source);
    assert_eq!(progressive.meshes(), [0usize; 0]);
    let json = Gltf::open(&progressive.path()).json;
    assert_eq!(json["meshes"], Gltf::open(&source).json["meshes"]);
}

#[test]
fn wrong_paths_are_named() {
    let gear = fixtures().join("shapes/gear.glb");
    let directory = TempDir::new().expect("a temporary directory");
    let copy = directory.path().join("gear.glb");
    std::fs::copy(&gear, &copy).expect("a copy");
    for (output, base, named) in
        [("out.gltf", "0.1", ".glb"), ("gear.glb", "0.1", "is the input"), ("out.glb", "0", "(0, 1]")]
    {
        let output = directory.path().join(output);
        let arguments = ["progressive".as_ref(), copy.as_os_str(), "-o".as_ref(), output.as_os_str()];
        let run = support::run(&[&arguments[..], &["--base".as_ref(), base.as_ref()]].concat());
        assert_eq!(run.code, Some(2), "{}", run.stderr);
        assert!(run.stderr.contains(named), "{}", run.stderr);
    }
}

#[test]
fn the_same_bytes_come_out_for_any_number_of_threads() {
    let directory = TempDir::new().expect("a temporary directory");
    let source = fixtures().join("nodes/shared_mesh.glb");
    let make = |jobs: &str| {
        let output = directory.path().join(format!("{jobs}.glb"));
        let arguments = ["progressive".as_ref(), source.as_os_str(), "-o".as_ref(), output.as_os_str(), "-j".as_ref()];
        let run = support::run(&[&arguments[..], &[jobs.as_ref()]].concat());
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        std::fs::read(output).expect("the output")
    };
    assert!(make("1") == make("3"));
}

#[test]
fn the_javascript_decoder_agrees() {
    if node_is_missing() {
        return;
    }
    for name in [
        "materials/two_primitives.glb",
        "skinned/skin_and_morph.glb",
        "skinned/tentacle_eight_influences.glb",
        "storage/quantized_interleaved.glb",
        "attributes/custom.glb",
        "attributes/color_u8.glb",
        "storage/non_indexed_facets.glb",
        "foliage/plant.glb",
    ] {
        let progressive = Progressive::fixture(name);
        let (base, full) = progressive.counts();
        let meshes = progressive.meshes();
        // One mesh, so that the decoder's number is the file's.
        assert_eq!(meshes.len(), 1, "{name}");
        let counts: Vec<usize> = (0..=4).map(|step| base + (full - base) * step / 4).collect();
        let theirs = ask_decoder("progressive", &progressive.path(), &counts);
        let ours = counts.iter().flat_map(|&count| {
            progressive.rebuild(Some(count));
            ask_decoder("plain", &progressive.directory.path().join("rebuilt.glb"), &meshes)
        });
        assert_eq!(theirs, ours.collect::<Vec<_>>(), "{name}");
    }
}

#[test]
fn the_javascript_decoder_stands_beginnings_and_damage() {
    if node_is_missing() {
        return;
    }
    let progressive = Progressive::fixture("materials/two_primitives.glb");
    let refused = ask_decoder("damaged", &progressive.path(), &[]);
    assert_eq!(refused, ["records: all", "without checksums: some", "before them: some"]);
    let bytes = progressive.bytes();
    let part = progressive.directory.path().join("half.glb");
    std::fs::write(&part, &bytes[..bytes.len() / 2]).expect("a writable directory");
    let (run, output) = progressive.try_rebuild(&bytes[..bytes.len() / 2], None);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(
        ask_decoder("progressive", &part, &[usize::MAX >> 12]),
        ask_decoder("plain", &output, &progressive.meshes())
    );
}
