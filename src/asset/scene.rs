//! Nodes: who draws which mesh, what moves, what carries levels already.
//!
//! Transforms are computed from the document itself: the little that is needed of a node is less than what the
//! `gltf` crate asks of the whole document before it agrees to parse it.

use super::Asset;
use super::accessor::{self, Reader, Select};
use super::cursor::Cursor;
use glam::{DMat4, DQuat, DVec3};
use serde_json::Value;
use std::collections::BTreeSet;

/// The facts about the node graph that presets and the writer ask for.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// For each mesh: who draws it.
    pub uses: Vec<MeshUse>,
    /// Nodes that a channel (or KHR_animation_pointer) moves: translation, rotation, scale.
    pub animated_transform: BTreeSet<usize>,
    /// Nodes whose morph weights a channel animates.
    pub animated_weights: BTreeSet<usize>,
    /// Parent of each node.
    pub parent: Vec<Option<usize>>,
    /// Nodes with `MSFT_lod` in the source, with their `ids`.
    pub existing: Vec<(usize, Vec<usize>)>,
    /// Nodes at or below a node of some `ids`: lower levels already.
    pub lower: BTreeSet<usize>,
}

/// Who draws a mesh.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MeshUse {
    /// Nodes with this mesh, in order.
    pub nodes: Vec<usize>,
    /// Largest uniform scale (cube root of the world matrix's determinant) of those nodes and of the instances that
    /// `EXT_mesh_gpu_instancing` makes of them; 1 for a mesh that no node draws.
    pub scale: f32,
}

impl Scene {
    pub(super) fn of(asset: &Asset) -> Self {
        let document = &asset.document;
        let nodes = document.array("nodes");
        let children: Vec<_> = nodes.iter().map(|node| indices(node.get("children"))).collect();
        let existing: Vec<_> = nodes
            .iter()
            .enumerate()
            .map(|(i, node)| (i, indices(node.pointer("/extensions/MSFT_lod/ids"))))
            .filter(|(_, ids)| !ids.is_empty())
            .collect();
        let mut scene = Self { parent: find_parents(&children), ..Self::default() };
        scene.lower = find_below(&children, existing.iter().flat_map(|(_, ids)| ids.iter().copied()));
        scene.uses = find_uses(asset, &hang_levels(&scene.parent, &existing));
        scene.existing = existing;
        scene.find_animated(document.array("animations"));
        scene
    }

    fn find_animated(&mut self, animations: &[Value]) {
        let channels = animations.iter().filter_map(|a| a.get("channels")?.as_array()).flatten();
        for target in channels.filter_map(|channel| channel.get("target")) {
            let pointer = target.pointer("/extensions/KHR_animation_pointer/pointer").and_then(Value::as_str);
            if let Some(pointer) = pointer {
                self.add_pointer(pointer);
            } else if let (Some(node), Some(path)) = (index(target.get("node")), target.get("path")) {
                self.add_animated(node, path.as_str().unwrap_or_default());
            }
        }
    }

    fn add_animated(&mut self, node: usize, path: &str) {
        match path {
            "translation" | "rotation" | "scale" => drop(self.animated_transform.insert(node)),
            "weights" => drop(self.animated_weights.insert(node)),
            _ => {}
        }
    }

    /// `/nodes/3/translation`, `/nodes/3/weights` or one of its elements, `/meshes/1/weights`.
    fn add_pointer(&mut self, pointer: &str) {
        let mut steps = pointer.split('/').skip(1);
        let array = steps.next().unwrap_or_default();
        let Some(index) = steps.next().and_then(|i| i.parse::<usize>().ok()) else { return };
        let member = steps.next().unwrap_or_default();
        if array == "nodes" && index < self.parent.len() {
            self.add_animated(index, member);
        } else if (array, member) == ("meshes", "weights") {
            let nodes = self.uses.get(index).map(|u| u.nodes.clone()).unwrap_or_default();
            self.animated_weights.extend(nodes);
        }
    }
}

fn index(value: Option<&Value>) -> Option<usize> {
    usize::try_from(value?.as_u64()?).ok()
}

fn indices(list: Option<&Value>) -> Vec<usize> {
    list.and_then(Value::as_array).map(|l| l.iter().filter_map(|i| index(Some(i))).collect()).unwrap_or_default()
}

fn find_parents(children: &[Vec<usize>]) -> Vec<Option<usize>> {
    let mut parents = vec![None; children.len()];
    for (parent, children) in children.iter().enumerate() {
        for &child in children {
            if let Some(slot) = parents.get_mut(child) {
                *slot = Some(parent);
            }
        }
    }
    parents
}

/// `tops` and everything below them.
fn find_below(children: &[Vec<usize>], tops: impl Iterator<Item = usize>) -> BTreeSet<usize> {
    let mut stack: Vec<_> = tops.collect();
    let mut below = BTreeSet::new();
    while let Some(node) = stack.pop() {
        if below.insert(node) {
            stack.extend(children.get(node).into_iter().flatten());
        }
    }
    below
}

/// Parents for placing things: a level without a parent hangs where the node is whose level it is.
fn hang_levels(parents: &[Option<usize>], existing: &[(usize, Vec<usize>)]) -> Vec<Option<usize>> {
    let mut hung = parents.to_vec();
    for (node, ids) in existing {
        let parent = parents.get(*node).copied().flatten();
        for &id in ids {
            if let Some(slot) = hung.get_mut(id) {
                *slot = slot.or(parent);
            }
        }
    }
    hung
}

fn find_uses(asset: &Asset, parents: &[Option<usize>]) -> Vec<MeshUse> {
    let document = &asset.document;
    let scales = find_scales(document.array("nodes"), parents);
    let mut uses: Vec<_> = document.array("meshes").iter().map(|_| MeshUse { nodes: Vec::new(), scale: 0.0 }).collect();
    for (i, (node, scale)) in document.array("nodes").iter().zip(scales).enumerate() {
        let Some(mesh) = index(node.get("mesh")).and_then(|m| uses.get_mut(m)) else { continue };
        mesh.nodes.push(i);
        mesh.scale = mesh.scale.max(scale as f32 * largest_instance(asset, node));
    }
    for unused in uses.iter_mut().filter(|u| u.nodes.is_empty()) {
        unused.scale = 1.0;
    }
    uses
}

/// The world's uniform scale at each node. Determinants multiply along a path, so no matrices need to.
fn find_scales(nodes: &[Value], parents: &[Option<usize>]) -> Vec<f64> {
    let mut scales: Vec<Option<f64>> = vec![None; nodes.len()];
    for start in 0..nodes.len() {
        let mut path = Vec::new();
        let mut at = Some(start);
        let mut above = 1.0;
        while let Some(node) = at {
            if let Some(&Some(known)) = scales.get(node) {
                above = known;
                break;
            }
            // A level that hangs below its own node ends here: the graph was checked for every other cycle.
            if path.len() > nodes.len() {
                break;
            }
            path.push(node);
            at = parents.get(node).copied().flatten();
        }
        for node in path.into_iter().rev() {
            let Some((value, slot)) = nodes.get(node).zip(scales.get_mut(node)) else { continue };
            above *= Transform::of(value).matrix().determinant().abs().cbrt();
            *slot = Some(above);
        }
    }
    scales.into_iter().map(|scale| scale.unwrap_or(1.0)).collect()
}

/// Where a node stands in its parent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Transform {
    pub translation: DVec3,
    pub rotation: DQuat,
    pub scale: DVec3,
    /// Instead of all of these.
    fixed: Option<DMat4>,
}

impl Transform {
    pub fn of(node: &Value) -> Self {
        let node = Cursor::root(node);
        let triple = |name: &str| node.get(name).and_then(|t| t.numbers().ok()).map(DVec3::from_array);
        let rotation = node.get("rotation").and_then(|r| r.numbers().ok()).map_or(DQuat::IDENTITY, DQuat::from_array);
        Self {
            translation: triple("translation").unwrap_or(DVec3::ZERO),
            rotation: rotation.normalize(),
            scale: triple("scale").unwrap_or(DVec3::ONE),
            fixed: node.get("matrix").and_then(|m| m.numbers().ok()).map(|m| DMat4::from_cols_array(&m)),
        }
    }

    pub fn matrix(&self) -> DMat4 {
        self.fixed
            .unwrap_or_else(|| DMat4::from_scale_rotation_translation(self.scale, self.rotation, self.translation))
    }
}

/// The largest uniform scale among the node's GPU instances; 1 without any.
fn largest_instance(asset: &Asset, node: &Value) -> f32 {
    let root = asset.document.root();
    let Some(scale) = index(node.pointer("/extensions/EXT_mesh_gpu_instancing/attributes/SCALE")) else { return 1.0 };
    let mut scales = Vec::new();
    let read = match accessor::compression(root, &asset.buffers, scale) {
        None => Reader::open(root, &asset.buffers, scale).and_then(|r| r.read_floats(Select::All, &mut scales)),
        Some(_) => Ok(()),
    };
    let (triples, _) = scales.as_chunks::<3>();
    let largest = triples.iter().map(|s| s.iter().product::<f32>().abs().cbrt()).fold(0.0, f32::max);
    if read.is_err() || triples.is_empty() || !largest.is_finite() { 1.0 } else { largest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::{Container, Document};
    use serde_json::json;

    fn scene(root: Value) -> Scene {
        Asset {
            path: "test.gltf".into(),
            container: Container::Gltf,
            document: Document::new(root),
            buffers: Vec::new(),
            resources: Vec::new(),
            warnings: Vec::new(),
        }
        .scene()
    }

    #[test]
    fn scales_multiply_down_the_tree_and_levels_hang_where_their_node_does() {
        let scene = scene(json!({
            "meshes": [{}, {}, {}],
            "nodes": [
                {"scale": [2, 2, 2], "children": [1]},
                {"mesh": 0, "scale": [1, 1, 8], "extensions": {"MSFT_lod": {"ids": [2]}}},
                {"mesh": 1, "scale": [3, 3, 3], "children": [3]},
                {"mesh": 0, "rotation": [0, 0, 2, 0]},
            ],
        }));
        assert_eq!(scene.uses[0].nodes, [1, 3]);
        assert_eq!(scene.uses[0].scale, 6.0);
        assert_eq!(scene.uses[1], MeshUse { nodes: vec![2], scale: 6.0 });
        assert_eq!(scene.uses[2], MeshUse { nodes: vec![], scale: 1.0 });
        assert_eq!(scene.parent, [None, Some(0), None, Some(2)]);
        assert_eq!(scene.existing, [(1, vec![2])]);
        assert_eq!(scene.lower, BTreeSet::from([2, 3]));
    }

    #[test]
    fn channels_and_pointers_mark_what_moves() {
        let pointer = |text: &str| {
            json!({"sampler": 0, "target": {"path": "pointer",
                "extensions": {"KHR_animation_pointer": {"pointer": text}}}})
        };
        let scene = scene(json!({
            "meshes": [{}],
            "nodes": [{}, {}, {"mesh": 0}, {}],
            "animations": [{"channels": [
                {"sampler": 0, "target": {"node": 0, "path": "rotation"}},
                {"sampler": 0, "target": {"node": 1, "path": "weights"}},
                {"sampler": 0, "target": {"path": "translation"}},
                pointer("/nodes/3/scale"), pointer("/meshes/0/weights/1"), pointer("/nodes/99/scale"),
                pointer("/materials/0/emissiveFactor"),
            ]}],
        }));
        assert_eq!(scene.animated_transform, BTreeSet::from([0, 3]));
        assert_eq!(scene.animated_weights, BTreeSet::from([1, 2]));
    }
}
