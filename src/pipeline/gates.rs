//! Gates: figures of a level that a preset does not accept.

use crate::preset::{ErrorBound, Gates, Severity};
use crate::report::{BrokenGate, LevelReport, MeshReport};

/// The gates that the levels of `mesh` break.
pub(super) fn check_gates(mesh: &MeshReport, gates: &Gates) -> Vec<BrokenGate> {
    mesh.levels.iter().flat_map(|level| check_level(mesh, level, gates)).collect()
}

fn check_level(mesh: &MeshReport, level: &LevelReport, gates: &Gates) -> Vec<BrokenGate> {
    let mut broken = Vec::new();
    let mut check = |key: &'static str, found: f64, limit: f64, severity: Severity, what: String| {
        if found <= limit {
            return;
        }
        let name = mesh.name.as_ref().map(|name| format!(" \"{name}\"")).unwrap_or_default();
        let message = format!("level {} of mesh {}{name}: {what}; the preset's {key} sets this", level.level, mesh.mesh);
        let fails = severity == Severity::Fail;
        broken.push(BrokenGate { mesh: mesh.mesh, level: level.level, key, limit, found, fails, message });
    };
    if let Some((bound, severity)) = gates.max_error {
        let (found, limit, unit) = match bound {
            ErrorBound::Units(units) => (level.error.hausdorff, units, "units"),
            ErrorBound::Percent(percent) => (level.error.hausdorff_percent, percent, "% of the diagonal"),
        };
        let what = format!("largest error {found:.4} {unit}, allowed {limit}");
        check("gates.max_error", found, limit, severity, what);
    }
    // Unequal triangle counts say nothing about quality.
    let comparable = level.baseline.as_ref().filter(|baseline| baseline.reached);
    if let (Some((limit, severity)), Some(baseline)) = (gates.max_rms_vs_meshopt, comparable) {
        let found = baseline.ratio.rms;
        let what = format!("RMS error {found:.3} × meshoptimizer's, allowed {limit}");
        check("gates.max_rms_vs_meshopt", found, limit, severity, what);
    }
    if let Some((limit, severity)) = gates.max_gap_edges {
        let what = format!("{} open gap edges, allowed {limit}", level.gap_edges);
        check("gates.max_gap_edges", level.gap_edges as f64, limit as f64, severity, what);
    }
    broken
}
