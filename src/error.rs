//! The one error type of the library: what is wrong, where, and the way out.
//!
//! A message reads `FILE: PLACE: what is wrong (help: what to do)`. `PLACE` is a JSON pointer into the
//! document (`/meshes/0/primitives/1`), a byte offset or a TOML line and column.

use std::fmt;
use std::path::{Path, PathBuf};

/// Shorthand for results of this library.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What kind of trouble it is; decides who has to act.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// The operating system refused: missing file, no permission, disk full.
    Io,
    /// The input breaks its format's rules.
    Malformed,
    /// The input is legal, but this version cannot handle it.
    Unsupported,
    /// The input is larger than the limits allow.
    Limit,
    /// A preset or an option is wrong.
    Preset,
    /// A bug in gltf-lod: an internal invariant did not hold.
    Internal,
}

/// An error with its place. Build it with [`Error::new`] and friends, then add the place where it is known.
#[derive(Debug, Clone, thiserror::Error)]
pub struct Error {
    /// What kind of trouble it is.
    pub kind: Kind,
    /// The file it is about.
    pub file: Option<PathBuf>,
    /// JSON pointer, byte offset or line in that file.
    pub place: Option<String>,
    /// What is wrong: found and expected.
    pub message: String,
    /// The way out.
    pub help: Option<String>,
}

impl Error {
    /// An error of `kind` without a place yet.
    pub fn new(kind: Kind, message: impl Into<String>) -> Self {
        Self { kind, file: None, place: None, message: message.into(), help: None }
    }

    /// The document breaks a rule at the JSON pointer `place`.
    pub fn malformed(place: impl Into<String>, message: impl Into<String>) -> Self {
        Self { place: Some(place.into()), ..Self::new(Kind::Malformed, message) }
    }

    /// The document asks at `place` for something this version cannot do.
    pub fn unsupported(place: impl Into<String>, message: impl Into<String>) -> Self {
        Self { place: Some(place.into()), ..Self::new(Kind::Unsupported, message) }
    }

    /// The operating system refused an operation on `file`.
    pub fn io(file: &Path, source: &std::io::Error) -> Self {
        Self { file: Some(file.to_owned()), ..Self::new(Kind::Io, source.to_string()) }
    }

    /// Names the file, unless a more exact one is known already.
    #[must_use]
    pub fn in_file(mut self, file: &Path) -> Self {
        self.file.get_or_insert_with(|| file.to_owned());
        self
    }

    /// Adds the way out.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}: ", file.display())?;
        }
        if let Some(place) = self.place.as_ref().filter(|p| !p.is_empty()) {
            write!(f, "{place}: ")?;
        }
        write!(f, "{}", self.message)?;
        if let Some(help) = &self.help {
            write!(f, " (help: {help})")?;
        }
        Ok(())
    }
}
