//! The JSON document and the only ways to change it: append and patch.
//!
//! Nothing is ever removed from a top-level array or moved inside it, so that no index changes, not even one that
//! stands in an extension this tool does not know. Places are JSON pointers (`/nodes/3`); an edit of a place that does
//! not exist does nothing, because the structural pass has already vouched for every place that is edited.

use serde::Serialize;
use serde_json::{Map, Value};

/// A glTF document. Reading is free; changes go through the methods here, which only ever append or add members.
#[derive(Debug, Clone, PartialEq)]
pub struct Document {
    root: Value,
    /// What one level of nesting is indented by; `None` writes everything on one line.
    indent: Option<String>,
}

impl Document {
    /// Wraps a parsed document. `root` must be an object.
    pub(crate) fn new(root: Value) -> Self {
        Self { root, indent: None }
    }

    /// Writes the document as `text` was written: on one line, or indented as its first member is.
    pub(crate) fn styled_like(mut self, text: &[u8]) -> Self {
        self.indent = indent_of(text);
        self
    }

    /// The whole document.
    pub fn root(&self) -> &Value {
        &self.root
    }

    /// The elements of the top-level array `name` (`"nodes"`, `"meshes"`, …); empty when absent.
    pub fn array(&self, name: &str) -> &[Value] {
        self.root.get(name).and_then(Value::as_array).map_or(&[], Vec::as_slice)
    }

    /// Appends to the top-level array `name` and returns the new element's index.
    pub(crate) fn push(&mut self, name: &str, element: Value) -> usize {
        self.append("", name, element);
        self.array(name).len() - 1
    }

    /// Appends to the array `member` of the object at `place`, which is made where it is missing.
    pub(crate) fn append(&mut self, place: &str, member: &str, element: Value) {
        let Some(object) = self.object(place) else { return };
        if let Value::Array(array) = object.entry(member).or_insert_with(|| Value::Array(Vec::new())) {
            array.push(element);
        }
    }

    /// Adds the member or gives it another value.
    pub(crate) fn set(&mut self, place: &str, member: &str, value: Value) {
        if let Some(object) = self.object(place) {
            object.insert(member.to_owned(), value);
        }
    }

    /// Takes a member out, to put it elsewhere.
    pub(crate) fn take(&mut self, place: &str, member: &str) -> Option<Value> {
        self.object(place)?.shift_remove(member)
    }

    /// Puts `value` in the place of what is there (an element of an array).
    pub(crate) fn replace(&mut self, place: &str, value: Value) {
        if let Some(old) = self.root.pointer_mut(place) {
            *old = value;
        }
    }

    /// Adds an extension to the object at `place`. What uses it is up to [`Document::add_extension_used`].
    pub(crate) fn set_extension(&mut self, place: &str, name: &str, payload: Value) {
        let Some(object) = self.object(place) else { return };
        if let Value::Object(extensions) = object.entry("extensions").or_insert_with(|| Value::Object(Map::new())) {
            extensions.insert(name.to_owned(), payload);
        }
    }

    /// Takes an extension out of the object at `place`, and `extensions` with it when it was the only one.
    pub(crate) fn take_extension(&mut self, place: &str, name: &str) -> Option<Value> {
        let object = self.object(place)?;
        let extensions = object.get_mut("extensions")?.as_object_mut()?;
        let payload = extensions.shift_remove(name);
        if payload.is_some() && extensions.is_empty() {
            object.shift_remove("extensions");
        }
        payload
    }

    /// Names the extension in `extensionsUsed`, once.
    pub(crate) fn add_extension_used(&mut self, name: &str) {
        if !self.array("extensionsUsed").iter().any(|used| used == name) {
            self.append("", "extensionsUsed", name.into());
        }
    }

    /// Takes the name out of `extensionsUsed`, and the list when it was the only one.
    pub(crate) fn remove_extension_used(&mut self, name: &str) {
        let Some(root) = self.object("") else { return };
        if let Some(Value::Array(used)) = root.get_mut("extensionsUsed") {
            used.retain(|used| used != name);
            if used.is_empty() {
                root.shift_remove("extensionsUsed");
            }
        }
    }

    /// The JSON text, in the style of the source.
    pub(crate) fn to_json(&self) -> Vec<u8> {
        let Some(indent) = &self.indent else { return self.root.to_string().into_bytes() };
        let mut text = Vec::new();
        let formatter = serde_json::ser::PrettyFormatter::with_indent(indent.as_bytes());
        let mut serializer = serde_json::Serializer::with_formatter(&mut text, formatter);
        // Into memory, with text for keys, this cannot fail.
        match self.root.serialize(&mut serializer) {
            Ok(()) => text.push(b'\n'),
            Err(_) => text = self.root.to_string().into_bytes(),
        }
        text
    }

    fn object(&mut self, place: &str) -> Option<&mut Map<String, Value>> {
        self.root.pointer_mut(place)?.as_object_mut()
    }
}

/// The white space before the first member, if that member stands on a line of its own.
fn indent_of(text: &[u8]) -> Option<String> {
    let inside = text.iter().position(|&b| b == b'{').and_then(|brace| text.get(brace + 1..))?;
    let white: Vec<u8> = inside.iter().copied().take_while(u8::is_ascii_whitespace).collect();
    let line = white.iter().rposition(|&b| b == b'\n')?;
    let indent = white.get(line + 1..)?;
    // Longer than any editor's: rather a file that was padded than one that was indented.
    (indent.len() <= 16).then(|| String::from_utf8_lossy(indent).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn edits_append_and_keep_the_order_of_members() {
        let mut document = Document::new(json!({"asset": {"version": "2.0"}, "nodes": [{"name": "a", "mesh": 0}]}));
        assert_eq!(document.push("nodes", json!({"name": "b"})), 1);
        assert_eq!(document.push("meshes", json!({"name": "m"})), 0);
        document.append("/nodes/0", "children", 1.into());
        document.set_extension("/nodes/0", "MSFT_lod", json!({"ids": [1]}));
        document.add_extension_used("MSFT_lod");
        document.add_extension_used("MSFT_lod");
        assert_eq!(document.take("/nodes/0", "mesh"), Some(json!(0)));
        assert_eq!(document.take("/nodes/9", "mesh"), None);
        let text = String::from_utf8(document.to_json()).unwrap();
        assert_eq!(
            text,
            r#"{"asset":{"version":"2.0"},"nodes":[{"name":"a","children":[1],"extensions":{"MSFT_lod":{"ids":[1]}}},{"name":"b"}],"meshes":[{"name":"m"}],"extensionsUsed":["MSFT_lod"]}"#
        );
        assert_eq!(document.take_extension("/nodes/0", "MSFT_lod"), Some(json!({"ids": [1]})));
        assert_eq!(document.root().pointer("/nodes/0/extensions"), None);
    }

    #[test]
    fn the_text_is_written_in_the_style_it_was_read_in() {
        for (text, indent) in [
            ("{\"asset\":{}}", None),
            ("{ \"asset\":{}}", None),
            ("{\n\t\"asset\":{}\n}", Some("\t")),
            ("\u{feff}{\r\n    \"asset\":{}\r\n}", Some("    ")),
            ("{}", None),
            ("", None),
        ] {
            assert_eq!(indent_of(text.as_bytes()).as_deref(), indent, "{text:?}");
        }
        let document = Document::new(json!({"a": [1]})).styled_like(b"{\n\t\"a\":[1]}");
        assert_eq!(document.to_json(), b"{\n\t\"a\": [\n\t\t1\n\t]\n}\n");
    }
}
