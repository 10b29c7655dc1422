//! A level as bytes: its buffer views, its accessors, and which primitive uses which.
//!
//! All vertex attributes of a level that have the same stride share one buffer view, all its indices another.
//! Attributes start at multiples of 4 bytes, as glTF asks. A level of source vertices has indices only.

use super::storage::{Storage, level_storage};
use crate::asset::{AttributeLayout, Channel, Component, Geometry, PrimitiveLayout, Shape};
use crate::mesh::Mesh;
use crate::meshoptimizer::optimize_order;
use gltf_json::buffer::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// One level of one mesh, encoded. All indices and offsets count from the start of this level's own.
#[derive(Debug, Default)]
pub(super) struct EncodedLevel {
    /// The content of its buffer views, each padded to a multiple of 4 bytes.
    pub bytes: Vec<u8>,
    pub views: Vec<ViewDraft>,
    pub accessors: Vec<AccessorDraft>,
    /// Primitives that have triangles left, in the source's order.
    pub primitives: Vec<PrimitiveDraft>,
    /// Bytes that vertices of its own would have taken.
    pub bytes_saved: usize,
}

#[derive(Debug)]
pub(super) struct ViewDraft {
    pub offset: usize,
    pub length: usize,
    /// Given where the view holds several accessors or elements are padded.
    pub stride: Option<usize>,
    pub target: u32,
}

#[derive(Debug)]
pub(super) struct AccessorDraft {
    pub view: usize,
    /// The accessor without its `bufferView`.
    pub json: Map<String, Value>,
}

#[derive(Debug)]
pub(super) struct PrimitiveDraft {
    /// `meshes[m].primitives[source]` is the primitive it is a level of.
    pub source: usize,
    pub indices: usize,
    /// Attributes and morph targets are those of the primitive it is a level of; those below are empty.
    pub shares_vertices: bool,
    pub attributes: Vec<(String, usize)>,
    pub targets: Vec<Vec<(String, usize)>>,
}

/// Encodes a level. It is rounded to storage already; triangles are put in vertex-cache order, vertices in order of
/// first use, unused ones are left out, and so are groups without triangles.
pub(super) fn encode_level(level: &Mesh, geometry: &Geometry) -> EncodedLevel {
    encode_groups(level, geometry, Group::ordered_for_gpu)
}

/// As [`encode_level`], but triangles keep their order, and vertices that of their first use.
pub(super) fn encode_in_order(level: &Mesh, geometry: &Geometry) -> EncodedLevel {
    encode_groups(level, geometry, |group| group)
}

fn encode_groups(level: &Mesh, geometry: &Geometry, order: impl Fn(Group) -> Group) -> EncodedLevel {
    let mut encoder = Encoder::default();
    let mut primitives = Vec::new();
    for (primitive, group) in geometry.primitives.iter().zip(split_groups(level, geometry.primitives.len())) {
        if !group.triangles.is_empty() {
            primitives.push(encoder.encode_primitive(level, geometry, primitive, &order(group)));
        }
    }
    encoder.finish(primitives)
}

/// Encodes a level whose vertices are those of the source's plain mesh that `vertices` names. Triangles are put in vertex-cache order.
pub(super) fn encode_indices_only(level: &Mesh, vertices: &[u32], geometry: &Geometry) -> EncodedLevel {
    let mut encoder = Encoder::default();
    let (mut primitives, mut bytes_saved) = (Vec::new(), 0);
    let groups = split_groups(level, geometry.primitives.len()).into_iter().map(Group::ordered_for_gpu);
    for (primitive, group) in geometry.primitives.iter().zip(groups) {
        if group.triangles.is_empty() {
            continue;
        }
        let element = |own: u32| primitive.element(vertices[group.vertices[own as usize] as usize]);
        let triangles: Vec<[u32; 3]> = group.triangles.iter().map(|t| t.map(element)).collect();
        let last = triangles.as_flattened().iter().max().map_or(0, |&last| last as usize);
        let indices = encoder.encode_indices(&triangles, last + 1);
        let (attributes, targets) = Default::default();
        primitives.push(PrimitiveDraft {
            source: primitive.primitive,
            indices,
            shares_vertices: true,
            attributes,
            targets,
        });
        bytes_saved += group.vertices.len() * bytes_of_vertex(geometry, primitive);
    }
    EncodedLevel { bytes_saved, ..encoder.finish(primitives) }
}

/// Bytes of a vertex of a level with vertices of its own.
fn bytes_of_vertex(geometry: &Geometry, primitive: &PrimitiveLayout) -> usize {
    let base = primitive.attributes.iter().map(|layout| (None, layout));
    let targets =
        primitive.targets.iter().enumerate().flat_map(|(t, layouts)| layouts.iter().map(move |l| (Some(t), l)));
    let stride = |(target, layout): (Option<usize>, &AttributeLayout)| {
        Columns::of(layout.shape, level_storage(geometry, target, layout).component).stride()
    };
    base.chain(targets).map(stride).sum()
}

/// The triangles of one group over vertices of its own.
#[derive(Debug, Default, Clone, PartialEq)]
struct Group {
    triangles: Vec<[u32; 3]>,
    /// For each of its vertices the one of the level.
    vertices: Vec<u32>,
}

fn split_groups(level: &Mesh, groups: usize) -> Vec<Group> {
    let mut split = vec![Group::default(); groups];
    let mut number = vec![0u32; level.positions.len()];
    for (t, triangle) in level.triangles.iter().enumerate() {
        let Some(group) = split.get_mut(level.group(t) as usize) else { continue };
        let own = triangle.map(|v| {
            let number = &mut number[v as usize];
            // Not yet seen in this group.
            if group.vertices.get(*number as usize) != Some(&v) {
                *number = group.vertices.len() as u32;
                group.vertices.push(v);
            }
            *number
        });
        group.triangles.push(own);
    }
    split
}

impl Group {
    /// Triangles in vertex-cache order, vertices in the order in which these use them.
    fn ordered_for_gpu(mut self) -> Self {
        // The indices are this group's own, so the check cannot fail; the order as it is would be right as well.
        if let Ok(order) = optimize_order(&mut self.triangles, self.vertices.len()) {
            self.vertices = order.into_iter().map(|v| self.vertices[v as usize]).collect();
        }
        self
    }
}

/// Collects the content of buffer views while primitives are encoded.
#[derive(Default)]
struct Encoder {
    /// Vertex data by stride.
    vertex_data: BTreeMap<usize, Block>,
    index_data: Block,
    accessors: Vec<(Place, Map<String, Value>)>,
}

#[derive(Default)]
struct Block {
    bytes: Vec<u8>,
    accessors: usize,
    padded: bool,
}

/// The block an accessor lies in.
enum Place {
    Vertices { stride: usize },
    Indices,
}

impl Encoder {
    fn encode_primitive(
        &mut self,
        level: &Mesh,
        geometry: &Geometry,
        primitive: &PrimitiveLayout,
        group: &Group,
    ) -> PrimitiveDraft {
        let mut encode = |target: Option<usize>, layouts: &[AttributeLayout]| -> Vec<(String, usize)> {
            let encode_one = |layout: &AttributeLayout| {
                let storage = level_storage(geometry, target, layout);
                (layout.name.clone(), self.encode_attribute(level, layout, storage, &group.vertices))
            };
            layouts.iter().map(encode_one).collect()
        };
        let attributes = encode(None, &primitive.attributes);
        let targets = primitive.targets.iter().enumerate().map(|(t, layouts)| encode(Some(t), layouts)).collect();
        let indices = self.encode_indices(&group.triangles, group.vertices.len());
        PrimitiveDraft { source: primitive.primitive, indices, shares_vertices: false, attributes, targets }
    }

    fn encode_attribute(
        &mut self,
        level: &Mesh,
        layout: &AttributeLayout,
        storage: Storage,
        vertices: &[u32],
    ) -> usize {
        let columns = Columns::of(layout.shape, storage.component);
        let stride = columns.stride();
        let block = self.vertex_data.entry(stride).or_default();
        let offset = block.bytes.len();
        let mut bounds = Bounds::new(layout.shape.width());
        block.bytes.reserve(stride * vertices.len());
        for &v in vertices {
            let values = element(level, layout, v);
            if layout.name == "POSITION" {
                bounds.add(values.as_slice(), storage);
            }
            columns.write(values.as_slice(), storage, &mut block.bytes);
        }
        block.accessors += 1;
        block.padded |= columns.size() != stride;

        let mut json = accessor(offset, storage, vertices.len(), layout.shape);
        if layout.name == "POSITION" {
            json.insert("min".into(), bounds.low(storage));
            json.insert("max".into(), bounds.high(storage));
        }
        self.accessors.push((Place::Vertices { stride }, json));
        self.accessors.len() - 1
    }

    /// Indices are u16 or u32. Never u8: current graphics interfaces have no such index buffers, so engines convert them
    /// when they load. The largest value of the type is never used, since it restarts primitives.
    fn encode_indices(&mut self, triangles: &[[u32; 3]], vertex_count: usize) -> usize {
        let small = vertex_count <= usize::from(u16::MAX);
        let component = if small { Component::U16 } else { Component::U32 };
        let storage = Storage { component, normalized: false };
        let bytes = &mut self.index_data.bytes;
        pad(bytes, component.size());
        let offset = bytes.len();
        bytes.reserve(triangles.len() * 3 * component.size());
        for &index in triangles.iter().flatten() {
            if small {
                bytes.extend((index as u16).to_le_bytes());
            } else {
                bytes.extend(index.to_le_bytes());
            }
        }
        self.index_data.accessors += 1;
        self.accessors.push((Place::Indices, accessor(offset, storage, triangles.len() * 3, Shape::Scalar)));
        self.accessors.len() - 1
    }

    /// Lays the blocks one after the other: vertices by stride, then indices.
    fn finish(self, primitives: Vec<PrimitiveDraft>) -> EncodedLevel {
        let mut level = EncodedLevel { primitives, ..EncodedLevel::default() };
        let mut view_of_stride = BTreeMap::new();
        for (stride, block) in self.vertex_data {
            view_of_stride.insert(stride, level.views.len());
            let explicit = block.accessors > 1 || block.padded;
            level.push_view(&block.bytes, explicit.then_some(stride), ARRAY_BUFFER);
        }
        let index_view = level.views.len();
        if self.index_data.accessors > 0 {
            level.push_view(&self.index_data.bytes, None, ELEMENT_ARRAY_BUFFER);
        }
        level.accessors = self
            .accessors
            .into_iter()
            .map(|(place, json)| AccessorDraft {
                view: match place {
                    Place::Vertices { stride } => view_of_stride[&stride],
                    Place::Indices => index_view,
                },
                json,
            })
            .collect();
        level
    }
}

impl EncodedLevel {
    /// Whether some of its vertices are the source's.
    pub fn shares_vertices(&self) -> bool {
        self.primitives.iter().any(|primitive| primitive.shares_vertices)
    }

    fn push_view(&mut self, bytes: &[u8], stride: Option<usize>, target: u32) {
        self.views.push(ViewDraft { offset: self.bytes.len(), length: bytes.len(), stride, target });
        self.bytes.extend_from_slice(bytes);
        pad(&mut self.bytes, 4);
    }
}

/// Zeros up to a multiple of `alignment`.
pub(super) fn pad(bytes: &mut Vec<u8>, alignment: usize) {
    bytes.resize(bytes.len().next_multiple_of(alignment), 0);
}

fn accessor(offset: usize, storage: Storage, count: usize, shape: Shape) -> Map<String, Value> {
    let mut json = Map::new();
    if offset > 0 {
        json.insert("byteOffset".into(), offset.into());
    }
    json.insert("componentType".into(), (storage.component as u32).into());
    if storage.normalized {
        json.insert("normalized".into(), true.into());
    }
    json.insert("count".into(), count.into());
    json.insert("type".into(), shape.name().into());
    json
}

/// The numbers of one element as the mesh has them; joints are integers below 2¹⁶ and thus exact.
enum Element<'a> {
    Slice(&'a [f32]),
    Four([f32; 4]),
}

impl Element<'_> {
    fn as_slice(&self) -> &[f32] {
        match self {
            Self::Slice(values) => values,
            Self::Four(values) => values,
        }
    }
}

fn element<'a>(level: &'a Mesh, layout: &AttributeLayout, vertex: u32) -> Element<'a> {
    let v = vertex as usize;
    match layout.channel {
        Channel::Position => Element::Slice(&level.positions[v]),
        Channel::Attribute(index) => {
            let attribute = &level.attributes[index];
            Element::Slice(&attribute.values[v * attribute.width..][..layout.shape.width()])
        }
        Channel::Joints(set) | Channel::Weights(set) => {
            let Some(skin) = &level.skin else { return Element::Four([0.0; 4]) };
            let start = v * skin.influences + 4 * set;
            Element::Four(std::array::from_fn(|i| match layout.channel {
                Channel::Joints(_) => f32::from(skin.joints[start + i]),
                _ => skin.weights[start + i],
            }))
        }
    }
}

/// How the numbers of an element lie: columns of matrices start at multiples of 4 bytes.
struct Columns {
    rows: usize,
    count: usize,
    component_size: usize,
}

impl Columns {
    fn of(shape: Shape, component: Component) -> Self {
        let (rows, count) = match shape {
            Shape::Mat2 => (2, 2),
            Shape::Mat3 => (3, 3),
            Shape::Mat4 => (4, 4),
            vector => (vector.width(), 1),
        };
        Self { rows, count, component_size: component.size() }
    }

    /// Bytes of an element without padding behind it.
    fn size(&self) -> usize {
        let column = self.rows * self.component_size;
        if self.count == 1 { column } else { self.count * column.next_multiple_of(4) }
    }

    fn stride(&self) -> usize {
        self.size().next_multiple_of(4)
    }

    fn write(&self, values: &[f32], storage: Storage, bytes: &mut Vec<u8>) {
        for column in values.chunks(self.rows) {
            for &value in column {
                storage.write(value, bytes);
            }
            pad(bytes, 4);
        }
    }
}

/// Smallest and largest stored numbers; integers even where they are normalised.
struct Bounds {
    low: Vec<f64>,
    high: Vec<f64>,
}

impl Bounds {
    fn new(width: usize) -> Self {
        Self { low: vec![f64::INFINITY; width], high: vec![f64::NEG_INFINITY; width] }
    }

    fn add(&mut self, values: &[f32], storage: Storage) {
        for (i, &value) in values.iter().enumerate() {
            let stored = storage.encode(value);
            self.low[i] = self.low[i].min(stored);
            self.high[i] = self.high[i].max(stored);
        }
    }

    fn low(&self, storage: Storage) -> Value {
        self.low.iter().map(|&x| number(x, storage)).collect()
    }

    fn high(&self, storage: Storage) -> Value {
        self.high.iter().map(|&x| number(x, storage)).collect()
    }
}

/// The shortest JSON number that reads back as the stored one.
fn number(stored: f64, storage: Storage) -> Value {
    if stored.fract() == 0.0 && stored.abs() < 1e15 {
        return json!(stored as i64);
    }
    if storage.component != Component::F32 {
        return json!(stored);
    }
    let shortest = (stored as f32).to_string();
    shortest.parse::<f64>().map_or_else(|_| json!(stored), |x| json!(x))
}
