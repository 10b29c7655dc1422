//! glTF in, losslessly: bytes → chunks → document → checks → meshes as plain arrays.
//!
//! The document stays a JSON value from reading to writing; nothing typed ever re-serialises it.

// Everything here comes from a file: nothing may be taken for granted.
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::indexing_slicing))]

mod accessor;
mod check;
mod container;
mod cursor;
mod document;
mod files;
mod geometry;
mod merge;
mod poses;
mod primitive;
mod progressive;
mod scene;
mod uri;

pub use container::{Chunk, Container};
pub use document::Document;
pub use geometry::{AttributeLayout, Channel, Component, Geometry, PassedOver, PrimitiveLayout, Shape};
pub use poses::Animations;
pub use progressive::{PROGRESSIVE, Progressive, ProgressiveGroup, RecordChunk, RowAttribute};
pub use scene::{MeshUse, Scene};

use crate::error::{Error, Result};
use files::Files;
use std::path::{Path, PathBuf};

/// Bounds on what is read, against files that ask for the memory of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Largest file read, and largest sum of an asset's buffers, bytes.
    pub file_bytes: u64,
    /// Most vertices, and most triangles, of one mesh.
    pub vertices: usize,
    /// Most memory that one decoded mesh may take, bytes.
    pub mesh_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { file_bytes: 4 << 30, vertices: 200_000_000, mesh_bytes: 8 << 30 }
    }
}

/// A glTF asset, read and checked. Everything in `document` may be relied on to be structurally sound.
#[derive(Debug, Clone)]
pub struct Asset {
    /// The file it was read from.
    pub path: PathBuf,
    /// GLB (with its unknown chunks) or plain glTF.
    pub container: Container,
    /// The JSON, untouched.
    pub document: Document,
    /// The bytes of each `buffers[i]`, cut to `byteLength`; `None` for a buffer without data of its own: a fallback for
    /// compressed geometry, or one that a plain glTF leaves to others.
    pub buffers: Vec<Option<Vec<u8>>>,
    /// External files that the document names by relative URI (buffers and images), each once.
    pub resources: Vec<Resource>,
    /// Things worth telling the user that stop nothing.
    pub warnings: Vec<Error>,
}

/// An external file of an asset.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Resource {
    /// Where the document names it: JSON pointer of the object with the `uri`.
    pub pointer: String,
    /// The file, decoded from the URI, relative to the asset's directory; never leaves `root`.
    pub relative: PathBuf,
    /// Whether the file is there. A missing image is a warning, a missing buffer an error.
    pub exists: bool,
}

impl Asset {
    /// Reads and checks the asset at `path`. URIs may name files below `root` only (the input directory).
    ///
    /// # Errors
    /// Every problem names the file and the JSON pointer.
    pub fn read(path: &Path, root: &Path, limits: &Limits) -> Result<Self> {
        Self::read_checked(path, root, limits).map_err(|error| error.in_file(path))
    }

    /// As [`Asset::read`]; of a GLB that ends early, records of progressive meshes may be missing. Tells whether it ends early.
    ///
    /// # Errors
    /// Every problem names the file and the JSON pointer; [`Kind::Malformed`](crate::Kind::Malformed) where more than records is missing.
    pub fn read_prefix(path: &Path, root: &Path, limits: &Limits) -> Result<(Self, bool)> {
        let read = || {
            let (unpacked, mut document) = files::parse(path, limits, Container::unpack_prefix)?;
            let ends_early = unpacked.ends_early;
            if ends_early {
                progressive::fit_to_prefix(&mut document, unpacked.bin.as_ref().map_or(0, Vec::len))?;
            }
            Ok((Self::check_and_load(path, root, limits, unpacked, document)?, ends_early))
        };
        read().map_err(|error: Error| error.in_file(path))
    }

    fn read_checked(path: &Path, root: &Path, limits: &Limits) -> Result<Self> {
        let (unpacked, document) = files::parse(path, limits, Container::unpack)?;
        Self::check_and_load(path, root, limits, unpacked, document)
    }

    fn check_and_load(
        path: &Path,
        root: &Path,
        limits: &Limits,
        mut unpacked: container::Unpacked,
        document: Document,
    ) -> Result<Self> {
        let findings = check::check(document.root());
        if let Some(problem) = join_problems(findings.problems) {
            return Err(problem);
        }
        let files = Files::read(path, root, document.root(), &mut unpacked, limits)?;
        let warnings = [unpacked.warnings, findings.warnings, files.warnings].into_iter().flatten();
        Ok(Self {
            path: path.to_owned(),
            container: unpacked.container,
            document,
            buffers: files.buffers,
            resources: files.resources,
            warnings: warnings.map(|warning| warning.in_file(path)).collect(),
        })
    }

    /// The triangle primitives of `meshes[index]` as one plain mesh, a group each.
    ///
    /// # Errors
    /// Bad data inside the accessors: an index out of range, a position that is not finite.
    pub fn geometry(&self, index: usize, limits: &Limits) -> Result<Geometry> {
        geometry::read(self, index, true, limits).map_err(|error| error.in_file(&self.path))
    }

    /// As [`Asset::geometry`], but with joints and weights as the file has them: weights may sum to anything.
    ///
    /// # Errors
    /// As [`Asset::geometry`].
    pub fn stored_geometry(&self, index: usize, limits: &Limits) -> Result<Geometry> {
        geometry::read(self, index, false, limits).map_err(|error| error.in_file(&self.path))
    }

    /// Nodes, their transforms, what animates them and what draws which mesh.
    pub fn scene(&self) -> Scene {
        Scene::of(self)
    }

    /// What deforms meshes; `scene` is this asset's.
    pub fn animations(&self, scene: &Scene) -> Animations {
        Animations::of(self, scene)
    }
}

/// Every structural problem of a document, at most 100; empty means that every index, range and type in it is sound.
/// [`Asset::read`] refuses documents that have any.
pub fn find_problems(document: &Document) -> Vec<Error> {
    check::check(document.root()).problems
}

/// The first problem, and how many there are besides.
fn join_problems(problems: Vec<Error>) -> Option<Error> {
    let more = problems.len().saturating_sub(1);
    let mut first = problems.into_iter().next()?;
    if more > 0 {
        first.message =
            format!("{} (and {more} more {})", first.message, if more == 1 { "problem" } else { "problems" });
    }
    Some(first)
}
