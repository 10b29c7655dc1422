//! The report for people: a table for each file, one line for the run.

use super::model::{BrokenGate, FileReport, LevelReport, MeshReport, Ratio, RefusalCounts, Report, Status};
use comfy_table::{Cell, CellAlignment, Table, presets};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Duration;

const UNEQUAL: &str =
    "    * meshoptimizer did not reach the triangle count; its figures are for the count it stopped at\n";

/// How much the text tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// A file's meshes summed up for each level.
    Files,
    /// Every mesh, and all notes.
    Meshes,
}

/// The summary of a run: its files, then one line.
pub fn describe_run(report: &Report, detail: Detail) -> String {
    let mut text = String::new();
    for file in &report.files {
        text += &describe_file(file, detail);
        text.push('\n');
    }
    text + &describe_totals(report)
}

/// One file: a line, and a table of its levels.
pub fn describe_file(file: &FileReport, detail: Detail) -> String {
    let mut text = describe_heading(file);
    match detail {
        Detail::Files => text += &tabulate_levels(&file.meshes.iter().collect::<Vec<_>>()),
        Detail::Meshes => {
            for mesh in file.meshes.iter().filter(|mesh| !mesh.levels.is_empty()) {
                _ = writeln!(text, "  {}, {} triangles", name_mesh(mesh), mesh.triangles);
                text += &tabulate_levels(&[mesh]);
            }
        }
    }
    text += &describe_remarks(file, detail);
    text
}

/// Ours against meshoptimizer at equal triangle counts: a table for each mesh, then the geometric means.
pub fn describe_comparison(file: &FileReport) -> String {
    let mut text = describe_heading(file);
    for mesh in file.meshes.iter().filter(|mesh| !mesh.levels.is_empty()) {
        _ = writeln!(text, "  {}, {} triangles; ours / meshoptimizer's", name_mesh(mesh), mesh.triangles);
        text += &tabulate_comparison(mesh);
    }
    text += &describe_remarks(file, Detail::Meshes);
    match Ratio::geometric_mean(file.meshes.iter().flat_map(|mesh| &mesh.levels)) {
        Some(ratio) => {
            _ = writeln!(
                text,
                "geometric mean of ours over meshoptimizer's: RMS {}, Hausdorff {}",
                significant(ratio.rms),
                significant(ratio.hausdorff)
            );
        }
        None => text += "nothing to compare at equal triangle counts\n",
    }
    text
}

fn describe_heading(file: &FileReport) -> String {
    let meshes = file.meshes.iter().filter(|mesh| !mesh.levels.is_empty());
    let triangles: usize = meshes.clone().map(|mesh| mesh.triangles).sum();
    let what = match file.status {
        Status::Levels => format!("{}, {triangles} triangles", count(meshes.count(), "mesh", "meshes")),
        Status::Unchanged => "unchanged".to_owned(),
        Status::Failed => "FAILED".to_owned(),
    };
    let time = file.elapsed.map(|elapsed| format!(", {}", seconds(elapsed))).unwrap_or_default();
    format!("{}: {what}{time}\n", file.path)
}

/// A row for each level over all of `meshes` that have it.
fn tabulate_levels(meshes: &[&MeshReport]) -> String {
    let deepest = meshes.iter().map(|mesh| mesh.levels.len()).max().unwrap_or(0);
    if deepest == 0 {
        return String::new();
    }
    let heads =
        ["level", "triangles", "error %", "error units", "rms ×mo", "hausd. ×mo", "gaps", "coverage", "stopped by"];
    let mut table = start_table(&heads);
    let mut unequal = false;
    for index in 0..deepest {
        let levels: Vec<&LevelReport> = meshes.iter().filter_map(|mesh| mesh.levels.get(index)).collect();
        unequal |= levels.iter().any(|level| is_unequal(level));
        add_row(&mut table, &describe_level(index + 1, &levels));
    }
    let mut text = indent(&table);
    if unequal {
        text += UNEQUAL;
    }
    text
}

fn describe_level(number: usize, levels: &[&LevelReport]) -> [String; 9] {
    let worst = levels.iter().max_by(|a, b| a.error.hausdorff_percent.total_cmp(&b.error.hausdorff_percent));
    let error = worst.map(|level| level.error).unwrap_or_default();
    let star = if levels.iter().any(|level| is_unequal(level)) { "*" } else { "" };
    let ratio =
        Ratio::geometric_mean(levels.iter().copied()).or_else(|| Some(levels.first()?.baseline.as_ref()?.ratio));
    let show = |pick: fn(Ratio) -> f64| ratio.map_or("-".to_owned(), |r| format!("{}{star}", significant(pick(r))));
    [
        number.to_string(),
        levels.iter().map(|level| level.triangles).sum::<usize>().to_string(),
        significant(error.hausdorff_percent),
        significant(error.hausdorff),
        show(|r| r.rms),
        show(|r| r.hausdorff),
        levels.iter().map(|level| level.gap_edges).sum::<usize>().to_string(),
        describe_range(levels.iter().map(|level| level.switch_in)),
        describe_stops(levels),
    ]
}

fn tabulate_comparison(mesh: &MeshReport) -> String {
    let heads = ["level", "triangles", "rms %", "hausdorff %", "normal °", "gaps", "rms ×", "hausd. ×", ""];
    let mut settings: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    let mut table = start_table(&heads);
    for level in &mesh.levels {
        let Some(theirs) = &level.baseline else { continue };
        let star = if theirs.reached { "" } else { "*" };
        settings.entry(theirs.settings.as_str()).or_default().push(level.level.to_string());
        add_row(
            &mut table,
            &[
                level.level.to_string(),
                describe_counts(level.triangles, theirs.triangles),
                pair(level.error.rms_percent, theirs.error.rms_percent),
                pair(level.error.hausdorff_percent, theirs.error.hausdorff_percent),
                pair(level.normal_deg, theirs.normal_deg),
                format!("{} / {}", level.gap_edges, theirs.gap_edges),
                significant(theirs.ratio.rms),
                significant(theirs.ratio.hausdorff),
                star.to_owned(),
            ],
        );
    }
    let mut text = indent(&table) + &tabulate_poses(mesh);
    for (name, levels) in settings {
        _ = writeln!(text, "    meshoptimizer's best, level {}: {name}", levels.join(", "));
    }
    if mesh.levels.iter().any(is_unequal) {
        text += UNEQUAL;
    }
    text
}

/// The same in poses; nothing without any.
fn tabulate_poses(mesh: &MeshReport) -> String {
    let mut table = start_table(&["level", "poses", "posed rms %", "posed hausdorff %", ""]);
    let mut rows = 0;
    for level in &mesh.levels {
        let theirs = level.baseline.as_ref().and_then(|baseline| baseline.posed);
        let Some((ours, theirs)) = level.posed.zip(theirs) else { continue };
        let cells = [
            level.level.to_string(),
            ours.poses.to_string(),
            pair(ours.rms_percent, theirs.rms_percent),
            pair(ours.hausdorff_percent, theirs.hausdorff_percent),
            String::new(),
        ];
        add_row(&mut table, &cells);
        rows += 1;
    }
    if rows > 0 { indent(&table) } else { String::new() }
}

fn pair(ours: f64, theirs: f64) -> String {
    format!("{} / {}", significant(ours), significant(theirs))
}

fn describe_counts(ours: usize, theirs: usize) -> String {
    if ours == theirs { ours.to_string() } else { format!("{ours} / {theirs}") }
}

fn describe_remarks(file: &FileReport, detail: Detail) -> String {
    let mut text = String::new();
    let mut remark = |line: String| _ = writeln!(text, "    {line}");
    for (why, meshes) in group_skipped(&file.meshes) {
        remark(format!("{} without levels: {why}", count(meshes, "mesh", "meshes")));
    }
    match detail {
        Detail::Files => describe_worst_gates(&file.gates).into_iter().for_each(&mut remark),
        Detail::Meshes => file.gates.iter().map(describe_gate).for_each(&mut remark),
    }
    if detail == Detail::Meshes {
        file.notes.iter().for_each(|note| remark(format!("note: {note}")));
        for mesh in &file.meshes {
            mesh.notes.iter().for_each(|note| remark(format!("note: {}: {note}", name_mesh(mesh))));
            let dropped = mesh.dropped.iter();
            dropped.for_each(|level| {
                remark(format!("note: {}: level {} dropped: {}", name_mesh(mesh), level.requested, level.why))
            });
        }
    }
    text
}

/// One line for each gate: the level that breaks it most.
fn describe_worst_gates(gates: &[BrokenGate]) -> Vec<String> {
    let mut by_key: BTreeMap<(bool, &str), Vec<&BrokenGate>> = BTreeMap::new();
    gates.iter().for_each(|gate| by_key.entry((!gate.fails, gate.key)).or_default().push(gate));
    let describe = |gates: Vec<&BrokenGate>| {
        let worst = gates.iter().max_by(|a, b| a.found.total_cmp(&b.found))?;
        let more = if gates.len() > 1 { format!(" (and {} more)", gates.len() - 1) } else { String::new() };
        Some(describe_gate(worst) + &more)
    };
    by_key.into_values().filter_map(describe).collect()
}

fn describe_gate(gate: &BrokenGate) -> String {
    format!("gate {}: {}", if gate.fails { "FAILED" } else { "warns" }, gate.message)
}

fn group_skipped(meshes: &[MeshReport]) -> BTreeMap<&str, usize> {
    let mut groups = BTreeMap::new();
    for why in meshes.iter().filter_map(|mesh| mesh.skipped.as_deref()) {
        *groups.entry(why).or_default() += 1;
    }
    groups
}

fn describe_totals(report: &Report) -> String {
    let totals = &report.totals;
    let mut parts = vec![format!(
        "{}: {} with levels, {} unchanged, {} failed",
        count(totals.files, "file", "files"),
        totals.with_levels,
        totals.unchanged,
        totals.failed
    )];
    if totals.copied > 0 {
        parts.push(format!("{} copied", totals.copied));
    }
    if totals.levels > 0 {
        parts.push(format!("{}, {}", count(totals.levels, "level", "levels"), count(totals.gap_edges, "gap", "gaps")));
    }
    if let Some(ratio) = totals.vs_meshopt {
        let (rms, hausdorff) = (significant(ratio.rms), significant(ratio.hausdorff));
        parts.push(format!("vs meshoptimizer (mo): RMS ×{rms}, Hausdorff ×{hausdorff}"));
    }
    if totals.gates_failed + totals.gates_warned > 0 {
        parts.push(format!("gates: {} failed, {} warned", totals.gates_failed, totals.gates_warned));
    }
    parts.extend(report.elapsed.map(seconds));
    if report.dry_run {
        parts.push("dry run: nothing written".to_owned());
    }
    parts.join(" · ") + "\n"
}

fn describe_stops(levels: &[&LevelReport]) -> String {
    let [level] = levels else {
        let stuck = levels.iter().filter(|level| level.stop == "stuck").count();
        return if stuck > 0 { format!("{stuck} of {} stuck", levels.len()) } else { String::new() };
    };
    match level.stop {
        "stuck" => describe_refusals(&level.refusals),
        "target" => String::new(),
        other => other.to_owned(),
    }
}

/// What refused most is what a user can change.
fn describe_refusals(refusals: &RefusalCounts) -> String {
    let RefusalCounts { link, flip, needle, border, seam } = *refusals;
    let mut causes = [("link", link), ("flip", flip), ("needle", needle), ("border", border), ("seam", seam)];
    causes.sort_by_key(|&(_, times)| std::cmp::Reverse(times));
    let most: Vec<_> = causes.iter().filter(|(_, times)| *times > 0).take(2).map(|(cause, _)| *cause).collect();
    if most.is_empty() { "stuck".to_owned() } else { format!("stuck: {}", most.join(", ")) }
}

fn describe_range(values: impl Iterator<Item = f64> + Clone) -> String {
    let low = values.clone().fold(f64::INFINITY, f64::min);
    let high = values.fold(0.0, f64::max);
    if low == high { significant(high) } else { format!("{}..{}", significant(low), significant(high)) }
}

fn is_unequal(level: &LevelReport) -> bool {
    level.baseline.as_ref().is_some_and(|baseline| !baseline.reached)
}

pub(super) fn name_mesh(mesh: &MeshReport) -> String {
    match &mesh.name {
        Some(name) => format!("mesh {} \"{name}\"", mesh.mesh),
        None => format!("mesh {}", mesh.mesh),
    }
}

pub(crate) fn count(number: usize, one: &str, many: &str) -> String {
    format!("{number} {}", if number == 1 { one } else { many })
}

fn seconds(elapsed: Duration) -> String {
    format!("{:.2} s", elapsed.as_secs_f64())
}

/// Three significant digits.
pub(crate) fn significant(value: f64) -> String {
    let magnitude = value.abs();
    if value == 0.0 {
        "0".to_owned()
    } else if !(1e-4..1e6).contains(&magnitude) {
        format!("{value:.2e}")
    } else {
        let decimals = (2 - magnitude.log10().floor() as i32).max(0) as usize;
        format!("{value:.decimals$}")
    }
}

pub(crate) fn start_table(heads: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_preset(presets::NOTHING);
    add_row(&mut table, &heads.iter().map(ToString::to_string).collect::<Vec<_>>());
    table
}

/// The last column is words, all others are numbers.
pub(crate) fn add_row(table: &mut Table, cells: &[String]) {
    let last = cells.len().saturating_sub(1);
    let align = |(index, text): (usize, &String)| {
        Cell::new(text).set_alignment(if index == last { CellAlignment::Left } else { CellAlignment::Right })
    };
    table.add_row(cells.iter().enumerate().map(align).collect::<Vec<_>>());
}

pub(crate) fn indent(table: &Table) -> String {
    table.lines().map(|line| format!("  {}\n", line.trim_end())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_show_three_digits() {
        let shown = [0.0, 0.00123456, 0.5, 12.3456, 123.456, 12345.6, 0.0000123456, 2.5e9].map(significant);
        assert_eq!(shown, ["0", "0.00123", "0.500", "12.3", "123", "12346", "1.23e-5", "2.50e9"]);
    }

    #[test]
    fn the_worst_level_speaks_for_its_gate() {
        let gate = |key, found, fails| BrokenGate {
            mesh: 0,
            level: 1,
            key,
            limit: 1.0,
            found,
            fails,
            message: format!("{key} {found}"),
        };
        let gates = [gate("rms", 2.0, false), gate("gaps", 3.0, true), gate("rms", 4.0, false)];
        assert_eq!(describe_worst_gates(&gates), ["gate FAILED: gaps 3", "gate warns: rms 4 (and 1 more)"]);
    }
}
