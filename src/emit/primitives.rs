//! The JSON of level meshes: what their primitives take over from the source's, and what must stay behind.

use super::accessors::{EncodedLevel, PrimitiveDraft};
use crate::asset::{Geometry, PROGRESSIVE, PassedOver};
use serde_json::{Map, Value, json};

/// Extensions that promise something about the vertices, the triangle order or the closedness of the primitive they
/// stand on, so that a level with other triangles would break the promise.
const BOUND_TO_SOURCE_TRIANGLES: &[&str] = &[
    "CESIUM_primitive_outline",
    "EXT_mesh_manifold",
    "EXT_mesh_primitive_edge_visibility",
    "EXT_mesh_primitive_restart",
    "EXT_meshopt_compression",
    "FB_ngon_encoding",
    PROGRESSIVE,
    "KHR_draco_mesh_compression",
    "KHR_meshopt_compression",
    "NV_displacement_micromap",
    "NV_micromap_tooling",
    "NV_opacity_micromap",
];

/// The mesh of one level. `source` is the mesh it is a level of, `first_accessor` where the level's accessors start.
pub(super) fn level_mesh(
    source: &Value,
    geometry: &Geometry,
    level: &EncodedLevel,
    first_accessor: usize,
    name: String,
) -> Value {
    let mut mesh = Map::new();
    mesh.insert("name".into(), name.into());
    mesh.insert("primitives".into(), level_primitives(source, geometry, level, first_accessor).into());
    for member in ["weights", "extras"] {
        if let Some(value) = source.get(member) {
            mesh.insert(member.into(), value.clone());
        }
    }
    if let Some(extensions) = carried_extensions(source, false) {
        mesh.insert("extensions".into(), extensions);
    }
    mesh.into()
}

/// In the source's order: the level's own triangles, and points and lines as they are.
fn level_primitives(source: &Value, geometry: &Geometry, level: &EncodedLevel, first_accessor: usize) -> Vec<Value> {
    let empty = Vec::new();
    let primitives = source.get("primitives").and_then(Value::as_array).unwrap_or(&empty);
    let carried = |index: usize| geometry.passed_over.iter().any(|p: &PassedOver| p.primitive == index && p.carried);
    let one = |(index, primitive): (usize, &Value)| match level.primitives.iter().find(|p| p.source == index) {
        Some(draft) => Some(level_primitive(primitive, draft, first_accessor)),
        None => carried(index).then(|| primitive.clone()),
    };
    primitives.iter().enumerate().filter_map(one).collect()
}

fn level_primitive(source: &Value, draft: &PrimitiveDraft, first_accessor: usize) -> Value {
    let references = |attributes: &[(String, usize)]| -> Value {
        let reference = |(name, accessor): &(String, usize)| (name.clone(), (first_accessor + accessor).into());
        Value::Object(attributes.iter().map(reference).collect())
    };
    let mut primitive = Map::new();
    let shared = |name: &str| source.get(name).filter(|_| draft.shares_vertices).cloned();
    primitive.insert("attributes".into(), shared("attributes").unwrap_or_else(|| references(&draft.attributes)));
    primitive.insert("indices".into(), (first_accessor + draft.indices).into());
    if let Some(material) = source.get("material") {
        primitive.insert("material".into(), material.clone());
    }
    primitive.insert("mode".into(), 4.into());
    let own_targets = || draft.targets.iter().map(|t| references(t)).collect();
    if let Some(targets) = shared("targets").or((!draft.targets.is_empty()).then(own_targets)) {
        primitive.insert("targets".into(), targets);
    }
    if let Some(extensions) = carried_extensions(source, draft.shares_vertices) {
        primitive.insert("extensions".into(), extensions);
    }
    if let Some(extras) = source.get("extras") {
        primitive.insert("extras".into(), extras.clone());
    }
    primitive.into()
}

/// The extensions of a mesh or primitive that hold for its levels too; `None` when there are none. `same_vertices`: what is said of vertices
/// holds as well.
fn carried_extensions(source: &Value, same_vertices: bool) -> Option<Value> {
    let extensions = source.get("extensions")?.as_object()?;
    let carried: Map<String, Value> = extensions
        .iter()
        .filter(|(name, _)| !BOUND_TO_SOURCE_TRIANGLES.contains(&name.as_str()))
        .filter_map(|(name, payload)| {
            Some((name.clone(), if same_vertices { payload.clone() } else { carried_payload(name, payload)? }))
        })
        .collect();
    (!carried.is_empty()).then(|| carried.into())
}

fn carried_payload(name: &str, payload: &Value) -> Option<Value> {
    match name {
        // Property attributes are values of the source's vertices; textures are sampled by UV and stay right.
        "EXT_structural_metadata" => {
            let mut payload = payload.as_object()?.clone();
            payload.shift_remove("propertyAttributes");
            (!payload.is_empty()).then(|| payload.into())
        }
        // A feature set that names neither attribute nor texture counts the source's vertices.
        "EXT_mesh_features" => {
            let sets = payload.get("featureIds")?.as_array()?;
            let explicit = |set: &Value| set.get("attribute").is_some() || set.get("texture").is_some();
            sets.iter().all(explicit).then(|| payload.clone())
        }
        _ => Some(payload.clone()),
    }
}

/// Buffer views and accessors of a level as the document gets them.
pub(super) fn level_views(level: &EncodedLevel, buffer: usize, offset: usize) -> Vec<Value> {
    let one = |view: &super::accessors::ViewDraft| {
        let mut json = Map::new();
        json.insert("buffer".into(), buffer.into());
        if offset + view.offset > 0 {
            json.insert("byteOffset".into(), (offset + view.offset).into());
        }
        json.insert("byteLength".into(), view.length.into());
        if let Some(stride) = view.stride {
            json.insert("byteStride".into(), stride.into());
        }
        json.insert("target".into(), json!(view.target));
        json.into()
    };
    level.views.iter().map(one).collect()
}

/// See [`level_views`]; `first_view` is where the level's buffer views start.
pub(super) fn level_accessors(level: &EncodedLevel, first_view: usize) -> Vec<Value> {
    let one = |accessor: &super::accessors::AccessorDraft| {
        let mut json = Map::new();
        json.insert("bufferView".into(), (first_view + accessor.view).into());
        json.extend(accessor.json.clone());
        json.into()
    };
    level.accessors.iter().map(one).collect()
}

/// An extension of a mesh or primitive that says something of exactly its vertices or triangles.
pub(super) fn find_bound_extension(object: &Value) -> Option<&str> {
    let extensions = object.get("extensions")?.as_object()?;
    let is_bound = |(name, payload): &(&String, &Value)| {
        BOUND_TO_SOURCE_TRIANGLES.contains(&name.as_str())
            || *name == "EXT_mesh_features" && carried_payload(name, payload).is_none()
    };
    extensions.iter().find(is_bound).map(|(name, _)| name.as_str())
}
