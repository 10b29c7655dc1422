//! `MSFT_lod` on nodes, arranged so that the loaders in use show the right level at the right place.
//!
//! Babylon.js and three.js put LOD nodes beside the node that carries the extension, give them their own transform, and
//! drop everything below the carrier together with the finest level. Hence:
//! - LOD nodes repeat the carrier's transform, skin, morph weights and instances, and belong to one carrier only;
//! - a node with children, a camera, a light or a moving transform, or that is a joint, hands its mesh to a new leaf
//!   below it, which becomes the carrier;
//! - where morph weights are animated the carrier is a *switch node* above the mesh's node, since three.js loses a
//!   weights channel of the carrier itself. Not above skinned meshes: Babylon.js would draw all levels at once.

use super::channels::Channels;
use super::names::Names;
use crate::asset::{Asset, Document, Scene};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;

/// The levels that a node gets.
pub(super) struct NodeLevels<'a> {
    /// Their meshes, finest first.
    pub meshes: &'a [usize],
    /// `MSFT_screencoverage`.
    pub coverage: &'a [f64],
    /// `extras.gltf_lod`.
    pub extras: &'a Value,
}

/// Adds level nodes to a document.
pub(super) struct Arranger<'a> {
    source: &'a Asset,
    scene: &'a Scene,
    channels: &'a Channels,
    joints: BTreeSet<usize>,
    names: Names<'a>,
    /// What the user should know.
    pub notes: Vec<String>,
}

/// What belongs to the mesh of a node, and goes where the mesh goes.
const DRAWING_MEMBERS: [&str; 3] = ["mesh", "skin", "weights"];
const DRAWING_EXTENSIONS: [&str; 2] = ["EXT_mesh_gpu_instancing", "EXT_instance_features"];
/// What LOD nodes, which do not stand below the carrier, have to repeat besides.
const INHERITED_EXTENSIONS: [&str; 3] = ["KHR_node_visibility", "KHR_node_selectability", "KHR_node_hoverability"];
const TRANSFORM_MEMBERS: [&str; 4] = ["matrix", "translation", "rotation", "scale"];
/// Extensions of a node that must not vanish with its finest level.
const PLACED_EXTENSIONS: [&str; 2] = ["KHR_lights_punctual", "KHR_audio_emitter"];

impl<'a> Arranger<'a> {
    pub fn new(source: &'a Asset, scene: &'a Scene, channels: &'a Channels, naming: &'a str) -> Self {
        let joints = source
            .document
            .array("skins")
            .iter()
            .flat_map(|skin| {
                let joints = skin.get("joints").and_then(Value::as_array).into_iter().flatten();
                joints.chain(skin.get("skeleton")).filter_map(Value::as_u64)
            })
            .map(|node| node as usize)
            .collect();
        let names = Names::new(naming, source.document.array("nodes"));
        Self { source, scene, channels, joints, names, notes: Vec::new() }
    }

    /// Gives `node` its levels.
    pub fn arrange(&mut self, document: &mut Document, node: usize, levels: &NodeLevels<'_>) {
        let Some(json) = self.source.document.array("nodes").get(node) else { return };
        let name = self.name_of(node, json);
        let skinned = json.get("skin").is_some();
        let morphing = self.channels.morph_node(node);
        if skinned && morphing {
            self.notes.push(format!(
                "/nodes/{node}: skinned with animated morph weights; three.js (r187) does not play the weights on the finest level, \
                 no arrangement of nodes is right in every loader"
            ));
        }
        let drawing = if self.must_split(node, json) { self.split(document, node, &name) } else { node };
        let carrier = if morphing && !skinned { self.put_switch_above(document, drawing, &name) } else { drawing };
        let template = level_template(document, drawing);
        let ids = self.add_level_nodes(document, node, &template, carrier != drawing, levels.meshes, &name);
        document.set_extension(&pointer(carrier), "MSFT_lod", json!({ "ids": ids }));
        self.write_coverage(document, carrier, levels);
    }

    /// The node's name, or its mesh's, or its index.
    fn name_of(&self, node: usize, json: &Value) -> String {
        let name =
            |object: &Value| object.get("name").and_then(Value::as_str).filter(|n| !n.is_empty()).map(str::to_owned);
        let mesh = || self.source.document.array("meshes").get(json.get("mesh")?.as_u64()? as usize);
        name(json).or_else(|| mesh().and_then(name)).unwrap_or_else(|| format!("node{node}"))
    }

    /// Whether something other than the mesh hangs on this node. The transform of a skinned node moves nothing, so that
    /// it may be animated.
    fn must_split(&self, node: usize, json: &Value) -> bool {
        let has_children = json.get("children").and_then(Value::as_array).is_some_and(|c| !c.is_empty());
        let extensions = json.get("extensions");
        let has_extension = |name: &str| extensions.and_then(|e| e.get(name)).is_some();
        let moves = self.channels.move_node(node) && json.get("skin").is_none();
        has_children
            || json.get("camera").is_some()
            || PLACED_EXTENSIONS.iter().any(|name| has_extension(name))
            || moves
            || self.channels.change_node(node)
            || self.joints.contains(&node)
    }

    /// Hands the mesh of `node` and what belongs to it to a new leaf, and returns that.
    fn split(&mut self, document: &mut Document, node: usize, name: &str) -> usize {
        let place = pointer(node);
        let mut leaf = Map::new();
        leaf.insert("name".into(), self.names.level(name, 0).into());
        for member in DRAWING_MEMBERS {
            if let Some(value) = document.take(&place, member) {
                leaf.insert(member.into(), value);
            }
        }
        let skinned = leaf.contains_key("skin");
        let leaf = document.push("nodes", leaf.into());
        for extension in DRAWING_EXTENSIONS {
            if let Some(payload) = document.take_extension(&place, extension) {
                document.set_extension(&pointer(leaf), extension, payload);
            }
        }
        self.channels.hand_over_node(document, node, leaf);
        self.attach_leaf(document, node, leaf, skinned);
        leaf
    }

    /// Below `node`; but a skinned mesh whose node was a root becomes a root as well: no transform above it counts, and
    /// glTF advises against parents there.
    fn attach_leaf(&self, document: &mut Document, node: usize, leaf: usize, skinned: bool) {
        let scenes: Vec<usize> =
            if skinned && !self.is_shown_by_extension(node) { self.scenes_with_root(node) } else { Vec::new() };
        for scene in &scenes {
            document.append(&format!("/scenes/{scene}"), "nodes", leaf.into());
        }
        if scenes.is_empty() {
            document.append(&pointer(node), "children", leaf.into());
        }
    }

    /// Whether the node decides about what is below it, so that its mesh has to stay there.
    fn is_shown_by_extension(&self, node: usize) -> bool {
        let extensions = self.source.document.array("nodes").get(node).and_then(|n| n.get("extensions"));
        INHERITED_EXTENSIONS.iter().any(|name| extensions.and_then(|e| e.get(*name)).is_some())
            || self.channels.change_node(node)
    }

    fn scenes_with_root(&self, node: usize) -> Vec<usize> {
        let is_root =
            |scene: &Value| scene.get("nodes").and_then(Value::as_array).is_some_and(|n| n.contains(&node.into()));
        let scenes = self.source.document.array("scenes").iter().enumerate();
        scenes.filter(|(_, scene)| is_root(scene)).map(|(index, _)| index).collect()
    }

    /// A new node takes the place of `drawing`, which becomes its only child.
    fn put_switch_above(&mut self, document: &mut Document, drawing: usize, name: &str) -> usize {
        let name = self.names.unique(&format!("{name}_LODs"));
        let switch = document.array("nodes").len();
        let places = places_of(document, drawing);
        document.push("nodes", json!({ "name": name, "children": [drawing] }));
        for place in places {
            document.replace(&place, switch.into());
        }
        switch
    }

    /// One node of its own for each level. `node` is the source's, whose weights channels the levels follow.
    ///
    /// Below a switch node, which has no transform, a level with a transform hangs below a node without one: so each of
    /// `ids` has the carrier's own transform whichever of the two a loader takes.
    fn add_level_nodes(
        &mut self,
        document: &mut Document,
        node: usize,
        template: &Map<String, Value>,
        switched: bool,
        meshes: &[usize],
        name: &str,
    ) -> Vec<usize> {
        let wrapped = switched && TRANSFORM_MEMBERS.iter().any(|member| template.contains_key(*member));
        let mut ids = Vec::new();
        for (index, &mesh) in meshes.iter().enumerate() {
            let level_name = self.names.level(name, index + 1);
            let mesh_name = if wrapped { self.names.unique(&format!("{level_name}_mesh")) } else { level_name.clone() };
            let mut json = Map::new();
            json.insert("name".into(), mesh_name.into());
            json.insert("mesh".into(), mesh.into());
            json.extend(template.clone());
            let level = document.push("nodes", json.into());
            self.channels.repeat_for_node(document, node, level);
            ids.push(if wrapped {
                document.push("nodes", json!({ "name": level_name, "children": [level] }))
            } else {
                level
            });
        }
        ids
    }

    /// Coverage has its place in `extras`, which must be an object for that; other extras are left alone.
    fn write_coverage(&mut self, document: &mut Document, carrier: usize, levels: &NodeLevels<'_>) {
        let place = pointer(carrier);
        let mut extras = match document.root().pointer(&format!("{place}/extras")) {
            None => Map::new(),
            Some(Value::Object(extras)) => extras.clone(),
            Some(_) => {
                self.notes.push(format!(
                    "{place}: extras is not an object, so the screen coverage has no place and is left out"
                ));
                return;
            }
        };
        extras.insert("MSFT_screencoverage".into(), json!(levels.coverage));
        extras.insert("gltf_lod".into(), levels.extras.clone());
        document.set(&place, "extras", extras.into());
    }

    /// Takes the source's own levels off `carrier`; its level nodes stay in the file, used by nothing.
    pub fn remove_levels(&mut self, document: &mut Document, carrier: usize, ids: &[usize]) {
        let place = pointer(carrier);
        document.take_extension(&place, "MSFT_lod");
        let extras = format!("{place}/extras");
        document.take(&extras, "MSFT_screencoverage");
        document.take(&extras, "gltf_lod");
        if document.root().pointer(&extras).and_then(Value::as_object).is_some_and(Map::is_empty) {
            document.take(&place, "extras");
        }
        let nodes = ids.iter().map(|id| format!("/nodes/{id}")).collect::<Vec<_>>().join(", ");
        self.notes
            .push(format!("{place}: levels of the source are replaced; their nodes stay in the file unused: {nodes}"));
    }

    /// Whether `node` or one above it carries levels.
    pub fn is_below_levels(&self, node: usize) -> Option<usize> {
        // At most as many steps as there are nodes: the check has refused cycles, a lie ends here all the same.
        let above = std::iter::successors(Some(node), |&n| self.scene.parent.get(n).copied().flatten());
        above.take(self.scene.parent.len() + 1).find(|n| self.scene.existing.iter().any(|(carrier, _)| carrier == n))
    }
}

fn pointer(node: usize) -> String {
    format!("/nodes/{node}")
}

/// Where a node hangs: elements of `scenes/*/nodes` and `nodes/*/children`.
fn places_of(document: &Document, node: usize) -> Vec<String> {
    let mut places = Vec::new();
    for (array, member) in [("scenes", "nodes"), ("nodes", "children")] {
        for (index, object) in document.array(array).iter().enumerate() {
            let list = object.get(member).and_then(Value::as_array).into_iter().flatten().enumerate();
            let hanging = list.filter(|(_, element)| element.as_u64() == Some(node as u64));
            places.extend(hanging.map(|(position, _)| format!("/{array}/{index}/{member}/{position}")));
        }
    }
    places
}

/// What each LOD node repeats of the node that draws the finest level.
fn level_template(document: &Document, drawing: usize) -> Map<String, Value> {
    let mut template = Map::new();
    let Some(json) = document.array("nodes").get(drawing) else { return template };
    for member in ["skin", "weights"].into_iter().chain(TRANSFORM_MEMBERS) {
        if let Some(value) = json.get(member) {
            template.insert(member.into(), value.clone());
        }
    }
    let extensions: Map<String, Value> = DRAWING_EXTENSIONS
        .into_iter()
        .chain(INHERITED_EXTENSIONS)
        .filter_map(|name| Some((name.to_owned(), json.get("extensions")?.get(name)?.clone())))
        .collect();
    if !extensions.is_empty() {
        template.insert("extensions".into(), extensions.into());
    }
    template
}
