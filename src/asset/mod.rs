//! glTF in, losslessly: bytes → chunks → document → checks → meshes as plain arrays.
//!
//! The document stays a JSON value from reading to writing; nothing typed ever re-serialises it.

mod accessor;
mod check;
mod container;
mod document;
mod geometry;
mod scene;

pub use container::{Chunk, Container};
pub use document::Document;
pub use geometry::{AttributeLayout, Channel, Component, Geometry, PassedOver, PrimitiveLayout, Shape};
pub use scene::{MeshUse, Scene};

use crate::error::{Error, Kind, Result};
use std::path::{Path, PathBuf};

/// Bounds on what is read, against files that ask for the memory of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Largest file read (each of the asset's files), bytes.
    pub file_bytes: u64,
    /// Most vertices of one mesh.
    pub vertices: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { file_bytes: 4 << 30, vertices: 200_000_000 }
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
    /// The bytes of each `buffers[i]`, cut to `byteLength`; `None` for a buffer that only compressed geometry needs
    /// (fallback buffers without data).
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
    pub fn read(path: &Path, _root: &Path, _limits: &Limits) -> Result<Self> {
        Err(Error::new(Kind::Unsupported, "not there yet").in_file(path))
    }

    /// The triangle primitives of `meshes[index]` as one plain mesh, a group each.
    ///
    /// # Errors
    /// Bad data inside the accessors: an index out of range, a position that is not finite.
    pub fn geometry(&self, _index: usize, _limits: &Limits) -> Result<Geometry> {
        Err(Error::new(Kind::Unsupported, "not there yet"))
    }

    /// Nodes, their transforms, what animates them and what draws which mesh.
    pub fn scene(&self) -> Scene {
        Scene::default()
    }
}
