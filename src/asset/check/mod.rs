//! The structural pass: every index, range, type and graph is checked here before anything else looks at the document.
//!
//! One check for each kind of object; an object's check ends at its first problem, and the problems of all objects
//! are collected in document order of the kinds below. Unknown members and extensions are left alone. Strict where
//! wrong data would come out, tolerant where loaders are and the data is still clear.

mod data;
mod meshes;
mod nodes;

use super::cursor::Cursor;
use crate::error::{Error, Result};
use serde_json::Value;
use std::cell::RefCell;

/// More problems than this help nobody.
const MOST: usize = 100;

type Check = fn(&Document, &Cursor) -> Result<()>;

/// The top-level arrays and what is checked in each element; what others build on comes first.
const CHECKS: [(&str, Check); 14] = [
    ("buffers", data::check_buffer),
    ("bufferViews", data::check_view),
    ("accessors", data::check_accessor),
    ("images", check_image),
    ("samplers", check_object),
    ("textures", check_texture),
    ("materials", check_material),
    ("meshes", meshes::check_mesh),
    ("cameras", check_object),
    ("skins", nodes::check_skin),
    ("nodes", nodes::check_node),
    ("scenes", nodes::check_scene),
    ("animations", nodes::check_animation),
    ("extensionsUsed", check_name),
];

/// What the pass found.
#[derive(Debug, Default)]
pub(super) struct Findings {
    pub problems: Vec<Error>,
    pub warnings: Vec<Error>,
}

/// The document under check.
struct Document<'a> {
    root: &'a Value,
    /// The first only: what one attribute does wrong, all the others of the exporter do.
    warning: RefCell<Option<Error>>,
}

impl<'a> Document<'a> {
    fn length(&self, array: &str) -> usize {
        self.root.get(array).and_then(Value::as_array).map_or(0, Vec::len)
    }

    fn top(&self, array: &str, index: usize) -> Option<Cursor<'a>> {
        Cursor::top(self.root, array, index)
    }

    fn uses(&self, extension: &str) -> bool {
        let used = self.root.get("extensionsUsed").and_then(Value::as_array);
        used.is_some_and(|names| names.iter().any(|name| name == extension))
    }

    /// `object.name`, where present, must be an index into `array`.
    fn check_index(&self, object: &Cursor, name: &str, array: &str) -> Result<Option<usize>> {
        object.get(name).map(|index| index.index(array, self.length(array))).transpose()
    }

    /// `object.name`, where present, must be an array of indices into `array`.
    fn check_indices(&self, object: &Cursor, name: &str, array: &str) -> Result<Vec<usize>> {
        let Some(list) = object.get(name) else { return Ok(Vec::new()) };
        list.elements()?.map(|index| index.index(array, self.length(array))).collect()
    }

    fn warn(&self, warning: Error) {
        self.warning.borrow_mut().get_or_insert(warning);
    }
}

/// Checks the whole document. Without problems, every later reader may follow any index in it.
pub(super) fn check(root: &Value) -> Findings {
    let cursor = Cursor::root(root);
    if let Err(problem) = check_version(&cursor) {
        return Findings { problems: vec![problem], warnings: Vec::new() };
    }
    let document = Document { root, warning: RefCell::default() };
    let mut problems = Vec::new();
    for (array, check) in CHECKS {
        let Some(list) = cursor.get(array) else { continue };
        match list.elements() {
            Ok(elements) => problems.extend(elements.filter_map(|e| check(&document, &e).err()).take(MOST)),
            Err(problem) => problems.push(problem),
        }
    }
    problems.extend(document.check_index(&cursor, "scene", "scenes").err());
    // The graph is only walked when the nodes in it are sound.
    if problems.is_empty() {
        problems.extend(nodes::check_graph(&document).err());
    }
    problems.truncate(MOST);
    Findings { problems, warnings: document.warning.into_inner().into_iter().collect() }
}

fn check_version(root: &Cursor) -> Result<()> {
    root.object()?;
    let asset = root.need("asset")?;
    let version = asset.need("version")?;
    let least = asset.get("minVersion");
    for version in std::iter::once(version).chain(least) {
        let text = version.string()?;
        let expected = || version.expected("a version such as \"2.0\"");
        let (major, minor) = text.split_once('.').ok_or_else(expected)?;
        let major = major.parse::<u32>().map_err(|_| expected())?;
        let minor = minor.parse::<u32>().map_err(|_| expected())?;
        let least = version.place.ends_with("minVersion");
        if major != 2 || (least && minor > 0) {
            let error = Error::unsupported(&version.place, format!("glTF {text}; this version reads glTF 2.0"));
            return Err(if major < 2 { error.help("convert the asset to glTF 2.0 first") } else { error });
        }
    }
    Ok(())
}

fn check_object(_: &Document, object: &Cursor) -> Result<()> {
    object.object().map(drop)
}

fn check_name(_: &Document, name: &Cursor) -> Result<()> {
    name.string().map(drop)
}

fn check_image(document: &Document, image: &Cursor) -> Result<()> {
    image.object()?;
    if let Some(uri) = image.get("uri") {
        uri.string()?;
    }
    document.check_index(image, "bufferView", "bufferViews").map(drop)
}

fn check_texture(document: &Document, texture: &Cursor) -> Result<()> {
    texture.object()?;
    document.check_index(texture, "sampler", "samplers")?;
    document.check_index(texture, "source", "images")?;
    for name in ["KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds"] {
        if let Some(extension) = texture.extension(name) {
            document.check_index(&extension, "source", "images")?;
        }
    }
    Ok(())
}

fn check_material(document: &Document, material: &Cursor) -> Result<()> {
    material.object()?;
    check_texture_infos(document, material)?;
    if let Some(pbr) = material.get("pbrMetallicRoughness") {
        pbr.object()?;
        check_texture_infos(document, &pbr)?;
    }
    let Some(extensions) = material.get("extensions") else { return Ok(()) };
    for (name, extension) in extensions.members()? {
        if name.starts_with("KHR_materials_") {
            extension.object()?;
            check_texture_infos(document, &extension)?;
        }
    }
    if let Some(lod) = extensions.get("MSFT_lod") {
        document.check_indices(&lod, "ids", "materials")?;
    }
    Ok(())
}

/// Members whose name ends in `Texture` are texture infos, in the core and in every `KHR_materials_*`.
fn check_texture_infos(document: &Document, object: &Cursor) -> Result<()> {
    for (name, info) in object.members()? {
        if name.ends_with("Texture") {
            info.object()?;
            document.check_index(&info, "index", "textures")?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Kind;
    use serde_json::json;

    fn problems(more: Value) -> Vec<String> {
        let mut root = json!({"asset": {"version": "2.0"}});
        root.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        check(&root).problems.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn problems_of_all_objects_are_collected() {
        let found = problems(json!({
            "nodes": [{"mesh": 0}, {"children": [7]}],
            "textures": [{"source": 1}],
            "images": [{"uri": "a.png"}],
            "scene": 0,
        }));
        assert_eq!(
            found,
            [
                "/textures/0/source: names images[1], but the only one is images[0]",
                "/nodes/0/mesh: names meshes[0], but the document has no meshes",
                "/nodes/1/children/0: names nodes[7], but the last is nodes[1]",
                "/scene: names scenes[0], but the document has no scenes",
            ]
        );
    }

    #[test]
    fn only_version_2_0_is_read() {
        let version = |asset: Value| check(&json!({"asset": asset})).problems.first().map(|p| (p.kind, p.to_string()));
        assert_eq!(version(json!({"version": "2.0"})), None);
        assert_eq!(version(json!({"version": "2.1"})), None, "a newer minor version is readable by definition");
        assert_eq!(version(json!({"version": "1.0"})).unwrap().0, Kind::Unsupported);
        assert_eq!(version(json!({"version": "2.1", "minVersion": "2.1"})).unwrap().0, Kind::Unsupported);
        assert_eq!(version(json!({"version": 2.0})).unwrap().0, Kind::Malformed);
        assert_eq!(version(json!({})).unwrap().1, "/asset: \"version\" is missing");
    }

    #[test]
    fn texture_infos_are_checked_in_every_material_extension() {
        let found = problems(json!({
            "textures": [{}],
            "materials": [{"extensions": {
                "KHR_materials_clearcoat": {"clearcoatTexture": {"index": 0}, "clearcoatNormalTexture": {"index": 2}},
                "ACME_unknown": {"someTexture": {"index": 99}},
            }}],
        }));
        let place = "/materials/0/extensions/KHR_materials_clearcoat/clearcoatNormalTexture/index";
        assert_eq!(found, [format!("{place}: names textures[2], but the only one is textures[0]")]);
    }
}
