//! What layers extend, written out: a list of steps, each with the conditions on names under which it holds.

use super::file::{Body, NameConditions, PresetFile};
use super::model::Keys;
use super::pattern::PathPattern;
use super::source::{Source, suggest};
use crate::error::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// More presets than this behind one asset are no design but a knot: lists in `extends` can double at every step.
const MOST_PRESETS: usize = 1000;

/// Keys that hold where all conditions do. Conditions on paths are decided before a step is made.
#[derive(Debug, Clone)]
pub struct Step {
    /// What is set.
    pub keys: Arc<Keys>,
    /// All have to hold.
    pub conditions: Vec<Arc<NameConditions>>,
    /// Where it stands.
    pub source: Arc<Source>,
    /// The source's name in reports: no directory outside the input root.
    pub label: Arc<str>,
}

/// A list of files to copy.
#[derive(Debug, Clone)]
pub struct Copy {
    /// The directory that the patterns are relative to, below the input root.
    directory: PathBuf,
    patterns: Arc<Vec<PathPattern>>,
}

/// A preset file with what its patterns are relative to.
pub struct Layer {
    /// The file.
    pub file: Arc<PresetFile>,
    /// Below the input root.
    directory: PathBuf,
    /// The asset's path below `directory`.
    asset: String,
    label: Arc<str>,
}

impl Copy {
    /// Whether the file at `relative` (to the input root) is copied.
    pub fn holds(&self, relative: &Path) -> bool {
        let Ok(below) = relative.strip_prefix(&self.directory) else { return false };
        let path = slashed(below);
        self.patterns.iter().any(|pattern| pattern.matches(&path))
    }
}

impl Layer {
    /// A file that stands in `directory` (below the input root), for `asset`; `label` is its name in reports.
    pub fn new(file: Arc<PresetFile>, directory: &Path, asset: &Path, label: &str) -> Self {
        let below = asset.strip_prefix(directory).unwrap_or(asset);
        Self { file, directory: directory.to_owned(), asset: slashed(below), label: label.into() }
    }
}

/// Writes out layers, with all they extend, as steps.
pub struct Expansion<'a> {
    /// Nearest first; the built-in presets are the last.
    layers: &'a [Layer],
    /// What has been written out, later steps win.
    pub steps: Vec<Step>,
    /// The nearest list of copies.
    pub copy: Option<Copy>,
    /// The presets being written out, outermost first, by layer and name.
    open: Vec<(usize, &'a str)>,
    /// How many presets have been written out.
    presets: usize,
    /// Rules for other paths are written out, too.
    every_path: bool,
}

impl<'a> Expansion<'a> {
    /// Nothing written out yet.
    pub fn new(layers: &'a [Layer]) -> Self {
        Self { layers, steps: Vec::new(), copy: None, open: Vec::new(), presets: 0, every_path: false }
    }

    /// Writes out `body`, which stands in layer `at` and holds under `conditions`: what it extends, its keys, its rules.
    pub fn add(&mut self, at: usize, body: &'a Body, conditions: &[Arc<NameConditions>]) -> Result<()> {
        for name in &body.extends {
            let unknown = |title: &str, help: &str| body.source.error(name.span.clone(), title, Some(help));
            self.add_preset(at, &name.value, conditions, &unknown)?;
        }
        let layer = &self.layers[at];
        let for_some_meshes = !conditions.is_empty() && body.keys.find_file_wide().is_some();
        let keys = if for_some_meshes { Arc::new(body.keys.without_file_wide()) } else { body.keys.clone() };
        self.steps.push(Step {
            keys,
            conditions: conditions.to_vec(),
            source: body.source.clone(),
            label: layer.label.clone(),
        });
        if let Some(patterns) = &body.copy {
            self.copy = Some(Copy { directory: layer.directory.clone(), patterns: patterns.clone() });
        }
        let every_path = self.every_path;
        for rule in body.rules.iter().filter(|rule| every_path || rule.holds_for_path(&layer.asset)) {
            let conditions: Vec<_> = conditions.iter().chain(&rule.names).cloned().collect();
            self.add(at, &rule.body, &conditions)?;
        }
        Ok(())
    }

    /// Writes out the preset `name`, seen from layer `from`. `refuse` makes an error, from title and help, at the place that
    /// asks for it.
    pub fn add_preset(
        &mut self,
        from: usize,
        name: &str,
        conditions: &[Arc<NameConditions>],
        refuse: &dyn Fn(&str, &str) -> Error,
    ) -> Result<()> {
        let layers = self.layers;
        let found = layers.iter().enumerate().skip(from).find_map(|(at, layer)| {
            let (name, body) = layer.file.presets.get_key_value(name)?;
            Some((at, name.as_str(), body))
        });
        let Some((at, name, body)) = found else {
            let names = layers.iter().skip(from).rev().flat_map(|layer| layer.file.presets.keys());
            return Err(refuse(&format!("unknown preset `{name}`"), &suggest(name, names.map(String::as_str))));
        };
        if let Some(first) = self.open.iter().position(|&open| open == (at, name)) {
            let circle: Vec<&str> = self.open.iter().skip(first).map(|(_, name)| *name).chain([name]).collect();
            return Err(refuse(
                &format!("presets extend each other in a circle: {}", circle.join(" → ")),
                "remove one `extends`",
            ));
        }
        self.presets += 1;
        if self.presets > MOST_PRESETS {
            return Err(refuse(&format!("more than {MOST_PRESETS} presets behind one"), "extend fewer presets"));
        }
        self.open.push((at, name));
        self.add(at, body, conditions)?;
        self.open.pop();
        Ok(())
    }
}

/// Finds unknown names and circles also where this asset does not come: in presets that nothing uses yet and in rules for
/// other paths.
pub fn check_names(layers: &[Layer]) -> Result<()> {
    for (at, layer) in layers.iter().enumerate() {
        let unnamed = (None, &layer.file.body);
        let named = layer.file.presets.iter().map(|(name, body)| (Some((at, name.as_str())), body));
        for (name, body) in named.chain([unnamed]) {
            let mut expansion = Expansion { every_path: true, ..Expansion::new(layers) };
            expansion.open.extend(name);
            expansion.add(at, body, &[])?;
        }
    }
    Ok(())
}

/// `path` with `/` between directories on every system.
pub fn slashed(path: &Path) -> String {
    let parts: Vec<_> = path.components().map(|part| part.as_os_str().to_string_lossy()).collect();
    parts.join("/")
}
