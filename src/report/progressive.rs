//! What became of progressive meshes, as a model and as text.

use super::text::{add_row, indent, start_table};
use serde::Serialize;
use std::fmt::Write;

/// A file written with progressive meshes.
#[derive(Debug, Clone, Serialize)]
pub struct ProgressiveReport {
    /// The file written.
    pub file: String,
    /// Bytes of the source with its buffers and images.
    pub source_bytes: u64,
    /// Bytes written.
    pub written_bytes: u64,
    /// One for each mesh of the file.
    pub meshes: Vec<ProgressiveMeshReport>,
    /// What the user should know.
    pub notes: Vec<String>,
    /// What is odd about the source.
    pub warnings: Vec<String>,
}

/// A mesh of a file written with progressive meshes. Bytes are those of geometry alone, in the source's component types.
#[derive(Debug, Clone, Default, Serialize)]
pub struct ProgressiveMeshReport {
    /// Index into `meshes`.
    pub mesh: usize,
    /// Its name.
    pub name: Option<String>,
    /// Why it goes through unchanged, if it does.
    pub skipped: Option<String>,
    /// Triangles of the source.
    pub triangles: usize,
    /// Triangles of the base.
    pub base_triangles: usize,
    /// Number of records.
    pub records: usize,
    /// Bytes of the base.
    pub base_bytes: usize,
    /// Bytes of all records.
    pub record_bytes: usize,
    /// Bytes of the source's triangles as a plain mesh.
    pub source_bytes: usize,
    /// Bytes that levels of 50, 25 and 12.5 % take in addition to the source's.
    pub chain_bytes: usize,
}

/// A file rebuilt from progressive meshes.
#[derive(Debug, Clone, Serialize)]
pub struct RebuildReport {
    /// The file written.
    pub file: String,
    /// Bytes written.
    pub written_bytes: u64,
    /// Its progressive meshes.
    pub meshes: Vec<RebuiltMeshReport>,
    /// What the user should know.
    pub notes: Vec<String>,
    /// What is odd about the input.
    pub warnings: Vec<String>,
}

/// A mesh rebuilt from its base and records.
#[derive(Debug, Clone, Serialize)]
pub struct RebuiltMeshReport {
    /// Index into `meshes`.
    pub mesh: usize,
    /// Triangles of the base.
    pub base_triangles: usize,
    /// Triangles now.
    pub triangles: usize,
    /// Triangles of the full mesh.
    pub full_triangles: usize,
    /// Whether the file ended before the records did that were wanted.
    pub ended_early: bool,
}

/// The report for people: a table of sizes.
pub fn describe_progressive(report: &ProgressiveReport) -> String {
    let mut text = format!("{}: {} bytes, the source has {}\n", report.file, report.written_bytes, report.source_bytes);
    let heads = ["mesh", "triangles", "base", "records", "bytes", "B/record", "× source", "× source + 3 levels"];
    let mut table = start_table(&heads);
    let made: Vec<_> = report.meshes.iter().filter(|mesh| mesh.skipped.is_none()).collect();
    for mesh in &made {
        let bytes = mesh.base_bytes + mesh.record_bytes;
        let share = |of: usize| format!("{:.2}", bytes as f64 / of.max(1) as f64);
        let name = mesh.name.as_ref().map(|name| format!(" {name}")).unwrap_or_default();
        add_row(
            &mut table,
            &[
                format!("{}{name}", mesh.mesh),
                mesh.triangles.to_string(),
                mesh.base_triangles.to_string(),
                mesh.records.to_string(),
                bytes.to_string(),
                format!("{:.1}", mesh.record_bytes as f64 / mesh.records.max(1) as f64),
                share(mesh.source_bytes),
                share(mesh.source_bytes + mesh.chain_bytes),
            ],
        );
    }
    if !made.is_empty() {
        text += &indent(&table);
    }
    for mesh in &report.meshes {
        if let Some(why) = &mesh.skipped {
            _ = writeln!(text, "    mesh {} goes through unchanged: {why}", mesh.mesh);
        }
    }
    text + &list_notes(&report.notes)
}

/// The report for people: a line for each mesh.
pub fn describe_rebuild(report: &RebuildReport) -> String {
    let mut text = format!("{}: {} bytes\n", report.file, report.written_bytes);
    for mesh in &report.meshes {
        let early = if mesh.ended_early { "; the file ends before the records wanted" } else { "" };
        let (now, base, full) = (mesh.triangles, mesh.base_triangles, mesh.full_triangles);
        _ = writeln!(text, "    mesh {}: {now} triangles of {base} to {full}{early}", mesh.mesh);
    }
    text + &list_notes(&report.notes)
}

fn list_notes(notes: &[String]) -> String {
    notes.iter().map(|note| format!("    note: {note}\n")).collect()
}
