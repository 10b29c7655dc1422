//! What an output may differ in from its source, and nothing else.

use super::reader::Gltf;
use super::{index, items, maybe_index};
use serde_json::{Map, Value, json};

/// Top-level lists that may grow at their end.
const GROWING: [&str; 6] = ["nodes", "meshes", "accessors", "bufferViews", "buffers", "extensionsUsed"];
/// Members of a node that go with its mesh when mesh and node part.
const MOVING: [&str; 3] = ["mesh", "skin", "weights"];

/// Everything in which `output` differs from `source` although it may not: JSON pointers with both values.
pub fn forbidden_differences(source: &Gltf, output: &Gltf) -> Vec<String> {
    let mut found = Vec::new();
    let (Some(before), Some(after)) = (source.json.as_object(), output.json.as_object()) else {
        return vec!["the document is no object".into()];
    };
    for (name, value) in before {
        let place = format!("/{name}");
        match (name.as_str(), after.get(name)) {
            (_, None) => found.push(format!("{place} is gone")),
            ("nodes", Some(new)) => compare_nodes(source, output, value, new, &mut found),
            ("scenes", Some(new)) => compare_scenes(output, value, new, &mut found),
            ("animations", Some(new)) => compare_animations(value, new, &mut found),
            ("buffers", Some(new)) => compare_buffers(value, new, &mut found),
            (name, Some(new)) if GROWING.contains(&name) => compare_prefix(&place, value, new, &mut found),
            (_, Some(new)) => expect_equal(&place, value, new, &mut found),
        }
    }
    for name in after.keys().filter(|name| !before.contains_key(*name) && !GROWING.contains(&name.as_str())) {
        found.push(format!("/{name} is new"));
    }
    for (i, data) in source.buffers.iter().enumerate() {
        let now = &output.buffers[i];
        if !now.starts_with(data) {
            found.push(format!("/buffers/{i}: the source's {} bytes are not there any more", data.len()));
        }
    }
    let others = |file: &Gltf| file.chunks.iter().filter(|(kind, _)| kind != b"BIN\0").cloned().collect::<Vec<_>>();
    if others(source) != others(output) {
        found.push("unknown GLB chunks differ".into());
    }
    found
}

fn expect_equal(place: &str, before: &Value, after: &Value, found: &mut Vec<String>) {
    if before != after {
        found.push(format!("{place}: {} became {}", shorten(before), shorten(after)));
    }
}

fn shorten(value: &Value) -> String {
    value.to_string().chars().take(120).collect()
}

fn compare_prefix(place: &str, before: &Value, after: &Value, found: &mut Vec<String>) {
    if items(after).len() < items(before).len() {
        found.push(format!("{place} has lost elements"));
    }
    for (i, (old, new)) in items(before).iter().zip(items(after)).enumerate() {
        expect_equal(&format!("{place}/{i}"), old, new, found);
    }
}

/// Buffers grow at their end; where the buffer is written inside the document its `uri` changes with it.
fn compare_buffers(before: &Value, after: &Value, found: &mut Vec<String>) {
    let without_data = |list: &Value| {
        let strip = |buffer: &Value| {
            let mut buffer = buffer.clone();
            let object = buffer.as_object_mut().expect("a buffer is an object");
            object.remove("byteLength");
            if object.get("uri").and_then(Value::as_str).is_some_and(|uri| uri.starts_with("data:")) {
                object.remove("uri");
            }
            buffer
        };
        Value::Array(items(list).iter().map(strip).collect())
    };
    compare_prefix("/buffers", &without_data(before), &without_data(after), found);
}

fn compare_animations(before: &Value, after: &Value, found: &mut Vec<String>) {
    if items(before).len() != items(after).len() {
        found.push("/animations has another length".into());
    }
    for (i, (old, new)) in items(before).iter().zip(items(after)).enumerate() {
        let place = format!("/animations/{i}");
        compare_prefix(&format!("{place}/channels"), &old["channels"], &new["channels"], found);
        let (mut old, mut new) = (old.clone(), new.clone());
        old["channels"] = Value::Null;
        new["channels"] = Value::Null;
        expect_equal(&place, &old, &new, found);
    }
}

/// A scene's node may be replaced by a switch node above it.
fn compare_scenes(output: &Gltf, before: &Value, after: &Value, found: &mut Vec<String>) {
    if items(before).len() != items(after).len() {
        found.push("/scenes has another length".into());
    }
    for (i, (old, new)) in items(before).iter().zip(items(after)).enumerate() {
        let place = format!("/scenes/{i}");
        compare_children(output, &format!("{place}/nodes"), &old["nodes"], &new["nodes"], found);
        let (mut old, mut new) = (old.clone(), new.clone());
        old["nodes"] = Value::Null;
        new["nodes"] = Value::Null;
        expect_equal(&place, &old, &new, found);
    }
}

fn compare_children(output: &Gltf, place: &str, before: &Value, after: &Value, found: &mut Vec<String>) {
    if items(before).len() != items(after).len() {
        found.push(format!("{place} has another length"));
    }
    for (old, new) in items(before).iter().zip(items(after)) {
        if old != new && !is_switch_above(output, index(new), old) {
            found.push(format!("{place}: node {old} became {new}"));
        }
    }
}

/// A new node with levels and without a transform, whose only child is `below`.
fn is_switch_above(output: &Gltf, node: usize, below: &Value) -> bool {
    let node = &output.list("nodes")[node];
    let still = ["matrix", "translation", "rotation", "scale", "mesh"].iter().all(|member| node.get(member).is_none());
    still && node["children"] == json!([below]) && !node["extensions"]["MSFT_lod"].is_null()
}

fn compare_nodes(source: &Gltf, output: &Gltf, before: &Value, after: &Value, found: &mut Vec<String>) {
    if items(after).len() < items(before).len() {
        found.push("/nodes has lost elements".into());
    }
    for (i, (old, new)) in items(before).iter().zip(items(after)).enumerate() {
        let place = format!("/nodes/{i}");
        let (Some(old_object), Some(new_object)) = (old.as_object(), new.as_object()) else { continue };
        let leaf = leaf_of(source, output, old, new);
        let children = items(&new["children"]).len() - usize::from(leaf.is_some());
        let kept: Value = items(&new["children"]).iter().take(children).cloned().collect();
        compare_children(output, &format!("{place}/children"), &old["children"], &kept, found);
        let new_home = leaf.map_or(new_object, |leaf| leaf.as_object().expect("a node is an object"));
        for (member, value) in old_object {
            let home = if MOVING.contains(&member.as_str()) { new_home } else { new_object };
            match member.as_str() {
                "children" => {}
                "extensions" | "extras" if value.is_object() => {
                    compare_members(&place, member, value, home.get(member), new_home.get(member), found);
                }
                _ => expect_equal(&format!("{place}/{member}"), value, home.get(member).unwrap_or(&Value::Null), found),
            }
        }
        report_new_members(&place, old_object, new_object, found);
    }
}

/// The child that took over the node's mesh, if mesh and node parted.
fn leaf_of<'a>(source: &Gltf, output: &'a Gltf, old: &Value, new: &Value) -> Option<&'a Value> {
    let parted = old.get("mesh").is_some() && new.get("mesh").is_none();
    let leaf = maybe_index(items(&new["children"]).last()?)?;
    let is_new = leaf >= source.list("nodes").len();
    (parted && is_new).then(|| &output.list("nodes")[leaf])
}

/// `extensions` and `extras` keep all they had; instancing goes with the mesh.
fn compare_members(
    place: &str,
    member: &str,
    old: &Value,
    new: Option<&Value>,
    leaf: Option<&Value>,
    found: &mut Vec<String>,
) {
    for (key, value) in old.as_object().into_iter().flatten() {
        let place = format!("{place}/{member}/{key}");
        let home = if key == "EXT_mesh_gpu_instancing" { leaf } else { new };
        expect_equal(&place, value, home.and_then(|home| home.get(key)).unwrap_or(&Value::Null), found);
    }
}

fn report_new_members(place: &str, old: &Map<String, Value>, new: &Map<String, Value>, found: &mut Vec<String>) {
    for (member, value) in new {
        let allowed: &[&str] = match member.as_str() {
            "extensions" => &["MSFT_lod"],
            "extras" => &["MSFT_screencoverage", "gltf_lod"],
            "children" => continue,
            _ => &[],
        };
        match old.get(member) {
            None if allowed.is_empty() => found.push(format!("{place}/{member} is new")),
            before => {
                let known = |key: &String| before.is_some_and(|before| before.get(key).is_some());
                let keys = value.as_object().into_iter().flat_map(|object| object.keys());
                for key in keys.filter(|key| !allowed.is_empty() && !known(key) && !allowed.contains(&key.as_str())) {
                    found.push(format!("{place}/{member}/{key} is new"));
                }
            }
        }
    }
}
