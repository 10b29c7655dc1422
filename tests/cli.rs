//! The command line as a build step meets it: exit codes, what is written, what is left alone.

mod support;

use serde_json::Value;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use support::{Run, files_below, fixtures, items, run};
use tempfile::TempDir;

/// A directory to play in: `in` holds a good asset.
struct Place {
    directory: TempDir,
}

impl Place {
    fn new() -> Self {
        let place = Self { directory: TempDir::new().expect("a temporary directory") };
        place.add("in/gear.glb", &fs::read(fixtures().join("shapes/gear.glb")).expect("a fixture"));
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    fn add(&self, name: &str, content: &[u8]) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().expect("a directory")).expect("a writable directory");
        fs::write(path, content).expect("a writable file");
    }

    fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Runs the tool in the directory.
    fn run(&self, arguments: &str) -> Run {
        let output = Command::new(env!("CARGO_BIN_EXE_gltf-lod"))
            .current_dir(self.directory.path())
            .args(arguments.split_whitespace())
            .output()
            .expect("the binary starts");
        let text = |bytes| String::from_utf8(bytes).expect("output is UTF-8");
        Run { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
    }

    /// Runs the tool and expects this exit code.
    fn expect(&self, code: i32, arguments: &str) -> Run {
        let run = self.run(arguments);
        assert_eq!(run.code, Some(code), "{arguments}\n{}\n{}", run.stdout, run.stderr);
        run
    }

    fn report(&self) -> Value {
        serde_json::from_slice(&self.read("report.json")).expect("the report is JSON")
    }
}

#[test]
fn wrong_usage_is_named_and_ends_with_2() {
    let place = Place::new();
    for (arguments, named) in [
        ("", "Usage"),
        ("build", "INPUT"),
        ("build in", "--output"),
        ("build gone -o out", "gone"),
        ("build in -o in", "--in-place"),
        ("build in/gear.glb -o in", "--in-place"),
        ("build in in -o out", "same output"),
        ("build in -o in/gear.glb", "not a directory"),
        ("build in -o out --preset mobil", "mobile"),
        ("build in -o out --levels 0.5,2", "2"),
        ("build in -o out --levels half", "half"),
        ("build in -o out --jobs 0", "1024"),
        ("build in -o out --config gone.toml", "gone.toml"),
        ("build in -o out --algorithm magic", "magic"),
        ("compare in", "in"),
    ] {
        let run = place.expect(2, arguments);
        assert!(run.stderr.contains(named), "{arguments}: {}", run.stderr);
    }
    assert_eq!(files_below(place.directory.path()).len(), 1, "nothing was written");
}

#[test]
fn a_wrong_preset_stops_the_run_before_anything_is_written() {
    let place = Place::new();
    place.add("in/deep/gltf-lod.toml", b"levls = [0.5]\n");
    place.add("in/deep/gear.glb", &place.read("in/gear.glb"));
    let run = place.expect(2, "build in -o out");
    assert!(run.stderr.contains("gltf-lod.toml") && run.stderr.contains("levels"), "{}", run.stderr);
    assert!(!place.path("out").exists());
}

#[test]
fn an_output_inside_the_input_is_no_input() {
    let place = Place::new();
    place.expect(0, "build in -o in/out -q");
    let first = files_below(&place.path("in"));
    place.expect(0, "build in -o in/out -q");
    assert!(files_below(&place.path("in")) == first);
    assert_eq!(first.into_keys().collect::<Vec<_>>(), [PathBuf::from("gear.glb"), PathBuf::from("out/gear.glb")]);
}

#[test]
fn a_file_of_the_working_directory_needs_no_path() {
    let place = Place::new();
    place.add("gear.glb", &place.read("in/gear.glb"));
    place.add("gltf-lod.toml", b"levels = [0.3]\n");
    place.expect(0, "build gear.glb -o out -q");
    let compared = place.expect(0, "compare gear.glb --json -q");
    let report: Value = serde_json::from_str(&compared.stdout).expect("JSON");
    assert_eq!(items(&report["meshes"][0]["levels"]).len(), 1, "the preset beside it holds");
    place.expect(0, "inspect gear.glb");
    place.expect(0, "bench gear.glb --runs 1");
    place.expect(0, "progressive gear.glb -o coarse.glb");
    place.expect(0, "rebuild coarse.glb -o fine.glb");
    place.expect(0, "build gear.glb --in-place -q");
    assert!(place.read("gear.glb") == place.read("out/gear.glb"));
}

#[test]
fn sources_change_only_when_that_is_asked_for() {
    let place = Place::new();
    let source = place.read("in/gear.glb");
    place.expect(2, "build in -o in");
    assert!(place.read("in/gear.glb") == source);
    place.expect(0, "build in --in-place -q");
    let built = place.read("in/gear.glb");
    assert!(built.len() > source.len());
    // Levels that are there are kept, so that nothing is left to do.
    place.expect(0, "build in -o in --in-place -q");
    assert!(place.read("in/gear.glb") == built);
}

#[test]
fn a_dry_run_tells_everything_and_writes_nothing() {
    let place = Place::new();
    let told = place.expect(0, "build in -o out --dry-run").stdout;
    assert!(told.contains("gear.glb") && told.contains("dry run"), "{told}");
    assert!(!place.path("out").exists());
}

#[test]
fn a_broken_file_costs_that_file_only() {
    let place = Place::new();
    place.add("in/a broken one.glb", b"glTF, but not really");
    place.add("in/empty.gltf", b"");
    let run = place.expect(3, "build in -o out --report report.json");
    let errors: Vec<&str> = run.stderr.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 2, "{}", run.stderr);
    assert!(errors[0].contains("a broken one.glb: ") && errors[1].contains("empty.gltf: "), "{errors:?}");
    assert_eq!(files_below(&place.path("out")).into_keys().collect::<Vec<_>>(), [PathBuf::from("gear.glb")]);
    let report = place.report();
    let status: Vec<_> =
        items(&report["files"]).iter().map(|file| file["status"].as_str().expect("a string")).collect();
    assert_eq!(status, ["failed", "failed", "levels"]);
    assert_eq!(report["files"][0]["errors"][0]["file"], "a broken one.glb");
}

#[test]
#[cfg(unix)]
fn a_directory_that_cannot_be_read_is_trouble_of_its_own() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let place = Place::new();
    symlink("gone", place.path("in/dangling.glb")).expect("a link");
    fs::create_dir(place.path("in/secret")).expect("a directory");
    fs::set_permissions(place.path("in/secret"), fs::Permissions::from_mode(0o000)).expect("permissions");
    let run = place.run("build in -o out");
    fs::set_permissions(place.path("in/secret"), fs::Permissions::from_mode(0o755)).expect("permissions");
    assert_eq!(run.code, Some(3), "{}", run.stderr);
    assert!(run.stderr.contains("dangling.glb"), "{}", run.stderr);
    assert!(place.path("out/gear.glb").exists());
}

#[test]
fn a_failed_gate_ends_with_1_and_a_warning_does_not() {
    let place = Place::new();
    let gate = |on: &str| format!("[gates]\nmax_error = {{ value = \"0.000001%\", on = \"{on}\" }}\n");
    place.add("strict.toml", gate("fail").as_bytes());
    place.add("mild.toml", gate("warn").as_bytes());
    let failed = place.expect(1, "build in -o out --config strict.toml --report report.json");
    assert!(failed.stdout.contains("gate FAILED") && failed.stdout.contains("max_error"), "{}", failed.stdout);
    assert!(place.path("out/gear.glb").exists());
    let gate = &place.report()["files"][0]["gates"][0];
    assert_eq!((&gate["key"], &gate["fails"]), (&Value::from("gates.max_error"), &Value::from(true)));
    assert!(gate["found"].as_f64() > gate["limit"].as_f64(), "{gate}");
    let quiet = place.expect(1, "build in -o out --config strict.toml -q");
    assert!(quiet.stdout.is_empty() && quiet.stderr.contains("max_error"), "{}", quiet.stderr);
    let warned = place.expect(0, "build in -o out --config mild.toml");
    assert!(warned.stdout.contains("gate warns"), "{}", warned.stdout);
}

#[test]
fn reports_are_reproducible_and_name_no_machine() {
    let place = Place::new();
    let mut reports = Vec::new();
    for jobs in [1, 2, 7] {
        place.expect(0, &format!("build in -o out --report report.json --no-times --jobs {jobs}"));
        reports.push(place.read("report.json"));
    }
    assert!(reports.windows(2).all(|pair| pair[0] == pair[1]));
    let text = String::from_utf8(reports.swap_remove(0)).expect("UTF-8");
    assert!(!text.contains(&*place.directory.path().to_string_lossy()));
    let keys = |value: &Value| value.as_object().expect("an object").keys().cloned().collect::<Vec<_>>().join(" ");
    let report: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(keys(&report), "tool version format dry_run totals problems files");
    let level = &report["files"][0]["meshes"][0]["levels"][0];
    assert_eq!(
        keys(level),
        "level target triangles vertices stop refusals error pixels_at_switch switch_in normal_deg normal_p95_deg shading_deg \
         uv_mean uv_p95 slivers5 slivers10 flipped degenerate nonmanifold_edges gap_edges posed baseline"
    );
    assert_eq!(keys(&level["error"]), "hausdorff rms mean hausdorff_percent rms_percent mean_percent");
    assert!(level["baseline"]["ratio"]["rms"].as_f64().is_some_and(|ratio| ratio > 0.0), "{level}");
    place.expect(0, "build in -o out --report report.json");
    assert!(place.report()["times"]["files"]["gear.glb"].as_f64().is_some());
}

#[test]
fn switches_show_the_tolerated_pixels() {
    let place = Place::new();
    place.expect(0, "build in -o out --report report.json -q");
    let report = place.report();
    let mesh = &report["files"][0]["meshes"][0];
    let levels = items(&mesh["levels"]);
    assert_eq!(items(&mesh["coverage"]).len(), levels.len() + 1);
    for (level, coverage) in levels.iter().zip(items(&mesh["coverage"])) {
        let (c, pixels) = (coverage.as_f64().expect("a number"), level["pixels_at_switch"].as_f64().expect("a number"));
        assert_eq!(level["switch_in"], *coverage);
        assert!(c > 0.0 && c <= 1.0 && pixels <= 1.0 + 1e-9, "{c} {pixels}");
    }
}

#[test]
fn other_files_are_copied_only_if_a_preset_asks_for_it() {
    let place = Place::new();
    place.add("in/licence.txt", b"free");
    place.add("in/notes/todo.md", b"much");
    place.expect(0, "build in -o out -q");
    assert_eq!(files_below(&place.path("out")).len(), 1);
    place.add("in/gltf-lod.toml", b"copy = [\"*.txt\"]\n");
    let told = place.expect(0, "build in -o out").stdout;
    assert!(told.contains("1 copied"), "{told}");
    assert_eq!(place.read("out/licence.txt"), b"free");
    assert!(!place.path("out/notes").exists() && !place.path("out/gltf-lod.toml").exists());
}

#[test]
fn inputs_that_bring_different_files_of_one_name_do_not_mix() {
    let place = Place::new();
    let asset = br#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"data.bin"}]}"#;
    place.add("a/one.gltf", asset);
    place.add("a/data.bin", b"aaaa");
    place.add("b/two.gltf", asset);
    place.add("b/data.bin", b"bbbb");
    let run = place.expect(3, "build a b -o out");
    assert!(run.stderr.contains("two.gltf: ") && run.stderr.contains("data.bin"), "{}", run.stderr);
    assert_eq!(
        files_below(&place.path("out")).into_keys().collect::<Vec<_>>(),
        ["data.bin", "one.gltf"].map(PathBuf::from)
    );
    assert_eq!(place.read("out/data.bin"), b"aaaa");
    // The same file under both names is no clash.
    place.add("b/data.bin", b"aaaa");
    fs::remove_file(place.path("b/two.gltf")).expect("removed");
    place.add("a/two.gltf", asset);
    place.expect(0, "build a/one.gltf a/two.gltf -o shared");
}

#[test]
fn init_writes_a_preset_that_works_and_does_not_overwrite_it() {
    let place = Place::new();
    place.expect(0, "init in");
    place.expect(0, "build in -o out -q");
    place.add("in/gltf-lod.toml", b"levels = [0.3]\n");
    let run = place.expect(2, "init in");
    assert!(run.stderr.contains("--force"), "{}", run.stderr);
    assert_eq!(place.read("in/gltf-lod.toml"), b"levels = [0.3]\n");
    place.expect(0, "init in --force");
    assert_ne!(place.read("in/gltf-lod.toml"), b"levels = [0.3]\n");
}

#[test]
fn presets_are_listed() {
    let listed = run(&["presets"]).stdout;
    for name in ["default", "mobile", "hero", "prop", "character", "terrain", "foliage"] {
        assert!(listed.lines().any(|line| line.starts_with(name)), "{name}: {listed}");
    }
}

#[test]
fn comparison_measures_both_at_equal_counts() {
    let place = Place::new();
    let compared = place.expect(0, "compare in/gear.glb --levels 0.5,0.2 --json -q");
    let compared: Value = serde_json::from_str(&compared.stdout).expect("JSON");
    let levels = items(&compared["meshes"][0]["levels"]);
    assert_eq!(levels.len(), 2);
    for level in levels.iter().filter(|level| level["baseline"]["reached"] == true) {
        let (ours, theirs) = (&level["triangles"], &level["baseline"]["triangles"]);
        let (ours, theirs) = (ours.as_u64().expect("a count"), theirs.as_u64().expect("a count"));
        assert!(ours.abs_diff(theirs) <= ours / 100 + 2, "{ours} against {theirs}");
    }
    let table = place.expect(0, "compare in/gear.glb -q").stdout;
    assert!(table.contains("geometric mean"), "{table}");
    assert!(table.lines().filter(|line| !line.contains("gate")).all(|line| line.chars().count() <= 100), "{table}");
    assert_eq!(files_below(place.directory.path()).len(), 1, "nothing was written");
}

#[test]
fn inspection_shows_levels_with_coverage_error_and_bytes() {
    let place = Place::new();
    place.expect(0, "build in -o out -q --report report.json");
    let inspected = place.expect(0, "inspect out/gear.glb --json");
    let inspected: Value = serde_json::from_str(&inspected.stdout).expect("JSON");
    let report = place.report();
    let reported = items(&report["files"][0]["meshes"][0]["levels"]);
    let levels = items(&inspected["lods"][0]["levels"]);
    assert_eq!(levels.len(), reported.len() + 1);
    for (level, reported) in levels[1..].iter().zip(reported) {
        assert_eq!(level["triangles"], reported["triangles"]);
        assert_eq!(level["error"], reported["error"]["hausdorff"]);
        assert!(level["bytes"].as_u64() < levels[0]["bytes"].as_u64());
    }
    let table = place.expect(0, "inspect out/gear.glb").stdout;
    assert!(table.contains("levels of node"), "{table}");
}

#[test]
fn text_fits_a_hundred_columns() {
    let out = TempDir::new().expect("a temporary directory");
    let told = run(&["build".as_ref(), fixtures().as_os_str(), "-o".as_ref(), out.path().as_os_str()]);
    // Names are as long as they are: tables have none.
    let is_table = |line: &&str| line.starts_with("  ") && !line.starts_with("    gate");
    let wide: Vec<&str> = told.stdout.lines().filter(is_table).filter(|line| line.chars().count() > 100).collect();
    assert_eq!(wide, [""; 0]);
    assert!(told.stdout.lines().last().is_some_and(|line| line.contains("files: ")), "{}", told.stdout);
}

#[test]
fn a_reader_that_has_seen_enough_is_no_failure() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_gltf-lod"))
        .args([OsStr::new("inspect"), fixtures().join("shapes/gear.glb").as_os_str(), OsStr::new("--json")])
        .stdout(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    drop(child.stdout.take());
    assert_eq!(child.wait().expect("it ends").code(), Some(0));
}

#[test]
fn lines_replace_bars_where_there_is_no_terminal() {
    let place = Place::new();
    let told = place.expect(0, "build in -o out").stderr;
    assert!(told.starts_with("[1/1] gear.glb: ") && told.lines().count() == 1, "{told:?}");
    let quiet = place.expect(0, "build in -o out -q");
    assert_eq!((quiet.stdout.as_str(), quiet.stderr.as_str()), ("", ""));
}

#[test]
fn help_teaches() {
    let help = run(&["build", "--help"]).stdout;
    assert!(help.contains("Examples:") && help.contains("Exit codes:"), "{help}");
    assert!(Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").is_dir());
}

#[test]
fn the_predictor_is_trained_again_bit_for_bit() {
    let place = Place::new();
    let told = place.expect(0, "train-w in/gear.glb --generated 1 --reductions 4 -o w.json --samples s.csv").stdout;
    assert!(told.contains("8 samples of 2 models") && told.contains("3-4-5"), "{told}");
    let weights: Value = serde_json::from_slice(&place.read("w.json")).expect("JSON");
    let command = "gltf-lod train-w in/gear.glb --generated 1 --reductions 4 --seed 1 -o w.json --samples s.csv";
    assert_eq!(weights["command"], command);
    let (first, samples) = (place.read("w.json"), place.read("s.csv"));
    place.expect(0, command.strip_prefix("gltf-lod ").expect("the command"));
    assert!(place.read("w.json") == first && place.read("s.csv") == samples);

    place.expect(0, "train-w --from-samples s.csv -o again.json -q");
    let again: Value = serde_json::from_slice(&place.read("again.json")).expect("JSON");
    assert!(again["net"] == weights["net"] && again["shape_net"] == weights["shape_net"]);

    place.add("bad.csv", &[&samples[..], b"gear,1,2,x\n"].concat());
    for (code, arguments, named) in [
        (2, "train-w -o w.json", "--generated"),
        (3, "train-w gone.glb -o w.json", "gone.glb"),
        (3, "train-w --from-samples bad.csv -o w.json", "line 10"),
        (2, "train-w --from-samples s.csv --generated 3 -o w.json", "cannot be used"),
    ] {
        let told = place.expect(code, arguments).stderr;
        assert!(told.contains(named), "{arguments}\n{told}");
    }
    assert!(place.read("w.json") == first, "what failed has written nothing");
}

#[test]
fn papers_are_compared_with_stand_ins_that_prove_nothing() {
    let place = Place::new();
    let told = place.expect(0, "papers --most-triangles 6000 --runs 1 -q").stdout;
    for part in ["cow (made)", "0.024733", "left out as too large: bunny", "not measured", "dragon (paper)"] {
        assert!(told.contains(part), "{part}\n{told}");
    }
    place.add("models/cow.glb", &place.read("in/gear.glb"));
    let found = place.expect(0, "papers --models models --most-triangles 6000 --runs 1 --json").stdout;
    let found: Value = serde_json::from_str(&found).expect("JSON");
    assert_eq!(found["speeds"][0]["subject"]["stands_in"], false);
    assert_eq!(found["qfvp"][0]["published"][2], 0.020492);
    let claims = items(&found["claims"]);
    assert!(claims.len() >= 10 && claims.iter().any(|claim| claim["holds"].is_boolean()), "{found}");
}
