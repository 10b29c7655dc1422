//! Takes back everything that adding levels may change; what is left has to be the source.

use super::{Sides, elements, indices, level_ids, number, problem};
use crate::emit::channels::split_pointer;
use crate::emit::progressive::ranges_of_view;
use crate::error::Error;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};

/// More than this many differences help nobody.
const MOST_DIFFERENCES: usize = 20;

pub(super) fn find_changes(sides: &Sides<'_>) -> Vec<Error> {
    let mut problems = Vec::new();
    let restored = take_back(sides);
    find_differences(sides.source, &restored, &mut String::new(), &mut problems);
    find_changed_bytes(sides, &mut problems);
    problems
}

/// The written document without what is ours.
fn take_back(sides: &Sides<'_>) -> Value {
    let mut root = sides.written.clone();
    let old_nodes = elements(sides.source, "nodes").len();
    let leaves = find_leaves(sides.source, sides.written, old_nodes);
    for node in 0..old_nodes {
        restore_node(sides, &mut root, node, leaves.get(&node).copied());
    }
    for (array, member) in [("scenes", "nodes"), ("nodes", "children")] {
        for index in 0..elements(&root, array).len() {
            restore_list(sides, &mut root, array, index, member);
        }
    }
    restore_animations(sides, &mut root, &leaves);
    restore_extensions_used(sides.source, &mut root);
    for name in ["nodes", "meshes", "accessors", "bufferViews", "buffers"] {
        truncate(sides.source, &mut root, name);
    }
    restore_offsets(sides.source, &mut root);
    root
}

/// The new leaf that has taken the mesh of a source's node, for each node that has lost its mesh: below the node, below
/// a switch node below it, or a root of the same scene.
fn find_leaves(source: &Value, written: &Value, old_nodes: usize) -> BTreeMap<usize, usize> {
    let nodes = elements(written, "nodes");
    let roots: Vec<usize> = elements(written, "scenes").iter().flat_map(|scene| indices(scene, "nodes")).collect();
    let new_roots: Vec<usize> = roots.into_iter().filter(|&root| root >= old_nodes).collect();
    let mut leaves = BTreeMap::new();
    let mut taken = BTreeSet::new();
    for (index, (before, after)) in elements(source, "nodes").iter().zip(nodes).enumerate() {
        let (Some(mesh), None) = (number(before, "mesh"), number(after, "mesh")) else { continue };
        let below = indices(after, "children");
        let below_switch = below.iter().filter(|&&n| n >= old_nodes).filter_map(|&n| nodes.get(n));
        let mut candidates: Vec<usize> = below_switch.flat_map(|switch| indices(switch, "children")).collect();
        candidates.extend(&below);
        candidates.extend(&new_roots);
        let takes_over = |leaf: usize| {
            let leaf = nodes.get(leaf)?;
            (number(leaf, "mesh") == Some(mesh) && leaf.get("skin") == before.get("skin")).then_some(())
        };
        let free = |leaf: &usize| *leaf >= old_nodes && !taken.contains(leaf);
        if let Some(leaf) = candidates.into_iter().find(|leaf| free(leaf) && takes_over(*leaf).is_some()) {
            taken.insert(leaf);
            leaves.insert(index, leaf);
        }
    }
    leaves
}

fn restore_node(sides: &Sides<'_>, root: &mut Value, index: usize, leaf: Option<usize>) {
    let old_nodes = elements(sides.source, "nodes").len();
    let before = &elements(sides.source, "nodes")[index];
    let leaf = leaf.and_then(|leaf| elements(sides.written, "nodes").get(leaf)).cloned();
    let Some(node) = root.pointer_mut(&format!("/nodes/{index}")).and_then(Value::as_object_mut) else { return };
    if let Some(leaf) = leaf {
        for member in ["mesh", "skin", "weights"] {
            if let Some(value) = leaf.get(member) {
                node.insert(member.into(), value.clone());
            }
        }
        for name in ["EXT_mesh_gpu_instancing", "EXT_instance_features"] {
            if let Some(payload) = leaf.pointer(&format!("/extensions/{name}")) {
                set_inside(node, "extensions", name, Some(payload));
            }
        }
    }
    let ids = level_ids(&Value::Object(node.clone()));
    let ours = ids.as_ref().is_some_and(|ids| ids.iter().all(|&id| id >= old_nodes));
    let replaced = level_ids(before).is_some() && ids != level_ids(before) && has_new_levels(sides, index);
    if ours || replaced {
        set_inside(node, "extensions", "MSFT_lod", before.pointer("/extensions/MSFT_lod"));
        if node.get("extras").is_none_or(Value::is_object) {
            set_inside(node, "extras", "MSFT_screencoverage", before.pointer("/extras/MSFT_screencoverage"));
            set_inside(node, "extras", "gltf_lod", before.pointer("/extras/gltf_lod"));
        }
        for member in ["extensions", "extras"] {
            if before.get(member).is_none() && node.get(member).and_then(Value::as_object).is_some_and(Map::is_empty) {
                node.shift_remove(member);
            }
        }
    }
}

/// Whether the node or one below it carries levels of ours.
fn has_new_levels(sides: &Sides<'_>, index: usize) -> bool {
    let old_nodes = elements(sides.source, "nodes").len();
    let nodes = elements(sides.written, "nodes");
    let mut open = vec![index];
    for _ in 0..=nodes.len() {
        let Some(node) = open.pop().and_then(|n| nodes.get(n)) else { return false };
        if level_ids(node).is_some_and(|ids| ids.iter().all(|&id| id >= old_nodes)) {
            return true;
        }
        open.extend(indices(node, "children"));
    }
    false
}

/// Sets or removes `object[member][name]`.
fn set_inside(object: &mut Map<String, Value>, member: &str, name: &str, value: Option<&Value>) {
    match value {
        Some(value) => {
            if let Value::Object(inner) = object.entry(member).or_insert_with(|| Value::Object(Map::new())) {
                inner.insert(name.into(), value.clone());
            }
        }
        None => {
            if let Some(inner) = object.get_mut(member).and_then(Value::as_object_mut) {
                inner.shift_remove(name);
            }
        }
    }
}

/// A new node in a list of nodes is a switch, which stands where its only child stood, or a leaf.
fn restore_list(sides: &Sides<'_>, root: &mut Value, array: &str, index: usize, member: &str) {
    let old_nodes = elements(sides.source, "nodes").len();
    let replace = |id: usize| match id {
        old if old < old_nodes => Some(old),
        new => match indices(elements(sides.written, "nodes").get(new)?, "children")[..] {
            [child] if child < old_nodes => Some(child),
            _ => None,
        },
    };
    let had_list = elements(sides.source, array).get(index).is_some_and(|object| object.get(member).is_some());
    let Some(object) = root.pointer_mut(&format!("/{array}/{index}")).and_then(Value::as_object_mut) else { return };
    let Some(list) = object.get_mut(member).and_then(Value::as_array_mut) else { return };
    let restore = |id: &Value| id.as_u64().and_then(|id| replace(id as usize)).map(Value::from);
    *list = list.iter().filter_map(restore).collect();
    if list.is_empty() && !had_list {
        object.shift_remove(member);
    }
}

/// Levels have channels of their own, at the end; channels of a mesh that moved to a leaf follow it.
fn restore_animations(sides: &Sides<'_>, root: &mut Value, leaves: &BTreeMap<usize, usize>) {
    let owners: BTreeMap<usize, usize> = leaves.iter().map(|(&node, &leaf)| (leaf, node)).collect();
    let owner = |leaf: usize| owners.get(&leaf).copied();
    for (index, before) in elements(sides.source, "animations").iter().enumerate() {
        let place = format!("/animations/{index}/channels");
        let Some(channels) = root.pointer_mut(&place).and_then(Value::as_array_mut) else { continue };
        channels.truncate(elements(before, "channels").len());
        for target in channels.iter_mut().filter_map(|channel| channel.get_mut("target")) {
            if let Some(node) = number(target, "node").and_then(owner) {
                target["node"] = node.into();
            }
            if let Some(pointer) = target.pointer_mut("/extensions/KHR_animation_pointer/pointer") {
                let node = pointer.as_str().and_then(split_pointer).filter(|(array, ..)| *array == "nodes");
                if let Some((node, rest)) = node.and_then(|(_, leaf, rest)| Some((owner(leaf)?, rest))) {
                    *pointer = format!("/nodes/{node}/{rest}").into();
                }
            }
        }
    }
}

fn restore_extensions_used(source: &Value, root: &mut Value) {
    if elements(source, "extensionsUsed").iter().any(|name| name == "MSFT_lod") {
        return;
    }
    let Some(object) = root.as_object_mut() else { return };
    let Some(used) = object.get_mut("extensionsUsed").and_then(Value::as_array_mut) else { return };
    used.retain(|name| name != "MSFT_lod");
    if used.is_empty() && source.get("extensionsUsed").is_none() {
        object.shift_remove("extensionsUsed");
    }
}

fn truncate(source: &Value, root: &mut Value, name: &str) {
    let Some(object) = root.as_object_mut() else { return };
    if source.get(name).is_none() {
        object.shift_remove(name);
    } else if let Some(array) = object.get_mut(name).and_then(Value::as_array_mut) {
        array.truncate(elements(source, name).len());
    }
}

/// A GLB's own buffer may have grown and its content moved inside it; [`find_changed_bytes`] looks at the content.
fn restore_offsets(source: &Value, root: &mut Value) {
    let Some(before) = elements(source, "buffers").first().filter(|buffer| buffer.get("uri").is_none()) else { return };
    if let (Some(buffer), Some(length)) = (root.pointer_mut("/buffers/0"), before.get("byteLength")) {
        buffer["byteLength"] = length.clone();
    }
    for (index, view) in elements(source, "bufferViews").iter().enumerate() {
        for (place, before) in ranges_of_view(index, view) {
            let Some(after) = root.pointer_mut(&place).and_then(Value::as_object_mut) else { continue };
            if number(before, "buffer") != Some(0) {
                continue;
            }
            match before.get("byteOffset") {
                Some(offset) => drop(after.insert("byteOffset".into(), offset.clone())),
                None => drop(after.shift_remove("byteOffset")),
            }
        }
    }
}

/// Buffers begin with what they were; where content has moved, every buffer view has what it had.
fn find_changed_bytes(sides: &Sides<'_>, problems: &mut Vec<Error>) {
    let range = |buffers: &[Option<&[u8]>], view: &Value| -> Option<Vec<u8>> {
        let start = number(view, "byteOffset").unwrap_or(0);
        let end = start.checked_add(number(view, "byteLength")?)?;
        (*buffers.get(number(view, "buffer")?)?)?.get(start..end).map(<[u8]>::to_vec)
    };
    let before: Vec<Option<&[u8]>> = sides.source_buffers.iter().map(|b| b.as_deref()).collect();
    let after: Vec<Option<&[u8]>> = sides.written_buffers.iter().map(|b| b.as_deref()).collect();
    for (index, old) in before.iter().enumerate() {
        let Some(old) = old else { continue };
        let new = after.get(index).copied().flatten().unwrap_or_default();
        let may_grow = index == 0 && sides.written.pointer("/buffers/0/uri").is_none();
        if (may_grow && new.starts_with(old)) || new == *old {
            continue;
        }
        if !may_grow {
            problems.push(problem(format!("/buffers/{index}"), "its bytes are not the source's"));
            continue;
        }
        for (view, json) in elements(sides.source, "bufferViews").iter().enumerate() {
            for (place, json) in ranges_of_view(view, json) {
                let moved = sides.written.pointer(&place).and_then(|json| range(&after, json));
                if number(json, "buffer") == Some(index) && moved != range(&before, json) {
                    problems.push(problem(place, "its bytes are not the source's"));
                }
            }
        }
    }
}

fn find_differences(before: &Value, after: &Value, place: &mut String, problems: &mut Vec<Error>) {
    if problems.len() >= MOST_DIFFERENCES || before == after {
        return;
    }
    let mut below = |key: &str, before: Option<&Value>, after: Option<&Value>, problems: &mut Vec<Error>| {
        let length = place.len();
        place.push('/');
        place.push_str(&key.replace('~', "~0").replace('/', "~1"));
        match (before, after) {
            (Some(before), Some(after)) => find_differences(before, after, place, problems),
            (Some(_), None) => problems.push(problem(place.clone(), "the source has it, the result does not")),
            (None, _) => problems.push(problem(place.clone(), "the result has it, the source does not")),
        }
        place.truncate(length);
    };
    match (before, after) {
        (Value::Object(a), Value::Object(b)) => {
            a.iter().for_each(|(key, value)| below(key, Some(value), b.get(key), problems));
            let new = b.iter().filter(|(key, _)| !a.contains_key(*key));
            new.for_each(|(key, value)| below(key, None, Some(value), problems));
        }
        (Value::Array(a), Value::Array(b)) => {
            for i in 0..a.len().max(b.len()) {
                below(&i.to_string(), a.get(i), b.get(i), problems);
            }
        }
        _ => problems.push(problem(place.clone(), format!("{before} in the source, {after} in the result"))),
    }
}
