//! The bench for people: a table of all meshes together, one line for each mesh.

use super::Figures;
use super::report::{BenchReport, MeshBench};
use super::summary::{ModeSummary, Ratios, Summary};
use crate::report::{add_row, count, indent, significant, start_table};
use std::fmt::Write;

/// The tables; with `all_levels` one of every level, too.
pub fn describe_bench(report: &BenchReport, all_levels: bool) -> String {
    let mut text = String::new();
    if !report.meshes.is_empty() {
        text += &tabulate_meshes(&report.meshes);
        if all_levels {
            report.meshes.iter().for_each(|mesh| text += &tabulate_levels(mesh));
        }
        text += &describe_modes(report);
        text += &describe_attributes(&report.summary);
    }
    for skipped in &report.skipped {
        _ = writeln!(text, "{}: mesh {} left out: {}", skipped.file, skipped.mesh, skipped.why);
    }
    text
}

fn tabulate_meshes(meshes: &[MeshBench]) -> String {
    let heads = ["tris", "cpu ms", "wall ms", "Mtri/s", "B/vertex", "cpu ×", "wall ×", "rms ×", "hausd. ×", ""];
    let mut table = start_table(&heads);
    for mesh in meshes {
        let alone = Summary::of(std::slice::from_ref(mesh));
        let ours = &mesh.ours;
        add_row(
            &mut table,
            &[
                mesh.triangles.to_string(),
                significant(ours.times.cpu * 1e3),
                significant(ours.times.wall * 1e3),
                significant(ours.triangles_per_second / 1e6),
                ours.peak_bytes_per_vertex.map_or("-".to_owned(), |bytes| format!("{bytes:.0}")),
                show(alone.chain_time_vs_meshopt_chained),
                show(alone.chain_wall_vs_meshopt_chained),
                show(alone.rms_vs_meshopt),
                show(alone.hausdorff_vs_meshopt),
                name_mesh(mesh),
            ],
        );
    }
    let title = "Chains of gltf-lod; × over meshoptimizer's: times over plain calls chained, distances over plain\n";
    title.to_owned() + &indent(&table)
}

fn name_mesh(mesh: &MeshBench) -> String {
    if mesh.mesh == 0 { mesh.file.clone() } else { format!("{} {}", mesh.file, mesh.mesh) }
}

fn tabulate_levels(mesh: &MeshBench) -> String {
    let mut table = start_table(&["triangles", "hausdorff %", "rms %", "normal °", "slivers %", "gaps", "by"]);
    let mut add = |figures: &Figures, by: String| {
        add_row(
            &mut table,
            &[
                figures.triangles.to_string(),
                significant(figures.hausdorff_percent),
                significant(figures.rms_percent),
                significant(figures.normal_deg),
                significant(figures.slivers10 * 100.0),
                figures.gap_edges.to_string(),
                by,
            ],
        );
    };
    for level in &mesh.levels {
        add(&level.ours, format!("{} ({})", env!("CARGO_PKG_NAME"), level.stop));
        for rival in &level.meshopt {
            add(&rival.figures, shorten(&rival.mode.name()) + if rival.reached { "" } else { " (count not reached)" });
        }
    }
    format!("{}\n{}", name_mesh(mesh), indent(&table))
}

fn describe_modes(report: &BenchReport) -> String {
    let summary = &report.summary;
    let columns = Columns { attributes: summary.attributes.is_some(), poses: summary.has_poses() };
    let mut heads = vec!["hausd.", "rms", "normals"];
    heads.extend(columns.heads());
    heads.extend(["slivers", "cpu", "wall", "by"]);
    let mut table = start_table(&heads);
    let is_partial = |mode: &ModeSummary| mode.ratios.levels < summary.levels;
    for mode in &summary.modes {
        let mut cells = show_ratios(&mode.ratios, columns);
        let star = if is_partial(mode) { "*" } else { "" };
        cells.extend([show(mode.chain_time), show(mode.chain_wall), shorten(&mode.mode) + star]);
        add_row(&mut table, &cells);
    }
    let levels: Vec<String> = report.levels.iter().map(ToString::to_string).collect();
    let mut text = format!(
        "gltf-lod and meshoptimizer's modes, geometric means over {}, levels {};\n\
         figures at equal counts over plain simplify's, times over its chained calls'; lower is better\n{}",
        count(summary.meshes, "mesh", "meshes"),
        levels.join(" "),
        indent(&table)
    );
    if summary.modes.iter().any(is_partial) {
        text += "  * without the levels at which it or plain simplify does not reach the count, or has no such mode\n";
    }
    text
}

/// Columns that not all meshes fill.
#[derive(Clone, Copy)]
struct Columns {
    attributes: bool,
    poses: bool,
}

impl Columns {
    fn heads(self) -> impl Iterator<Item = &'static str> {
        let attributes = if self.attributes { &["shading", "uv"][..] } else { &[] };
        let poses = if self.poses { &["posed hausd.", "posed rms"][..] } else { &[] };
        attributes.iter().chain(poses).copied()
    }
}

fn show_ratios(ratios: &Ratios, columns: Columns) -> Vec<String> {
    let mut cells = vec![show(ratios.hausdorff), show(ratios.rms), show(ratios.normals)];
    if columns.attributes {
        cells.extend([show(ratios.shading), show(ratios.uv)]);
    }
    if columns.poses {
        cells.extend([show(ratios.posed_hausdorff), show(ratios.posed_rms)]);
    }
    cells.push(ratios.slivers.map_or("-".to_owned(), |share| format!("{:.1} %", share * 100.0)));
    cells
}

fn describe_attributes(summary: &Summary) -> String {
    let Some(attributes) = &summary.attributes else { return String::new() };
    let columns = Columns { attributes: true, poses: summary.has_poses() };
    let mut heads = vec!["hausd.", "rms", "normals"];
    heads.extend(columns.heads());
    heads.extend(["slivers", "levels", "against"]);
    let mut table = start_table(&heads);
    for (ratios, name) in [
        (&attributes.best_by_rms, "the best by RMS, each level"),
        (&attributes.best_of_each, "the best of all, each column"),
    ] {
        let mut cells = show_ratios(ratios, columns);
        cells.extend([ratios.levels.to_string(), name.to_owned()]);
        add_row(&mut table, &cells);
    }
    let mut text = "gltf-lod relative to meshoptimizer's attribute modes\n".to_owned() + &indent(&table);
    _ = writeln!(
        text,
        "  time of the chain relative to simplifyWithAttributes chained: cpu {}, wall {}",
        show(summary.chain_time_vs_meshopt_attributes_chained),
        show(summary.chain_wall_vs_meshopt_attributes_chained)
    );
    text
}

fn show(ratio: Option<f64>) -> String {
    ratio.map_or("-".to_owned(), significant)
}

/// Names of modes are long where tables are wide.
fn shorten(mode: &str) -> String {
    mode.replace("attributes", "attr")
}
