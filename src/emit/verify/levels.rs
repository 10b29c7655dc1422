//! The rules of MSFT_lod that loaders rely on, for the levels that the tool added.

use super::{Sides, elements, indices, level_ids, number, problem};
use crate::emit::channels::split_pointer;
use crate::error::Error;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

pub(super) fn find_broken_rules(sides: &Sides<'_>) -> Vec<Error> {
    let mut rules = Rules {
        sides,
        nodes: elements(sides.written, "nodes"),
        old_nodes: elements(sides.source, "nodes").len(),
        parent: parents(sides.written),
        level_of_mesh: BTreeMap::new(),
        carrier_of_id: BTreeMap::new(),
        driven: Driven::by(sides.written),
        problems: Vec::new(),
    };
    rules.check_carriers();
    rules.check_meshes();
    rules.check_extension_lists();
    rules.problems
}

struct Rules<'a> {
    sides: &'a Sides<'a>,
    nodes: &'a [Value],
    old_nodes: usize,
    /// Parents of nodes; scenes do not count.
    parent: BTreeMap<usize, usize>,
    /// At which level our carriers use a mesh.
    level_of_mesh: BTreeMap<usize, usize>,
    carrier_of_id: BTreeMap<usize, usize>,
    driven: Driven,
    problems: Vec<Error>,
}

impl Rules<'_> {
    fn report(&mut self, place: impl Into<String>, message: impl Into<String>) {
        self.problems.push(problem(place, message));
    }

    fn check_carriers(&mut self) {
        let scene_roots: BTreeSet<usize> =
            elements(self.sides.written, "scenes").iter().flat_map(|scene| indices(scene, "nodes")).collect();
        for carrier in 0..self.nodes.len() {
            let Some(ids) = level_ids(&self.nodes[carrier]) else { continue };
            if !ids.iter().any(|&id| id >= self.old_nodes) {
                continue;
            }
            let place = format!("/nodes/{carrier}");
            let outer = self.above(carrier).find(|&n| level_ids(&self.nodes[n]).is_some());
            if let Some(above) = outer {
                self.report(&place, format!("levels below the levels of /nodes/{above}"));
            }
            for &id in &ids {
                if id < self.old_nodes || id >= self.nodes.len() {
                    self.report(&place, format!("level node {id} is not a new one"));
                } else if scene_roots.contains(&id) || self.parent.contains_key(&id) {
                    self.report(&place, format!("level node {id} hangs in a scene or below a node"));
                } else if let Some(other) = self.carrier_of_id.insert(id, carrier) {
                    self.report(&place, format!("level node {id} belongs to /nodes/{other} as well"));
                }
            }
            self.check_coverage(carrier, ids.len());
            self.check_chain(carrier, &ids);
        }
    }

    fn above(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(self.parent.get(&node).copied(), |n| self.parent.get(n).copied()).take(self.nodes.len())
    }

    fn check_coverage(&mut self, carrier: usize, levels: usize) {
        let extras = self.nodes[carrier].get("extras");
        if extras.is_some_and(|extras| !extras.is_object()) {
            return;
        }
        let coverage: Option<Vec<f64>> = extras
            .and_then(|extras| extras.get("MSFT_screencoverage")?.as_array())
            .map(|list| list.iter().filter_map(Value::as_f64).collect());
        let good = |c: &Vec<f64>| {
            c.len() == levels + 1 && c.iter().all(|x| (0.0..=1.0).contains(x)) && c.windows(2).all(|w| w[0] > w[1])
        };
        if !coverage.as_ref().is_some_and(good) {
            let place = format!("/nodes/{carrier}/extras/MSFT_screencoverage");
            self.report(place, format!("{coverage:?} is not {} numbers that fall from 1 to 0", levels + 1));
        }
    }

    /// The node that draws on behalf of a carrier or of one of its ids: itself, or the only node below it.
    fn drawing(&self, node: usize) -> Option<usize> {
        let json = self.nodes.get(node)?;
        match (number(json, "mesh"), indices(json, "children").as_slice()) {
            (Some(_), []) => Some(node),
            (None, [child]) => {
                let below = self.nodes.get(*child)?;
                (number(below, "mesh").is_some() && indices(below, "children").is_empty()).then_some(*child)
            }
            _ => None,
        }
    }

    fn check_chain(&mut self, carrier: usize, ids: &[usize]) {
        let place = format!("/nodes/{carrier}");
        let mut triangles_above = usize::MAX;
        let Some(finest) = self.drawing(carrier) else {
            return self.report(place, "a node with levels has children of its own, or no mesh");
        };
        for (level, &node) in std::iter::once(&carrier).chain(ids).enumerate() {
            let Some(drawing) = self.drawing(node) else {
                self.report(&place, format!("level {level} draws no mesh"));
                continue;
            };
            if level > 0 && level_ids(&self.nodes[node]).is_some() {
                self.report(&place, format!("level {level} has levels of its own"));
            }
            if transform(&self.nodes[node]) != transform(&self.nodes[carrier]) || !self.draws_alike(finest, drawing) {
                self.report(
                    &place,
                    format!("level {level} differs from the node in transform, skin, weights or instances"),
                );
            }
            self.check_weights_channels(finest, drawing);
            let Some(mesh) = number(&self.nodes[drawing], "mesh") else { continue };
            if *self.level_of_mesh.entry(mesh).or_insert(level) != level {
                self.report(&place, format!("mesh {mesh} stands at two levels"));
            }
            let triangles = triangle_count(self.sides.written, mesh);
            if triangles == 0 || triangles >= triangles_above {
                self.report(&place, format!("level {level} has {triangles} triangles"));
            }
            triangles_above = triangles;
            self.check_against_finest(number(&self.nodes[finest], "mesh"), mesh);
        }
        self.check_carrier_is_still(carrier);
    }

    fn draws_alike(&self, finest: usize, drawing: usize) -> bool {
        let (a, b) = (&self.nodes[finest], &self.nodes[drawing]);
        let instances = |node: &Value| node.pointer("/extensions/EXT_mesh_gpu_instancing").cloned();
        transform(a) == transform(b)
            && a.get("skin") == b.get("skin")
            && a.get("weights") == b.get("weights")
            && instances(a) == instances(b)
    }

    /// A carrier is moved by nothing, except where it is skinned.
    fn check_carrier_is_still(&mut self, carrier: usize) {
        let moved = self.driven.moved.contains(&carrier);
        if moved && self.nodes[carrier].get("skin").is_none() {
            self.report(format!("/nodes/{carrier}"), "an animation moves a node with levels");
        }
    }

    /// What drives the weights of the finest level drives those of `drawing`, by the same samplers.
    fn check_weights_channels(&mut self, finest: usize, drawing: usize) {
        if self.driven.weights.get(&finest) != self.driven.weights.get(&drawing) {
            self.report(format!("/nodes/{drawing}"), "its morph weights do not follow those of the finest level");
        }
    }

    fn check_against_finest(&mut self, finest: Option<usize>, mesh: usize) {
        let meshes = elements(self.sides.written, "meshes");
        let (Some(source), Some(level)) = (finest.and_then(|m| meshes.get(m)), meshes.get(mesh)) else { return };
        let place = format!("/meshes/{mesh}");
        if source.get("weights") != level.get("weights") || source.get("extras") != level.get("extras") {
            self.report(&place, "weights or extras are not those of the finest level");
        }
        let kinds: Vec<_> = elements(source, "primitives").iter().map(kind).collect();
        for (index, primitive) in elements(level, "primitives").iter().enumerate() {
            if !kinds.contains(&kind(primitive)) {
                let message = "material, attributes and morph targets are those of no primitive of the finest level";
                self.report(format!("{place}/primitives/{index}"), message);
            }
        }
    }

    /// New accessors lie in their buffers; indices name vertices.
    fn check_meshes(&mut self) {
        let old = elements(self.sides.source, "accessors").len();
        for index in old..elements(self.sides.written, "accessors").len() {
            if accessor_bytes(self.sides, index).is_none_or(<[u8]>::is_empty) {
                self.report(format!("/accessors/{index}"), "is empty or leaves its buffer");
            }
        }
        let old_meshes = elements(self.sides.source, "meshes").len();
        for (mesh, json) in elements(self.sides.written, "meshes").iter().enumerate().skip(old_meshes) {
            for (p, primitive) in elements(json, "primitives").iter().enumerate() {
                let is_new = number(primitive, "indices").is_some_and(|accessor| accessor >= old);
                if is_new && !self.has_good_indices(primitive) {
                    self.report(
                        format!("/meshes/{mesh}/primitives/{p}"),
                        "attributes differ in count, lack bounds, or an index is out of range",
                    );
                }
            }
        }
    }

    fn has_good_indices(&self, primitive: &Value) -> bool {
        let accessors = elements(self.sides.written, "accessors");
        let attributes = primitive.get("attributes").into_iter().chain(elements(primitive, "targets"));
        let attributes = attributes.filter_map(Value::as_object).flatten();
        let mut counts = BTreeSet::new();
        for (name, accessor) in attributes {
            let Some(json) = accessor.as_u64().and_then(|a| accessors.get(a as usize)) else { return false };
            counts.insert(number(json, "count"));
            let bounds = |member| elements(json, member).iter().filter(|x| x.is_number()).count() == 3;
            // What the source has, it may have without bounds.
            let is_new = accessor.as_u64() >= Some(elements(self.sides.source, "accessors").len() as u64);
            if is_new && name == "POSITION" && !(bounds("min") && bounds("max")) {
                return false;
            }
        }
        let [Some(count)] = counts.into_iter().collect::<Vec<_>>()[..] else { return false };
        let Some(accessor) = number(primitive, "indices") else { return false };
        let Some(bytes) = accessor_bytes(self.sides, accessor) else { return false };
        let wide = accessors.get(accessor).and_then(|a| number(a, "componentType"))
            == Some(gltf_json::accessor::UNSIGNED_INT as usize);
        let restart = if wide { u64::from(u32::MAX) } else { u64::from(u16::MAX) };
        let size = if wide { 4 } else { 2 };
        let index = |chunk: &[u8]| chunk.iter().rev().fold(0u64, |sum, &byte| sum << 8 | u64::from(byte));
        bytes.len() % (3 * size) == 0
            && bytes.chunks(size).map(index).all(|index| index < count as u64 && index != restart)
    }

    fn check_extension_lists(&mut self) {
        let names = |member: &str| elements(self.sides.written, member).iter().any(|name| name == "MSFT_lod");
        let (used, required) = (names("extensionsUsed"), names("extensionsRequired"));
        if !self.carrier_of_id.is_empty() && !used {
            self.report("/extensionsUsed", "does not name MSFT_lod");
        }
        let was_required = elements(self.sides.source, "extensionsRequired").iter().any(|name| name == "MSFT_lod");
        if required && !was_required {
            self.report(
                "/extensionsRequired",
                "names MSFT_lod, which keeps other viewers from showing the finest level",
            );
        }
    }
}

fn parents(root: &Value) -> BTreeMap<usize, usize> {
    let nodes = elements(root, "nodes").iter().enumerate();
    nodes.flat_map(|(node, json)| indices(json, "children").into_iter().map(move |child| (child, node))).collect()
}

fn transform(node: &Value) -> [Option<&Value>; 4] {
    ["matrix", "translation", "rotation", "scale"].map(|member| node.get(member))
}

/// What a level primitive shares with the primitive it comes from: material, attribute names, morph targets.
fn kind(primitive: &Value) -> (Option<&Value>, BTreeSet<&String>, usize) {
    let attributes = primitive.get("attributes").and_then(Value::as_object);
    (
        primitive.get("material"),
        attributes.into_iter().flat_map(|a| a.keys()).collect(),
        elements(primitive, "targets").len(),
    )
}

fn triangle_count(root: &Value, mesh: usize) -> usize {
    let count = |accessor: Option<usize>| number(elements(root, "accessors").get(accessor?)?, "count");
    let triangles = |primitive: &Value| {
        let position = || primitive.pointer("/attributes/POSITION").and_then(Value::as_u64).map(|a| a as usize);
        let corners = count(number(primitive, "indices").or_else(position)).unwrap_or(0);
        match number(primitive, "mode").unwrap_or(4) {
            4 => corners / 3,
            5 | 6 => corners.saturating_sub(2),
            _ => 0,
        }
    };
    elements(root, "meshes").get(mesh).map_or(0, |m| elements(m, "primitives").iter().map(triangles).sum())
}

/// The bytes from the first to behind the last element.
fn accessor_bytes<'a>(sides: &'a Sides<'_>, index: usize) -> Option<&'a [u8]> {
    let accessor = elements(sides.written, "accessors").get(index)?;
    let view = elements(sides.written, "bufferViews").get(number(accessor, "bufferView")?)?;
    let component = crate::asset::Component::from_code(number(accessor, "componentType")? as u64)?;
    let shape = match accessor.get("type")?.as_str()? {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" => 4,
        // Matrices of small components are padded inside; their last element ends before this.
        "MAT2" => 4,
        "MAT3" => 9,
        _ => 16,
    };
    let element = shape * component.size();
    let stride = number(view, "byteStride").unwrap_or(element);
    let length = stride.checked_mul(number(accessor, "count")?.checked_sub(1)?)?.checked_add(element)?;
    let start = number(accessor, "byteOffset").unwrap_or(0);
    let end = start.checked_add(length).filter(|&end| Some(end) <= number(view, "byteLength"))?;
    let offset = number(view, "byteOffset").unwrap_or(0);
    let buffer = sides.written_buffers.get(number(view, "buffer")?)?.as_deref()?;
    buffer.get(offset.checked_add(start)?..offset.checked_add(end)?)
}

/// What the channels of a document do to nodes.
#[derive(Default)]
struct Driven {
    /// Nodes whose transform is animated.
    moved: BTreeSet<usize>,
    /// For each node whose morph weights are animated: animation and sampler of each channel.
    weights: BTreeMap<usize, BTreeSet<(usize, Option<usize>)>>,
}

impl Driven {
    fn by(root: &Value) -> Self {
        let mut driven = Self::default();
        for (animation, json) in elements(root, "animations").iter().enumerate() {
            for channel in elements(json, "channels") {
                let Some((node, what)) = channel.get("target").and_then(driven_node) else { continue };
                if what.split('/').next() == Some("weights") {
                    driven.weights.entry(node).or_default().insert((animation, number(channel, "sampler")));
                } else if ["translation", "rotation", "scale"].contains(&what) {
                    driven.moved.insert(node);
                }
            }
        }
        driven
    }
}

/// The node that a channel's target names, and what of it.
fn driven_node(target: &Value) -> Option<(usize, &str)> {
    match target.get("path")?.as_str()? {
        "pointer" => {
            let pointer = target.pointer("/extensions/KHR_animation_pointer/pointer")?.as_str()?;
            split_pointer(pointer).filter(|(array, ..)| *array == "nodes").map(|(_, node, what)| (node, what))
        }
        path => Some((number(target, "node")?, path)),
    }
}
