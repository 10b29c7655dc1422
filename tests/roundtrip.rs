//! Outputs hold everything of their sources unchanged, and their levels keep the rules that real loaders have.

mod support;

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::LazyLock;
use support::difference::forbidden_differences;
use support::lod_rules::{level_ids, mesh_of, new_roots, violations};
use support::reader::Gltf;
use support::surface::open_edges;
use support::{
    Build, assets_below, build, build_shared, directory_from, files_below, fixtures, index, items, report_of, run,
};

/// Fixtures whose meshes must not get levels: too small, or with levels already.
const WITHOUT_NEW_LEVELS: [&str; 2] = ["shapes/cube.glb", "existing_lod/sphere.glb"];

/// All fixtures with their own settings, built once.
fn built_fixtures() -> &'static Build {
    static BUILD: LazyLock<Build> = LazyLock::new(|| build_shared("roundtrip", &fixtures(), &[]));
    assert_eq!(BUILD.run.code, Some(0), "{}", BUILD.run.stderr);
    &BUILD
}

#[test]
fn fixtures_keep_all_they_had_and_gain_valid_levels() {
    let build = built_fixtures();
    for relative in assets_below(&fixtures()) {
        let (source, output) = (Gltf::open(&fixtures().join(&relative)), Gltf::open(&build.out.path().join(&relative)));
        expect_sound(&relative, &source, &output);
        let wanted = !WITHOUT_NEW_LEVELS.iter().any(|name| relative == Path::new(name));
        assert_eq!(!new_roots(&source, &output).is_empty(), wanted, "{}", relative.display());
    }
}

#[test]
fn untouched_assets_and_resources_are_copied_byte_for_byte() {
    let build = built_fixtures();
    let (sources, outputs) = (files_below(&fixtures()), files_below(build.out.path()));
    for name in WITHOUT_NEW_LEVELS {
        assert!(outputs[Path::new(name)] == sources[Path::new(name)], "{name} changed");
    }
    let mut pictures = 0;
    for (relative, bytes) in sources.iter().filter(|(path, _)| path.extension().is_some_and(|e| e == "png")) {
        assert!(outputs.get(relative) == Some(bytes), "{} is missing or changed", relative.display());
        pictures += 1;
    }
    assert_eq!(pictures, 2);
    let readme = Path::new("README.md");
    assert!(sources.contains_key(readme) && !outputs.contains_key(readme), "files that are not glTF are left alone");
}

#[test]
fn progressive_layout_keeps_the_document() {
    let settings = tempfile::NamedTempFile::with_suffix(".toml").expect("a temporary file");
    std::fs::write(settings.path(), "layout = \"progressive\"\nsamples = 2000\n").expect("a writable file");
    let config = settings.path().to_str().expect("a UTF-8 path");
    let build = build(&fixtures(), &["--config", config]);
    assert_eq!(build.run.code, Some(0), "{}", build.run.stderr);
    for relative in assets_below(&fixtures()) {
        let (source, output) = (Gltf::open(&fixtures().join(&relative)), Gltf::open(&build.out.path().join(&relative)));
        assert_eq!(violations(&source, &output), [""; 0], "{}", relative.display());
        expect_equal_geometry(&relative, &source, &output);
    }
}

#[test]
fn levels_of_source_vertices_are_index_buffers_alone() {
    let settings = tempfile::NamedTempFile::with_suffix(".toml").expect("a temporary file");
    std::fs::write(settings.path(), "placement = \"subset\"\neffort = \"fast\"\nsamples = 2000\n")
        .expect("a writable file");
    let config = settings.path().to_str().expect("a UTF-8 path");
    let build = build(&fixtures(), &["--config", config]);
    assert_eq!(build.run.code, Some(0), "{}", build.run.stderr);
    let mut primitives = 0;
    for relative in assets_below(&fixtures()) {
        let (source, output) = (Gltf::open(&fixtures().join(&relative)), Gltf::open(&build.out.path().join(&relative)));
        expect_sound(&relative, &source, &output);
        let of_source: Vec<&Value> = source.list("meshes").iter().flat_map(|mesh| items(&mesh["primitives"])).collect();
        for mesh in &output.list("meshes")[source.list("meshes").len()..] {
            let triangles = |primitive: &&Value| primitive["mode"].as_u64().is_none_or(|mode| mode == 4);
            for level in items(&mesh["primitives"]).iter().filter(triangles) {
                let same = |key: &str, other: &Value| level[key] == other[key];
                let whole = of_source
                    .iter()
                    .any(|other| ["attributes", "targets", "material"].iter().all(|key| same(key, other)));
                assert!(whole, "{}: a level has vertices of its own", relative.display());
                let vertices = output.vertex_count(level);
                let indices = output.triangle_indices(level);
                assert!(
                    !indices.is_empty() && indices.iter().flatten().all(|&v| v < vertices),
                    "{}",
                    relative.display()
                );
                primitives += 1;
            }
        }
    }
    assert!(primitives > 80, "{primitives} primitives");
}

#[test]
fn a_second_run_keeps_the_levels_of_the_first() {
    let first = built_fixtures();
    let second = build(first.out.path(), &[]);
    assert_eq!(second.run.code, Some(0), "{}", second.run.stderr);
    assert!(files_below(first.out.path()) == files_below(second.out.path()), "levels were made of levels");
}

#[test]
fn a_dry_run_writes_nothing() {
    let build = build(&fixtures().join("storage"), &["--dry-run"]);
    assert_eq!(build.run.code, Some(0), "{}", build.run.stderr);
    assert!(files_below(build.out.path()).is_empty());
}

#[test]
fn one_file_is_built_like_a_directory() {
    let whole = built_fixtures();
    let single = build(&fixtures().join("shapes/gear.glb"), &[]);
    assert_eq!(single.run.code, Some(0), "{}", single.run.stderr);
    let built = files_below(single.out.path());
    assert_eq!(built.keys().map(|path| path.as_path()).collect::<Vec<_>>(), [Path::new("gear.glb")]);
    // The rules of fixtures/gltf-lod.toml reach up to the input root only: here that is the file's own directory.
    let triangles =
        |build: &Build, name: &str| report_of(&build.report, Path::new(name))["meshes"][0]["triangles"].clone();
    assert_eq!(triangles(whole, "shapes/gear.glb"), triangles(&single, "gear.glb"));
}

#[test]
fn outputs_can_be_inspected() {
    let relative = Path::new("skinned/bending_cylinder.glb");
    let file = built_fixtures().out.path().join(relative);
    let inspected = run(&["inspect".as_ref(), "--json".as_ref(), file.as_os_str()]);
    assert_eq!(inspected.code, Some(0), "{}", inspected.stderr);
    let inspected: serde_json::Value = serde_json::from_str(&inspected.stdout).expect("JSON");
    let levels = items(&inspected["lods"][0]["levels"]);
    let (source, output) = (Gltf::open(&fixtures().join(relative)), Gltf::open(&file));
    let root = new_roots(&source, &output)[0];
    assert_eq!(levels.len(), 1 + level_ids(&output, root).len());
}

#[test]
fn corpus_keeps_all_it_had_and_gains_valid_levels() {
    let Some(corpus) = directory_from("GLTF_LOD_CORPUS") else { return };
    for part in std::fs::read_dir(&corpus).expect("a readable corpus") {
        let part = part.expect("a readable corpus").path();
        if !part.is_dir() || part.ends_with("invalid") {
            continue;
        }
        let build = build(&part, &[]);
        assert_eq!(build.run.code, Some(0), "{}: {}", part.display(), build.run.stderr);
        for relative in assets_below(&part) {
            let output = build.out.path().join(&relative);
            if relative.ends_with("CubeWithLOD.gltf") {
                // Its buffer has no data, so that no reader can load it; it has levels and needs none.
                assert_eq!(std::fs::read(part.join(&relative)).ok(), std::fs::read(&output).ok());
                continue;
            }
            let (source, output) = (Gltf::open(&part.join(&relative)), Gltf::open(&output));
            expect_sound(&relative, &source, &output);
            expect_no_new_open_edges(&relative, &source, &output);
        }
    }
}

/// Closed surfaces stay closed, and borders have no more edges than before.
fn expect_no_new_open_edges(relative: &Path, source: &Gltf, output: &Gltf) {
    let count = |mesh: usize| open_edges(&output.mesh_triangles(mesh));
    let pairs = new_roots(source, output).into_iter().flat_map(|root| {
        level_ids(output, root).into_iter().map(move |id| (mesh_of(output, root), mesh_of(output, id)))
    });
    for (finest, level) in pairs.collect::<BTreeSet<_>>() {
        let (before, after) = (count(finest), count(level));
        assert!(after <= before, "{} meshes {finest} and {level}: {after} open edges of {before}", relative.display());
    }
}

fn expect_sound(relative: &Path, source: &Gltf, output: &Gltf) {
    assert_eq!(forbidden_differences(source, output), [""; 0], "{}", relative.display());
    assert_eq!(violations(source, output), [""; 0], "{}", relative.display());
}

/// Every accessor of the source holds the same numbers in the output.
fn expect_equal_geometry(relative: &Path, source: &Gltf, output: &Gltf) {
    for accessor in 0..source.list("accessors").len() {
        let (before, after) = (source.elements(accessor), output.elements(accessor));
        assert!(before == after, "{}: accessor {accessor} holds other numbers", relative.display());
    }
}

/// The `gltf` crate finds the triangles that the report names, in the source's mesh and in its levels.
#[test]
fn another_reader_finds_the_levels() {
    let build = built_fixtures();
    let mut levels_read = 0;
    for relative in assets_below(&fixtures()) {
        let output = build.out.path().join(&relative);
        // It reads neither quantised nor sparse positions, and no files with blanks in their names.
        let plain = output.extension().is_some_and(|e| e == "glb") && !relative.starts_with("storage");
        let Some(meshes) = report_of(&build.report, &relative)["meshes"].as_array().filter(|_| plain) else { continue };
        let bytes = std::fs::read(&output).expect("an output");
        let file = gltf::Gltf::from_slice_without_validation(&bytes).expect("a file that the crate parses");
        let triangles = |mesh: gltf::Mesh| -> usize {
            let indices = mesh.primitives().filter(|p| p.mode() == gltf::mesh::Mode::Triangles).map(|primitive| {
                let reader = primitive.reader(|_| file.blob.as_deref());
                let vertices = reader.read_positions().expect("positions").count();
                let indices: Vec<u32> = match reader.read_indices() {
                    Some(indices) => indices.into_u32().collect(),
                    None => (0..vertices as u32).collect(),
                };
                assert!(indices.iter().all(|&i| (i as usize) < vertices), "{}", relative.display());
                indices.len() / 3
            });
            indices.sum()
        };
        let found: Vec<usize> = file.meshes().map(triangles).collect();
        for level in meshes.iter().flat_map(|mesh| items(&mesh["levels"])) {
            assert!(found.contains(&index(&level["triangles"])), "{}: {level}", relative.display());
            levels_read += 1;
        }
    }
    assert!(levels_read > 40, "only {levels_read} levels were read");
}
