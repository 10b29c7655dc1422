//! Checks a written asset against its source, without trusting the code that wrote it.
//!
//! Two questions: is everything that is not ours still there, value for value and byte for byte (`unchanged`); and do
//! the levels keep the rules that loaders rely on (`levels`)?

mod levels;
mod unchanged;

use super::{Content, Output};
use crate::asset::{Asset, Container};
use crate::error::{Error, Kind};
use base64::Engine;
use serde_json::Value;
use std::borrow::Cow;

/// Source and result side by side.
struct Sides<'a> {
    source: &'a Value,
    source_buffers: &'a [Option<Vec<u8>>],
    written: &'a Value,
    written_buffers: Vec<Option<Cow<'a, [u8]>>>,
}

/// Compares `written`, read back, with the `source` it was made from.
///
/// # Errors
/// Everything that is wrong, each with its JSON pointer.
pub fn check(source: &Asset, written: &Asset) -> Result<(), Vec<Error>> {
    check_sides(&Sides {
        source: source.document.root(),
        source_buffers: &source.buffers,
        written: written.document.root(),
        written_buffers: written.buffers.iter().map(|b| b.as_deref().map(Cow::Borrowed)).collect(),
    })
}

/// As [`check`], before anything is on the disk.
///
/// # Errors
/// Everything that is wrong, each with its JSON pointer.
pub fn check_output(source: &Asset, output: &Output) -> Result<(), Vec<Error>> {
    let main = match output.files.first().map(|file| &file.content) {
        Some(Content::Bytes(main)) => main,
        // The source itself.
        Some(Content::CopyOf(_)) => return Ok(()),
        None => return Err(vec![problem("", "there is no file")]),
    };
    let unpacked = Container::unpack(main.clone()).map_err(|e| vec![e])?;
    let written: Value = serde_json::from_slice(&unpacked.json).map_err(|e| vec![problem("", e.to_string())])?;
    let mut written_buffers = Vec::new();
    for (index, buffer) in elements(&written, "buffers").iter().enumerate() {
        let content = match buffer.get("uri").and_then(Value::as_str) {
            None => unpacked.bin.as_deref().filter(|_| index == 0).map(Cow::Borrowed),
            Some(uri) => {
                content_of(uri, output).or(source.buffers.get(index).and_then(|b| b.as_deref()).map(Cow::Borrowed))
            }
        };
        written_buffers.push(content);
    }
    check_sides(&Sides {
        source: source.document.root(),
        source_buffers: &source.buffers,
        written: &written,
        written_buffers,
    })
}

/// The bytes of a new file or a data URI; `None` for files that are copied from the source.
fn content_of<'a>(uri: &str, output: &'a Output) -> Option<Cow<'a, [u8]>> {
    if let Some((_, data)) = uri.strip_prefix("data:").and_then(|rest| rest.split_once(";base64,")) {
        return base64::engine::general_purpose::STANDARD.decode(data).ok().map(Cow::Owned);
    }
    let name = percent_encoding::percent_decode_str(uri).decode_utf8().ok()?;
    output.files.iter().find(|file| file.relative.to_str() == Some(&*name)).and_then(|file| match &file.content {
        Content::Bytes(bytes) => Some(Cow::Borrowed(bytes.as_slice())),
        Content::CopyOf(_) => None,
    })
}

fn check_sides(sides: &Sides<'_>) -> Result<(), Vec<Error>> {
    let mut problems = unchanged::find_changes(sides);
    problems.extend(levels::find_broken_rules(sides));
    if problems.is_empty() { Ok(()) } else { Err(problems) }
}

fn problem(place: impl Into<String>, message: impl Into<String>) -> Error {
    Error { place: Some(place.into()), ..Error::new(Kind::Internal, message) }
}

fn elements<'a>(object: &'a Value, member: &str) -> &'a [Value] {
    object.get(member).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

fn number(object: &Value, member: &str) -> Option<usize> {
    object.get(member).and_then(Value::as_u64).map(|x| x as usize)
}

fn indices(object: &Value, member: &str) -> Vec<usize> {
    elements(object, member).iter().filter_map(Value::as_u64).map(|x| x as usize).collect()
}

/// `ids` of a node with levels.
fn level_ids(node: &Value) -> Option<Vec<usize>> {
    node.pointer("/extensions/MSFT_lod").map(|extension| indices(extension, "ids"))
}
