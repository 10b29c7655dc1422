//! One preset file: from its tables to what a layer needs, checked as far as a file can be by itself.

use super::builtin;
use super::layers::MeshNames;
use super::model::{self, Keys};
use super::pattern::{NamePattern, PathPattern};
use super::source::Source;
use super::value::{OneOrMore, Placed};
use crate::error::Result;
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A preset file, read and checked as far as it can be by itself.
#[derive(Debug)]
pub struct PresetFile {
    /// What holds without being asked for by name.
    pub body: Body,
    /// What is defined for `extends` and `--preset`.
    pub presets: BTreeMap<String, Body>,
}

/// What a file, a preset or a rule says.
#[derive(Debug)]
pub struct Body {
    /// One line that says what it is for.
    pub description: Option<String>,
    /// The keys, without those of the presets it extends.
    pub keys: Arc<Keys>,
    /// Where it stands.
    pub source: Arc<Source>,
    /// The presets it builds on, each with its place in `source`.
    pub extends: Vec<Placed<String>>,
    /// What is copied beside the models.
    pub copy: Option<Arc<Vec<PathPattern>>>,
    /// Its exceptions, in their order.
    pub rules: Vec<Rule>,
}

/// An exception.
#[derive(Debug)]
pub struct Rule {
    path: Option<Vec<PathPattern>>,
    /// The conditions on names, if there are any.
    pub names: Option<Arc<NameConditions>>,
    /// What holds for what fulfils all conditions.
    pub body: Body,
}

/// The conditions of a rule on names; an absent one always holds.
#[derive(Debug, Default, PartialEq, Serialize)]
pub struct NameConditions {
    #[serde(skip_serializing_if = "Option::is_none")]
    node: Option<OneOrMore<NamePattern>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh: Option<OneOrMore<NamePattern>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    material: Option<OneOrMore<NamePattern>>,
}

impl PresetFile {
    /// Reads a preset file.
    ///
    /// # Errors
    /// [`crate::Kind::Preset`], pointing at the place.
    pub fn parse(source: Source) -> Result<Self> {
        let source = Arc::new(source);
        let file: model::File = source.parse()?;
        let mut presets = BTreeMap::new();
        for (name, preset) in file.preset.iter().flatten() {
            if builtin::is_name(&name.value) {
                let title = format!("`{}` is a built-in preset", name.value);
                return Err(source.error(
                    name.span.clone(),
                    &title,
                    Some("choose another name; it can build on it with `extends`"),
                ));
            }
            let model::Preset { description, extends, copy, rule, .. } = preset;
            presets.insert(name.value.clone(), read_body(&source, description, extends, preset.keys(), copy, rule)?);
        }
        let model::File { description, extends, copy, rule, .. } = &file;
        Ok(Self { body: read_body(&source, description, extends, file.keys(), copy, rule)?, presets })
    }
}

fn read_body(
    source: &Arc<Source>,
    description: &Option<String>,
    extends: &Option<Placed<OneOrMore<String>>>,
    keys: Keys,
    copy: &Option<OneOrMore<PathPattern>>,
    rules: &Option<model::Rules>,
) -> Result<Body> {
    Ok(Body {
        description: description.clone(),
        source: source.clone(),
        extends: read_extends(source, extends),
        keys: Arc::new(keys),
        copy: copy.as_ref().map(|copy| Arc::new(copy.0.clone())),
        rules: read_rules(source, rules)?,
    })
}

fn read_rules(source: &Arc<Source>, rules: &Option<model::Rules>) -> Result<Vec<Rule>> {
    rules.iter().flat_map(|rules| &rules.0).map(|rule| read_rule(source, rule)).collect()
}

fn read_rule(source: &Arc<Source>, rule: &Placed<model::Rule>) -> Result<Rule> {
    let model::Rule { path, node, mesh, material, extends, .. } = &rule.value;
    let keys = rule.value.keys();
    let names = NameConditions { node: node.clone(), mesh: mesh.clone(), material: material.clone() };
    if path.is_none() && names == NameConditions::default() {
        let help = "add `path`, `node`, `mesh` or `material`; what holds everywhere goes to the top of the file";
        return Err(source.error(rule.span.clone(), "this rule has no condition", Some(help)));
    }
    if extends.is_none() && keys == Keys::default() {
        let help = "add a key such as `levels`, `extends` or `skip = true`";
        return Err(source.error(rule.span.clone(), "this rule sets nothing", Some(help)));
    }
    if names != NameConditions::default()
        && let Some((key, span)) = keys.find_file_wide()
    {
        let title = format!("`{key}` holds for whole files, not for single meshes");
        let help = "set it at the top of a file, or in a rule whose only condition is `path`";
        return Err(source.error(span, &title, Some(help)));
    }
    Ok(Rule {
        path: path.as_ref().map(|path| path.0.clone()),
        names: (names != NameConditions::default()).then(|| Arc::new(names)),
        body: read_body(source, &None, extends, keys, &None, &None)?,
    })
}

/// The names in `extends`, each with its own place where the text shows it.
fn read_extends(source: &Source, extends: &Option<Placed<OneOrMore<String>>>) -> Vec<Placed<String>> {
    let Some(extends) = extends else { return Vec::new() };
    let place = |name: &str| source.find_string(&extends.span, name).unwrap_or_else(|| extends.span.clone());
    extends.value.0.iter().map(|name| Placed { value: name.clone(), span: place(name) }).collect()
}

impl Rule {
    /// Whether the condition on paths holds for `path`, which is relative to the directory of the rule's file.
    pub fn holds_for_path(&self, path: &str) -> bool {
        self.path.as_ref().is_none_or(|patterns| patterns.iter().any(|pattern| pattern.matches(path)))
    }
}

impl NameConditions {
    /// Whether all of them hold.
    pub fn hold(&self, names: &MeshNames<'_>) -> bool {
        let matches = |patterns: &Option<OneOrMore<NamePattern>>, names: &[&str]| {
            patterns
                .as_ref()
                .is_none_or(|patterns| patterns.0.iter().any(|pattern| names.iter().any(|name| pattern.matches(name))))
        };
        matches(&self.mesh, &[names.mesh.unwrap_or_default()])
            && matches(&self.node, &as_strs(names.nodes))
            && matches(&self.material, &as_strs(names.materials))
    }
}

fn as_strs(names: &[String]) -> Vec<&str> {
    names.iter().map(String::as_str).collect()
}
