//! Writes the assets of `fixtures/`: `cargo run --example make_fixtures`.
//!
//! Every file is made from formulas, so that it may be used for anything (CC0), and its bytes are the same on every
//! machine: `tests/fixtures.rs` compares them with the committed ones.

mod assets;
mod builder;
mod deforming;
mod png;
mod portable;
mod scenes;
mod shape;
mod storage;
mod surfaces;

use std::path::Path;

/// A file to write, with its path below `fixtures/`.
pub type File = (&'static str, Vec<u8>);

/// All fixtures.
pub fn files() -> Vec<File> {
    [assets::files(), deforming::files(), storage::files(), scenes::files()].concat()
}

#[allow(dead_code)] // The test includes this file for `files` only.
fn main() -> std::io::Result<()> {
    for (name, bytes) in files() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent)?;
        }
        std::fs::write(path, bytes)?;
    }
    Ok(())
}
