//! The library's face for programs: no printing, no clock, one bug costs one asset.

mod support;

use gltf_lod::report::{FileReport, Outcome, Status};
use gltf_lod::{BuildOptions, Kind, Observer, Unobserved, build};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use support::{files_below, fixtures};

fn options(out: &std::path::Path) -> BuildOptions {
    BuildOptions { inputs: vec![fixtures().join("materials")], output: Some(out.to_owned()), ..BuildOptions::default() }
}

#[test]
fn a_bug_costs_one_asset() {
    struct Broken;
    impl Observer for Broken {
        fn mesh_started(&self, path: &str, _mesh: &str, _triangles: usize) {
            assert!(path != "variants.glb", "an invariant broke");
        }
    }
    let out = tempfile::tempdir().expect("a temporary directory");
    let report = build(&options(out.path()), &Broken).expect("the run goes on");
    let status: Vec<_> = report.files.iter().map(|file| (file.path.as_str(), file.status)).collect();
    assert_eq!(status, [("two_primitives.glb", Status::Levels), ("variants.glb", Status::Failed)]);
    let error = &report.files[1].errors[0].error;
    assert!(error.kind == Kind::Internal && error.message.contains("an invariant broke"), "{error}");
    assert_eq!(report.outcome(), Outcome::Trouble);
    assert_eq!(files_below(out.path()).len(), 1);
}

#[test]
fn an_observer_sees_the_run_and_brings_the_clock() {
    #[derive(Default)]
    struct Log {
        lines: Mutex<Vec<String>>,
        triangles: AtomicUsize,
        ticks: AtomicUsize,
    }
    impl Log {
        fn note(&self, line: String) {
            self.lines.lock().expect("no poison").push(line);
        }
    }
    impl Observer for Log {
        fn found(&self, files: usize, bytes: u64) {
            assert!(bytes > 0);
            self.note(format!("found {files}"));
        }
        fn asset_started(&self, path: &str) {
            self.note(format!("start {path}"));
        }
        fn mesh_finished(&self, triangles: usize) {
            self.triangles.fetch_add(triangles, Ordering::Relaxed);
        }
        fn asset_finished(&self, report: &FileReport) {
            self.note(format!("end {}", report.path));
        }
        fn elapsed(&self) -> Option<Duration> {
            Some(Duration::from_secs(self.ticks.fetch_add(1, Ordering::Relaxed) as u64))
        }
    }
    let out = tempfile::tempdir().expect("a temporary directory");
    let log = Log::default();
    let report = build(&BuildOptions { jobs: Some(1), dry_run: true, ..options(out.path()) }, &log).expect("a report");
    let lines = log.lines.into_inner().expect("no poison");
    assert_eq!(
        lines,
        ["found 2", "start two_primitives.glb", "end two_primitives.glb", "start variants.glb", "end variants.glb"]
    );
    assert_eq!(log.triangles.into_inner(), report.totals.source_triangles);
    assert_eq!(report.files[0].elapsed, Some(Duration::from_secs(1)));
    assert_eq!(report.elapsed, Some(Duration::from_secs(5)));
}

#[test]
fn without_a_clock_there_are_no_times() {
    let out = tempfile::tempdir().expect("a temporary directory");
    let report = build(&BuildOptions { dry_run: true, ..options(out.path()) }, &Unobserved).expect("a report");
    assert!(report.elapsed.is_none());
    assert!(!gltf_lod::report::to_json(&report, true).contains("\"times\""));
}
