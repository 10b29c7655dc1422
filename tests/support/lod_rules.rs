//! The rules that real loaders have for MSFT_lod, checked on a finished file.
//!
//! Only nodes that got their levels in this run are judged: hand-made levels of the source stay as they are.

use super::reader::Gltf;
use super::{index, items, maybe_index};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Where `output` breaks a rule, in words. `source` tells which levels are new.
pub fn violations(source: &Gltf, output: &Gltf) -> Vec<String> {
    let mut found = Vec::new();
    let roots = new_roots(source, output);
    if !roots.is_empty() && !items(&output.json["extensionsUsed"]).iter().any(|e| e == "MSFT_lod") {
        found.push("extensionsUsed does not name MSFT_lod".into());
    }
    if items(&output.json["extensionsRequired"]).iter().any(|e| e == "MSFT_lod") {
        found.push("extensionsRequired names MSFT_lod".into());
    }
    check_level_nodes_hang_nowhere(output, &roots, &mut found);
    check_mesh_indices_stay_on_one_level(output, &roots, &mut found);
    for &root in &roots {
        check_root(output, root, &mut found);
        check_coverage(output, root, &mut found);
        check_levels(output, root, &mut found);
        check_animations(output, root, &mut found);
    }
    found
}

/// Nodes whose `MSFT_lod` the source does not have.
pub fn new_roots(source: &Gltf, output: &Gltf) -> Vec<usize> {
    let has =
        |file: &Gltf, node: usize| file.list("nodes").get(node).is_some_and(|n| !n["extensions"]["MSFT_lod"].is_null());
    (0..output.list("nodes").len()).filter(|&node| has(output, node) && !has(source, node)).collect()
}

/// The nodes of a root's levels, finest first, without the root.
pub fn level_ids(file: &Gltf, root: usize) -> Vec<usize> {
    items(&file.list("nodes")[root]["extensions"]["MSFT_lod"]["ids"]).iter().map(index).collect()
}

/// The node at or below `node` that draws (the mesh node below a switch).
pub fn drawing_node(file: &Gltf, node: usize) -> usize {
    let object = &file.list("nodes")[node];
    match items(&object["children"]) {
        [child] if object.get("mesh").is_none() => index(child),
        _ => node,
    }
}

/// The mesh that a level draws.
pub fn mesh_of(file: &Gltf, node: usize) -> usize {
    index(&file.list("nodes")[drawing_node(file, node)]["mesh"])
}

fn check_level_nodes_hang_nowhere(file: &Gltf, roots: &[usize], found: &mut Vec<String>) {
    let mut users = BTreeMap::<usize, usize>::new();
    let lists = file.list("nodes").iter().flat_map(|n| [&n["children"], &n["extensions"]["MSFT_lod"]["ids"]]);
    for child in lists.chain(file.list("scenes").iter().map(|s| &s["nodes"])).flat_map(items) {
        *users.entry(index(child)).or_default() += 1;
    }
    for id in roots.iter().flat_map(|&root| level_ids(file, root)) {
        if users[&id] != 1 {
            found.push(format!("level node {id} hangs in {} places", users[&id]));
        }
    }
}

fn check_mesh_indices_stay_on_one_level(file: &Gltf, roots: &[usize], found: &mut Vec<String>) {
    let mut levels = BTreeMap::<usize, BTreeSet<usize>>::new();
    for &root in roots {
        for (level, node) in std::iter::once(root).chain(level_ids(file, root)).enumerate() {
            levels.entry(mesh_of(file, node)).or_default().insert(level);
        }
    }
    for (mesh, levels) in levels.iter().filter(|(_, levels)| levels.len() > 1) {
        found.push(format!("mesh {mesh} stands at levels {levels:?}"));
    }
}

/// The node with the levels draws one mesh and nothing else hangs on it that would vanish with LOD0.
fn check_root(file: &Gltf, root: usize, found: &mut Vec<String>) {
    let node = &file.list("nodes")[root];
    let below = drawing_node(file, root);
    if below == root && !items(&node["children"]).is_empty() {
        found.push(format!("node {root} has levels, a mesh and children"));
    }
    if below != root && !items(&file.list("nodes")[below]["children"]).is_empty() {
        found.push(format!("node {below} below the switch {root} has children"));
    }
    if below != root && file.list("nodes")[below].get("skin").is_some() {
        found.push(format!("switch node {root} stands above a skinned mesh"));
    }
    if node.get("camera").is_some() || !node["extensions"]["KHR_lights_punctual"].is_null() {
        found.push(format!("node {root} has levels and a camera or a light"));
    }
    if let Some(above) =
        ancestors(file, root).into_iter().find(|&a| !file.list("nodes")[a]["extensions"]["MSFT_lod"].is_null())
    {
        found.push(format!("node {root} has levels below node {above} with levels"));
    }
}

fn ancestors(file: &Gltf, node: usize) -> Vec<usize> {
    let parent_of =
        |child: usize| file.list("nodes").iter().position(|n| items(&n["children"]).iter().any(|c| index(c) == child));
    let mut found = Vec::new();
    let mut at = node;
    while let Some(parent) = parent_of(at) {
        found.push(parent);
        at = parent;
    }
    found
}

fn check_coverage(file: &Gltf, root: usize, found: &mut Vec<String>) {
    let extras = &file.list("nodes")[root]["extras"];
    if !extras.is_object() {
        return; // An extras that is no object leaves no room.
    }
    let coverage: Vec<f64> = items(&extras["MSFT_screencoverage"]).iter().filter_map(Value::as_f64).collect();
    let falling = coverage.windows(2).all(|pair| pair[0] > pair[1]);
    if coverage.len() != level_ids(file, root).len() + 1
        || !falling
        || !coverage.iter().all(|c| (0.0..=1.0).contains(c))
    {
        found.push(format!("node {root}: MSFT_screencoverage is {coverage:?}"));
    }
}

fn check_levels(file: &Gltf, root: usize, found: &mut Vec<String>) {
    // A switch node and the mesh node below it each have a say in where a level stands.
    let placement = |node: usize| -> Vec<Value> {
        let below = Some(drawing_node(file, node)).filter(|&below| below != node);
        let nodes = [Some(node), below].into_iter().flatten().map(|node| &file.list("nodes")[node]);
        nodes
            .flat_map(|n| ["matrix", "translation", "rotation", "scale"].map(|m| n.get(m).cloned()))
            .flatten()
            .collect()
    };
    let drawn = |node: usize, member: &str| file.list("nodes")[drawing_node(file, node)].get(member).cloned();
    let instancing =
        |node: usize| file.list("nodes")[drawing_node(file, node)]["extensions"]["EXT_mesh_gpu_instancing"].clone();
    let mut above = root;
    for id in level_ids(file, root) {
        if placement(id) != placement(root) {
            found.push(format!("level node {id} has another transform than node {root}"));
        }
        for member in ["skin", "weights"] {
            if drawn(id, member) != drawn(root, member) {
                found.push(format!("level node {id} has another {member} than node {root}"));
            }
        }
        if instancing(id) != instancing(root) {
            found.push(format!("level node {id} is instanced otherwise than node {root}"));
        }
        if !file.list("nodes")[id]["extensions"]["MSFT_lod"].is_null() {
            found.push(format!("level node {id} has levels itself"));
        }
        check_mesh(file, mesh_of(file, root), mesh_of(file, above), mesh_of(file, id), found);
        above = id;
    }
}

/// A level's mesh against LOD0's and against the level above it.
fn check_mesh(file: &Gltf, finest: usize, above: usize, level: usize, found: &mut Vec<String>) {
    let triangles = |mesh: usize| file.mesh_triangles(mesh).len();
    if triangles(level) >= triangles(above) {
        found.push(format!("mesh {level} has no fewer triangles than mesh {above}"));
    }
    let mesh = |mesh: usize| &file.list("meshes")[mesh];
    if mesh(level)["weights"] != mesh(finest)["weights"] {
        found.push(format!("mesh {level} has other weights than mesh {finest}"));
    }
    if mesh(level)["extras"]["targetNames"] != mesh(finest)["extras"]["targetNames"] {
        found.push(format!("mesh {level} has other target names than mesh {finest}"));
    }
    let originals = items(&mesh(finest)["primitives"]);
    for primitive in items(&mesh(level)["primitives"]) {
        check_accessors(file, level, primitive, found);
        let is_point_or_line = primitive["mode"].as_u64().is_some_and(|mode| mode < 4);
        if is_point_or_line {
            if !originals.contains(primitive) {
                found.push(format!("mesh {level} has points or lines that mesh {finest} does not have"));
            }
        } else if !originals.iter().any(|original| is_level_of(file, original, primitive)) {
            found.push(format!("mesh {level} has a primitive that is like none of mesh {finest}"));
        }
    }
}

/// Same material, extensions, extras; same semantics and component types; plain triangles.
fn is_level_of(file: &Gltf, original: &Value, level: &Value) -> bool {
    let kind = |accessor: &Value| {
        let accessor = &file.list("accessors")[index(accessor)];
        [&accessor["type"], &accessor["componentType"], &accessor["normalized"]]
            .map(|v| if v == &Value::Bool(false) { Value::Null } else { v.clone() })
    };
    let kinds = |attributes: &Value| -> BTreeMap<String, [Value; 3]> {
        attributes.as_object().into_iter().flatten().map(|(name, accessor)| (name.clone(), kind(accessor))).collect()
    };
    let targets = |primitive: &Value| items(&primitive["targets"]).iter().map(kinds).collect::<Vec<_>>();
    let promises = ["FB_ngon_encoding", "EXT_mesh_manifold"];
    let extensions = |primitive: &Value| {
        let mut all = primitive["extensions"].as_object().cloned().unwrap_or_default();
        promises.iter().for_each(|name| _ = all.remove(*name));
        all
    };
    level["mode"].as_u64().unwrap_or(4) == 4
        && level["material"] == original["material"]
        && level["extras"] == original["extras"]
        && extensions(level) == extensions(original)
        && promises.iter().all(|name| level["extensions"][*name].is_null())
        && kinds(&level["attributes"]) == kinds(&original["attributes"])
        && targets(level) == targets(original)
}

/// Counts agree, bounds are true, indices are in range and as narrow as fits.
fn check_accessors(file: &Gltf, mesh: usize, primitive: &Value, found: &mut Vec<String>) {
    let accessor = |i: &Value| &file.list("accessors")[index(i)];
    let vertices = file.vertex_count(primitive);
    let attributes = items(&primitive["targets"]).iter().chain([&primitive["attributes"]]);
    for (name, attribute) in attributes.flat_map(|a| a.as_object().into_iter().flatten()) {
        if index(&accessor(attribute)["count"]) != vertices || vertices == 0 {
            found.push(format!("mesh {mesh}: {name} has another count than POSITION"));
        }
        let values = file.elements(index(attribute));
        if values.iter().flatten().any(|x| !x.is_finite()) {
            found.push(format!("mesh {mesh}: {name} has a number that is not finite"));
        }
    }
    let position = &primitive["attributes"]["POSITION"];
    let values = file.elements(index(position));
    // Bounds are those of the stored integers, not of what they stand for: comparing them needs plain numbers.
    for k in (0..3).filter(|_| accessor(position)["normalized"] != true) {
        let range = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v[k]), hi.max(v[k])));
        // Readers take them as single precision, so that fewer digits may stand for the same number.
        let bound = |member: &str| accessor(position)[member][k].as_f64().map(|x| x as f32);
        let stated = (bound("min"), bound("max"));
        if stated != (Some(range.0 as f32), Some(range.1 as f32)) {
            found.push(format!("mesh {mesh}: POSITION states bounds {stated:?}, has {range:?}"));
        }
    }
    if let Some(indices) = maybe_index(&primitive["indices"]) {
        let largest = file.elements(indices).iter().map(|i| i[0] as usize).max().unwrap_or(0);
        if largest >= vertices {
            found.push(format!("mesh {mesh}: index {largest} of {vertices} vertices"));
        }
    }
}

/// No animation moves the root; morph weights reach every level by the same sampler.
fn check_animations(file: &Gltf, root: usize, found: &mut Vec<String>) {
    for (a, animation) in file.list("animations").iter().enumerate() {
        let sampler_of = |node: usize, path: &str| -> Vec<&Value> {
            let hits = |channel: &&Value| {
                maybe_index(&channel["target"]["node"]) == Some(node) && channel["target"]["path"] == path
            };
            items(&animation["channels"]).iter().filter(hits).map(|channel| &channel["sampler"]).collect()
        };
        if ["translation", "rotation", "scale"].iter().any(|path| !sampler_of(root, path).is_empty()) {
            found.push(format!("animation {a} moves node {root}, which has levels"));
        }
        let weights = sampler_of(drawing_node(file, root), "weights");
        for id in level_ids(file, root) {
            if sampler_of(drawing_node(file, id), "weights") != weights {
                found.push(format!(
                    "animation {a} does not drive the morph weights of level node {id} as those of {root}"
                ));
            }
        }
    }
}
