//! The room as a whole.

mod errors;
mod hashing;
mod layering;
mod properties;
mod shipped;

use super::*;
use crate::Error;
use std::fs;
use std::path::Path;

/// Writes `files` into a fresh directory.
fn directory(files: &[(&str, &str)]) -> tempfile::TempDir {
    let root = tempfile::tempdir().unwrap();
    for (path, text) in files {
        let path = root.path().join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    root
}

fn read_with(flags: &Flags, files: &[(&str, &str)], asset: &str) -> Result<AssetPresets, Error> {
    let root = directory(files);
    Presets::new(flags)?.for_asset(root.path(), Path::new(asset))
}

fn read(files: &[(&str, &str)], asset: &str) -> AssetPresets {
    read_with(&Flags::default(), files, asset).unwrap_or_else(|error| panic!("{error}"))
}

fn settings(files: &[(&str, &str)], asset: &str) -> Settings {
    read(files, asset).settings(&MeshNames::default()).unwrap()
}

fn mesh(name: &str) -> MeshNames<'_> {
    MeshNames { mesh: Some(name), ..MeshNames::default() }
}

/// Place and picture of the error in a file.
fn error_in(text: &str) -> (String, String) {
    let error = read_with(&Flags::default(), &[(FILE_NAME, text)], "a.glb")
        .and_then(|presets| presets.settings(&MeshNames::default()))
        .expect_err(text);
    assert_eq!(error.kind, crate::Kind::Preset);
    assert!(error.file.unwrap().ends_with(FILE_NAME));
    (error.place.unwrap(), error.message)
}

fn ratios(settings: &Settings) -> Vec<f64> {
    settings.levels.iter().filter_map(|level| level.ratio).collect()
}
