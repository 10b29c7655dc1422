//! The JSON document and the only ways to change it: append and patch.

use serde_json::Value;

/// A glTF document. Reading is free; changes go through the methods here, which only ever append or add members.
#[derive(Debug, Clone, PartialEq)]
pub struct Document {
    root: Value,
}

impl Document {
    /// Wraps a parsed document. `root` must be an object.
    pub(crate) fn new(root: Value) -> Self {
        Self { root }
    }

    /// The whole document.
    pub fn root(&self) -> &Value {
        &self.root
    }

    /// The elements of the top-level array `name` (`"nodes"`, `"meshes"`, …); empty when absent.
    pub fn array(&self, name: &str) -> &[Value] {
        self.root.get(name).and_then(Value::as_array).map_or(&[], Vec::as_slice)
    }
}
