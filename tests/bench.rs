//! `gltf-lod bench`: what is measured, and how it is told. How fast anything is decides nothing here.

mod support;

use serde_json::Value;
use std::path::Path;
use support::{Run, fixtures, items, run};

fn bench(inputs: &[&Path], options: &str) -> Run {
    let mut arguments = vec!["bench".into()];
    arguments.extend(inputs.iter().map(|input| input.as_os_str().to_owned()));
    arguments.extend(options.split_whitespace().map(Into::into));
    run(&arguments)
}

fn quick(name: &str) -> String {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/quick.toml");
    format!("--config {} --effort fast --runs 1 {name}", config.display())
}

fn bench_json(file: &str, options: &str) -> Value {
    let run = bench(&[&fixtures().join(file)], &quick(&format!("--json {options}")));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    serde_json::from_str(&run.stdout).expect("JSON")
}

fn positive(value: &Value) -> f64 {
    value.as_f64().filter(|number| *number > 0.0).unwrap_or_else(|| panic!("{value} is no positive number"))
}

fn keys(value: &Value) -> String {
    value.as_object().expect("an object").keys().cloned().collect::<Vec<_>>().join(" ")
}

#[test]
fn positions_are_compared_with_plain_and_update() {
    let report = bench_json("attributes/positions_only.glb", "");
    assert_eq!(
        keys(&report),
        "tool version format levels preset algorithm effort threads summary meshes skipped problems"
    );
    assert_eq!(report["levels"], serde_json::json!([0.5, 0.25, 0.125, 0.0625]));
    let summary = &report["summary"];
    for key in [
        "chain_time_vs_meshopt_chained",
        "chain_wall_vs_meshopt_chained",
        "hausdorff_vs_meshopt",
        "rms_vs_meshopt",
        "normals_vs_meshopt",
        "triangles_per_second",
        "peak_bytes_per_vertex",
    ] {
        positive(&summary[key]);
    }
    assert!(summary["slivers"].as_f64().is_some_and(|share| (0.0..=1.0).contains(&share)));
    assert!(summary["attributes"].is_null() && summary["chain_time_vs_meshopt_attributes_chained"].is_null());
    let modes: Vec<_> = items(&summary["modes"]).iter().map(|mode| mode["mode"].as_str().expect("a name")).collect();
    assert_eq!(modes, ["gltf-lod", "plain", "plain chained", "update", "update chained"]);
    // Plain is the measure of everything; its chain that of time.
    assert_eq!(summary["modes"][1]["rms"], 1.0);
    assert_eq!(summary["modes"][2]["chain_time"], 1.0);

    let mesh = &report["meshes"][0];
    assert_eq!((items(&report["meshes"]).len(), &mesh["triangles"]), (1, &Value::from(2400)));
    // More than the levels take, less than a simplifier with pointers would.
    assert!((100.0..3000.0).contains(&positive(&mesh["ours"]["peak_bytes_per_vertex"])), "{mesh}");
    for times in std::iter::once(&mesh["ours"]).chain(items(&mesh["meshopt"])) {
        assert!(positive(&times["cpu"]) <= positive(&times["cpu_median"]), "{times}");
        assert!(positive(&times["wall"]) <= positive(&times["wall_median"]) && times["runs"] == 1, "{times}");
    }
    for (level, count) in items(&mesh["levels"]).iter().zip([1200, 600, 300, 150]) {
        let found = level["ours"]["triangles"].as_u64().expect("a count");
        assert!(found.abs_diff(count) <= 1, "{level}");
        for rival in items(&level["meshopt"]).iter().filter(|rival| rival["reached"] == true) {
            let theirs = rival["figures"]["triangles"].as_u64().expect("a count");
            assert!(theirs.abs_diff(found) <= found / 100 + 2, "{rival}");
            positive(&rival["figures"]["rms_percent"]);
        }
    }
    assert_eq!(items(&mesh["levels"]).len(), 4);
}

#[test]
fn attributes_bring_their_modes() {
    let report = bench_json("attributes/normals_and_seam.glb", "--levels 0.5,0.2");
    let summary = &report["summary"];
    assert_eq!((items(&summary["modes"]).len(), &summary["levels"]), (13, &Value::from(2)));
    positive(&summary["chain_time_vs_meshopt_attributes_chained"]);
    for reference in ["best_by_rms", "best_of_each"] {
        for column in ["hausdorff", "rms", "normals", "shading", "uv"] {
            positive(&summary["attributes"][reference][column]);
        }
    }
    let of_each = |column: &str| positive(&summary["attributes"]["best_of_each"][column]);
    let by_rms = |column: &str| positive(&summary["attributes"]["best_by_rms"][column]);
    assert!(of_each("uv") >= by_rms("uv") && of_each("shading") >= by_rms("shading"), "{summary}");
    assert_eq!(of_each("rms"), by_rms("rms"));
}

#[test]
fn directories_are_walked_and_what_has_no_levels_is_named() {
    let shapes = bench(&[&fixtures().join("shapes")], &quick("--quiet"));
    assert_eq!(shapes.code, Some(0), "{}", shapes.stderr);
    assert!(shapes.stdout.contains("gear.glb") && shapes.stdout.contains("thin_bowl.glb"), "{}", shapes.stdout);
    assert!(shapes.stdout.contains("cube.glb: mesh 0 left out: fewer than"), "{}", shapes.stdout);
    let is_too_wide = |line: &&str| line.chars().count() > 100;
    assert_eq!(shapes.stdout.lines().find(is_too_wide), None);
}

#[test]
fn text_fits_a_hundred_columns_with_all_levels() {
    let told = bench(&[&fixtures().join("attributes/tangents.glb")], &quick("-v")).stdout;
    assert!(told.contains("attr+permissive+update chained") && told.contains("gltf-lod (target)"), "{told}");
    assert_eq!(told.lines().find(|line| line.chars().count() > 100), None);
}

#[test]
fn bad_input_is_told_as_everywhere() {
    let place = tempfile::tempdir().expect("a temporary directory");
    let broken = place.path().join("broken.glb");
    std::fs::write(&broken, b"glTF, but not really").expect("a writable directory");
    let good = fixtures().join("shapes/gear.glb");
    let mixed = bench(&[&broken, &good], &quick("--json"));
    assert_eq!(mixed.code, Some(3));
    assert!(mixed.stderr.starts_with("error: ") && mixed.stderr.contains("broken.glb"), "{}", mixed.stderr);
    let report: Value = serde_json::from_str(&mixed.stdout).expect("JSON");
    assert_eq!((items(&report["meshes"]).len(), items(&report["problems"]).len()), (1, 1));

    let refused = |inputs: &[&Path], options: &str, named: &str| {
        let run = bench(inputs, options);
        assert!(run.code == Some(2) && run.stderr.contains(named), "{options}: {}", run.stderr);
    };
    refused(&[], "", "FILE");
    refused(&[Path::new("gone.glb")], "", "gone.glb");
    refused(&[&good], "--runs 0", "--runs");
    refused(&[&good], "--levels 0.5,0.7", "--levels");
    refused(&[&good], "--effort hasty", "hasty");
    refused(&[&good], "--algorithm magic", "magic");
    refused(&[&good, &good], "", "once");
}

#[test]
fn help_says_what_is_timed() {
    let help = run(&["bench", "--help"]).stdout;
    assert!(help.contains("--runs") && help.contains("chained") && help.contains("Exit codes:"), "{help}");
}
