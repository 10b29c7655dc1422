//! The same inputs give the same bytes, whatever the number of threads.

mod support;

use serde_json::Value;
use std::path::Path;
use support::{Build, build, files_below, fixtures};

#[test]
fn outputs_and_report_do_not_depend_on_threads() {
    expect_same_bytes(&fixtures(), &["1", "2", "7", "2"]);
}

#[test]
fn a_large_mesh_does_not_depend_on_threads() {
    let Some(corpus) = support::directory_from("GLTF_LOD_CORPUS") else { return };
    expect_same_bytes(&corpus.join("skinned/mannequiny"), &["1", "2", "7"]);
}

fn expect_same_bytes(input: &Path, jobs: &[&str]) {
    let builds: Vec<Build> = jobs.iter().map(|jobs| build(input, &["--jobs", jobs])).collect();
    let first = files_below(builds[0].out.path());
    assert!(!first.is_empty(), "{}", builds[0].run.stderr);
    for (build, jobs) in builds.iter().zip(jobs) {
        assert_eq!(build.run.code, Some(0), "{}", build.run.stderr);
        let other = files_below(build.out.path());
        assert!(first.keys().eq(other.keys()), "other files with --jobs {jobs}");
        for (path, bytes) in &first {
            assert!(bytes == &other[path], "{} differs with --jobs {jobs}", path.display());
        }
        assert_eq!(without_times(&builds[0].report), without_times(&build.report), "report with --jobs {jobs}");
    }
}

fn without_times(report: &Value) -> Value {
    let mut report = report.clone();
    let object = report.as_object_mut().expect("a report was written");
    object.remove("times").expect("the report has times");
    report
}
