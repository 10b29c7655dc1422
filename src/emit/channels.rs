//! Animation channels by what they move, and the edits that let morph weights reach every level.

use crate::asset::Document;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// The channels of a document that matter to the arrangement of nodes.
#[derive(Debug, Default)]
pub(super) struct Channels {
    /// Channels of each node's morph weights.
    node_weights: BTreeMap<usize, Vec<Channel>>,
    /// Channels of each mesh's default morph weights (KHR_animation_pointer only).
    mesh_weights: BTreeMap<usize, Vec<Channel>>,
    /// Nodes whose translation, rotation or scale is animated.
    moved: BTreeSet<usize>,
    /// Nodes of which anything else is animated, such as their visibility.
    changed: BTreeSet<usize>,
}

/// Where a weights channel stands and what its target says.
#[derive(Debug, Clone)]
struct Channel {
    animation: usize,
    channel: usize,
    target: Target,
}

#[derive(Debug, Clone)]
enum Target {
    /// `{"node": N, "path": "weights"}`
    Path,
    /// `/nodes/N/` or `/meshes/M/` and this.
    Pointer(String),
}

impl Channels {
    /// Sorts all channels of the document.
    pub fn of(document: &Document) -> Self {
        let mut channels = Self::default();
        for (animation, json) in document.array("animations").iter().enumerate() {
            let list = json.get("channels").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
            for (channel, json) in list.iter().enumerate() {
                if let Some(target) = json.get("target") {
                    channels.add(animation, channel, target);
                }
            }
        }
        channels
    }

    fn add(&mut self, animation: usize, channel: usize, target: &Value) {
        let here = |target| Channel { animation, channel, target };
        let path = target.get("path").and_then(Value::as_str);
        if path == Some("pointer") {
            let Some((array, index, rest)) = target.pointer(POINTER).and_then(Value::as_str).and_then(split_pointer)
            else {
                return;
            };
            let weights = rest == "weights" || rest.starts_with("weights/");
            match (array, rest) {
                ("nodes", _) if weights => {
                    self.node_weights.entry(index).or_default().push(here(Target::Pointer(rest.to_owned())));
                }
                ("meshes", _) if weights => {
                    self.mesh_weights.entry(index).or_default().push(here(Target::Pointer(rest.to_owned())));
                }
                ("nodes", "translation" | "rotation" | "scale") => drop(self.moved.insert(index)),
                ("nodes", _) => drop(self.changed.insert(index)),
                _ => {}
            }
            return;
        }
        let Some(node) = target.get("node").and_then(Value::as_u64).map(|node| node as usize) else { return };
        match path {
            Some("weights") => self.node_weights.entry(node).or_default().push(here(Target::Path)),
            Some("translation" | "rotation" | "scale") => drop(self.moved.insert(node)),
            _ => {}
        }
    }

    /// Whether the node's transform is animated.
    pub fn move_node(&self, node: usize) -> bool {
        self.moved.contains(&node)
    }

    /// Whether anything of the node but its transform and its morph weights is animated.
    pub fn change_node(&self, node: usize) -> bool {
        self.changed.contains(&node)
    }

    /// Whether the node's morph weights are animated.
    pub fn morph_node(&self, node: usize) -> bool {
        self.node_weights.contains_key(&node)
    }

    /// Lets the weights channels of `from` drive `to` instead: the mesh has moved there.
    pub fn hand_over_node(&self, document: &mut Document, from: usize, to: usize) {
        for channel in self.node_weights.get(&from).into_iter().flatten() {
            let Channel { animation, channel: index, .. } = channel;
            if let Some(json) = channel.aimed_at(document, "nodes", to) {
                document.replace(&format!("/animations/{animation}/channels/{index}"), json);
            }
        }
    }

    /// Lets the samplers that drive the weights of `node` drive those of `level` too.
    pub fn repeat_for_node(&self, document: &mut Document, node: usize, level: usize) {
        repeat(document, self.node_weights.get(&node), "nodes", level);
    }

    /// Lets the samplers that drive the default weights of `mesh` drive those of `level` too.
    pub fn repeat_for_mesh(&self, document: &mut Document, mesh: usize, level: usize) {
        repeat(document, self.mesh_weights.get(&mesh), "meshes", level);
    }
}

fn repeat(document: &mut Document, channels: Option<&Vec<Channel>>, array: &str, index: usize) {
    for channel in channels.into_iter().flatten() {
        if let Some(json) = channel.aimed_at(document, array, index) {
            document.append(&format!("/animations/{}", channel.animation), "channels", json);
        }
    }
}

impl Channel {
    /// The channel's JSON with `array[index]` as its target.
    fn aimed_at(&self, document: &Document, array: &str, index: usize) -> Option<Value> {
        let place = format!("/animations/{}/channels/{}", self.animation, self.channel);
        let mut json = document.root().pointer(&place)?.clone();
        let target = json.get_mut("target")?;
        match &self.target {
            Target::Path => *target.get_mut("node")? = index.into(),
            Target::Pointer(rest) => *target.pointer_mut(POINTER)? = json!(format!("/{array}/{index}/{rest}")),
        }
        Some(json)
    }
}

const POINTER: &str = "/extensions/KHR_animation_pointer/pointer";

/// `/nodes/3/weights/0` as `("nodes", 3, "weights/0")`.
pub(super) fn split_pointer(pointer: &str) -> Option<(&str, usize, &str)> {
    let (array, rest) = pointer.strip_prefix('/')?.split_once('/')?;
    let (index, rest) = rest.split_once('/')?;
    Some((array, index.parse().ok()?, rest))
}
