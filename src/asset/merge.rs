//! Primitives with different attributes merged into one [`Mesh`] with all of them.

use super::accessor::Reader;
use super::geometry::{AttributeLayout, Channel, Geometry, PassedOver, PrimitiveLayout};
use super::primitive::{Assembler, Faces, Mode};
use super::{Component, Limits};
use crate::error::{Error, Kind, Result};
use crate::mesh::{Attribute, Mesh, Semantic, Skin};
use std::collections::BTreeMap;

/// A decodable triangle primitive before its numbers are read.
pub(super) struct Part<'a> {
    pub primitive: usize,
    pub place: String,
    pub mode: Mode,
    pub indices: Option<Reader<'a>>,
    /// Elements of each of its attributes.
    pub count: usize,
    pub attributes: Vec<Source<'a>>,
    pub targets: Vec<Vec<Source<'a>>>,
}

/// An attribute's name and where its numbers come from.
pub(super) struct Source<'a> {
    pub name: String,
    pub place: String,
    pub reader: Reader<'a>,
}

/// The skin that binds the fewest joints among those the mesh is drawn with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Joints {
    pub skin: usize,
    pub count: usize,
}

impl Part<'_> {
    pub fn corners(&self) -> usize {
        self.indices.as_ref().map_or(self.count, |indices| indices.header.count)
    }

    /// Base attributes and morph targets, each with the number of its target.
    fn sources(&self) -> impl Iterator<Item = (Option<usize>, &Source<'_>)> {
        let base = self.attributes.iter().map(|source| (None, source));
        let targets = self.targets.iter().enumerate();
        base.chain(targets.flat_map(|(t, sources)| sources.iter().map(move |source| (Some(t), source))))
    }
}

/// Whether a base attribute is a set of joints or weights, and which.
fn skin_set(target: Option<usize>, name: &str, kind: &str) -> Option<u32> {
    if target.is_some() { None } else { name.strip_prefix(kind)?.parse().ok() }
}

/// Name and morph target: what makes attributes of several primitives the same.
type Key = (Option<usize>, String);

/// Where everything goes in the merged mesh.
#[derive(Debug, Default)]
struct Plan {
    columns: BTreeMap<Key, usize>,
    attributes: Vec<Attribute>,
    /// Position of each glTF joint set among those that the mesh has.
    sets: BTreeMap<u32, usize>,
}

impl Plan {
    fn of(parts: &[Part]) -> Self {
        let mut plan = Self::default();
        for (target, source) in parts.iter().flat_map(Part::sources) {
            if let Some(set) = skin_set(target, &source.name, "JOINTS_") {
                plan.sets.insert(set, 0);
            } else if skin_set(target, &source.name, "WEIGHTS_").is_none() && !is_position(target, source) {
                plan.add(target, source);
            }
        }
        (0..).zip(plan.sets.values_mut()).for_each(|(position, slot)| *slot = position);
        plan
    }

    fn add(&mut self, target: Option<usize>, source: &Source) {
        let semantic = find_semantic(target, source);
        let width = source.reader.header.shape.width();
        let next = self.attributes.len();
        let column = *self.columns.entry((target, source.name.clone())).or_insert(next);
        match self.attributes.get_mut(column) {
            None => self.attributes.push(Attribute { semantic, width, values: Vec::new() }),
            Some(attribute) => {
                attribute.width = attribute.width.max(width);
                // Identifiers in one primitive forbid interpolation in all.
                attribute.semantic = attribute.semantic.max(semantic);
            }
        }
    }

    fn channel(&self, target: Option<usize>, source: &Source) -> Option<Channel> {
        if is_position(target, source) {
            return Some(Channel::Position);
        }
        let set = |kind| skin_set(target, &source.name, kind).map(|set| self.sets.get(&set).copied());
        match (set("JOINTS_"), set("WEIGHTS_")) {
            (Some(slot), _) => slot.map(Channel::Joints),
            (_, Some(slot)) => slot.map(Channel::Weights),
            _ => self.columns.get(&(target, source.name.clone())).map(|&column| Channel::Attribute(column)),
        }
    }

    fn layout(&self, target: Option<usize>, source: &Source) -> Option<AttributeLayout> {
        let header = &source.reader.header;
        Some(AttributeLayout {
            name: source.name.clone(),
            component: header.component,
            normalized: header.normalized,
            shape: header.shape,
            channel: self.channel(target, source)?,
        })
    }

    /// Bytes of a vertex in the merged mesh.
    fn vertex_bytes(&self) -> u64 {
        let numbers = 3 + self.attributes.iter().map(|a| a.width).sum::<usize>();
        let influences = 4 * self.sets.len();
        (4 * numbers + 6 * influences) as u64
    }
}

fn is_position(target: Option<usize>, source: &Source) -> bool {
    target.is_none() && source.name == "POSITION"
}

fn find_semantic(target: Option<usize>, source: &Source) -> Semantic {
    let name = source.name.as_str();
    if let Some(target) = target.map(|t| u32::try_from(t).unwrap_or(u32::MAX)) {
        return if name == "POSITION" { Semantic::MorphPosition(target) } else { Semantic::MorphOther(target) };
    }
    let set = |prefix| name.strip_prefix(prefix).and_then(|set| set.parse().ok());
    let header = &source.reader.header;
    match name {
        "NORMAL" => Semantic::Normal,
        "TANGENT" => Semantic::Tangent,
        _ => match (set("TEXCOORD_"), set("COLOR_"), set("_FEATURE_ID_")) {
            (Some(set), _, _) => Semantic::TexCoord(set),
            (_, Some(set), _) => Semantic::Color(set),
            (_, _, Some(_)) => Semantic::Id,
            _ if header.component == Component::F32 || header.normalized => Semantic::Generic,
            _ => Semantic::Id,
        },
    }
}

/// The mesh under construction.
struct Merger<'a> {
    plan: Plan,
    vertex_bytes: u64,
    limits: &'a Limits,
    joints: Option<Joints>,
    /// Whether weights are put right.
    balance: bool,
    assembler: Assembler,
    geometry: Geometry,
}

/// Merges `parts` in order; `balance` puts their weights right.
pub(super) fn merge(
    parts: &[Part],
    passed_over: Vec<PassedOver>,
    joints: Option<Joints>,
    balance: bool,
    limits: &Limits,
) -> Result<Geometry> {
    let mut plan = Plan::of(parts);
    let vertex_bytes = plan.vertex_bytes();
    let influences = 4 * plan.sets.len();
    let skin = (influences > 0).then(|| Skin { influences, ..Skin::default() });
    let mesh = Mesh { attributes: std::mem::take(&mut plan.attributes), skin, ..Mesh::default() };
    let geometry = Geometry { mesh, primitives: Vec::new(), passed_over, warnings: Vec::new() };
    let mut merger = Merger { plan, vertex_bytes, limits, joints, balance, assembler: Assembler::default(), geometry };
    for part in parts {
        merger.append(part)?;
    }
    Ok(merger.geometry)
}

impl Merger<'_> {
    fn append(&mut self, part: &Part) -> Result<()> {
        self.check_size(part, part.mode.triangles(part.corners()), 0)?;
        let faces = self.assembler.read(part.mode, part.indices.as_ref(), part.count, &part.place)?;
        self.check_size(part, faces.triangles.len(), faces.vertices)?;
        if faces.left_over > 0 {
            let message = format!("{} indices at the end make no triangle and are left out", faces.left_over);
            self.warn(&part.place, message);
        }
        let first = self.geometry.mesh.positions.len();
        for (target, source) in part.sources() {
            match self.plan.channel(target, source) {
                Some(Channel::Position) => self.append_positions(part, source, &faces)?,
                Some(Channel::Attribute(column)) => self.append_column(column, source, &faces)?,
                _ => {}
            }
        }
        let mesh = &mut self.geometry.mesh;
        // A primitive without an attribute that another has.
        for attribute in &mut mesh.attributes {
            attribute.values.resize((first + faces.vertices) * attribute.width, 0.0);
        }
        self.append_skin(part, first, &faces)?;

        let mesh = &mut self.geometry.mesh;
        let group = self.geometry.primitives.len() as u32;
        let first = first as u32;
        if mesh.triangles.is_empty() && first == 0 {
            mesh.triangles = faces.triangles;
        } else {
            mesh.triangles.extend(faces.triangles.iter().map(|t| t.map(|corner| first + corner)));
        }
        mesh.groups.resize(mesh.triangles.len(), group);
        let layouts = |target, sources: &[Source]| sources.iter().filter_map(|s| self.plan.layout(target, s)).collect();
        self.geometry.primitives.push(PrimitiveLayout {
            primitive: part.primitive,
            vertices: first..mesh.positions.len() as u32,
            elements: faces.used,
            attributes: layouts(None, &part.attributes),
            targets: part.targets.iter().enumerate().map(|(t, sources)| layouts(Some(t), sources)).collect(),
        });
        Ok(())
    }

    /// Many primitives may share few bytes, so that the merged mesh has to be bounded, not only the file.
    fn check_size(&self, part: &Part, triangles: usize, vertices: usize) -> Result<()> {
        let triangles = self.geometry.mesh.triangles.len().saturating_add(triangles);
        let vertices = self.geometry.mesh.positions.len().saturating_add(vertices);
        let most = self.limits.vertices.min(u32::MAX as usize - 1);
        let bytes = (vertices as u64).saturating_mul(self.vertex_bytes).saturating_add(16 * triangles as u64);
        let message = if triangles > most || vertices > most {
            format!("the mesh up to here has {triangles} triangles and {vertices} vertices; the limit is {most} each")
        } else if bytes > self.limits.mesh_bytes {
            format!("the mesh up to here needs {bytes} bytes; the limit is {}", self.limits.mesh_bytes)
        } else {
            return Ok(());
        };
        Err(Error { kind: Kind::Limit, ..Error::malformed(&part.place, message) })
    }

    fn append_positions(&mut self, part: &Part, source: &Source, faces: &Faces) -> Result<()> {
        let mut numbers = Vec::with_capacity(3 * faces.vertices);
        source.reader.read_floats(faces.select(), &mut numbers)?;
        let positions = numbers.as_chunks::<3>().0;
        if let Some(vertex) = positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            let position = positions.get(vertex).copied().unwrap_or_default();
            let element = faces.element(vertex);
            let message = format!("the position of vertex {element} of {} is {position:?}, not finite", part.count);
            return Err(Error::malformed(&source.place, message));
        }
        self.geometry.mesh.positions.extend_from_slice(positions);
        Ok(())
    }

    fn append_column(&mut self, column: usize, source: &Source, faces: &Faces) -> Result<()> {
        let Some(attribute) = self.geometry.mesh.attributes.get_mut(column) else { return Ok(()) };
        let (start, width) = (attribute.values.len(), source.reader.header.shape.width());
        if width == attribute.width {
            source.reader.read_floats(faces.select(), &mut attribute.values)?;
        } else {
            let mut narrow = Vec::new();
            source.reader.read_floats(faces.select(), &mut narrow)?;
            // A colour without alpha is opaque.
            let filler = if matches!(attribute.semantic, Semantic::Color(_)) { 1.0 } else { 0.0 };
            for element in narrow.chunks_exact(width) {
                attribute.values.extend_from_slice(element);
                attribute.values.extend((width..attribute.width).map(|_| filler));
            }
        }
        let semantic = attribute.semantic;
        let new = attribute.values.get_mut(start..).unwrap_or_default();
        if semantic == Semantic::Id {
            check_ids(new, source)?;
        }
        let lost = clear_non_finite(new);
        let vanished = match semantic {
            Semantic::Normal => new.as_chunks::<3>().0.iter().filter(|n| **n == [0.0; 3]).count(),
            _ => 0,
        };
        if lost > 0 {
            self.warn(&source.place, format!("{lost} numbers are not finite; taken as 0"));
        } else if vanished > 0 {
            self.warn(&source.place, format!("{vanished} of {} normals have no length", faces.vertices));
        }
        Ok(())
    }

    /// Weights are made to sum to 1 over all sets; a vertex that nothing moves follows its first joint, as in viewers.
    fn append_skin(&mut self, part: &Part, first: usize, faces: &Faces) -> Result<()> {
        let Some(skin) = &mut self.geometry.mesh.skin else { return Ok(()) };
        let width = skin.influences;
        skin.joints.resize((first + faces.vertices) * width, 0);
        skin.weights.resize((first + faces.vertices) * width, 0.0);
        let joints = skin.joints.get_mut(first * width..).unwrap_or_default();
        let weights = skin.weights.get_mut(first * width..).unwrap_or_default();
        let mut place = None;
        for source in &part.attributes {
            match self.plan.channel(None, source) {
                Some(Channel::Joints(slot)) => {
                    let mut numbers = Vec::new();
                    source.reader.read_unsigned(faces.select(), &mut numbers)?;
                    let elements = numbers.as_chunks::<4>().0;
                    scatter(joints, width, slot, elements, |joint| u16::try_from(joint).unwrap_or(u16::MAX));
                    place = Some(&source.place);
                }
                Some(Channel::Weights(slot)) => {
                    let mut numbers = Vec::new();
                    source.reader.read_floats(faces.select(), &mut numbers)?;
                    let clean = |weight: f32| if weight.is_finite() { weight.max(0.0) } else { 0.0 };
                    scatter(weights, width, slot, numbers.as_chunks::<4>().0, clean);
                }
                _ => {}
            }
        }
        let Some(place) = place else { return Ok(()) };
        let mut unmoved = 0;
        for (vertex, (joints, weights)) in
            joints.chunks_exact_mut(width).zip(weights.chunks_exact_mut(width)).enumerate()
        {
            unmoved += usize::from(self.balance && !balance(joints, weights));
            let largest = joints.iter().copied().max().map_or(0, usize::from);
            if let Some(bound) = self.joints.filter(|bound| largest >= bound.count) {
                let vertex = faces.element(vertex);
                let message =
                    format!("vertex {vertex} follows joint {largest}, but skins[{}] has {}", bound.skin, bound.count);
                return Err(Error::malformed(place, message));
            }
        }
        if unmoved > 0 {
            self.warn(place, format!("{unmoved} vertices have no weight; they follow their first joint"));
        }
        Ok(())
    }

    fn warn(&mut self, place: &str, message: String) {
        self.geometry.warnings.push(Error::malformed(place, message));
    }
}

/// Writes the elements of one set into rows of all sets.
fn scatter<T: Copy, U>(rows: &mut [U], width: usize, slot: usize, elements: &[[T; 4]], convert: impl Fn(T) -> U) {
    for (row, element) in rows.chunks_exact_mut(width).zip(elements) {
        for (to, &from) in row.iter_mut().skip(4 * slot).zip(element) {
            *to = convert(from);
        }
    }
}

/// Makes one vertex's weights sum to 1 and its weightless joints 0; false if it had no weight at all.
fn balance(joints: &mut [u16], weights: &mut [f32]) -> bool {
    let sum: f32 = weights.iter().sum();
    let weighted = sum > 0.0 && sum.is_finite();
    if weighted {
        // Sums that are 1 but for rounding are left as the file has them.
        if (sum - 1.0).abs() > 1e-6 {
            weights.iter_mut().for_each(|weight| *weight /= sum);
        }
    } else {
        weights.fill(0.0);
        weights.iter_mut().take(1).for_each(|weight| *weight = 1.0);
    }
    joints.iter_mut().zip(weights).filter(|(_, weight)| **weight == 0.0).for_each(|(joint, _)| *joint = 0);
    weighted
}

/// Takes numbers that are none as 0 and tells how many there were.
fn clear_non_finite(numbers: &mut [f32]) -> usize {
    let mut lost = 0;
    for number in numbers.iter_mut().filter(|number| !number.is_finite()) {
        *number = 0.0;
        lost += 1;
    }
    lost
}

/// Identifiers are kept as `f32`, which has all whole numbers up to 2²⁴.
fn check_ids(ids: &[f32], source: &Source) -> Result<()> {
    const LARGEST: f32 = 16_777_216.0;
    if source.reader.header.component != Component::U32 || ids.iter().all(|id| *id < LARGEST) {
        return Ok(());
    }
    Err(Error::unsupported(&source.place, "identifiers of 2^24 and more cannot be carried to levels")
        .help("store them as UNSIGNED_SHORT or UNSIGNED_BYTE; glTF allows no other integers here"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::{Asset, Container, Document};
    use serde_json::{Value, json};

    /// An asset with one mesh; each accessor gets a view of its own over the bytes that it comes with.
    fn asset(accessors: &[(u32, &str, bool, usize, Vec<u8>)], more: Value) -> Asset {
        let (mut bytes, mut views, mut objects) = (Vec::new(), Vec::new(), Vec::new());
        for (i, (component, shape, normalized, count, data)) in accessors.iter().enumerate() {
            views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": data.len()}));
            objects.push(json!({"bufferView": i, "componentType": component, "type": shape, "normalized": normalized,
                "count": count}));
            bytes.extend_from_slice(data);
        }
        let mut root = json!({"asset": {"version": "2.0"}, "accessors": objects, "bufferViews": views,
            "buffers": [{"byteLength": bytes.len()}]});
        root.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        Asset {
            path: "test.gltf".into(),
            container: Container::Gltf,
            document: Document::new(root),
            buffers: vec![Some(bytes)],
            resources: Vec::new(),
            warnings: Vec::new(),
        }
    }

    fn floats(numbers: &[f32]) -> Vec<u8> {
        numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
    }

    fn line(count: usize) -> (u32, &'static str, bool, usize, Vec<u8>) {
        let positions: Vec<_> = (0..count).flat_map(|i| [i as f32, 0.0, 0.0]).collect();
        (5126, "VEC3", false, count, floats(&positions))
    }

    fn read(accessors: &[(u32, &str, bool, usize, Vec<u8>)], primitives: Value) -> Result<Geometry> {
        asset(accessors, json!({"meshes": [{"primitives": primitives}]})).geometry(0, &Limits::default())
    }

    #[test]
    fn primitives_over_shared_vertices_each_get_the_ones_they_use() {
        let accessors = [line(6), (5121, "SCALAR", false, 3, vec![5, 1, 3]), (5121, "SCALAR", false, 3, vec![3, 1, 0])];
        let geometry = read(
            &accessors,
            json!([{"attributes": {"POSITION": 0}, "indices": 1}, {"attributes": {"POSITION": 0}, "indices": 2}]),
        )
        .unwrap();
        let x: Vec<_> = geometry.mesh.positions.iter().map(|p| p[0]).collect();
        assert_eq!(x, [1.0, 3.0, 5.0, 0.0, 1.0, 3.0]);
        assert_eq!(geometry.mesh.triangles, [[2, 0, 1], [5, 4, 3]]);
        assert_eq!(geometry.mesh.groups, [0, 1]);
        assert_eq!(geometry.primitives[1].vertices, 3..6);
    }

    #[test]
    fn attributes_are_united_over_primitives_and_colours_widened() {
        let accessors = [
            line(3),
            (5121, "VEC3", true, 3, vec![255, 0, 0, 0, 255, 0, 0, 0, 255]),
            (5121, "VEC4", true, 3, vec![0; 12]),
            (5126, "SCALAR", false, 3, floats(&[1.0, f32::NAN, 3.0])),
            (5123, "SCALAR", false, 3, vec![7, 0, 8, 0, 9, 0]),
        ];
        let geometry = read(
            &accessors,
            json!([
                {"attributes": {"COLOR_0": 1, "POSITION": 0, "_HEAT": 3}},
                {"attributes": {"POSITION": 0, "COLOR_0": 2, "_FEATURE_ID_0": 4, "_PART": 4}},
            ]),
        )
        .unwrap();
        let attributes = &geometry.mesh.attributes;
        let semantics: Vec<_> = attributes.iter().map(|a| (a.semantic, a.width)).collect();
        let expected = [(Semantic::Color(0), 4), (Semantic::Generic, 1), (Semantic::Id, 1), (Semantic::Id, 1)];
        assert_eq!(semantics, expected);
        assert_eq!(attributes[0].values[..8], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0]);
        assert_eq!(attributes[1].values, [1.0, 0.0, 3.0, 0.0, 0.0, 0.0]);
        assert_eq!(attributes[2].values, [0.0, 0.0, 0.0, 7.0, 8.0, 9.0]);
        let channels: Vec<_> = geometry.primitives[0].attributes.iter().map(|a| (&*a.name, a.channel)).collect();
        let expected =
            [("COLOR_0", Channel::Attribute(0)), ("POSITION", Channel::Position), ("_HEAT", Channel::Attribute(1))];
        assert_eq!(channels, expected);
        let warning = geometry.warnings[0].to_string();
        assert!(warning.contains("/meshes/0/primitives/0/attributes/_HEAT: 1 numbers are not finite"), "{warning}");
    }

    #[test]
    fn weights_sum_to_one_over_all_sets() {
        let weights = floats(&[0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
        let accessors = [
            line(3),
            (5121, "VEC4", false, 3, vec![1, 9, 9, 9, 2, 9, 9, 9, 3, 4, 9, 9]),
            (5126, "VEC4", false, 3, weights.clone()),
            (5121, "VEC4", false, 3, vec![5; 12]),
        ];
        let primitives =
            json!([{"attributes": {"JOINTS_0": 1, "JOINTS_2": 3, "WEIGHTS_0": 2, "WEIGHTS_2": 2, "POSITION": 0}}]);
        let geometry = read(&accessors, primitives.clone()).unwrap();
        let skin = geometry.mesh.skin.unwrap();
        assert_eq!(skin.influences, 8);
        assert_eq!(skin.joints[..8], [1, 0, 0, 0, 5, 0, 0, 0]);
        assert_eq!(skin.weights[..8], [0.5, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0]);
        assert_eq!((skin.joints[8], skin.weights[8]), (2, 1.0), "without weights: the first joint");
        assert_eq!(skin.weights[16..], [0.25, 0.25, 0.0, 0.0, 0.25, 0.25, 0.0, 0.0]);
        assert_eq!(geometry.primitives[0].attributes[3].channel, Channel::Weights(1));
        assert!(geometry.warnings[0].to_string().contains("1 vertices have no weight"));

        let scene = json!({"meshes": [{"primitives": primitives}], "nodes": [{"mesh": 0, "skin": 0}],
            "skins": [{"joints": [0, 0, 0, 0]}]});
        let message = asset(&accessors, scene).geometry(0, &Limits::default()).unwrap_err().to_string();
        assert!(message.ends_with("vertex 0 follows joint 5, but skins[0] has 4"), "{message}");
    }

    #[test]
    fn morph_targets_become_attributes_also_where_a_primitive_leaves_one_out() {
        let accessors = [line(3), (5126, "VEC3", false, 3, floats(&[2.0; 9]))];
        let primitives = json!([
            {"attributes": {"POSITION": 0}, "targets": [{"POSITION": 1}, {"NORMAL": 1}]},
            {"attributes": {"POSITION": 0}, "targets": [{}, {"POSITION": 1}]},
        ]);
        let geometry = read(&accessors, primitives).unwrap();
        let semantics: Vec<_> = geometry.mesh.attributes.iter().map(|a| a.semantic).collect();
        assert_eq!(semantics, [Semantic::MorphPosition(0), Semantic::MorphOther(1), Semantic::MorphPosition(1)]);
        assert_eq!(geometry.mesh.attributes[0].values[9..], [0.0; 9]);
        assert_eq!(geometry.mesh.attributes[2].values[9..], [2.0; 9]);
        assert_eq!(geometry.primitives[1].targets[0], []);
        assert_eq!(geometry.primitives[1].targets[1][0].channel, Channel::Attribute(2));
    }

    #[test]
    fn what_is_no_decodable_triangle_is_passed_over() {
        let geometry = read(
            &[line(5), (5126, "SCALAR", false, 5, floats(&[0.0; 5]))],
            json!([
                {"attributes": {"POSITION": 0}, "mode": 0},
                {"attributes": {"POSITION": 0}, "mode": 2},
                {"attributes": {"_X": 1}},
                {"attributes": {"POSITION": 0}},
            ]),
        )
        .unwrap();
        let why: Vec<_> = geometry.passed_over.iter().map(|p| (p.primitive, &*p.why, p.carried)).collect();
        assert_eq!(why, [(0, "points", true), (1, "lines", true), (2, "without positions", true)]);
        assert_eq!(geometry.primitives[0].primitive, 3);
        assert_eq!(geometry.mesh.triangles, [[0, 1, 2]]);
        assert!(geometry.warnings[0].to_string().contains("2 indices at the end make no triangle"));
    }

    #[test]
    fn compressed_primitives_are_passed_over_unless_plain_data_stands_beside() {
        let passed_over = |edit: &dyn Fn(&mut Value)| {
            let draco = json!({"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {}}});
            let primitive = json!({"attributes": {"POSITION": 0}, "extensions": draco});
            let mut asset = asset(&[line(3)], json!({"meshes": [{"primitives": [primitive]}]}));
            let mut root = asset.document.root().clone();
            edit(&mut root);
            asset.document = Document::new(root);
            asset.buffers.push(None);
            let geometry = asset.geometry(0, &Limits::default()).unwrap();
            geometry.passed_over.first().map(|p| (p.why.clone(), p.carried))
        };
        assert_eq!(passed_over(&|_| {}), None);
        let bare = |root: &mut Value| drop(root["accessors"][0].as_object_mut().unwrap().remove("bufferView"));
        assert_eq!(passed_over(&bare), Some(("compressed with KHR_draco_mesh_compression".to_owned(), false)));
        let meshopt = |root: &mut Value| {
            root["bufferViews"][0]["buffer"] = json!(1);
            root["bufferViews"][0]["extensions"] = json!({"EXT_meshopt_compression": {}});
        };
        assert_eq!(passed_over(&meshopt), Some(("compressed with EXT_meshopt_compression".to_owned(), false)));
    }
}
