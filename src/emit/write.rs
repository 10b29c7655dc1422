//! Files onto the disk: all of an asset, or none.
//!
//! Every file is first written in full to a temporary file beside its target. Then all are renamed, the asset's own file
//! last, so that nobody sees it without what it names. When a rename fails, what was replaced before is put back.

use super::{Content, Output, OutputFile};
use crate::error::{Error, Kind, Result};
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::Mutex;
use tempfile::{NamedTempFile, TempPath};

/// Assets of a folder may share resources. One commits (or takes back) at a time, so that taking back cannot remove a
/// file that another asset of this process found in place.
static COMMIT: Mutex<()> = Mutex::new(());

/// Writes all files of `output` below `directory`, or none: each to a temporary file beside its target, then renamed.
/// Directories are made; a copy whose target has the same bytes already is left as it is.
///
/// # Errors
/// [`Kind::Io`] with the file; nothing of this asset is left behind.
pub fn write(output: &Output, directory: &Path) -> Result<()> {
    let mut made = MadeDirectories::default();
    let result = stage_and_commit(output, directory, &mut made);
    if result.is_err() {
        made.remove();
    }
    result
}

fn stage_and_commit(output: &Output, directory: &Path, made: &mut MadeDirectories) -> Result<()> {
    let mut staged = Vec::new();
    for file in &output.files {
        let target = target_path(directory, &file.relative)?;
        if let Some(parent) = target.parent() {
            made.make(parent)?;
        }
        staged.push(Staged::new(file, target)?);
    }
    sync_directories(&commit_all(staged)?);
    Ok(())
}

/// Puts all files in place, the first (the asset's own) last, or none.
fn commit_all(staged: Vec<Staged<'_>>) -> Result<Vec<Committed>> {
    let _one_at_a_time = COMMIT.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let mut done = Vec::new();
    for file in staged.into_iter().rev() {
        match file.commit() {
            Ok(committed) => done.extend(committed),
            Err(error) => {
                done.into_iter().rev().for_each(Committed::take_back);
                return Err(error);
            }
        }
    }
    Ok(done)
}

/// `directory/relative` with `..` resolved by name: the directory before it need not exist.
fn target_path(directory: &Path, relative: &Path) -> Result<PathBuf> {
    let mut target = directory.to_owned();
    for component in relative.components() {
        match component {
            Component::Normal(name) => target.push(name),
            Component::CurDir => {}
            Component::ParentDir if target.file_name().is_some() => drop(target.pop()),
            _ => {
                let message = format!("output path {} leads out of the output directory", relative.display());
                return Err(Error::new(Kind::Internal, message));
            }
        }
    }
    Ok(target)
}

/// A file ready to be renamed, or one that is in place already.
struct Staged<'a> {
    file: &'a OutputFile,
    target: PathBuf,
    /// `None`: the target has the right bytes.
    temporary: Option<NamedTempFile>,
}

impl<'a> Staged<'a> {
    fn new(file: &'a OutputFile, target: PathBuf) -> Result<Self> {
        if target.is_dir() {
            let error = Error::new(Kind::Io, "a directory of this name is in the way").in_file(&target);
            return Err(error.help("remove it or choose another output directory"));
        }
        let in_place = matches!(&file.content, Content::CopyOf(source) if is_copy(source, &target));
        let temporary = if in_place { None } else { Some(stage(&file.content, &target)?) };
        Ok(Self { file, target, temporary })
    }

    fn commit(self) -> Result<Option<Committed>> {
        let temporary = match self.temporary {
            Some(temporary) => temporary,
            None if self.target.exists() => return Ok(None),
            // Another asset has taken it back since.
            None => stage(&self.file.content, &self.target)?,
        };
        let backup = back_up(&self.target)?;
        temporary.persist(&self.target).map_err(|e| Error::io(&self.target, &e.error))?;
        Ok(Some(Committed { target: self.target, backup }))
    }
}

/// A file that has been put in place.
struct Committed {
    target: PathBuf,
    /// What was there before; removed when dropped.
    backup: Option<TempPath>,
}

impl Committed {
    /// Best effort: there is nobody left to tell.
    fn take_back(self) {
        let _ = match self.backup {
            Some(backup) => backup.persist(&self.target).map_err(|e| e.error),
            None => fs::remove_file(&self.target),
        };
    }
}

/// Another name for what is at `target`, if anything.
fn back_up(target: &Path) -> Result<Option<TempPath>> {
    if fs::symlink_metadata(target).is_err() {
        return Ok(None);
    }
    let parent = target.parent().unwrap_or(Path::new("."));
    let link = |path: &Path| {
        fs::hard_link(target, path).or_else(|e| match e.kind() {
            io::ErrorKind::AlreadyExists => Err(e),
            // File systems without hard links.
            _ => fs::copy(target, path).map(drop),
        })
    };
    let backup = tempfile::Builder::new().prefix(TEMPORARY_PREFIX).make_in(parent, link);
    Ok(Some(backup.map_err(|e| Error::io(target, &e))?.into_temp_path()))
}

const TEMPORARY_PREFIX: &str = ".gltf-lod-";

/// Writes the content to a temporary file beside `target`, onto the disk.
fn stage(content: &Content, target: &Path) -> Result<NamedTempFile> {
    let failed = |e: io::Error| Error::io(target, &e);
    let parent = target.parent().unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY_PREFIX);
    // Readable as any other file the user makes (the umask applies), not only by the user.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut temporary = builder.tempfile_in(parent).map_err(failed)?;
    match content {
        Content::Bytes(bytes) => temporary.write_all(bytes).map_err(failed)?,
        Content::CopyOf(source) => {
            let mut source_file = File::open(source).map_err(|e| Error::io(source, &e))?;
            io::copy(&mut source_file, temporary.as_file_mut()).map_err(failed)?;
        }
    }
    // Without this a crash of the machine may leave the name with an empty file behind it.
    temporary.as_file().sync_data().map_err(failed)?;
    Ok(temporary)
}

/// Whether both files can be read and have the same bytes (or are the same file).
fn is_copy(source: &Path, target: &Path) -> bool {
    let compare = || -> io::Result<bool> {
        if fs::canonicalize(source)? == fs::canonicalize(target)? {
            return Ok(true);
        }
        let (mut a, mut b) = (File::open(source)?, File::open(target)?);
        if a.metadata()?.len() != b.metadata()?.len() {
            return Ok(false);
        }
        let (mut block_a, mut block_b) = (vec![0; 1 << 16], vec![0; 1 << 16]);
        loop {
            let length = a.read(&mut block_a)?;
            b.read_exact(&mut block_b[..length])?;
            if length == 0 || block_a[..length] != block_b[..length] {
                return Ok(length == 0);
            }
        }
    };
    compare().unwrap_or(false)
}

/// Directories made for this asset, outermost first.
#[derive(Default)]
struct MadeDirectories(Vec<PathBuf>);

impl MadeDirectories {
    fn make(&mut self, directory: &Path) -> Result<()> {
        let missing: Vec<&Path> =
            directory.ancestors().take_while(|d| !d.as_os_str().is_empty() && !d.exists()).collect();
        for directory in missing.into_iter().rev() {
            match fs::create_dir(directory) {
                Ok(()) => self.0.push(directory.to_owned()),
                // Another asset was faster.
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists && directory.is_dir() => {}
                Err(e) => return Err(Error::io(directory, &e)),
            }
        }
        Ok(())
    }

    /// Those that are still empty.
    fn remove(self) {
        for directory in self.0.iter().rev() {
            let _ = fs::remove_dir(directory);
        }
    }
}

/// Makes the renames themselves last; where directories cannot be opened (Windows) the system sees to it.
fn sync_directories(done: &[Committed]) {
    let parents: std::collections::BTreeSet<&Path> = done.iter().filter_map(|c| c.target.parent()).collect();
    for parent in parents {
        if let Ok(directory) = File::open(parent) {
            let _ = directory.sync_all();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn output(files: &[(&str, &[u8])]) -> Output {
        let file = |&(name, bytes): &(&str, &[u8])| OutputFile {
            relative: name.into(),
            content: Content::Bytes(bytes.to_vec()),
        };
        Output { files: files.iter().map(file).collect(), notes: Vec::new() }
    }

    fn names(directory: &Path) -> Vec<String> {
        let entries = walkdir::WalkDir::new(directory).min_depth(1).sort_by_file_name();
        let name = |e: walkdir::DirEntry| e.path().strip_prefix(directory).unwrap().display().to_string();
        entries.into_iter().map(|e| name(e.unwrap())).collect()
    }

    #[test]
    fn all_files_arrive_in_new_directories_readable_by_others() {
        let dir = tempfile::tempdir().unwrap();
        let source = dir.path().join("source.png");
        fs::write(&source, b"picture").unwrap();
        let out = dir.path().join("out/deep/down");
        let mut output = output(&[("a b.gltf", b"{}"), ("x/❤.bin", b"1234")]);
        output.files.push(OutputFile { relative: "../shared.png".into(), content: Content::CopyOf(source) });
        write(&output, &out).unwrap();
        write(&output, &out).unwrap();
        let out = dir.path().join("out");
        assert_eq!(
            names(&out),
            ["deep", "deep/down", "deep/down/a b.gltf", "deep/down/x", "deep/down/x/❤.bin", "deep/shared.png"]
        );
        assert_eq!(fs::read(out.join("deep/down/x/❤.bin")).unwrap(), b"1234");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let plain = dir.path().join("plain");
            fs::write(&plain, b"").unwrap();
            let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
            assert_eq!(mode(&out.join("deep/shared.png")), mode(&plain));
        }
    }

    #[test]
    fn a_directory_in_the_way_stops_everything_before_it_starts() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("a.gltf")).unwrap();
        let error = write(&output(&[("a.gltf", b"{}"), ("new/a.bin", b"1")]), dir.path()).unwrap_err();
        assert_eq!(error.kind, Kind::Io);
        assert_eq!(error.file, Some(dir.path().join("a.gltf")));
        assert_eq!(names(dir.path()), ["a.gltf"]);
    }

    #[test]
    fn a_missing_source_leaves_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let mut output = output(&[("sub/a.gltf", b"{}")]);
        let missing = dir.path().join("missing.png");
        output.files.push(OutputFile { relative: "missing.png".into(), content: Content::CopyOf(missing.clone()) });
        let error = write(&output, &dir.path().join("out")).unwrap_err();
        assert_eq!((error.kind, error.file), (Kind::Io, Some(missing)));
        assert_eq!(names(dir.path()), Vec::<String>::new());
    }

    /// The rename of the asset's own file, the last one, fails: two files were put in place before it.
    #[test]
    fn a_failed_rename_puts_back_what_was_there() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        fs::write(path("old.bin"), b"old").unwrap();
        let output = output(&[("a.gltf", b"{}"), ("old.bin", b"new"), ("new.bin", b"new")]);
        let staged: Vec<Staged> =
            output.files.iter().map(|f| Staged::new(f, path(f.relative.to_str().unwrap())).unwrap()).collect();
        // Nobody can rename a file onto a directory, not even root.
        fs::create_dir(path("a.gltf")).unwrap();
        let error = commit_all(staged).err().expect("the rename fails");
        assert_eq!(error.file, Some(path("a.gltf")));
        assert_eq!(fs::read(path("old.bin")).unwrap(), b"old");
        assert_eq!(names(dir.path()), ["a.gltf", "old.bin"]);
    }

    #[test]
    fn paths_that_leave_the_file_system_are_refused() {
        assert_eq!(target_path(Path::new("/a/b"), Path::new("../c/./d")).unwrap(), Path::new("/a/c/d"));
        assert!(target_path(Path::new("/"), Path::new("../c")).is_err());
        assert!(target_path(Path::new("out"), Path::new("/etc/passwd")).is_err());
    }
}
