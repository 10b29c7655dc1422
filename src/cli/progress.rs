//! Progress on stderr: bars on a terminal, a line for each file elsewhere.

use gltf_lod::Observer;
use gltf_lod::report::{FileReport, Status};
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Shows how a run goes on, and keeps its time.
pub struct Progress {
    start: Instant,
    display: Display,
    files: AtomicUsize,
    files_done: AtomicUsize,
    triangles: AtomicU64,
}

enum Display {
    Quiet,
    Lines,
    Bars { all: MultiProgress, files: ProgressBar, mesh: ProgressBar },
}

impl Progress {
    /// Bars if stderr is a terminal.
    pub fn new(quiet: bool) -> Self {
        let display = match (quiet, std::io::stderr().is_terminal()) {
            (true, _) => Display::Quiet,
            (false, false) => Display::Lines,
            (false, true) => Display::start_bars(),
        };
        let (files, files_done, triangles) = Default::default();
        Self { start: Instant::now(), display, files, files_done, triangles }
    }

    /// Takes the bars away, so that what follows is printed below what is left.
    pub fn finish(&self) {
        if let Display::Bars { all, files, mesh } = &self.display {
            // A spinner that goes on turning would draw itself again.
            files.finish_and_clear();
            mesh.finish_and_clear();
            _ = all.clear();
        }
    }

    fn count_file(&self, bytes: u64, describe: impl FnOnce() -> String) {
        let done = self.files_done.fetch_add(1, Ordering::Relaxed) + 1;
        match &self.display {
            Display::Quiet => {}
            Display::Lines => write_line(&format!("[{done}/{}] {}", self.files.load(Ordering::Relaxed), describe())),
            Display::Bars { files, .. } => files.inc(bytes),
        }
        self.show_counts();
    }

    /// The position counts bytes: files differ in size by orders of magnitude, and the time left goes by what is left to read.
    fn show_counts(&self) {
        if let Display::Bars { files, .. } = &self.display {
            let triangles =
                self.triangles.load(Ordering::Relaxed) as f64 / self.start.elapsed().as_secs_f64().max(1e-3);
            let (done, total) = (self.files_done.load(Ordering::Relaxed), self.files.load(Ordering::Relaxed));
            files.set_message(format!("{done}/{total} files, {triangles:.0} triangles/s"));
        }
    }
}

impl Display {
    fn start_bars() -> Self {
        let all = MultiProgress::new();
        let files = all.add(ProgressBar::new(0));
        let mesh = all.add(ProgressBar::new_spinner());
        // The templates are constants; a broken one falls back to indicatif's own.
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {msg}, {eta} left") {
            files.set_style(style);
        }
        if let Ok(style) = ProgressStyle::with_template("{spinner} {wide_msg}") {
            mesh.set_style(style);
        }
        mesh.enable_steady_tick(Duration::from_millis(120));
        Self::Bars { all, files, mesh }
    }
}

impl Observer for Progress {
    fn found(&self, files: usize, bytes: u64) {
        self.files.store(files, Ordering::Relaxed);
        if let Display::Bars { files: bar, .. } = &self.display {
            bar.set_length(bytes);
        }
        self.show_counts();
    }

    fn asset_started(&self, path: &str) {
        if let Display::Bars { mesh, .. } = &self.display {
            mesh.set_message(path.to_owned());
        }
    }

    fn mesh_started(&self, path: &str, mesh: &str, triangles: usize) {
        if let Display::Bars { mesh: bar, .. } = &self.display {
            bar.set_message(format!("{path} {mesh} ({triangles} triangles)"));
        }
    }

    fn mesh_finished(&self, triangles: usize) {
        self.triangles.fetch_add(triangles as u64, Ordering::Relaxed);
        self.show_counts();
    }

    fn asset_finished(&self, report: &FileReport) {
        self.count_file(report.source_bytes, || format!("{}: {}", report.path, describe_status(report)));
    }

    fn asset_benched(&self, path: &str, bytes: u64) {
        self.count_file(bytes, || path.to_owned());
    }

    fn elapsed(&self) -> Option<Duration> {
        Some(self.start.elapsed())
    }
}

fn describe_status(report: &FileReport) -> String {
    let levels: usize = report.meshes.iter().map(|mesh| mesh.levels.len()).sum();
    let time = report.elapsed.map(|elapsed| format!(", {:.2} s", elapsed.as_secs_f64())).unwrap_or_default();
    match report.status {
        Status::Levels => format!("{levels} levels{time}"),
        Status::Unchanged => format!("unchanged{time}"),
        Status::Failed => "failed".to_owned(),
    }
}

/// Nothing can be done about a stderr that is closed.
pub fn write_line(line: &str) {
    _ = writeln!(std::io::stderr(), "{line}");
}
