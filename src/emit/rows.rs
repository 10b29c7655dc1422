//! Vertices as rows of stored numbers, as progressive meshes have them, and back.

use super::storage::{Storage, group_members_of, level_storage, normalize_weights, round_members};
use crate::asset::{AttributeLayout, Channel, Component, Geometry, PrimitiveLayout, Progressive, ProgressiveGroup};
use crate::error::{Error, Result};
use crate::mesh::{Attribute, Mesh, Semantic, Skin};
use crate::progressive::{Log, Number, State, Steps};

/// Weights that are no source's are whole numbers of 2⁻¹², so that they sum to exactly 1.
const WEIGHT_STEP: i8 = -12;

/// One attribute of the rows of a group.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RowChannel {
    /// The morph target, if it is not a base attribute.
    pub target: Option<usize>,
    pub layout: AttributeLayout,
    pub storage: Storage,
    /// Exponent of the grid's step; none for integers and what must not be rounded.
    pub step: Option<i8>,
}

impl RowChannel {
    fn width(&self) -> usize {
        match self.layout.channel {
            Channel::Joints(_) | Channel::Weights(_) => 4,
            _ => self.layout.shape.width(),
        }
    }

    fn number(&self) -> Number {
        if self.storage.component == Component::F32 { Number::Float { step: self.step } } else { Number::Integer }
    }
}

/// The rows of each group with the steps for what is made from the source: positions, the other attributes, each target's.
pub(super) fn source_channels(geometry: &Geometry, steps: &Steps) -> Vec<Vec<RowChannel>> {
    let step = |layout: &AttributeLayout| match layout.channel {
        Channel::Position => steps.position,
        Channel::Attribute(index) => steps.attributes.get(index).copied().flatten(),
        Channel::Weights(_) => Some(WEIGHT_STEP),
        Channel::Joints(_) => None,
    };
    let of_group = |primitive: &PrimitiveLayout| {
        let mut base: Vec<_> = primitive.attributes.iter().map(|a| (None, a)).collect();
        base.sort_by_key(|(_, a)| a.channel != Channel::Position);
        let targets = primitive.targets.iter().enumerate().flat_map(|(t, list)| list.iter().map(move |a| (Some(t), a)));
        let channel = |(target, layout)| channel(geometry, target, layout, step(layout));
        base.into_iter().chain(targets).map(channel).collect()
    };
    geometry.primitives.iter().map(of_group).collect()
}

fn channel(geometry: &Geometry, target: Option<usize>, layout: &AttributeLayout, step: Option<i8>) -> RowChannel {
    let storage = level_storage(geometry, target, layout);
    RowChannel { target, layout: layout.clone(), storage, step: step.filter(|_| storage.component == Component::F32) }
}

/// The rows of each group as the extension lists them.
pub(super) fn stored_channels(geometry: &Geometry, progressive: &Progressive) -> Result<Vec<Vec<RowChannel>>> {
    let there: Vec<usize> = geometry.primitives.iter().map(|p| p.primitive).collect();
    let listed: Vec<usize> = progressive.groups.iter().map(|g| g.primitive).collect();
    if there != listed {
        let message = format!("lists the primitives {listed:?}, but the mesh has triangles in {there:?}");
        return Err(Error::malformed(&progressive.place, message));
    }
    let groups = geometry.primitives.iter().zip(&progressive.groups);
    let channels = groups.map(|(p, g)| group_channels(geometry, p, g)).collect::<Result<Vec<_>>>()?;
    let position = |group: &Vec<RowChannel>| group.first().map(|c| (c.layout.channel, c.number()));
    match channels.iter().zip(&progressive.groups).find(|(c, _)| position(c) != position(&channels[0])) {
        Some((_, group)) => {
            Err(Error::malformed(&group.place, "positions are coded otherwise than in the first primitive"))
        }
        None => Ok(channels),
    }
}

fn group_channels(
    geometry: &Geometry,
    primitive: &PrimitiveLayout,
    group: &ProgressiveGroup,
) -> Result<Vec<RowChannel>> {
    let lists = std::iter::once((None, &primitive.attributes, Some(&group.attributes)));
    let targets = primitive.targets.iter().enumerate();
    let lists = lists.chain(targets.map(|(t, layouts)| (Some(t), layouts, group.targets.get(t))));
    let mut channels = Vec::new();
    for (target, layouts, listed) in lists {
        let listed = listed.map_or(&[][..], Vec::as_slice);
        let mut names: Vec<&str> = layouts.iter().map(|l| l.name.as_str()).collect();
        for attribute in listed {
            let layout =
                layouts.iter().find(|l| l.name == attribute.name).filter(|_| names.contains(&attribute.name.as_str()));
            let Some(layout) = layout else {
                let message = format!(
                    "{} is listed, but the primitive has no such attribute (or it is listed twice)",
                    attribute.name
                );
                return Err(Error::malformed(&group.place, message));
            };
            names.retain(|name| *name != attribute.name);
            channels.push(channel(geometry, target, layout, attribute.step));
        }
        if let Some(name) = names.first() {
            return Err(Error::malformed(&group.place, format!("{name} of the primitive is not listed")));
        }
    }
    match channels.first() {
        Some(first) if first.layout.channel == Channel::Position => Ok(channels),
        _ => Err(Error::malformed(&group.place, "the first attribute must be POSITION")),
    }
}

/// A mesh without vertices whose groups have these rows.
pub(super) fn empty_state(channels: &[Vec<RowChannel>]) -> State {
    let numbers = |c: &RowChannel| std::iter::repeat_n(c.number(), c.width());
    State::new(channels.iter().map(|group| group.iter().flat_map(numbers).collect()).collect())
}

/// The nodes of a log as vertices, rounded to what the file can hold. The source's stay what they are.
pub(super) fn node_rows(geometry: &Geometry, channels: &[Vec<RowChannel>], log: &mut Log) -> State {
    let members = group_members_of(&log.made_groups, geometry.primitives.len());
    round_members(&mut log.made, geometry, &members);
    let mut nodes = empty_state(channels);
    let group_of = |v: u32| geometry.primitives.partition_point(|p| p.vertices.end <= v);
    for &v in &log.sources {
        let group = group_of(v);
        nodes.add_vertex(group as u32, &row(&geometry.mesh, &channels[group], v));
    }
    for (v, &group) in (0..).zip(&log.made_groups) {
        step_weights(&mut log.made, &channels[group as usize], v);
        nodes.add_vertex(group, &row(&log.made, &channels[group as usize], v));
    }
    nodes
}

/// Rounds the weights of a made vertex to steps.
fn step_weights(mesh: &mut Mesh, channels: &[RowChannel], v: u32) {
    let is_float = |c: &RowChannel| matches!(c.layout.channel, Channel::Weights(_)) && c.step.is_some();
    let Some(skin) = mesh.skin.as_mut().filter(|_| channels.iter().any(is_float)) else { return };
    let range = v as usize * skin.influences..(v as usize + 1) * skin.influences;
    normalize_weights(&mut skin.weights[range.clone()], Some(1 << -WEIGHT_STEP));
    let joints = skin.joints[range.clone()].iter_mut().zip(&skin.weights[range]);
    joints.filter(|(_, weight)| **weight == 0.0).for_each(|(joint, _)| *joint = 0);
}

/// Numbers of a row.
pub(super) fn row_width(channels: &[RowChannel]) -> usize {
    channels.iter().map(RowChannel::width).sum()
}

/// The stored numbers of vertex `v`.
pub(super) fn row(mesh: &Mesh, channels: &[RowChannel], v: u32) -> Vec<i32> {
    let mut row = Vec::new();
    let index = v as usize;
    for channel in channels {
        let mut add = |x: f32| row.push(to_raw(channel.storage, x));
        match (channel.layout.channel, &mesh.skin) {
            (Channel::Position, _) => mesh.positions[index].iter().for_each(|&x| add(x)),
            (Channel::Attribute(column), _) => {
                let Attribute { width, values, .. } = &mesh.attributes[column];
                values[index * width..][..channel.width()].iter().for_each(|&x| add(x));
            }
            (Channel::Joints(set), Some(skin)) => {
                skin.joints[index * skin.influences + 4 * set..][..4].iter().for_each(|&j| add(f32::from(j)));
            }
            (Channel::Weights(set), Some(skin)) => {
                skin.weights[index * skin.influences + 4 * set..][..4].iter().for_each(|&w| add(w));
            }
            (Channel::Joints(_) | Channel::Weights(_), None) => (0..4).for_each(|_| add(0.0)),
        }
    }
    row
}

/// The vertices and faces of `state` as a mesh that is stored as `geometry` says. A group without faces gets one without area, of a copy of
/// its row in `stand_ins`: a glTF primitive cannot be empty.
pub(super) fn to_mesh(
    state: &State,
    geometry: &Geometry,
    channels: &[Vec<RowChannel>],
    stand_ins: &[Vec<i32>],
) -> Mesh {
    let source = &geometry.mesh;
    let attributes = source.attributes.iter().map(|a| Attribute { values: Vec::new(), ..a.clone() }).collect();
    let skin = source.skin.as_ref().map(|s| Skin { influences: s.influences, ..Skin::default() });
    let mut mesh = Mesh { attributes, skin, ..Mesh::default() };
    for v in 0..state.vertex_count() as u32 {
        append(&mut mesh, &channels[state.group(v) as usize], state.row(v));
    }
    mesh.triangles = state.faces().to_vec();
    mesh.groups = state.faces().iter().map(|f| state.group(f[0])).collect();
    for group in groups_without_faces(state) {
        let v = mesh.positions.len() as u32;
        append(&mut mesh, &channels[group as usize], &stand_ins[group as usize]);
        mesh.triangles.push([v; 3]);
        mesh.groups.push(group);
    }
    mesh
}

/// The groups that no face belongs to.
pub(super) fn groups_without_faces(state: &State) -> Vec<u32> {
    let mut has_face = vec![false; state.group_count()];
    state.faces().iter().for_each(|f| has_face[state.group(f[0]) as usize] = true);
    (0..).zip(has_face).filter(|(_, has)| !has).map(|(group, _)| group).collect()
}

fn append(mesh: &mut Mesh, channels: &[RowChannel], row: &[i32]) {
    let vertex = mesh.positions.len();
    for attribute in &mut mesh.attributes {
        let filler = if matches!(attribute.semantic, Semantic::Color(_)) { 1.0 } else { 0.0 };
        attribute.values.resize((vertex + 1) * attribute.width, filler);
    }
    if let Some(skin) = &mut mesh.skin {
        skin.joints.resize((vertex + 1) * skin.influences, 0);
        skin.weights.resize((vertex + 1) * skin.influences, 0.0);
    }
    let mut rest = row;
    for channel in channels {
        let (raw, after) = rest.split_at(channel.width());
        rest = after;
        let values = raw.iter().map(|&raw| from_raw(channel.storage, raw));
        match (channel.layout.channel, &mut mesh.skin) {
            (Channel::Position, _) => {
                let mut values = values;
                mesh.positions.push(std::array::from_fn(|_| values.next().unwrap_or(0.0)));
            }
            (Channel::Attribute(column), _) => {
                let Attribute { width, values: all, .. } = &mut mesh.attributes[column];
                all[vertex * *width..].iter_mut().zip(values).for_each(|(to, from)| *to = from);
            }
            (Channel::Joints(set), Some(skin)) => {
                let to = &mut skin.joints[vertex * skin.influences + 4 * set..][..4];
                to.iter_mut().zip(raw).for_each(|(to, &raw)| *to = u16::try_from(raw).unwrap_or(u16::MAX));
            }
            (Channel::Weights(set), Some(skin)) => {
                let to = &mut skin.weights[vertex * skin.influences + 4 * set..][..4];
                to.iter_mut().zip(values).for_each(|(to, from)| *to = from);
            }
            (Channel::Joints(_) | Channel::Weights(_), None) => {}
        }
    }
}

fn to_raw(storage: Storage, value: f32) -> i32 {
    match storage.component {
        Component::F32 => value.to_bits() as i32,
        // Unsigned 32-bit numbers above the middle wrap around, and back below.
        _ => storage.encode(value) as i64 as i32,
    }
}

fn from_raw(storage: Storage, raw: i32) -> f32 {
    match storage.component {
        Component::F32 => f32::from_bits(raw as u32),
        Component::U32 => storage.decode(f64::from(raw as u32)),
        _ => storage.decode(f64::from(raw)),
    }
}
