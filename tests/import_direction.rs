//! The rooms of `src` may use each other in one direction only; this test reads the sources and holds them to it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// What each room may use of this crate. `error` is everybody's.
const ALLOWED: &[(&str, &[&str])] = &[
    ("error", &[]),
    ("mesh", &["tasks"]),
    ("bvh", &["lanes"]),
    ("lanes", &[]),
    ("tasks", &[]),
    ("curvature", &["lanes", "mesh", "tasks"]),
    // Attributes and simplifier are one level: the weights of attributes are options of the simplifier.
    ("attributes", &["curvature", "lanes", "mesh", "simplify"]),
    ("random", &[]),
    ("predictor", &["curvature", "mesh", "random"]),
    ("shapes", &["mesh", "random"]),
    ("measure", &["bvh", "mesh", "random"]),
    ("progressive", &["mesh"]),
    ("simplify", &["attributes", "bvh", "curvature", "lanes", "mesh", "predictor", "progressive", "tasks"]),
    ("meshoptimizer", &["mesh"]),
    ("baseline", &["measure", "mesh", "meshoptimizer"]),
    ("asset", &["mesh", "meshoptimizer"]),
    ("emit", &["asset", "mesh", "meshoptimizer", "progressive"]),
    ("preset", &["emit", "simplify"]),
    ("discover", &[]),
    ("coverage", &["preset"]),
    ("report", &["measure", "predictor", "simplify"]),
    ("bench", &["asset", "baseline", "measure", "mesh", "pipeline", "preset", "report", "simplify"]),
    (
        "pipeline",
        &[
            "asset",
            "baseline",
            "coverage",
            "discover",
            "emit",
            "measure",
            "mesh",
            "predictor",
            "preset",
            "progressive",
            "random",
            "report",
            "shapes",
            "simplify",
        ],
    ),
];

/// The room of a source file: the first part of its path below `src`.
fn room_of(path: &Path) -> String {
    let first = path.components().next().expect("a file has a name");
    first.as_os_str().to_string_lossy().trim_end_matches(".rs").to_owned()
}

fn sources() -> Vec<(PathBuf, String)> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let files = walkdir::WalkDir::new(&src).sort_by_file_name();
    let files = files.into_iter().map(|entry| entry.expect("src is readable").into_path());
    let is_test = |path: &Path| path.iter().any(|part| part == "tests" || part == "tests.rs");
    let rust = files.filter(|path| {
        path.extension().is_some_and(|ext| ext == "rs") && !is_test(path.strip_prefix(&src).unwrap_or(path))
    });
    let read = |path: PathBuf| {
        let text = fs::read_to_string(&path).expect("sources are UTF-8");
        (path.strip_prefix(&src).expect("below src").to_owned(), text)
    };
    let found: Vec<_> = rust.map(read).collect();
    assert!(found.len() > 10, "the sources were not found");
    found
}

/// What the crate's root passes on from `error`.
const ERRORS: &[&str] = &["error", "Error", "Kind", "Result"];

/// Code without line comments and without the unit tests at the end of a file, which may use what they like.
fn code_of(text: &str) -> String {
    let before_tests = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or(text);
    let lines = before_tests.lines().map(|line| line.split("//").next().unwrap_or(line));
    lines.collect::<Vec<_>>().join("\n")
}

/// The rooms named after `crate::`, also in a group: `crate::{error::Error, mesh}`.
fn rooms_used(code: &str) -> BTreeSet<String> {
    let name = |text: &str| -> String { text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect() };
    let mut rooms = BTreeSet::new();
    for rest in code.split("crate::").skip(1) {
        let Some(group) = rest.strip_prefix('{') else {
            rooms.insert(name(rest));
            continue;
        };
        let mut depth = 0;
        let mut at_start = true;
        for (index, symbol) in group.char_indices() {
            match symbol {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => at_start = true,
                _ if at_start && !symbol.is_whitespace() => {
                    rooms.insert(name(&group[index..]));
                    at_start = false;
                }
                _ => {}
            }
        }
    }
    rooms
}

/// `path: what` for every source outside `exempt` whose code holds one of `words`.
fn files_with(words: &[&str], exempt: &[&str]) -> Vec<String> {
    let mut found = Vec::new();
    for (path, text) in sources().iter().filter(|(path, _)| !exempt.contains(&room_of(path).as_str())) {
        let code = code_of(text);
        found.extend(
            words.iter().filter(|word| code.contains(**word)).map(|word| format!("{}: {word}", path.display())),
        );
    }
    found
}

#[test]
fn the_scan_sees_every_way_to_name_a_room() {
    let code = "use crate::error::Error;\nuse crate::{mesh::{Mesh, Skin}, simplify};\nlet x = crate::emit::write();";
    assert_eq!(rooms_used(code), ["emit", "error", "mesh", "simplify"].map(str::to_owned).into());
}

#[test]
fn rooms_import_in_one_direction() {
    let allowed: BTreeMap<&str, &[&str]> = ALLOWED.iter().copied().collect();
    let mut wrong = Vec::new();
    for (path, text) in sources() {
        let room = room_of(&path);
        let used = rooms_used(&code_of(&text));
        if room == "lib" {
            continue;
        }
        // The program is another crate: it reaches the library by its name.
        let rooms = if room == "main" || room == "cli" {
            &["cli"][..]
        } else {
            allowed.get(room.as_str()).copied().unwrap_or(&[])
        };
        let refused = used
            .iter()
            .filter(|name| **name != room && !ERRORS.contains(&name.as_str()) && !rooms.contains(&name.as_str()));
        wrong.extend(refused.map(|name| format!("{} uses {name}", path.display())));
    }
    assert_eq!(wrong, Vec::<String>::new());
}

/// A room's top file would reach the crate's root, past the scan above, by `super::`; a file one deeper by `super::super::`.
#[test]
fn no_room_is_left_through_super() {
    let mut wrong = Vec::new();
    for (path, text) in sources() {
        let is_top = path.components().count() == 1 || path.ends_with("mod.rs") && path.components().count() == 2;
        let way_out = if is_top { "super::" } else { "super::super::" };
        if code_of(&text).contains(way_out) {
            wrong.push(path.display().to_string());
        }
    }
    assert_eq!(wrong, Vec::<String>::new());
}

#[test]
fn every_room_has_a_place_in_the_table() {
    let known = |room: &str| ["lib", "main", "cli"].contains(&room) || ALLOWED.iter().any(|(name, _)| *name == room);
    let unknown: BTreeSet<String> =
        sources().iter().map(|(path, _)| room_of(path)).filter(|room| !known(room)).collect();
    assert_eq!(unknown, BTreeSet::new());
}

#[test]
fn only_the_command_line_prints() {
    let words = ["println!", "print!(", "dbg!", "std::io::stdout", "std::io::stderr", "io::stdout()", "io::stderr()"];
    assert_eq!(files_with(&words, &["cli"]), Vec::<String>::new());
}

#[test]
fn only_the_command_line_reads_clock_and_environment() {
    assert_eq!(files_with(&["Instant::now", "SystemTime", "std::env::", "env::var"], &["cli"]), Vec::<String>::new());
}

#[test]
fn crates_of_the_command_line_stay_there() {
    assert_eq!(
        files_with(&["anyhow", "indicatif", "clap", "cpu_time", "peakmem_alloc"], &["cli"]),
        Vec::<String>::new()
    );
}

#[test]
fn one_door_leads_to_meshoptimizer() {
    assert_eq!(
        files_with(&["meshopt::", "unsafe {", "unsafe fn", "allow(unsafe_code)"], &["meshoptimizer"]),
        Vec::<String>::new()
    );
}

#[test]
fn only_emit_edits_documents() {
    let words = ["document.push", "document.set", "document.patch", "document.root_mut"];
    assert_eq!(files_with(&words, &["emit", "asset"]), Vec::<String>::new());
}
