//! An asset's files: its own, its buffers' bytes, and the external files that it names.

use super::accessor::{MESHOPT, NO_DATA};
use super::container::{Container, Unpacked};
use super::cursor::Cursor;
use super::uri::{self, Directories, Uri};
use super::{Document, Limits, Resource};
use crate::error::{Error, Kind, Result};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Reads a regular file of at most `limits.file_bytes`.
fn read_file(path: &Path, limits: &Limits) -> Result<Vec<u8>> {
    let length = file_length(path)?;
    if length > limits.file_bytes {
        let message = format!("{length} bytes; the limit is {}", limits.file_bytes);
        return Err(Error::new(Kind::Limit, message).in_file(path));
    }
    read_start(path, length)
}

/// The length of a regular file: a pipe or a device could go on for ever.
fn file_length(path: &Path) -> Result<u64> {
    let metadata = std::fs::metadata(path).map_err(|error| Error::io(path, &error))?;
    if metadata.is_file() { Ok(metadata.len()) } else { Err(Error::new(Kind::Io, "not a regular file").in_file(path)) }
}

/// The first `length` bytes of a file, or fewer should it end sooner.
fn read_start(path: &Path, length: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
    let read = File::open(path).and_then(|file| file.take(length).read_to_end(&mut bytes));
    read.map_err(|error| Error::io(path, &error))?;
    Ok(bytes)
}

/// Takes the file apart by `unpack` and parses its JSON.
pub(super) fn parse(
    path: &Path,
    limits: &Limits,
    unpack: fn(Vec<u8>) -> Result<Unpacked>,
) -> Result<(Unpacked, Document)> {
    let mut unpacked = unpack(read_file(path, limits)?)?;
    let json = std::mem::take(&mut unpacked.json);
    let mut text = json.as_slice();
    if let Some(rest) = text.strip_prefix(b"\xEF\xBB\xBF") {
        unpacked.warnings.push(Error::malformed("byte 0", "the JSON begins with a byte order mark"));
        text = rest;
    }
    // Some exporters pad the JSON chunk with zeros instead of spaces.
    while let (Container::Glb { .. }, Some(rest)) = (&unpacked.container, text.strip_suffix(b"\0")) {
        text = rest;
    }
    let root = serde_json::from_slice::<Value>(text).map_err(|error| explain_json(&error, text, path))?;
    if !root.is_object() {
        return Err(Error::malformed("", "the document must be a JSON object"));
    }
    Ok((unpacked, Document::new(root).styled_like(text)))
}

fn explain_json(error: &serde_json::Error, text: &[u8], path: &Path) -> Error {
    let place = format!("line {} column {}", error.line(), error.column());
    let message = error.to_string();
    let message = message.strip_suffix(&format!(" at {place}")).unwrap_or(&message);
    let error = Error::malformed(place, format!("not valid JSON: {message}"));
    if message.starts_with("recursion limit") {
        return Error { kind: Kind::Limit, ..error }.help("objects and arrays nested deeper than 127 are not read");
    }
    let glb = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
    match text {
        [b'{', ..] => error,
        [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..] => error.help("the file is UTF-16: save it as UTF-8"),
        _ if glb => error.help("the file is no GLB either, which begins with \"glTF\""),
        _ => error,
    }
}

/// What the document's files hold.
#[derive(Debug, Default)]
pub(super) struct Files {
    pub buffers: Vec<Option<Vec<u8>>>,
    pub resources: Vec<Resource>,
    pub warnings: Vec<Error>,
    named: BTreeSet<PathBuf>,
}

/// Where a buffer's bytes are.
enum Source {
    /// In the document or the BIN chunk.
    Here(Vec<u8>),
    /// In a file.
    File(PathBuf),
    /// In a file that is not there.
    Missing(PathBuf),
    /// Nowhere.
    Nowhere,
}

impl Files {
    /// Reads the buffers of a checked document and looks for its other files.
    pub fn read(path: &Path, root: &Path, document: &Value, unpacked: &mut Unpacked, limits: &Limits) -> Result<Self> {
        let directories = Directories::new(path, root)?;
        let top = Cursor::root(document);
        let buffers: Vec<_> = top.get("buffers").map(|b| b.elements()).transpose()?.into_iter().flatten().collect();
        check_total(&buffers, limits)?;
        let mut files = Self::default();
        let is_glb = unpacked.container != Container::Gltf;
        for buffer in &buffers {
            let bytes = files.read_buffer(buffer, &directories, unpacked.bin.take(), is_glb)?;
            files.buffers.push(bytes);
        }
        for image in top.get("images").map(|i| i.elements()).transpose()?.into_iter().flatten() {
            files.find_image(&image, &directories)?;
        }
        if let Some(extensions) = top.get("extensions") {
            files.find_in_extensions(&extensions, &directories);
        }
        Ok(files)
    }

    /// The bytes of one buffer. `bin` is offered to the first buffer only, which takes it if it has no URI. A plain glTF may leave the data of a
    /// buffer to others: that is an error only for those who need it.
    fn read_buffer(
        &mut self,
        buffer: &Cursor,
        directories: &Directories,
        bin: Option<Vec<u8>>,
        is_glb: bool,
    ) -> Result<Option<Vec<u8>>> {
        let length = buffer.need("byteLength")?.integer()?;
        let short = |holder: &str, found: u64| {
            let message = format!("byteLength is {length}, but {holder} has {found} bytes");
            buffer.error(message).help("the data is truncated: export or copy it again")
        };
        let mut bytes = match self.find_buffer(buffer, directories, bin)? {
            Source::Here(bytes) => bytes,
            Source::File(path) => match file_length(&path)? {
                found if found < length as u64 => return Err(short(&path.display().to_string(), found)),
                _ => read_start(&path, length as u64)?,
            },
            Source::Missing(_) | Source::Nowhere if is_fallback(buffer) => return Ok(None),
            Source::Missing(path) => {
                return Err(Error { kind: Kind::Io, ..buffer.error(format!("{} is missing", path.display())) }
                    .help("a buffer's file must lie where its uri says, relative to the asset"));
            }
            Source::Nowhere if is_glb => return Err(buffer.error(NO_DATA)),
            Source::Nowhere => {
                self.warnings.push(buffer.error(NO_DATA));
                return Ok(None);
            }
        };
        if bytes.len() < length {
            return Err(short("its data", bytes.len() as u64));
        }
        bytes.truncate(length);
        Ok(Some(bytes))
    }

    fn find_buffer(&mut self, buffer: &Cursor, directories: &Directories, bin: Option<Vec<u8>>) -> Result<Source> {
        let Some(uri) = buffer.get("uri") else {
            let Some(bin) = bin.filter(|_| !is_fallback(buffer)) else { return Ok(Source::Nowhere) };
            self.check_padding(buffer, bin.len(), buffer.need("byteLength")?.integer()?);
            return Ok(Source::Here(bin));
        };
        match uri::parse(uri.string()?) {
            Uri::Data(payload) => uri::decode_data(payload, &uri.place).map(Source::Here),
            Uri::Scheme(scheme) => Err(refuse_scheme(&uri, scheme)),
            Uri::Relative(reference) => {
                let (relative, exists) = directories.resolve(reference, &uri.place)?;
                let path = directories.locate(&relative);
                self.add_resource(&uri, relative, exists);
                Ok(if exists { Source::File(path) } else { Source::Missing(path) })
            }
        }
    }

    fn check_padding(&mut self, buffer: &Cursor, bin: usize, length: usize) {
        if bin > length.saturating_add(3) {
            let message = format!("byteLength is {length}, but the BIN chunk has {bin} bytes; the rest is left out");
            self.warnings.push(buffer.error(message));
        }
    }

    fn find_image(&mut self, image: &Cursor, directories: &Directories) -> Result<()> {
        let Some(uri) = image.get("uri") else { return Ok(()) };
        match uri::parse(uri.string()?) {
            Uri::Data(_) => {}
            // Nothing is read from there and nothing has to be copied: viewers fetch it.
            Uri::Scheme(scheme) if ["http", "https"].iter().any(|s| scheme.eq_ignore_ascii_case(s)) => {
                self.warnings.push(uri.error("the image is on a server; its URI is kept, nothing is fetched"));
            }
            Uri::Scheme(scheme) => return Err(refuse_scheme(&uri, scheme)),
            Uri::Relative(reference) => {
                let (relative, exists) = directories.resolve(reference, &uri.place)?;
                if !exists {
                    let path = directories.locate(&relative);
                    self.warnings.push(uri.error(format!("the image {} is missing", path.display())));
                }
                self.add_resource(&uri, relative, exists);
            }
        }
        Ok(())
    }

    /// Extensions name files too (sounds, light profiles, schemas). Those that are there belong to the asset; of
    /// the others nothing is known that would be worth a word.
    fn find_in_extensions(&mut self, value: &Cursor, directories: &Directories) {
        let members = value.members().into_iter().flatten().map(|(_, member)| member);
        for member in members.chain(value.elements().into_iter().flatten()) {
            let named = ["/uri", "/schemaUri"].iter().any(|end| member.place.ends_with(end));
            if let (true, Some(text)) = (named, member.value.as_str())
                && let Uri::Relative(reference) = uri::parse(text)
                && let Ok((relative, true)) = directories.resolve(reference, &member.place)
            {
                self.add_resource(&member, relative, true);
            }
            self.find_in_extensions(&member, directories);
        }
    }

    fn add_resource(&mut self, uri: &Cursor, relative: PathBuf, exists: bool) {
        if self.named.insert(relative.clone()) {
            let pointer = uri.place.rsplit_once('/').map_or("", |(object, _)| object).to_owned();
            self.resources.push(Resource { pointer, relative, exists });
        }
    }
}

/// Many buffers may name one large file, so that it is their sum that has to be bounded.
fn check_total(buffers: &[Cursor], limits: &Limits) -> Result<()> {
    let mut total = 0_u64;
    for buffer in buffers.iter().filter(|b| !is_fallback(b)) {
        total = total.saturating_add(buffer.need("byteLength")?.integer()? as u64);
        if total > limits.file_bytes {
            let message = format!("the buffers up to here need {total} bytes; the limit is {}", limits.file_bytes);
            return Err(Error { kind: Kind::Limit, ..buffer.error(message) });
        }
    }
    Ok(())
}

/// Whether the buffer only stands for what a compressed view expands to.
fn is_fallback(buffer: &Cursor) -> bool {
    let marked = |name: &str| buffer.extension(name)?.get("fallback")?.value.as_bool();
    MESHOPT.into_iter().any(|name| marked(name) == Some(true))
}

fn refuse_scheme(uri: &Cursor, scheme: &str) -> Error {
    uri.error(format!("the URI's scheme is {scheme:?}; only data: and relative URIs are read"))
        .help("put the file beside the asset and name it relative to that")
}
