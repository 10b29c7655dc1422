//! The committed fixtures and broken files are what their generator makes, byte for byte, and nothing else lies among them.

#[path = "../examples/make_fixtures/main.rs"]
mod make_fixtures;

use std::collections::BTreeSet;
use std::path::Path;

/// Written by hand: they have no generator.
const BY_HAND: [&str; 2] = ["fixtures/README.md", "fixtures/gltf-lod.toml"];

#[test]
fn generator_reproduces_the_committed_bytes() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut expected: BTreeSet<_> = BY_HAND.iter().map(|name| root.join(name)).collect();
    let mut found = BTreeSet::new();
    for (directory, files) in make_fixtures::directories() {
        let directory = root.join(directory);
        for (name, bytes) in files {
            let path = directory.join(name);
            let committed = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            assert!(committed == bytes, "{} differs: run `cargo run --example make_fixtures`", path.display());
            expected.insert(path);
        }
        let entries = walkdir::WalkDir::new(&directory).into_iter().map(|entry| entry.expect("a readable directory"));
        found.extend(entries.filter(|entry| entry.file_type().is_file()).map(walkdir::DirEntry::into_path));
    }
    assert_eq!(found, expected);
}
