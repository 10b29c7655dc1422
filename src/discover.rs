//! Which files a run is about: inputs → assets, other files, and where each one's output goes.
//!
//! The order is that of the inputs, sorted by name within each: the same on every machine.

use crate::error::{Error, Kind, Result};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};
use walkdir::{DirEntry, WalkDir};

/// Where the results go.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Destination {
    /// Below this directory, in the shape of the input tree.
    Directory(PathBuf),
    /// Below this directory, which may be an input: sources are overwritten.
    DirectoryInPlace(PathBuf),
    /// Beside each source, which is overwritten.
    Sources,
}

/// A file of the inputs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// The file, as reached from the input given.
    pub path: PathBuf,
    /// The input directory; for an input that is a file, the directory it lies in.
    pub root: PathBuf,
    /// The file relative to `root`, and its output relative to the destination.
    pub relative: PathBuf,
    /// The file that is written for it.
    pub output: PathBuf,
    /// Its size in bytes.
    pub bytes: u64,
}

/// What the inputs hold.
#[derive(Debug, Default)]
pub struct Found {
    /// Files named `.glb` or `.gltf`, whatever the case.
    pub assets: Vec<Source>,
    /// All other files.
    pub others: Vec<Source>,
    /// Directories and links that could not be read; everything else is there.
    pub troubles: Vec<Error>,
}

/// Finds the files of `inputs` (files or directories). Directory links are followed once: a loop is not entered. A destination
/// inside an input is left out.
///
/// # Errors
/// [`Kind::Preset`] for usage errors: an input that is missing, a destination that would overwrite a source, two sources with the same
/// output.
pub fn discover(inputs: &[PathBuf], destination: &Destination) -> Result<Found> {
    check_destination(inputs, destination)?;
    let mut found = Found::default();
    for input in inputs {
        let kind = std::fs::metadata(input).map_err(|source| refuse_missing(input, &source))?;
        if kind.is_dir() {
            walk(input, destination, &mut found);
        } else {
            add_file(input, kind.len(), destination, &mut found)?;
        }
    }
    refuse_shared_outputs(&found.assets)?;
    if matches!(destination, Destination::Directory(_)) {
        refuse_overwriting(&found)?;
    }
    Ok(found)
}

/// Whether a file is a glTF asset by its name.
pub fn is_asset(path: &Path) -> bool {
    let is = |ext: &OsStr| ext.eq_ignore_ascii_case("glb") || ext.eq_ignore_ascii_case("gltf");
    path.extension().is_some_and(is)
}

fn refuse_missing(input: &Path, source: &std::io::Error) -> Error {
    Error { file: Some(input.to_owned()), ..Error::new(Kind::Preset, format!("cannot read this input: {source}")) }
        .help("give a .glb or .gltf file, or a directory")
}

fn check_destination(inputs: &[PathBuf], destination: &Destination) -> Result<()> {
    let (Destination::Directory(out) | Destination::DirectoryInPlace(out)) = destination else { return Ok(()) };
    if out.exists() && !out.is_dir() {
        return Err(Error { file: Some(out.clone()), ..Error::new(Kind::Preset, "the output is not a directory") });
    }
    if matches!(destination, Destination::DirectoryInPlace(_)) {
        return Ok(());
    }
    let resolved = resolve(out);
    match inputs.iter().find(|input| input.is_dir() && resolve(input) == resolved) {
        Some(input) => Err(refuse_in_place(input)),
        None => Ok(()),
    }
}

fn refuse_in_place(source: &Path) -> Error {
    Error { file: Some(source.to_owned()), ..Error::new(Kind::Preset, "the output would overwrite this input") }
        .help("choose another directory with -o, or allow it with --in-place")
}

fn walk(root: &Path, destination: &Destination, found: &mut Found) {
    let left_out = match destination {
        Destination::Directory(out) => Some(resolve(out)),
        _ => None,
    };
    let enter = |entry: &DirEntry| !entry.file_type().is_dir() || Some(resolve(entry.path())) != left_out;
    for entry in WalkDir::new(root).follow_links(true).sort_by_file_name().into_iter().filter_entry(enter) {
        match entry {
            Ok(entry) if entry.file_type().is_file() => {
                let bytes = entry.metadata().map_or(0, |m| m.len());
                let relative = entry.path().strip_prefix(root).unwrap_or(entry.path()).to_owned();
                found.add(entry.into_path(), root.to_owned(), relative, bytes, destination);
            }
            Ok(_) => {}
            Err(error) => found.troubles.extend(describe_walk_error(&error)),
        }
    }
}

/// What lies behind a link to a directory above it has been walked already; a dangling link matters only if it should be an asset.
fn describe_walk_error(error: &walkdir::Error) -> Option<Error> {
    let path = error.path()?;
    let dangling = path.is_symlink() && !path.exists();
    if error.loop_ancestor().is_some() || (dangling && !is_asset(path)) {
        return None;
    }
    let message = error.io_error().map_or_else(|| error.to_string(), std::io::Error::to_string);
    Some(Error { file: Some(path.to_owned()), ..Error::new(Kind::Io, message) })
}

fn add_file(input: &Path, bytes: u64, destination: &Destination, found: &mut Found) -> Result<()> {
    let name = input.file_name().filter(|_| is_asset(input));
    let Some(name) = name else {
        let error = Error::new(Kind::Preset, "this input is neither a directory nor a .glb or .gltf file");
        return Err(Error { file: Some(input.to_owned()), ..error });
    };
    found.add(input.to_owned(), directory_of(input).to_owned(), PathBuf::from(name), bytes, destination);
    Ok(())
}

/// The directory that a file lies in: `.` for a bare name.
pub fn directory_of(file: &Path) -> &Path {
    file.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."))
}

impl Found {
    fn add(&mut self, path: PathBuf, root: PathBuf, relative: PathBuf, bytes: u64, destination: &Destination) {
        let output = match destination {
            Destination::Directory(out) | Destination::DirectoryInPlace(out) => out.join(&relative),
            Destination::Sources => path.clone(),
        };
        let list = if is_asset(&path) { &mut self.assets } else { &mut self.others };
        list.push(Source { path, root, relative, output, bytes });
    }
}

fn refuse_shared_outputs(assets: &[Source]) -> Result<()> {
    let mut first: BTreeMap<PathBuf, &Source> = BTreeMap::new();
    for source in assets {
        let Some(other) = first.insert(resolve(&source.output), source) else { continue };
        let message = format!("has the same output as {}: {}", other.path.display(), source.output.display());
        return Err(Error { file: Some(source.path.clone()), ..Error::new(Kind::Preset, message) }
            .help("give each input once, or build the directory that holds both"));
    }
    Ok(())
}

/// An output may also hit a source when the input lies inside the destination, or when it is a file.
fn refuse_overwriting(found: &Found) -> Result<()> {
    let all = || found.assets.iter().chain(&found.others);
    let sources: BTreeMap<PathBuf, &Source> = all().map(|s| (resolve(&s.path), s)).collect();
    match all().find_map(|s| sources.get(&resolve(&s.output))) {
        Some(hit) => Err(refuse_in_place(&hit.path)),
        None => Ok(()),
    }
}

/// The path without links and `..`, as far as it exists; the rest is taken literally.
pub(crate) fn resolve(path: &Path) -> PathBuf {
    if let Ok(resolved) = path.canonicalize() {
        return resolved;
    }
    match (path.parent(), path.components().next_back()) {
        (Some(parent), Some(Component::Normal(name))) if parent == Path::new("") => resolve(Path::new(".")).join(name),
        (Some(parent), Some(Component::Normal(name))) => resolve(parent).join(name),
        (Some(parent), Some(Component::ParentDir)) => resolve(parent).parent().map_or(PathBuf::new(), Path::to_owned),
        _ => path.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use tempfile::TempDir;

    fn tree(files: &[&str]) -> TempDir {
        let directory = tempfile::tempdir().unwrap();
        for file in files {
            let path = directory.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, file).unwrap();
        }
        directory
    }

    fn names(sources: &[Source]) -> Vec<&str> {
        sources.iter().map(|source| source.relative.to_str().unwrap()).collect()
    }

    fn into(out: impl Into<PathBuf>) -> Destination {
        Destination::Directory(out.into())
    }

    #[test]
    fn a_directory_is_mirrored_in_sorted_order() {
        let tree = tree(&["b.GLB", "a/z ü.gltf", "a/b.bin", "readme.md"]);
        let found = discover(&[tree.path().to_owned()], &into("out")).unwrap();
        assert_eq!(names(&found.assets), ["a/z ü.gltf", "b.GLB"]);
        assert_eq!(names(&found.others), ["a/b.bin", "readme.md"]);
        assert_eq!(found.assets[0].output, Path::new("out/a/z ü.gltf"));
        assert_eq!(found.assets[1].bytes, 5);
    }

    #[test]
    fn a_file_goes_by_its_name() {
        let tree = tree(&["a/b.glb"]);
        let found = discover(&[tree.path().join("a/b.glb")], &into("out")).unwrap();
        assert_eq!(found.assets[0].output, Path::new("out/b.glb"));
        assert_eq!(found.assets[0].root, tree.path().join("a"));
    }

    #[test]
    fn an_output_inside_the_input_is_left_out() {
        let tree = tree(&["a.glb", "out/a.glb", "out/deep/b.glb", "outer/c.glb"]);
        let found = discover(&[tree.path().to_owned()], &into(tree.path().join("outer/../out"))).unwrap();
        assert_eq!(names(&found.assets), ["a.glb", "outer/c.glb"]);
    }

    #[test]
    fn sources_are_not_overwritten_unasked() {
        let tree = tree(&["a.glb", "sub/sub/a.glb", "sub/a.glb"]);
        let root = tree.path().to_owned();
        let refused = |inputs: &[PathBuf], out: &Path| discover(inputs, &into(out)).unwrap_err();
        assert_eq!(refused(std::slice::from_ref(&root), &root).kind, Kind::Preset);
        assert_eq!(refused(&[root.join("a.glb")], &root).file, Some(root.join("a.glb")));
        // The input lies inside the output, and its own subdirectory leads back to it.
        assert_eq!(refused(&[root.join("sub")], &root).file, Some(root.join("sub/a.glb")));
        assert!(discover(std::slice::from_ref(&root), &Destination::DirectoryInPlace(root.clone())).is_ok());
    }

    #[test]
    fn two_sources_of_one_output_are_refused() {
        let tree = tree(&["a/x.glb", "b/x.glb"]);
        let error = discover(&[tree.path().join("a"), tree.path().join("b")], &into("out")).unwrap_err();
        assert_eq!(error.file, Some(tree.path().join("b/x.glb")));
        assert!(discover(&[tree.path().join("a"), tree.path().join("b")], &Destination::Sources).is_ok());
    }

    #[test]
    fn missing_and_foreign_inputs_are_named() {
        let tree = tree(&["readme.md"]);
        for input in ["gone.glb", "readme.md"] {
            let input = tree.path().join(input);
            let error = discover(std::slice::from_ref(&input), &into("out")).unwrap_err();
            assert_eq!((error.kind, error.file), (Kind::Preset, Some(input)));
        }
    }

    #[test]
    #[cfg(unix)]
    fn links_neither_loop_nor_hide_what_is_missing() {
        let tree = tree(&["a/x.glb"]);
        let link = |target: &str, name: &str| std::os::unix::fs::symlink(target, tree.path().join(name)).unwrap();
        link("..", "a/up");
        link("gone", "a/dangling.txt");
        link("gone", "a/dangling.glb");
        let found = discover(&[tree.path().to_owned()], &into("out")).unwrap();
        assert_eq!(names(&found.assets), ["a/x.glb"]);
        let files: Vec<_> = found.troubles.iter().map(|error| error.file.clone().unwrap()).collect();
        assert_eq!(files, [tree.path().join("a/dangling.glb")]);
    }

    #[test]
    fn paths_that_do_not_exist_yet_are_resolved_as_far_as_they_go() {
        let tree = tree(&["a/x.glb"]);
        let base = tree.path().canonicalize().unwrap();
        assert_eq!(resolve(&tree.path().join("a/../new/deep")), base.join("new/deep"));
        assert_eq!(resolve(&tree.path().join("new/../a")), base.join("a"));
        assert_eq!(resolve(Path::new("new")), std::env::current_dir().unwrap().join("new"));
    }
}
