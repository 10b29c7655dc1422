//! Gates: figures of a level that a preset does not accept.

use crate::preset::{ErrorBound, Gates, Severity};
use crate::report::{BrokenGate, LevelReport, MeshReport};

/// The gates that the levels of `mesh` break.
pub(super) fn check_gates(mesh: &MeshReport, gates: &Gates) -> Vec<BrokenGate> {
    mesh.levels.iter().flat_map(|level| check_level(mesh, level, gates)).collect()
}

fn check_level(mesh: &MeshReport, level: &LevelReport, gates: &Gates) -> Vec<BrokenGate> {
    let mut broken = Vec::new();
    let mut check = |key: &'static str, what: &str, unit: &str, found: f64, limit: f64, severity: Severity| {
        if found <= limit {
            return;
        }
        let name = mesh.name.as_ref().map(|name| format!(" \"{name}\"")).unwrap_or_default();
        let rounded = (found * 1e4).round() / 1e4;
        let message =
            format!("mesh {}{name} level {}: {what} {rounded}{unit}, {key} = {limit}", mesh.mesh, level.level);
        let fails = severity == Severity::Fail;
        broken.push(BrokenGate { mesh: mesh.mesh, level: level.level, key, limit, found, fails, message });
    };
    match gates.max_error {
        Some((ErrorBound::Units(limit), severity)) => {
            check("gates.max_error", "largest error", "", level.error.hausdorff, limit, severity);
        }
        Some((ErrorBound::Percent(limit), severity)) => {
            check("gates.max_error", "largest error", " %", level.error.hausdorff_percent, limit, severity);
        }
        None => {}
    }
    // Unequal triangle counts say nothing about quality.
    let comparable = level.baseline.as_ref().filter(|baseline| baseline.reached);
    if let (Some((limit, severity)), Some(baseline)) = (gates.max_rms_vs_meshopt, comparable) {
        check("gates.max_rms_vs_meshopt", "RMS", " × meshoptimizer's", baseline.ratio.rms, limit, severity);
    }
    if let Some((limit, severity)) = gates.max_gap_edges {
        check("gates.max_gap_edges", "gap edges", "", level.gap_edges as f64, limit as f64, severity);
    }
    broken
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::{Distance, Measurement};
    use crate::report::{BaselineReport, TargetReport};
    use crate::simplify::{Refusals, Stop};

    /// A mesh with one level, 2 units off on a diagonal of 100, with 3 gap edges; meshoptimizer is half as far off.
    fn mesh(reached: bool) -> MeshReport {
        let away = |distance| Distance { max: distance, rms: distance, mean: distance };
        let measure = |distance| Measurement {
            diagonal: 100.0,
            to_level: away(distance),
            to_source: away(distance),
            gap_edges: 3,
            ..Measurement::default()
        };
        let target = TargetReport { ratio: None, triangles: None, error: None };
        let mut level = LevelReport::new(1, target, Stop::Target, Refusals::default(), &measure(2.0));
        level.baseline = Some(BaselineReport::new("plain".to_owned(), reached, &measure(1.0), &measure(2.0)));
        MeshReport { levels: vec![level], ..MeshReport::new(4, Some("Chair".to_owned()), 1, "height") }
    }

    fn broken(mesh: &MeshReport, gates: Gates) -> Vec<(f64, f64, bool)> {
        check_gates(mesh, &gates).iter().map(|gate| (gate.found, gate.limit, gate.fails)).collect()
    }

    #[test]
    fn each_gate_compares_in_its_own_unit() {
        let units = Gates { max_error: Some((ErrorBound::Units(1.5), Severity::Fail)), ..Gates::default() };
        assert_eq!(broken(&mesh(true), units), [(2.0, 1.5, true)]);
        let percent = Gates { max_error: Some((ErrorBound::Percent(1.0), Severity::Warn)), ..Gates::default() };
        assert_eq!(broken(&mesh(true), percent), [(2.0, 1.0, false)]);
        let gaps = Gates { max_gap_edges: Some((2, Severity::Warn)), ..Gates::default() };
        assert_eq!(broken(&mesh(true), gaps), [(3.0, 2.0, false)]);
        let equal = Gates { max_error: Some((ErrorBound::Percent(2.0), Severity::Fail)), ..Gates::default() };
        assert_eq!(broken(&mesh(true), equal), []);
    }

    #[test]
    fn unequal_counts_are_not_judged() {
        let gates = Gates { max_rms_vs_meshopt: Some((1.0, Severity::Fail)), ..Gates::default() };
        assert_eq!(broken(&mesh(true), gates), [(2.0, 1.0, true)]);
        assert_eq!(broken(&mesh(false), gates), []);
        let message = &check_gates(&mesh(true), &gates)[0].message;
        assert_eq!(message, "mesh 4 \"Chair\" level 1: RMS 2 × meshoptimizer's, gates.max_rms_vs_meshopt = 1");
    }
}
