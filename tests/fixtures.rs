//! The committed fixtures are what their generator makes, byte for byte, and nothing else lies among them.

#[path = "../examples/make_fixtures/main.rs"]
mod make_fixtures;

use std::collections::BTreeSet;
use std::path::Path;

/// Written by hand: they have no generator.
const BY_HAND: [&str; 2] = ["README.md", "gltf-lod.toml"];

#[test]
fn generator_reproduces_the_committed_bytes() {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let mut expected: BTreeSet<_> = BY_HAND.iter().map(|name| directory.join(name)).collect();
    for (name, bytes) in make_fixtures::files() {
        let path = directory.join(name);
        let committed = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert!(committed == bytes, "{} differs: run `cargo run --example make_fixtures`", path.display());
        expected.insert(path);
    }
    let entries = walkdir::WalkDir::new(&directory).into_iter().map(|entry| entry.expect("a readable directory"));
    let files = entries.filter(|entry| entry.file_type().is_file()).map(walkdir::DirEntry::into_path);
    assert_eq!(files.collect::<BTreeSet<_>>(), expected);
}
