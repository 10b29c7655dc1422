//! Layers: which preset files hold for an asset, in which order, and what they add up to for a mesh.
//!
//! The order is: the built-in `default` → every `gltf-lod.toml` from the input root down to the asset's directory →
//! `--config` → `--preset` → the other flags. A layer is what it `extends`, then its keys, then its rules in their order; what
//! comes later wins. A name in `extends` is looked up in the file itself, then in the files further out, then among the
//! built-in presets.

use super::expand::{Copy, Expansion, Layer, Step, check_names, slashed};
use super::file::{NameConditions, PresetFile};
use super::level::Levels;
use super::model::{Algorithm, EdgePolicy, Effort, Keys};
use super::source::{Source, reword};
use super::value::Placed;
use super::{Coverage, Settings, builtin, settings};
use crate::error::{Error, Kind, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Name of the preset files in asset directories.
pub const FILE_NAME: &str = "gltf-lod.toml";

/// What stands for a file's path where flags set keys.
const FLAGS: &str = "flags";

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
    /// `--effort NAME`.
    pub effort: Option<String>,
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

    /// The layers for a file, whose path is `below` relative to the input root. For a file that is an input itself the root is its directory.
    ///
    /// # Errors
    /// As [`Presets::new`], for the `gltf-lod.toml` files on the way.
    pub fn for_asset(&self, root: &Path, below: &Path) -> Result<AssetPresets> {
        let layers = self.layers(root, below)?;
        check_names(&layers)?;
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
        let algorithm = Algorithm::from_name(name).map_err(|message| name_error("--algorithm", &message))?;
        keys.algorithm = Some(Placed { value: algorithm, span: 0..0 });
    }
    if let Some(name) = &flags.effort {
        keys.effort = Some(Effort::from_name(name).map_err(|message| name_error("--effort", &message))?);
    }
    let source = Arc::new(Source::new(FLAGS, ""));
    Ok(Step { keys: Arc::new(keys), conditions: Vec::new(), source, label: FLAGS.into() })
}

fn name_error(flag: &str, message: &str) -> Error {
    let (title, help) = reword(message, None);
    at_flag(flag, &title).help(help.unwrap_or_default())
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
        let skip = self.skip_reason(names);
        if skip.is_none() {
            self.check_coverage(&keys, names)?;
            self.check_locks(&keys, names)?;
        }
        Ok(Settings { skip, ..settings::resolve(&keys)? })
    }

    /// The same settings as JSON, in the spelling of preset files, for reports: every key, in a fixed order.
    ///
    /// # Errors
    /// [`Kind::Internal`] if JSON cannot express them, which it can.
    pub fn effective(&self, names: &MeshNames<'_>) -> Result<serde_json::Value> {
        serde_json::to_value(self.keys(names)).map_err(|error| Error::new(Kind::Internal, error.to_string()))
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
        self.copy.as_ref().is_some_and(|copy| copy.holds(relative))
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
    fn check_coverage(&self, keys: &Keys, names: &MeshNames<'_>) -> Result<()> {
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

    /// meshoptimizer locks open borders only.
    fn check_locks(&self, keys: &Keys, names: &MeshNames<'_>) -> Result<()> {
        let Some(algorithm) = keys.algorithm.as_ref().filter(|key| key.value == Algorithm::Meshopt) else {
            return Ok(());
        };
        let locked = [("seam", keys.seam), ("material_border", keys.material_border)];
        let Some((key, _)) = locked.into_iter().find(|(_, policy)| *policy == Some(EdgePolicy::Lock)) else {
            return Ok(());
        };
        let title = format!("meshoptimizer cannot keep `{key} = \"lock\"`");
        let help = format!("choose another algorithm, or set `{key} = \"preserve\"`");
        let step = self.steps_for(names).rfind(|step| step.keys.algorithm.is_some());
        Err(match step.filter(|step| step.source.path() != Path::new(FLAGS)) {
            Some(step) => step.source.error(algorithm.span.clone(), &title, Some(&help)),
            None => at_flag("--algorithm", &title).help(help),
        })
    }

    fn skip_reason(&self, names: &MeshNames<'_>) -> Option<String> {
        let (step, skip) = self.steps_for(names).rev().find_map(|step| Some((step, step.keys.skip.as_ref()?)))?;
        let line = step.source.position(skip.span.start).0;
        skip.value.then(|| format!("`skip` in {}, line {line}", step.label))
    }
}
