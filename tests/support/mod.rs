//! What the integration tests share: running the tool, and a glTF reader that owes nothing to the product's.

#![allow(dead_code)] // Every test binary uses its part.

pub mod awkward;
pub mod difference;
pub mod lod_rules;
pub mod projection;
pub mod reader;
pub mod surface;

use serde_json::Value;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// A finished run of the tool.
pub struct Run {
    /// Exit code; `None` if a signal ended it.
    pub code: Option<i32>,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

/// A finished `build` with its output tree and report.
pub struct Build {
    /// The run.
    pub run: Run,
    /// Its output directory.
    pub out: Directory,
    /// The `--report`; null if none was written.
    pub report: Value,
}

/// A directory that is deleted with this value, if it is a temporary one.
pub enum Directory {
    /// Temporary.
    Own(TempDir),
    /// Kept, below `target`, so that a build can be shared by the tests of a binary.
    Shared(PathBuf),
}

impl Directory {
    /// Where it is.
    pub fn path(&self) -> &Path {
        match self {
            Self::Own(directory) => directory.path(),
            Self::Shared(path) => path,
        }
    }
}

/// `fixtures/` of the repository.
pub fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures")
}

/// The directory that an environment variable names. Says so when it is unset: such tests are skipped.
pub fn directory_from(variable: &str) -> Option<PathBuf> {
    let directory = std::env::var_os(variable).map(PathBuf::from);
    if directory.is_none() {
        println!("skipped: {variable} is not set");
    }
    directory
}

/// Runs the tool.
pub fn run<A: AsRef<OsStr>>(arguments: &[A]) -> Run {
    let output = Command::new(env!("CARGO_BIN_EXE_gltf-lod")).args(arguments).output().expect("the binary starts");
    let text = |bytes| String::from_utf8(bytes).expect("output is UTF-8");
    Run { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// Builds `input` into a fresh directory, quietly, with a report and few samples.
pub fn build(input: &Path, options: &[&str]) -> Build {
    build_into(Directory::Own(TempDir::new().expect("a temporary directory")), input, options)
}

/// The same into a directory below `target` that goes by `name`.
pub fn build_shared(name: &str, input: &Path, options: &[&str]) -> Build {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if path.exists() {
        std::fs::remove_dir_all(&path).expect("a directory of an earlier run");
    }
    build_into(Directory::Shared(path), input, options)
}

fn build_into(out: Directory, input: &Path, options: &[&str]) -> Build {
    let report = tempfile::NamedTempFile::new().expect("a temporary file");
    let quick = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/quick.toml");
    let mut arguments = vec![OsStr::new("build"), input.as_os_str(), OsStr::new("-o"), out.path().as_os_str()];
    arguments.extend([OsStr::new("--quiet"), OsStr::new("--report"), report.path().as_os_str()]);
    if !options.contains(&"--config") {
        arguments.extend([OsStr::new("--config"), quick.as_os_str()]);
    }
    arguments.extend(options.iter().map(OsStr::new));
    let run = run(&arguments);
    let report = std::fs::read(report.path()).ok().and_then(|text| serde_json::from_slice(&text).ok());
    Build { run, out, report: report.unwrap_or(Value::Null) }
}

/// The `.glb` and `.gltf` files below `directory`, relative, sorted.
pub fn assets_below(directory: &Path) -> Vec<PathBuf> {
    let is_asset = |path: &PathBuf| path.extension().is_some_and(|e| e == "glb" || e == "gltf");
    files_below(directory).into_keys().filter(is_asset).collect()
}

/// All files below `directory`, relative, with their bytes.
pub fn files_below(directory: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let entries = walkdir::WalkDir::new(directory).into_iter().map(|entry| entry.expect("a readable directory"));
    let files = entries.filter(|entry| entry.file_type().is_file());
    files
        .map(|entry| {
            let relative = entry.path().strip_prefix(directory).expect("walked paths start with it").to_owned();
            (relative, std::fs::read(entry.path()).expect("a readable file"))
        })
        .collect()
}

/// The report's entry for the asset at `relative`.
pub fn report_of<'a>(report: &'a Value, relative: &Path) -> &'a Value {
    let name = relative.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/");
    let files = report["files"].as_array().expect("the report lists files");
    files.iter().find(|file| file["path"] == name.as_str()).unwrap_or_else(|| panic!("{name} is not in the report"))
}

/// A number of a JSON value that must be there.
pub fn index(value: &Value) -> usize {
    value.as_u64().and_then(|n| usize::try_from(n).ok()).unwrap_or_else(|| panic!("{value} is no index"))
}

/// An optional number of a JSON value.
pub fn maybe_index(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|n| usize::try_from(n).ok())
}

/// An array, empty when absent.
pub fn items(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}
