//! The text of a preset file, and messages that point into it.
//!
//! Every message names the file, line and column (counted in characters, from 1), shows the line with carets under the
//! place, and says what to write instead where that can be known.

use crate::error::{Error, Kind, Result};
use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use serde::de::DeserializeOwned;
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Larger than any preset that a person writes.
const LARGEST_FILE: usize = 1 << 20;

/// Longer words are no slips of the finger.
const LONGEST_WORD: usize = 40;

/// More names are no help.
const MOST_NAMES: usize = 40;

/// Characters of a message, without the picture.
const LONGEST_TITLE: usize = 300;

/// What people write first, and the key that does it.
const OTHER_WORDS: [(&str, &str); 6] = [
    ("ratio", "levels"),
    ("ratios", "levels"),
    ("targets", "levels"),
    ("file", "path"),
    ("glob", "path"),
    ("weights", "attribute_weights"),
];

/// A preset file.
#[derive(Debug)]
pub struct Source {
    path: PathBuf,
    text: String,
}

impl Source {
    /// A text and the path that messages name.
    pub fn new(path: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        Self { path: path.into(), text: text.into() }
    }

    /// Reads the file at `path`; `None` where there is none.
    ///
    /// # Errors
    /// [`Kind::Io`]; [`Kind::Limit`] above 1 MiB; [`Kind::Preset`] for text that is not UTF-8.
    pub fn read(path: &Path) -> Result<Option<Self>> {
        if path.symlink_metadata().is_err_and(|error| error.kind() == ErrorKind::NotFound) {
            return Ok(None);
        }
        let bytes = read_at_most(path, LARGEST_FILE).map_err(|error| Error::io(path, &error))?;
        if bytes.len() > LARGEST_FILE {
            let message = format!("a preset of more than {LARGEST_FILE} bytes");
            return Err(Error::new(Kind::Limit, message).in_file(path));
        }
        match String::from_utf8(bytes) {
            Ok(text) => Ok(Some(Self::new(path, text))),
            Err(error) => {
                let good = error.utf8_error().valid_up_to();
                let source = Self::new(path, String::from_utf8_lossy(error.as_bytes()));
                let end = good + char::REPLACEMENT_CHARACTER.len_utf8();
                Err(source.error(good..end, "this is not UTF-8", Some("save the file as UTF-8")))
            }
        }
    }

    /// The path that messages name.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads the TOML into a `T`.
    ///
    /// # Errors
    /// [`Kind::Preset`], pointing at the place.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T> {
        toml::from_str(&self.text).map_err(|error| {
            let span = error.span().unwrap_or(0..0);
            let (title, help) = reword(error.message(), self.text.get(span.clone()));
            self.error(span, &title, help.as_deref())
        })
    }

    /// Line and column of a byte offset, both from 1, the column in characters.
    pub fn position(&self, offset: usize) -> (usize, usize) {
        let before = self.text.get(..self.boundary_at_or_before(offset)).unwrap_or_default();
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let in_line = before.get(line_start..).unwrap_or_default();
        (before.matches('\n').count() + 1, in_line.trim_start_matches('\u{feff}').chars().count() + 1)
    }

    /// An error at the byte range `span`: what is wrong, and the way out.
    pub fn error(&self, span: Range<usize>, title: &str, help: Option<&str>) -> Error {
        let title = shorten(title);
        let span = self.first_line_of(span);
        let (line, column) = self.position(span.start);
        let snippet = Snippet::source(self.text.as_str()).annotation(AnnotationKind::Primary.span(span));
        let mut group = Group::with_level(Level::ERROR).element(snippet);
        if let Some(help) = help {
            group = group.element(Level::HELP.message(help));
        }
        let picture = Renderer::plain().render(&[group]);
        let mut error = Error::new(Kind::Preset, format!("{title}\n{picture}")).in_file(&self.path);
        error.place = Some(format!("line {line}, column {column}"));
        error
    }

    /// Where `text` stands as a plain string within `span`, quotes included.
    pub fn find_string(&self, span: &Range<usize>, text: &str) -> Option<Range<usize>> {
        let within = self.text.get(span.clone())?;
        let quoted = [format!("\"{text}\""), format!("'{text}'")];
        let start = quoted.iter().find_map(|quoted| within.find(quoted))? + span.start;
        Some(start..start + text.len() + 2)
    }

    /// The part of `span` on its first line, on character boundaries: carets under ten lines point at nothing.
    fn first_line_of(&self, span: Range<usize>) -> Range<usize> {
        let start = self.boundary_at_or_before(span.start);
        let end = self.boundary_at_or_before(span.end);
        let marked = self.text.get(start..end).unwrap_or_default();
        start..start + marked.lines().next().unwrap_or_default().len()
    }

    fn boundary_at_or_before(&self, offset: usize) -> usize {
        (0..=offset.min(self.text.len())).rev().find(|&at| self.text.is_char_boundary(at)).unwrap_or(0)
    }
}

/// The file's bytes, or one more than `limit` of them. A pipe is refused: reading it could wait for ever.
fn read_at_most(path: &Path, limit: usize) -> io::Result<Vec<u8>> {
    if !path.metadata()?.is_file() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "not a regular file"));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(limit as u64 + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// A message stays readable whatever the file is full of.
fn shorten(title: &str) -> Cow<'_, str> {
    match title.char_indices().nth(LONGEST_TITLE) {
        Some((end, _)) => format!("{}…", title.get(..end).unwrap_or_default()).into(),
        None => title.into(),
    }
}

/// serde's wording, in words that a newcomer to TOML and Rust understands: title and help.
///
/// The types of this room put their help on a second line of the message. `written` is the text that the message is about.
pub fn reword(message: &str, written: Option<&str>) -> (String, Option<String>) {
    let (title, help) =
        message.split_once('\n').map_or((message, None), |(title, help)| (title, Some(help.to_owned())));
    for (prefix, what) in [("unknown field `", "unknown key"), ("unknown variant `", "unknown value")] {
        if let Some((word, expected)) = title.strip_prefix(prefix).and_then(|rest| rest.split_once("`, expected ")) {
            return (format!("{what} `{word}`"), Some(suggest(word, backticked(expected))));
        }
    }
    for prefix in ["invalid type: ", "invalid value: "] {
        if let Some((found, expected)) = title.strip_prefix(prefix).and_then(|rest| rest.split_once(", expected ")) {
            let found = name_found(found, written);
            return (format!("expected {}, found {found}", expected.replace("a boolean", "true or false")), help);
        }
    }
    let title = match title {
        "wanted string or table" => "expected a word in quotes",
        "string values must be quoted, expected literal string" if written.is_none_or(str::is_empty) => {
            "a value is missing"
        }
        "string values must be quoted, expected literal string" => "text must stand in quotes",
        title => title,
    };
    (title.replace("missing field", "missing key"), help)
}

/// What stands in the file, as it stands there where that is short.
fn name_found(serde: &str, written: Option<&str>) -> String {
    match (serde, written) {
        ("map", _) => "a table".to_owned(),
        ("sequence", _) => "a list".to_owned(),
        (_, Some(text)) if !text.is_empty() && text.len() <= 40 && !text.contains('\n') => format!("`{text}`"),
        (other, _) => other.replace("floating point ", ""),
    }
}

/// The words between backticks.
fn backticked(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// "did you mean …?" where one of `names` is near, else what there is.
pub fn suggest<'a>(written: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.into_iter().collect();
    match nearest(written, &names) {
        Some(name) => format!("did you mean `{name}`?"),
        None => {
            let quoted: Vec<String> = names.iter().take(MOST_NAMES).map(|name| format!("`{name}`")).collect();
            let more = if names.len() > MOST_NAMES { ", …" } else { "" };
            format!("there is {}{more}", quoted.join(", "))
        }
    }
}

fn nearest<'a>(written: &str, names: &[&'a str]) -> Option<&'a str> {
    let length = written.chars().count();
    if length > LONGEST_WORD {
        return None;
    }
    let written = written.to_lowercase().replace('-', "_");
    if let Some((_, meant)) = OTHER_WORDS.iter().find(|(word, _)| *word == written)
        && let Some(name) = names.iter().find(|name| *name == meant)
    {
        return Some(name);
    }
    names
        .iter()
        .map(|name| (strsim::damerau_levenshtein(&written, name), *name))
        .min()
        .filter(|(slips, _)| *slips <= length.div_ceil(3))
        .map(|(_, name)| name)
}
