//! The presets that come with gltf-lod, embedded from `config/`.

use super::file::PresetFile;
use super::model::Keys;
use super::source::Source;
use std::sync::{Arc, OnceLock};

/// The built-in presets by name.
const TEXTS: [(&str, &str); 7] = [
    ("default", include_str!("../../config/default.toml")),
    ("mobile", include_str!("../../config/mobile.toml")),
    ("hero", include_str!("../../config/hero.toml")),
    ("prop", include_str!("../../config/prop.toml")),
    ("character", include_str!("../../config/character.toml")),
    ("terrain", include_str!("../../config/terrain.toml")),
    ("foliage", include_str!("../../config/foliage.toml")),
];

/// What `gltf-lod presets` shows of a built-in preset.
#[derive(Debug, Clone, PartialEq)]
pub struct PresetInfo {
    /// The name, for `extends` and `--preset`.
    pub name: &'static str,
    /// One line that says what it is for.
    pub description: String,
    /// Its levels, e.g. `50%, 25%, 12.5%`.
    pub levels: String,
    /// The TOML file, with the reasons for its values in comments.
    pub text: &'static str,
}

/// The built-in presets, `default` first.
pub fn list() -> Vec<PresetInfo> {
    let info = |&(name, text): &(&'static str, &'static str)| {
        let body = file().presets.get(name)?;
        let mut keys = default_keys();
        keys.overlay(&body.keys);
        let levels: Vec<String> =
            keys.levels.iter().flat_map(|levels| &levels.value.0).map(ToString::to_string).collect();
        Some(PresetInfo { name, description: body.description.clone()?, levels: levels.join(", "), text })
    };
    TEXTS.iter().filter_map(info).collect()
}

/// A commented `gltf-lod.toml` for a new project.
pub fn init_text() -> &'static str {
    include_str!("init.toml")
}

/// Whether a built-in preset has this name.
pub fn is_name(name: &str) -> bool {
    TEXTS.iter().any(|(builtin, _)| *builtin == name)
}

/// All built-in presets as one file that only defines presets and extends `default`.
pub fn file() -> &'static Arc<PresetFile> {
    static FILE: OnceLock<Arc<PresetFile>> = OnceLock::new();
    FILE.get_or_init(|| Arc::new(read_all()))
}

/// The keys of `default`: it sets every one (a test holds it to that).
pub fn default_keys() -> Keys {
    file().presets.get("default").map(|body| (*body.keys).clone()).unwrap_or_default()
}

fn read_all() -> PresetFile {
    let parse = |path: String, text: &str| {
        PresetFile::parse(Source::new(path, text))
            .unwrap_or_else(|error| panic!("an embedded preset is broken: {error}"))
    };
    let presets = TEXTS.iter().map(|(name, text)| {
        let PresetFile { body, .. } = parse(format!("config/{name}.toml"), text);
        ((*name).to_owned(), body)
    });
    PresetFile { presets: presets.collect(), ..parse("built-in".to_owned(), "extends = \"default\"") }
}
