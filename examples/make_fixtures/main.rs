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

use std::path::{Path, PathBuf};

/// A file to write, with its path below `fixtures/`.
pub type File = (&'static str, Vec<u8>);

/// All fixtures.
pub fn files() -> Vec<File> {
    [assets::files(), deforming::files(), storage::files(), scenes::files()].concat()
}

#[allow(dead_code)] // The test includes this file for `files` only.
fn main() -> std::io::Result<()> {
    let target = std::env::args_os()
        .nth(1)
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures"), PathBuf::from);
    for (path, bytes) in files() {
        let path = target.join(path);
        std::fs::create_dir_all(path.parent().unwrap_or(&target))?;
        std::fs::write(path, bytes)?;
    }
    Ok(())
}
