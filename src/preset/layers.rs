//! Layers: which preset files hold for an asset, in which order, and what they add up to for a mesh.
//!
//! The order is: the built-in `default` → every `gltf-lod.toml` from the input root down to the asset's directory →
//! `--config` → `--preset` → the other flags. A layer is what it `extends`, then its keys, then its rules in their order; what
//! comes later wins. A name in `extends` is looked up in the file itself, then in the files further out, then among the
//! built-in presets.

use super::level::Levels;
use super::model::{self, Keys};
use super::pattern::{NamePattern, PathPattern};
use super::source::{Source, reword, suggest};
use super::value::{OneOrMore, Placed};
use super::{Coverage, Settings, builtin, settings};
use crate::error::{Error, Kind, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Name of the preset files in asset directories.
pub const FILE_NAME: &str = "gltf-lod.toml";

/// More presets than this behind one asset are no design but a knot (lists in `extends` can double at every step).
const MOST_PRESETS: usize = 1000;

/// All preset layers of a run. Files are read once; may be shared between threads.
#[derive(Debug)]
pub struct Presets {
    config: Option<Arc<PresetFile>>,
    preset: Option<String>,
    flags: Step,
    /// By directory.
    files: Mutex<BTreeMap<PathBuf, Arc<ReadOnce>>>,
}

type ReadOnce = OnceLock<Result<Option<Arc<PresetFile>>>>;

/// What the command line says about presets.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Flags {
    /// `--config FILE`.
    pub config: Option<PathBuf>,
    /// `--preset NAME`: a built-in preset or one that a config file defines.
    pub preset: Option<String>,
    /// `--levels 0.5,0.25`: replaces the levels of every layer.
    pub levels: Option<Vec<f64>>,
    /// `--algorithm NAME`.
    pub algorithm: Option<String>,
}

/// The layers that apply to one asset, read and checked; cheap to clone.
#[derive(Debug, Clone)]
pub struct AssetPresets {
    steps: Arc<[Step]>,
    copy: Option<Copy>,
}

/// The names that rules match.
#[derive(Debug, Clone, Copy, Default)]
pub struct MeshNames<'a> {
    /// Name of the mesh, if it has one.
    pub mesh: Option<&'a str>,
    /// Names of the nodes that draw it.
    pub nodes: &'a [String],
    /// Names of its materials.
    pub materials: &'a [String],
}

/// Keys that hold where all conditions do. Conditions on paths are decided before a step is made.
#[derive(Debug, Clone)]
struct Step {
    keys: Arc<Keys>,
    conditions: Vec<Arc<NameConditions>>,
    source: Arc<Source>,
    /// The source's name in reports: no directory outside the input root.
    label: Arc<str>,
}

#[derive(Debug, Clone)]
struct Copy {
    /// The directory that the patterns are relative to, below the input root.
    directory: PathBuf,
    patterns: Arc<Vec<PathPattern>>,
}

/// The conditions of a rule on names; an absent one always holds.
#[derive(Debug, Default, PartialEq, serde::Serialize)]
struct NameConditions {
    #[serde(skip_serializing_if = "Option::is_none")]
    node: Option<OneOrMore<NamePattern>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh: Option<OneOrMore<NamePattern>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    material: Option<OneOrMore<NamePattern>>,
}

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
    source: Arc<Source>,
    extends: Vec<Placed<String>>,
    copy: Option<Arc<Vec<PathPattern>>>,
    rules: Vec<Rule>,
}

#[derive(Debug)]
struct Rule {
    path: Option<Vec<PathPattern>>,
    names: Option<Arc<NameConditions>>,
    body: Body,
}

impl Presets {
    /// Reads `--config` and checks the flags; `--preset` is looked up for each asset, since files on its way may define it.
    ///
    /// # Errors
    /// [`Kind::Preset`] with file, line, column, a caret and a suggestion; [`Kind::Io`] when `--config` cannot be read.
    pub fn new(flags: &Flags) -> Result<Self> {
        let config = match &flags.config {
            Some(path) => Some(read_config(path)?),
            None => None,
        };
        Ok(Self { config, preset: flags.preset.clone(), flags: read_flags(flags)?, files: Mutex::new(BTreeMap::new()) })
    }

    /// The layers for the file at `asset`, which lies below the input root `root`. For a file that is an input itself the
    /// root is its directory.
    ///
    /// # Errors
    /// As [`Presets::new`], for the `gltf-lod.toml` files on the way.
    pub fn for_asset(&self, root: &Path, asset: &Path) -> Result<AssetPresets> {
        let below = asset.strip_prefix(root).map_err(|_| {
            let message = format!("{} is not below the input root {}", asset.display(), root.display());
            Error::new(Kind::Internal, message)
        })?;
        let layers = self.layers(root, below)?;
        check_presets(&layers)?;
        let mut expansion = Expansion::new(&layers);
        let refuse = |title: &str, help: &str| at_flag("--preset", title).help(help);
        for (at, layer) in layers.iter().enumerate().rev() {
            expansion.add(at, &layer.file.body, &[])?;
        }
        if let Some(name) = &self.preset {
            expansion.add_preset(0, name, &[], &refuse)?;
        }
        let Expansion { mut steps, copy, .. } = expansion;
        steps.push(self.flags.clone());
        Ok(AssetPresets { steps: steps.into(), copy })
    }

    /// The files that hold for `below` the root, nearest first; last the built-in ones.
    fn layers(&self, root: &Path, below: &Path) -> Result<Vec<Layer>> {
        let mut layers = Vec::new();
        if let Some(config) = &self.config {
            let name = config.body.source.path().file_name().unwrap_or_default();
            layers.push(Layer::new(config.clone(), Path::new(""), below, &name.to_string_lossy()));
        }
        for directory in below.ancestors().skip(1) {
            if let Some(file) = self.file_in(&root.join(directory))? {
                layers.push(Layer::new(file, directory, below, &slashed(&directory.join(FILE_NAME))));
            }
        }
        layers.push(Layer::new(builtin::file().clone(), Path::new(""), below, "a built-in preset"));
        Ok(layers)
    }

    /// The preset file of a directory, from memory if it has been read before.
    fn file_in(&self, directory: &Path) -> Result<Option<Arc<PresetFile>>> {
        let once = {
            let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
            files.entry(directory.to_owned()).or_default().clone()
        };
        once.get_or_init(|| match Source::read(&directory.join(FILE_NAME))? {
            Some(source) => PresetFile::parse(source).map(|file| Some(Arc::new(file))),
            None => Ok(None),
        })
        .clone()
    }
}

fn read_config(path: &Path) -> Result<Arc<PresetFile>> {
    match Source::read(path)? {
        Some(source) => PresetFile::parse(source).map(Arc::new),
        None => Err(Error::new(Kind::Io, "no such file")
            .in_file(path)
            .help("--config names a TOML file; `gltf-lod init` writes one")),
    }
}

/// The keys that flags set.
fn read_flags(flags: &Flags) -> Result<Step> {
    let mut keys = Keys::default();
    if let Some(ratios) = &flags.levels {
        let levels = Levels::from_ratios(ratios).map_err(|message| {
            let (title, help) = reword(&message, None);
            at_flag("--levels", &title).help(help.unwrap_or("shares of the triangles, e.g. 0.5,0.25,0.125".to_owned()))
        })?;
        keys.levels = Some(Placed { value: levels, span: 0..0 });
    }
    if let Some(name) = &flags.algorithm {
        let algorithm = model::Algorithm::from_name(name).map_err(|message| {
            let (title, help) = reword(&message, None);
            at_flag("--algorithm", &title).help(help.unwrap_or_default())
        })?;
        keys.algorithm = Some(algorithm);
    }
    let source = Arc::new(Source::new("flags", ""));
    Ok(Step { keys: Arc::new(keys), conditions: Vec::new(), source, label: "flags".into() })
}

fn at_flag(flag: &str, title: &str) -> Error {
    Error { place: Some(flag.to_owned()), ..Error::new(Kind::Preset, title) }
}

impl AssetPresets {
    /// The settings of one mesh after all layers and rules.
    ///
    /// # Errors
    /// [`Kind::Preset`] where settings of different layers do not fit together (a list of coverages that is not as long as the levels).
    pub fn settings(&self, names: &MeshNames<'_>) -> Result<Settings> {
        let keys = self.keys(names);
        self.check_together(&keys, names)?;
        let mut settings = settings::resolve(&keys)?;
        settings.skip = self.skip_reason(names);
        Ok(settings)
    }

    /// The same settings as JSON, in the spelling of preset files, for reports: every key, in a fixed order.
    ///
    /// # Errors
    /// As [`AssetPresets::settings`].
    pub fn effective(&self, names: &MeshNames<'_>) -> Result<serde_json::Value> {
        let keys = self.keys(names);
        self.check_together(&keys, names)?;
        serde_json::to_value(&keys).map_err(|error| Error::new(Kind::Internal, error.to_string()))
    }

    /// BLAKE3 of what the layers say for this asset, hex: part of the report and of cache keys. Neither formatting nor comments
    /// count, nor rules for other paths, nor how keys are spread over files.
    pub fn hash(&self) -> String {
        let folded = self.fold_steps();
        // Numbers, strings, lists and maps with string keys: this cannot fail.
        let text = serde_json::to_string(&folded).unwrap_or_default();
        blake3::hash(text.as_bytes()).to_hex().to_string()
    }

    /// Whether the file at `relative` (to the input root), which is not glTF, is copied to the output.
    pub fn copies(&self, relative: &Path) -> bool {
        let Some(copy) = &self.copy else { return false };
        let Ok(below) = relative.strip_prefix(&copy.directory) else { return false };
        let path = slashed(below);
        copy.patterns.iter().any(|pattern| pattern.matches(&path))
    }

    fn steps_for<'a>(&'a self, names: &'a MeshNames<'_>) -> impl DoubleEndedIterator<Item = &'a Step> {
        self.steps.iter().filter(move |step| step.conditions.iter().all(|condition| condition.hold(names)))
    }

    fn keys(&self, names: &MeshNames<'_>) -> Keys {
        let mut keys = Keys::default();
        for step in self.steps_for(names) {
            keys.overlay(&step.keys);
        }
        keys
    }

    /// Steps with the same conditions that follow each other become one; steps that say nothing vanish.
    fn fold_steps(&self) -> Vec<(Vec<&NameConditions>, Keys)> {
        let mut folded: Vec<(Vec<&NameConditions>, Keys)> = Vec::new();
        for step in self.steps.iter().filter(|step| *step.keys != Keys::default()) {
            let conditions = step.conditions.iter().map(AsRef::as_ref).collect();
            match folded.last_mut() {
                Some((last, keys)) if *last == conditions => keys.overlay(&step.keys),
                _ => folded.push((conditions, (*step.keys).clone())),
            }
        }
        folded
    }

    /// What no layer can check by itself. The error points at the coverage list: its length depends on the levels.
    fn check_together(&self, keys: &Keys, names: &MeshNames<'_>) -> Result<()> {
        let (Some(levels), Some(coverage), Some(cull)) = (&keys.levels, &keys.coverage, keys.cull_coverage) else {
            return Ok(());
        };
        let Coverage::Explicit(numbers) = &coverage.value else { return Ok(()) };
        let at_coverage = |title: String, help: &str| {
            let step = self.steps_for(names).rfind(|step| step.keys.coverage.is_some());
            match step {
                Some(step) => step.source.error(coverage.span.clone(), &title, Some(help)),
                None => Error::new(Kind::Internal, title),
            }
        };
        if numbers.len() != levels.value.0.len() {
            let title = format!("{} coverage numbers for {} levels", numbers.len(), levels.value.0.len());
            return Err(at_coverage(title, "give one number for each level, or `coverage = \"auto\"`"));
        }
        match numbers.last() {
            Some(&last) if last <= cull.get() => {
                let title =
                    format!("the last level would be culled (`cull_coverage = {}`) before it is shown", cull.get());
                Err(at_coverage(title, "make the last number larger than `cull_coverage`"))
            }
            _ => Ok(()),
        }
    }

    fn skip_reason(&self, names: &MeshNames<'_>) -> Option<String> {
        let (step, skip) = self.steps_for(names).rev().find_map(|step| Some((step, step.keys.skip.as_ref()?)))?;
        let line = step.source.position(skip.span.start).0;
        skip.value.then(|| format!("`skip` in {}, line {line}", step.label))
    }
}

impl NameConditions {
    fn hold(&self, names: &MeshNames<'_>) -> bool {
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

impl PresetFile {
    /// Reads a preset file.
    ///
    /// # Errors
    /// [`Kind::Preset`], pointing at the place.
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

/// A preset file with what its patterns are relative to.
struct Layer {
    file: Arc<PresetFile>,
    /// Below the input root.
    directory: PathBuf,
    /// The asset's path below `directory`.
    asset: String,
    label: Arc<str>,
}

impl Layer {
    fn new(file: Arc<PresetFile>, directory: &Path, asset: &Path, label: &str) -> Self {
        let below = asset.strip_prefix(directory).unwrap_or(asset);
        Self { file, directory: directory.to_owned(), asset: slashed(below), label: label.into() }
    }
}

/// Writes out layers, with all they extend, as steps.
struct Expansion<'a> {
    /// Nearest first; the built-in presets are the last.
    layers: &'a [Layer],
    steps: Vec<Step>,
    copy: Option<Copy>,
    /// The presets being written out, outermost first, by layer and name.
    open: Vec<(usize, &'a str)>,
    /// How many presets have been written out.
    presets: usize,
}

impl<'a> Expansion<'a> {
    fn new(layers: &'a [Layer]) -> Self {
        Self { layers, steps: Vec::new(), copy: None, open: Vec::new(), presets: 0 }
    }

    /// The keys, copies and rules of `body`, which stands in layer `at` and holds under `conditions`.
    fn add(&mut self, at: usize, body: &'a Body, conditions: &[Arc<NameConditions>]) -> Result<()> {
        for name in &body.extends {
            let unknown = |title: &str, help: &str| body.source.error(name.span.clone(), title, Some(help));
            self.add_preset(at, &name.value, conditions, &unknown)?;
        }
        let layer = &self.layers[at];
        self.steps.push(Step {
            keys: body.keys.clone(),
            conditions: conditions.to_vec(),
            source: body.source.clone(),
            label: layer.label.clone(),
        });
        if let Some(patterns) = &body.copy {
            self.copy = Some(Copy { directory: layer.directory.clone(), patterns: patterns.clone() });
        }
        for rule in body.rules.iter().filter(|rule| rule.holds_for_path(&layer.asset)) {
            let conditions: Vec<_> = conditions.iter().chain(&rule.names).cloned().collect();
            self.add(at, &rule.body, &conditions)?;
        }
        Ok(())
    }

    /// The preset `name`, seen from layer `from`. `refuse` makes an error, from title and help, at the place that asks for it.
    fn add_preset(
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

/// Finds unknown names and circles, also in presets that nothing uses yet.
fn check_presets(layers: &[Layer]) -> Result<()> {
    for (at, layer) in layers.iter().enumerate() {
        for (name, body) in &layer.file.presets {
            let mut expansion = Expansion::new(layers);
            expansion.open.push((at, name));
            expansion.add(at, body, &[])?;
        }
    }
    Ok(())
}

impl Rule {
    fn holds_for_path(&self, path: &str) -> bool {
        self.path.as_ref().is_none_or(|patterns| patterns.iter().any(|pattern| pattern.matches(path)))
    }
}

/// `path` with `/` between directories on every system.
fn slashed(path: &Path) -> String {
    let parts: Vec<_> = path.components().map(|part| part.as_os_str().to_string_lossy()).collect();
    parts.join("/")
}
