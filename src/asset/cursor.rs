//! A JSON value together with its pointer, so that what is wrong can be said where it is wrong.

use crate::error::{Error, Result};
use serde_json::{Map, Value};

/// A value inside the document and the JSON pointer to it.
#[derive(Debug, Clone)]
pub(super) struct Cursor<'a> {
    pub value: &'a Value,
    pub place: String,
}

impl<'a> Cursor<'a> {
    pub fn root(value: &'a Value) -> Self {
        Self { value, place: String::new() }
    }

    /// The element `index` of the top-level array `name`, if it is there.
    pub fn top(root: &'a Value, name: &str, index: usize) -> Option<Self> {
        let value = root.get(name)?.get(index)?;
        Some(Self { value, place: format!("/{name}/{index}") })
    }

    fn child(&self, value: &'a Value, step: &str) -> Self {
        let step = step.replace('~', "~0").replace('/', "~1");
        Self { value, place: format!("{}/{step}", self.place) }
    }

    /// The member `name`, if it is there.
    pub fn get(&self, name: &str) -> Option<Self> {
        self.value.get(name).map(|value| self.child(value, name))
    }

    /// The member `name`, which must be there.
    pub fn need(&self, name: &str) -> Result<Self> {
        self.get(name).ok_or_else(|| self.error(format!("\"{name}\" is missing")))
    }

    /// The payload of the extension `name`, if it is there.
    pub fn extension(&self, name: &str) -> Option<Self> {
        self.get("extensions")?.get(name)
    }

    pub fn error(&self, message: impl Into<String>) -> Error {
        Error::malformed(self.place.clone(), message)
    }

    pub fn expected(&self, what: &str) -> Error {
        self.error(format!("expected {what}, found {}", describe(self.value)))
    }

    pub fn object(&self) -> Result<&'a Map<String, Value>> {
        self.value.as_object().ok_or_else(|| self.expected("an object"))
    }

    /// The members of an object.
    pub fn members(&self) -> Result<impl Iterator<Item = (&'a str, Cursor<'a>)> + use<'a>> {
        let this = self.clone();
        Ok(self.object()?.iter().map(move |(name, value)| (name.as_str(), this.child(value, name))))
    }

    /// The elements of an array.
    pub fn elements(&self) -> Result<impl ExactSizeIterator<Item = Cursor<'a>> + use<'a>> {
        let array = self.value.as_array().ok_or_else(|| self.expected("an array"))?;
        let this = self.clone();
        Ok(array.iter().enumerate().map(move |(i, value)| this.child(value, &i.to_string())))
    }

    pub fn string(&self) -> Result<&'a str> {
        self.value.as_str().ok_or_else(|| self.expected("a string"))
    }

    pub fn boolean(&self) -> Result<bool> {
        self.value.as_bool().ok_or_else(|| self.expected("true or false"))
    }

    /// A whole number that fits the machine.
    pub fn integer(&self) -> Result<usize> {
        let number = self.value.as_u64().ok_or_else(|| self.expected("a whole number, not negative"))?;
        usize::try_from(number).map_err(|_| self.expected("a number of this machine's size"))
    }

    /// `N` numbers.
    pub fn numbers<const N: usize>(&self) -> Result<[f64; N]> {
        let wrong = || self.expected(&format!("{N} numbers"));
        let numbers = self.value.as_array().ok_or_else(wrong)?.iter().map(Value::as_f64).collect::<Option<Vec<_>>>();
        numbers.and_then(|n| n.try_into().ok()).ok_or_else(wrong)
    }

    /// An index into the top-level array `name`, which has `length` elements.
    pub fn index(&self, name: &str, length: usize) -> Result<usize> {
        let index = self.integer()?;
        if index < length {
            return Ok(index);
        }
        let there = match length {
            0 => format!("the document has no {name}"),
            1 => format!("the only one is {name}[0]"),
            _ => format!("the last is {name}[{}]", length - 1),
        };
        Err(self.error(format!("names {name}[{index}], but {there}")))
    }
}

/// The value in a few words, for messages.
fn describe(value: &Value) -> String {
    const LONGEST: usize = 40;
    match value {
        Value::Null => "null".to_owned(),
        Value::Bool(b) => b.to_string(),
        Value::Number(n) => n.to_string(),
        Value::String(s) if s.chars().count() <= LONGEST => format!("{s:?}"),
        Value::String(s) => format!("{:?}…", s.chars().take(LONGEST).collect::<String>()),
        Value::Array(a) => format!("an array of {}", a.len()),
        Value::Object(_) => "an object".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn errors_name_place_expectation_and_finding() {
        let root = json!({"nodes": [{"mesh": -1, "a/b": {}}], "count": 1e300});
        let node = Cursor::top(&root, "nodes", 0).unwrap();
        let mesh = node.get("mesh").unwrap();
        assert_eq!(
            mesh.integer().unwrap_err().to_string(),
            "/nodes/0/mesh: expected a whole number, not negative, found -1"
        );
        assert_eq!(node.get("a/b").unwrap().place, "/nodes/0/a~1b");
        assert!(Cursor::root(&root).need("count").unwrap().integer().is_err());
        assert!(Cursor::root(&root).need("x").unwrap_err().to_string().ends_with("\"x\" is missing"));
    }

    #[test]
    fn an_index_must_be_below_the_length() {
        let value = json!(3);
        assert_eq!(Cursor::root(&value).index("meshes", 4).unwrap(), 3);
        let message = Cursor::root(&value).index("meshes", 3).unwrap_err().to_string();
        assert!(message.ends_with("names meshes[3], but the last is meshes[2]"), "{message}");
    }
}
