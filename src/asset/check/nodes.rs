//! Nodes, skins, scenes, animations, and the graph: a forest without cycles.

use super::Document;
use crate::asset::accessor::Header;
use crate::asset::cursor::Cursor;
use crate::asset::geometry::{Component, Shape};
use crate::error::{Error, Result};
use serde_json::Value;

pub(super) fn check_node(document: &Document, node: &Cursor) -> Result<()> {
    node.object()?;
    for (name, array) in [("camera", "cameras"), ("mesh", "meshes"), ("skin", "skins")] {
        document.check_index(node, name, array)?;
    }
    document.check_indices(node, "children", "nodes")?;
    node.get("matrix").map(|m| m.numbers::<16>()).transpose()?;
    node.get("translation").map(|t| t.numbers::<3>()).transpose()?;
    node.get("rotation").map(|r| r.numbers::<4>()).transpose()?;
    node.get("scale").map(|s| s.numbers::<3>()).transpose()?;
    check_extensions(document, node)
}

fn check_extensions(document: &Document, node: &Cursor) -> Result<()> {
    let Some(extensions) = node.get("extensions") else { return Ok(()) };
    extensions.object()?;
    if let Some(lod) = extensions.get("MSFT_lod") {
        lod.object()?;
        document.check_indices(&lod, "ids", "nodes")?;
    }
    if let Some(light) = extensions.get("KHR_lights_punctual").and_then(|l| l.get("light")) {
        let lights = document.root.pointer("/extensions/KHR_lights_punctual/lights");
        light.index("lights", lights.and_then(Value::as_array).map_or(0, Vec::len))?;
    }
    let instancing = extensions.get("EXT_mesh_gpu_instancing").and_then(|i| i.get("attributes"));
    let Some(attributes) = instancing else { return Ok(()) };
    let mut count = None;
    for (_, index) in attributes.members()? {
        let accessor = index.index("accessors", document.length("accessors"))?;
        let header = document.top("accessors", accessor).and_then(|a| Header::parse(&a).ok());
        let Some(header) = header else { continue };
        let first = *count.get_or_insert(header.count);
        if header.count != first {
            return Err(index.error(format!("{} instances, but the first attribute has {first}", header.count)));
        }
    }
    Ok(())
}

pub(super) fn check_skin(document: &Document, skin: &Cursor) -> Result<()> {
    skin.need("joints")?;
    let joints = document.check_indices(skin, "joints", "nodes")?;
    document.check_index(skin, "skeleton", "nodes")?;
    let Some(matrices) = document.check_index(skin, "inverseBindMatrices", "accessors")? else { return Ok(()) };
    let header = document.top("accessors", matrices).and_then(|a| Header::parse(&a).ok());
    let Some(header) = header else { return Ok(()) };
    let place = skin.need("inverseBindMatrices")?;
    if (header.shape, header.component) != (Shape::Mat4, Component::F32) {
        return Err(place.error(format!("accessors[{matrices}] is not MAT4 of FLOAT")));
    }
    if header.count < joints.len() {
        return Err(place.error(format!("{} matrices for {} joints", header.count, joints.len())));
    }
    Ok(())
}

pub(super) fn check_scene(document: &Document, scene: &Cursor) -> Result<()> {
    scene.object()?;
    document.check_indices(scene, "nodes", "nodes").map(drop)
}

pub(super) fn check_animation(document: &Document, animation: &Cursor) -> Result<()> {
    animation.object()?;
    let samplers = animation.need("samplers")?.elements()?;
    let length = samplers.len();
    for sampler in samplers {
        for accessor in ["input", "output"] {
            sampler.need(accessor)?.index("accessors", document.length("accessors"))?;
        }
    }
    for channel in animation.need("channels")?.elements()? {
        channel.need("sampler")?.index("samplers", length)?;
        let target = channel.need("target")?;
        document.check_index(&target, "node", "nodes")?;
        target.need("path")?.string()?;
        if let Some(pointer) = target.extension("KHR_animation_pointer") {
            pointer.need("pointer")?.string()?;
        }
    }
    Ok(())
}

/// The nodes' `children` must make a forest, and following `children` and the `ids` of `MSFT_lod` must end.
pub(super) fn check_graph(document: &Document) -> Result<()> {
    let Some(nodes) = Cursor::root(document.root).get("nodes") else { return Ok(()) };
    let mut parents = vec![None; document.length("nodes")];
    let mut edges = Vec::with_capacity(parents.len());
    for (i, node) in nodes.elements()?.enumerate() {
        let mut below = document.check_indices(&node, "children", "nodes")?;
        for (k, &child) in below.iter().enumerate() {
            let Some(parent) = parents.get_mut(child) else { continue };
            if let Some(other) = parent.replace(i) {
                let message = format!("nodes[{child}] is a child of nodes[{other}] already");
                let message = if other == i { format!("nodes[{child}] is listed twice") } else { message };
                let error = Error::malformed(format!("{}/children/{k}", node.place), message);
                return Err(error.help("a node has one parent: duplicate the node"));
            }
        }
        if let Some(lod) = node.extension("MSFT_lod") {
            below.extend(document.check_indices(&lod, "ids", "nodes")?);
        }
        edges.push(below);
    }
    match find_cycle(&edges) {
        None => Ok(()),
        Some(cycle) => {
            let path: Vec<_> = cycle.iter().chain(cycle.first()).take(8).map(ToString::to_string).collect();
            let place = nodes.elements()?.nth(cycle.first().copied().unwrap_or(0)).unwrap_or(nodes);
            Err(place.error(format!("the node is below itself: nodes {}", path.join(" → "))))
        }
    }
}

/// A cycle of the graph, if it has one. Keeps its own stack, since hierarchies may be deeper than the thread's.
fn find_cycle(edges: &[Vec<usize>]) -> Option<Vec<usize>> {
    #[derive(Clone, Copy, PartialEq)]
    enum State {
        New,
        Open,
        Done,
    }
    let mut states = vec![State::New; edges.len()];
    for start in 0..edges.len() {
        let mut path = vec![(start, 0)];
        while let Some((node, next)) = path.last_mut() {
            let state = states.get_mut(*node)?;
            if *state == State::Done {
                path.pop();
                continue;
            }
            *state = State::Open;
            let Some(&below) = edges.get(*node).and_then(|e| e.get(*next)) else {
                *state = State::Done;
                path.pop();
                continue;
            };
            *next += 1;
            match states.get(below)? {
                State::Open => return Some(path.iter().map(|(n, _)| *n).skip_while(|n| *n != below).collect()),
                State::New => path.push((below, 0)),
                State::Done => {}
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use crate::asset::check::check;
    use serde_json::{Value, json};

    fn problem(more: Value) -> Option<String> {
        let mut root = json!({"asset": {"version": "2.0"}});
        root.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        check(&root).problems.first().map(ToString::to_string)
    }

    #[test]
    fn a_cycle_is_named_with_its_nodes() {
        let message =
            problem(json!({"nodes": [{"children": [1]}, {"children": [2]}, {"children": [3]}, {"children": [1]}]}));
        assert!(message.unwrap().contains("nodes[1] is a child of nodes[0] already"));
        let message = problem(json!({"nodes": [{}, {"children": [2]}, {"children": [1]}]}));
        assert_eq!(message.unwrap(), "/nodes/1: the node is below itself: nodes 1 → 2 → 1");
        let message = problem(json!({"nodes": [{"children": [0]}]}));
        assert_eq!(message.unwrap(), "/nodes/0: the node is below itself: nodes 0 → 0");
        let lod = json!({"extensions": {"MSFT_lod": {"ids": [0]}}});
        assert!(problem(json!({"nodes": [{"children": [1]}, lod]})).unwrap().contains("below itself"));
    }

    #[test]
    fn a_node_has_one_parent() {
        let message = problem(json!({"nodes": [{"children": [2]}, {"children": [2]}, {}]})).unwrap();
        assert!(message.starts_with("/nodes/1/children/0: nodes[2] is a child of nodes[0] already"), "{message}");
        let message = problem(json!({"nodes": [{"children": [1, 1]}, {}]})).unwrap();
        assert!(message.starts_with("/nodes/0/children/1: nodes[1] is listed twice"), "{message}");
    }

    #[test]
    fn a_hundred_thousand_levels_do_not_overflow_the_stack() {
        let mut nodes: Vec<_> = (1..100_000).map(|i| json!({"children": [i]})).collect();
        nodes.push(json!({}));
        assert_eq!(problem(json!({"nodes": nodes})), None);
    }

    #[test]
    fn skins_and_animations_are_checked() {
        let matrices = |count: usize| {
            problem(json!({"nodes": [{}, {}],
                "accessors": [{"componentType": 5126, "type": "MAT4", "count": count}],
                "skins": [{"joints": [0, 1], "inverseBindMatrices": 0}]}))
        };
        assert_eq!(matrices(2), None);
        assert_eq!(matrices(1).unwrap(), "/skins/0/inverseBindMatrices: 1 matrices for 2 joints");
        let channel = |sampler: usize, target: Value| {
            problem(json!({"nodes": [{}], "accessors": [{"componentType": 5126, "type": "SCALAR", "count": 1}],
                "animations": [{"samplers": [{"input": 0, "output": 0}],
                    "channels": [{"sampler": sampler, "target": target}]}]}))
        };
        let pointer =
            json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/nodes/0/scale"}}});
        assert_eq!(channel(0, pointer), None, "no node is needed");
        assert!(channel(1, json!({"path": "scale"})).unwrap().contains("names samplers[1]"));
        assert!(channel(0, json!({"path": "scale", "node": 1})).unwrap().contains("names nodes[1]"));
    }
}
