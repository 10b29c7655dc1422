//! Which bytes of a GLB's buffer only the finest level needs, so that they can go to the end.

use crate::asset::Document;
use serde_json::Value;
use std::collections::BTreeSet;
use std::ops::Range;

/// The source's buffer in two parts, each in the old order; together they are all of it.
#[derive(Debug, Default)]
pub(super) struct SourceSplit {
    /// Needed from the start: images, animations, skins, meshes without levels.
    pub shared: Vec<Range<usize>>,
    /// Needed for the source's own triangles of meshes with levels only.
    pub finest: Vec<Range<usize>>,
}

/// The meshes that get levels.
#[derive(Debug, Default)]
pub(super) struct Levelled {
    /// Levels with vertices of their own.
    pub own: BTreeSet<usize>,
    /// Levels that use the source's vertices.
    pub sharing: BTreeSet<usize>,
}

impl Levelled {
    fn contains(&self, mesh: usize) -> bool {
        self.own.contains(&mesh) || self.sharing.contains(&mesh)
    }

    /// The accessors of the vertices that levels use as well.
    fn vertices_of_sharing<'a>(&'a self, document: &'a Document) -> impl Iterator<Item = usize> + 'a {
        let meshes = self.sharing.iter().filter_map(|&mesh| document.array("meshes").get(mesh));
        meshes.flat_map(|mesh| elements(mesh, "primitives")).flat_map(vertex_accessors)
    }
}

/// The accessors of a primitive's attributes and morph targets.
fn vertex_accessors(primitive: &Value) -> impl Iterator<Item = usize> {
    let attributes = primitive.get("attributes").into_iter().chain(elements(primitive, "targets"));
    attributes.filter_map(Value::as_object).flat_map(|a| a.values()).filter_map(index_of)
}

/// Splits the first `length` bytes of buffer 0.
///
/// Overlapping views stay together, and bytes that no view names stay behind the view before them.
pub(super) fn split_source(document: &Document, meshes: &Levelled, length: usize) -> SourceSplit {
    let finest_views = views_of_finest(document, meshes);
    let mut ranges = Vec::new();
    for (index, view) in document.array("bufferViews").iter().enumerate() {
        for (_, object) in ranges_of_view(index, view) {
            let number = |member: &str| object.get(member).and_then(Value::as_u64).unwrap_or(0) as usize;
            if object.get("buffer").and_then(Value::as_u64) == Some(0) {
                let start = number("byteOffset").min(length);
                let end = start.saturating_add(number("byteLength")).min(length);
                ranges.push((start, end, finest_views.contains(&index)));
            }
        }
    }
    ranges.sort_unstable();

    let mut split = SourceSplit::default();
    let mut add = |range: Range<usize>, finest: bool| {
        let list = if finest { &mut split.finest } else { &mut split.shared };
        match list.last_mut() {
            Some(last) if last.end == range.start => last.end = range.end,
            _ if range.is_empty() => {}
            _ => list.push(range),
        }
    };
    let (mut start, mut end, mut finest) = (0, 0, false);
    for (view_start, view_end, view_finest) in ranges {
        if view_start >= end {
            add(start..view_start, finest);
            (start, end, finest) = (view_start, view_end, view_finest);
        } else {
            end = end.max(view_end);
            finest &= view_finest;
        }
    }
    add(start..length, finest);
    split
}

/// The objects of a buffer view that name a range of a buffer, with their places: itself, and where its compressed
/// content is.
pub(super) fn ranges_of_view(index: usize, view: &Value) -> Vec<(String, &Value)> {
    let place = format!("/bufferViews/{index}");
    let compressed = COMPRESSION.iter().filter_map(|name| {
        let payload = view.get("extensions")?.get(*name)?;
        Some((format!("{place}/extensions/{name}"), payload))
    });
    let mut ranges: Vec<_> = compressed.collect();
    ranges.push((place, view));
    ranges
}

const COMPRESSION: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Whether only buffer views name ranges of buffers. An extension that does so by itself would point at the wrong bytes.
pub(super) fn can_reorder(document: &Document, notes: &mut Vec<String>) -> bool {
    let ranged = names_ranges(document);
    if ranged {
        notes.push(
            "an extension names a range of a buffer by itself: level data is appended instead of put first".into(),
        );
    }
    !ranged
}

/// Whether anything but buffer views (and what compresses them) names ranges of buffers.
pub(super) fn names_ranges(document: &Document) -> bool {
    let outside = document.root().as_object().into_iter().flatten();
    let outside = outside.filter(|(name, _)| *name != "bufferViews").any(|(_, value)| names_buffer(value));
    let inside = document
        .array("bufferViews")
        .iter()
        .filter_map(|view| view.get("extensions")?.as_object())
        .any(|e| e.iter().any(|(name, payload)| !COMPRESSION.contains(&name.as_str()) && names_buffer(payload)));
    outside || inside
}

fn names_buffer(value: &Value) -> bool {
    match value {
        Value::Object(object) => object.get("buffer").is_some_and(Value::is_u64) || object.values().any(names_buffer),
        Value::Array(array) => array.iter().any(names_buffer),
        _ => false,
    }
}

/// Buffer views that nothing but triangles of `meshes` uses.
fn views_of_finest(document: &Document, meshes: &Levelled) -> BTreeSet<usize> {
    let is_triangles =
        |primitive: &Value| primitive.get("mode").and_then(Value::as_u64).is_none_or(|mode| (4..=6).contains(&mode));
    let (finest, shared) =
        accessors_by_user(document, |mesh, _, primitive| meshes.contains(mesh) && is_triangles(primitive));
    let shared = shared.into_iter().chain(meshes.vertices_of_sharing(document)).collect::<BTreeSet<_>>();
    let mut finest_views = BTreeSet::new();
    let mut shared_views = BTreeSet::new();
    for (index, accessor) in document.array("accessors").iter().enumerate() {
        let views = views_of_accessor(accessor);
        if finest.contains(&index) && !shared.contains(&index) {
            finest_views.extend(views);
        } else {
            shared_views.extend(views);
        }
    }
    shared_views.extend(document.array("images").iter().filter_map(|image| index_at(image, "/bufferView")));
    finest_views.difference(&shared_views).copied().collect()
}

/// The buffer views that an accessor names.
pub(super) fn views_of_accessor(accessor: &Value) -> impl Iterator<Item = usize> {
    let places = ["/bufferView", "/sparse/indices/bufferView", "/sparse/values/bufferView"];
    places.into_iter().filter_map(|place| index_at(accessor, place))
}

/// Accessors that the primitives use which `is_chosen` picks by mesh, number and content, and those that anything else uses.
pub(super) fn accessors_by_user(
    document: &Document,
    is_chosen: impl Fn(usize, usize, &Value) -> bool,
) -> (BTreeSet<usize>, BTreeSet<usize>) {
    let (mut chosen, mut shared) = (BTreeSet::new(), BTreeSet::new());
    for (number, mesh) in document.array("meshes").iter().enumerate() {
        for (index, primitive) in elements(mesh, "primitives").iter().enumerate() {
            let list = if is_chosen(number, index, primitive) { &mut chosen } else { &mut shared };
            list.extend(index_at(primitive, "/indices"));
            list.extend(vertex_accessors(primitive));
        }
    }
    for sampler in document.array("animations").iter().flat_map(|animation| elements(animation, "samplers")) {
        shared.extend(index_at(sampler, "/input").into_iter().chain(index_at(sampler, "/output")));
    }
    shared.extend(document.array("skins").iter().filter_map(|skin| index_at(skin, "/inverseBindMatrices")));
    for node in document.array("nodes") {
        let instances = node.pointer("/extensions/EXT_mesh_gpu_instancing/attributes").and_then(Value::as_object);
        shared.extend(instances.into_iter().flat_map(|a| a.values()).filter_map(index_of));
    }
    (chosen, shared)
}

pub(super) fn elements<'a>(object: &'a Value, member: &str) -> &'a [Value] {
    object.get(member).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

pub(super) fn index_at(object: &Value, place: &str) -> Option<usize> {
    object.pointer(place).and_then(index_of)
}

fn index_of(value: &Value) -> Option<usize> {
    value.as_u64().map(|index| index as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// Start and end of the shared ranges and of the finest's.
    fn split(document: &Document, meshes: &[usize], length: usize) -> [Vec<(usize, usize)>; 2] {
        split_among(document, &Levelled { own: meshes.iter().copied().collect(), ..Levelled::default() }, length)
    }

    fn split_among(document: &Document, meshes: &Levelled, length: usize) -> [Vec<(usize, usize)>; 2] {
        let split = split_source(document, meshes, length);
        [split.shared, split.finest].map(|ranges| ranges.into_iter().map(|r| (r.start, r.end)).collect())
    }

    #[test]
    fn images_and_other_meshes_come_first_and_no_byte_is_lost() {
        let document = Document::new(json!({
            "meshes": [
                {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]},
                {"primitives": [{"attributes": {"POSITION": 2}}]},
            ],
            "accessors": [{"bufferView": 0}, {"bufferView": 1}, {"bufferView": 3}],
            "images": [{"bufferView": 2}],
            "bufferViews": [
                {"buffer": 0, "byteOffset": 4, "byteLength": 10},
                {"buffer": 0, "byteOffset": 16, "byteLength": 4},
                {"buffer": 0, "byteOffset": 20, "byteLength": 8},
                {"buffer": 0, "byteOffset": 30, "byteLength": 2},
                {"buffer": 1, "byteOffset": 0, "byteLength": 99},
            ],
        }));
        assert_eq!(split(&document, &[0], 36), [vec![(0, 4), (20, 36)], vec![(4, 20)]]);
        assert_eq!(split(&document, &[0, 1], 36), [vec![(0, 4), (20, 30)], vec![(4, 20), (30, 36)]]);
    }

    #[test]
    fn vertices_that_levels_use_are_needed_from_the_start() {
        let document = Document::new(json!({
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "accessors": [{"bufferView": 0}, {"bufferView": 1}],
            "bufferViews": [{"buffer": 0, "byteLength": 12}, {"buffer": 0, "byteOffset": 12, "byteLength": 4}],
        }));
        let sharing = Levelled { sharing: BTreeSet::from([0]), ..Levelled::default() };
        assert_eq!(split_among(&document, &sharing, 16), [vec![(0, 12)], vec![(12, 16)]]);
    }

    #[test]
    fn overlapping_views_stay_together() {
        let document = Document::new(json!({
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"bufferView": 0}],
            "images": [{"bufferView": 1}],
            "bufferViews": [{"buffer": 0, "byteLength": 10}, {"buffer": 0, "byteOffset": 8, "byteLength": 4}],
        }));
        assert_eq!(split(&document, &[0], 12), [vec![(0, 12)], vec![]]);
    }
}
