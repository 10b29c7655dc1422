//! Every file of `tests/bad` costs that file only: one clear line, exit code 3, no output; good files go on.

mod support;

use std::path::{Path, PathBuf};
use support::{assets_below, build, directory_from, files_below, fixtures};
use tempfile::TempDir;

fn bad_files() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad")
}

#[test]
fn each_bad_file_gives_one_line_and_no_output() {
    let files = assets_below(&bad_files());
    assert!(files.len() >= 20, "{} bad files", files.len());
    for relative in files {
        expect_refused(&bad_files().join(relative));
    }
}

#[test]
fn good_files_beside_bad_ones_are_built() {
    let input = TempDir::new().expect("a temporary directory");
    copy_tree(&bad_files(), &input.path().join("bad"));
    let good = "storage/indices_u8.glb";
    std::fs::copy(fixtures().join(good), input.path().join("good.glb")).expect("a copy");
    let build = build(input.path(), &[]);
    assert_eq!(build.run.code, Some(3), "{}", build.run.stderr);
    let written = files_below(build.out.path());
    assert_eq!(written.keys().map(PathBuf::as_path).collect::<Vec<_>>(), [Path::new("good.glb")]);
    assert!(written[Path::new("good.glb")].len() > std::fs::read(fixtures().join(good)).expect("a fixture").len());
}

#[test]
fn a_missing_input_is_named() {
    let build = build(Path::new("no/such/directory"), &[]);
    assert!(matches!(build.run.code, Some(2 | 3)), "{:?}", build.run.code);
    assert!(build.run.stderr.contains("no/such/directory"), "{}", build.run.stderr);
}

#[test]
fn an_output_that_cannot_be_written_leaves_nothing_behind() {
    let directory = TempDir::new().expect("a temporary directory");
    let blocked = directory.path().join("out");
    std::fs::write(&blocked, "a file where a directory should be").expect("a writable file");
    let (input, out) = (fixtures().join("storage/indices_u8.glb"), blocked.as_os_str());
    let run = support::run(&["build".as_ref(), input.as_os_str(), "-o".as_ref(), out]);
    assert!(matches!(run.code, Some(2 | 3)), "{:?}: {}", run.code, run.stderr);
    assert!(run.stderr.contains("out"), "{}", run.stderr);
    assert_eq!(files_below(directory.path()).len(), 1);
}

#[test]
fn invalid_files_of_the_corpus_never_crash_the_tool() {
    let Some(corpus) = directory_from("GLTF_LOD_CORPUS") else { return };
    // The source of these is loadable: only warnings are right.
    let loadable =
        ["BoxBadNormals.glb", "zero-sized-bin-chunk-issue-440.glb", "Cube.gltf", "integer-out-of-bounds.gltf"];
    for relative in assets_below(&corpus.join("invalid")) {
        let file = corpus.join("invalid").join(&relative);
        if loadable.iter().any(|name| relative.ends_with(name)) {
            let build = build(&file, &[]);
            assert!(matches!(build.run.code, Some(0 | 3)), "{}: {}", relative.display(), build.run.stderr);
            continue;
        }
        expect_refused(&file);
    }
}

/// Exit code 3, one line on stderr that names the file and says more than that, nothing written.
fn expect_refused(file: &Path) {
    let build = build(file, &[]);
    let name = file.file_name().expect("a file").to_string_lossy();
    let lines: Vec<&str> = build.run.stderr.lines().filter(|line| !line.trim().is_empty()).collect();
    assert_eq!(build.run.code, Some(3), "{name}: {}", build.run.stderr);
    assert!(lines.len() == 1 && lines[0].contains(&*name), "{name}: {}", build.run.stderr);
    assert!(!build.run.stderr.contains("panicked"), "{name}: {}", build.run.stderr);
    assert!(files_below(build.out.path()).is_empty(), "{name}: something was written");
}

fn copy_tree(from: &Path, to: &Path) {
    for (relative, bytes) in files_below(from) {
        let target = to.join(relative);
        std::fs::create_dir_all(target.parent().expect("a directory")).expect("a writable directory");
        std::fs::write(target, bytes).expect("a writable file");
    }
}
