//! Who writes which file, when assets of several input directories share one output directory.

use crate::asset::{Asset, Limits};
use crate::discover::Source;
use crate::error::{Error, Kind};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A file that an asset brings along: where it goes, and where it comes from.
type Claim = (PathBuf, PathBuf);

/// The assets (by index) whose external buffers or images would overwrite other files of the same name; the first asset keeps its own.
///
/// One input directory mirrors itself, so nothing can clash; only runs with several have to look.
pub(super) fn find_clashes(assets: &[Source], limits: &Limits) -> BTreeMap<usize, Error> {
    let roots: BTreeSet<&Path> = assets.iter().map(|source| source.root.as_path()).collect();
    if roots.len() < 2 {
        return BTreeMap::new();
    }
    let claims: Vec<Vec<Claim>> = assets.par_iter().map(|source| list_claims(source, limits)).collect();
    let mut owners: BTreeMap<PathBuf, PathBuf> = BTreeMap::new();
    let mut clashes = BTreeMap::new();
    for (index, claims) in claims.into_iter().enumerate() {
        let clash = claims.iter().find(|(output, source)| owners.get(output).is_some_and(|owner| owner != source));
        match clash {
            Some((output, source)) => {
                _ = clashes.insert(index, describe_clash(output, source, &owners[output], &assets[index]))
            }
            None => owners.extend(claims),
        }
    }
    clashes
}

/// An asset that cannot be read claims nothing; it fails later, with its own error.
fn list_claims(source: &Source, limits: &Limits) -> Vec<Claim> {
    let Ok(asset) = Asset::read(&source.path, &source.root, limits) else { return Vec::new() };
    let beside = |file: &Path, relative: &Path| crate::discover::resolve(&file.with_file_name("").join(relative));
    let claim = |relative: &PathBuf| (beside(&source.output, relative), beside(&source.path, relative));
    asset.resources.iter().map(|resource| claim(&resource.relative)).collect()
}

fn describe_clash(output: &Path, source: &Path, owner: &Path, asset: &Source) -> Error {
    let message = format!("{} and {} would both be written to {}", owner.display(), source.display(), output.display());
    Error::new(Kind::Io, message)
        .in_file(&asset.path)
        .help("build the input directories into separate output directories")
}
