//! Globs over paths and over names.

use globset::{GlobBuilder, GlobSet};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;

/// A glob over paths, relative to the directory of the preset file.
///
/// `*` stops at `/`, `**` does not. A pattern without `/` matches the file name in every directory below.
#[derive(Debug, Clone)]
pub struct PathPattern(Pattern);

/// A glob over the names of nodes, meshes and materials; `*` matches any characters.
#[derive(Debug, Clone)]
pub struct NamePattern(Pattern);

#[derive(Clone)]
struct Pattern {
    written: String,
    glob: GlobSet,
}

impl fmt::Debug for Pattern {
    /// Without the compiled automaton, which fills pages.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.written.fmt(f)
    }
}

impl PathPattern {
    /// Whether the pattern matches `path`, whose directories are separated by `/`.
    pub fn matches(&self, path: &str) -> bool {
        self.0.glob.is_match(path)
    }

    fn new(written: &str) -> Result<Self, String> {
        if written.contains('\\') {
            return Err(
                "a path pattern has `/` between directories, not `\\`\nto match a star itself write `[*]`".into()
            );
        }
        if written.split('/').any(|part| part == "..") {
            return Err("paths are relative to this file's directory and cannot leave it\nmove the rule to a `gltf-lod.toml` higher up".into());
        }
        if written.is_empty() {
            return Err(EMPTY.into());
        }
        let anchored = match written.strip_prefix("./").or_else(|| written.strip_prefix('/')) {
            Some(below) => below.to_owned(),
            None if written.contains('/') => written.to_owned(),
            None => format!("**/{written}"),
        };
        let whole_directory = if anchored.ends_with('/') { "**" } else { "" };
        let glob = compile(&(anchored + whole_directory), true)?;
        Ok(Self(Pattern { written: written.to_owned(), glob }))
    }
}

impl NamePattern {
    /// Whether the pattern matches the whole of `name`.
    pub fn matches(&self, name: &str) -> bool {
        self.0.glob.is_match(name)
    }

    fn new(written: &str) -> Result<Self, String> {
        Ok(Self(Pattern { written: written.to_owned(), glob: compile(written, false)? }))
    }
}

const EMPTY: &str = "an empty pattern matches nothing\nremove it, or write `*`";

/// Unlike a single matcher, a set reports a pattern that is too large to compile instead of panicking.
fn compile(pattern: &str, stop_at_slash: bool) -> Result<GlobSet, String> {
    if pattern.is_empty() {
        return Err(EMPTY.into());
    }
    GlobBuilder::new(pattern)
        .literal_separator(stop_at_slash)
        .backslash_escape(true)
        .empty_alternates(true)
        .build()
        .and_then(|glob| GlobSet::builder().add(glob).build())
        .map_err(|error| {
            format!(
                "not a pattern: {}\nto match a special character itself write it in brackets, e.g. `[[]`",
                error.kind()
            )
        })
}

macro_rules! read_pattern {
    ($Name:ident, $expected:literal) => {
        impl<'de> Deserialize<'de> for $Name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Reader;
                impl Visitor<'_> for Reader {
                    type Value = $Name;
                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        f.write_str($expected)
                    }
                    fn visit_str<E: Error>(self, written: &str) -> Result<$Name, E> {
                        $Name::new(written).map_err(E::custom)
                    }
                }
                deserializer.deserialize_any(Reader)
            }
        }

        impl Serialize for $Name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(&self.0.written)
            }
        }

        impl PartialEq for $Name {
            fn eq(&self, other: &Self) -> bool {
                self.0.written == other.0.written
            }
        }

        impl JsonSchema for $Name {
            fn inline_schema() -> bool {
                true
            }
            fn schema_name() -> Cow<'static, str> {
                stringify!($Name).into()
            }
            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!({ "type": "string", "minLength": 1 })
            }
        }
    };
}

read_pattern!(PathPattern, "a path pattern such as \"props/**\" or \"*_hero.glb\"");
read_pattern!(NamePattern, "a name pattern such as \"*_collision\"");

/// How level nodes are called: `{name}` and `{level}` are replaced.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Naming(String);

impl Naming {
    /// The template.
    pub fn template(&self) -> &str {
        &self.0
    }

    fn new(template: &str) -> Result<Self, String> {
        let mut rest = template;
        while let Some((_, after)) = rest.split_once('{') {
            let (word, after) = after.split_once('}').ok_or("`{` without `}`\nthe words are `{name}` and `{level}`")?;
            if !["name", "level"].contains(&word) {
                return Err(format!("unknown word `{{{word}}}`\nthe words are `{{name}}` and `{{level}}`"));
            }
            rest = after;
        }
        if !template.contains("{level}") {
            return Err("all levels would have the same name\nadd `{level}`, as in \"{name}_LOD{level}\"".into());
        }
        Ok(Self(template.to_owned()))
    }
}

impl<'de> Deserialize<'de> for Naming {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NamingVisitor)
    }
}

struct NamingVisitor;

impl Visitor<'_> for NamingVisitor {
    type Value = Naming;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a name such as \"{name}_LOD{level}\"")
    }

    fn visit_str<E: Error>(self, template: &str) -> Result<Naming, E> {
        Naming::new(template).map_err(E::custom)
    }
}

impl JsonSchema for Naming {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        "Naming".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "pattern": r"^(([^{]|\{name\})*\{level\})([^{]|\{name\}|\{level\})*$" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matches(pattern: &str, path: &str) -> bool {
        PathPattern::new(pattern).unwrap().matches(path)
    }

    #[test]
    fn path_patterns_work_like_gitignore() {
        for (pattern, path, expected) in [
            ("*.glb", "tree.glb", true),
            ("*.glb", "forest/old/tree.glb", true),
            ("/*.glb", "forest/tree.glb", false),
            ("./*.glb", "tree.glb", true),
            ("forest/*.glb", "forest/tree.glb", true),
            ("forest/*.glb", "forest/old/tree.glb", false),
            ("forest/*.glb", "deep/forest/tree.glb", false),
            ("forest/", "forest/old/tree.glb", true),
            ("forest/**", "forest/old/tree.glb", true),
            ("**/old/**/*.glb", "old/tree.glb", true),
            ("**/old/*.{glb,gltf}", "a/b/old/tree.gltf", true),
            ("my props/wood chair*.glb", "my props/wood chair 2.glb", true),
            ("möbel/stühle/**", "möbel/stühle/lehnstuhl.glb", true),
            ("?öbel.glb", "möbel.glb", true),
            ("木/*.glb", "木/桜.glb", true),
            ("a%20b.glb", "a b.glb", false),
            ("[ab].glb", "b.glb", true),
            ("Tree.glb", "tree.glb", false),
        ] {
            assert_eq!(matches(pattern, path), expected, "{pattern} on {path}");
        }
    }

    #[test]
    fn names_are_matched_whole_and_slashes_are_letters() {
        let pattern = NamePattern::new("*_collision").unwrap();
        assert!(pattern.matches("rooms/hall_collision"));
        assert!(pattern.matches("wände außen_collision"));
        assert!(!pattern.matches("hall_collision.001"));
        assert!(NamePattern::new("*").unwrap().matches(""));
    }

    #[test]
    fn bad_patterns_say_what_to_write() {
        for (pattern, expected) in [
            ("a[b.glb", "not a pattern: unclosed character class"),
            ("a\\b.glb", "`/` between directories"),
            ("../other/*.glb", "cannot leave it"),
            ("", "an empty pattern"),
            ("/", "an empty pattern"),
        ] {
            let error = PathPattern::new(pattern).unwrap_err();
            assert!(error.contains(expected), "{pattern}: {error}");
        }
        assert!(NamePattern::new(&"{a?,b*}".repeat(100_000)).is_err());
    }
}
