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
    assembler: Assembler,
    geometry: Geometry,
}

/// Merges `parts` in order.
pub(super) fn merge(
    parts: &[Part],
    passed_over: Vec<PassedOver>,
    joints: Option<Joints>,
    limits: &Limits,
) -> Result<Geometry> {
    let mut plan = Plan::of(parts);
    let vertex_bytes = plan.vertex_bytes();
    let influences = 4 * plan.sets.len();
    let skin = (influences > 0).then(|| Skin { influences, ..Skin::default() });
    let mesh = Mesh { attributes: std::mem::take(&mut plan.attributes), skin, ..Mesh::default() };
    let geometry = Geometry { mesh, primitives: Vec::new(), passed_over, warnings: Vec::new() };
    let mut merger = Merger { plan, vertex_bytes, limits, joints, assembler: Assembler::default(), geometry };
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
        mesh.triangles.extend(faces.triangles.iter().map(|t| t.map(|corner| first + corner)));
        mesh.groups.resize(mesh.triangles.len(), group);
        let layouts = |target, sources: &[Source]| sources.iter().filter_map(|s| self.plan.layout(target, s)).collect();
        self.geometry.primitives.push(PrimitiveLayout {
            primitive: part.primitive,
            vertices: first..mesh.positions.len() as u32,
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
            unmoved += usize::from(!balance(joints, weights));
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
