//! Numbers as the source's component types hold them: rounding a level to its storage, and encoding it.
//!
//! Rounding happens before a level is measured, encoding when it is written; an encoded value decodes to exactly the
//! rounded one. Conversions are those of glTF 2.0 §3.6.2.2 (normalised integers).

use crate::asset::{AttributeLayout, Channel, Component, Geometry, PrimitiveLayout};
use crate::mesh::{Attribute, Mesh};
use glam::Vec3;

/// How one number is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Storage {
    pub component: Component,
    pub normalized: bool,
}

impl Storage {
    const FLOAT: Self = Self { component: Component::F32, normalized: false };

    /// As the attribute was stored in the source.
    pub fn of(layout: &AttributeLayout) -> Self {
        Self { component: layout.component, normalized: layout.normalized }
    }

    /// Smallest and largest integer that may be written. Normalised −128 is never written: it stands for −1 as −127 does.
    fn range(self) -> (f64, f64) {
        match self.component {
            Component::I8 => (if self.normalized { -127.0 } else { -128.0 }, 127.0),
            Component::U8 => (0.0, 255.0),
            Component::I16 => (if self.normalized { -32767.0 } else { -32768.0 }, 32767.0),
            Component::U16 => (0.0, 65535.0),
            Component::U32 => (0.0, f64::from(u32::MAX)),
            Component::F32 => (f64::from(f32::MIN), f64::from(f32::MAX)),
        }
    }

    /// The stored integer nearest to `value` (the value itself for floats).
    pub fn encode(self, value: f32) -> f64 {
        if self.component == Component::F32 {
            return f64::from(value);
        }
        let (low, high) = self.range();
        let scaled = if self.normalized { f64::from(value) * high } else { f64::from(value) };
        scaled.round().clamp(low, high)
    }

    /// What a stored number stands for.
    pub fn decode(self, stored: f64) -> f32 {
        if self.normalized && self.component != Component::F32 {
            (stored as f32 / self.range().1 as f32).max(-1.0)
        } else {
            stored as f32
        }
    }

    fn round(self, value: &mut f32) {
        if self.component != Component::F32 {
            *value = self.decode(self.encode(*value));
        }
    }

    /// Appends the stored number, little-endian.
    pub fn write(self, value: f32, bytes: &mut Vec<u8>) {
        let stored = self.encode(value);
        match self.component {
            Component::I8 => bytes.extend((stored as i8).to_le_bytes()),
            Component::U8 => bytes.extend((stored as u8).to_le_bytes()),
            Component::I16 => bytes.extend((stored as i16).to_le_bytes()),
            Component::U16 => bytes.extend((stored as u16).to_le_bytes()),
            Component::U32 => bytes.extend((stored as u32).to_le_bytes()),
            Component::F32 => bytes.extend(value.to_le_bytes()),
        }
    }
}

/// How the attribute is stored in a level of `geometry`: as in the source, except that positions (and the displacements
/// of one morph target) share one storage over all groups, since equal positions rounded differently would open gaps.
/// Groups that disagree are stored as floats.
pub(super) fn level_storage(geometry: &Geometry, target: Option<usize>, layout: &AttributeLayout) -> Storage {
    let own = Storage::of(layout);
    if layout.name != "POSITION" {
        return own;
    }
    let of_group = |primitive: &PrimitiveLayout| {
        let attributes = match target {
            None => &primitive.attributes,
            Some(target) => primitive.targets.get(target)?,
        };
        attributes.iter().find(|a| a.name == "POSITION").map(Storage::of)
    };
    if geometry.primitives.iter().filter_map(of_group).all(|other| other == own) { own } else { Storage::FLOAT }
}

/// Rounds `level` to the component types its primitives are stored in, so that what is measured is what is written.
///
/// Positions that are equal stay equal across groups. Normals and tangents are made unit vectors first (one that
/// vanished becomes the normal of its faces), colours are kept inside what glTF and the source allow, skin weights are
/// rounded so that they still sum to exactly 1, joints without weight become 0.
pub fn round_to_storage(level: &mut Mesh, geometry: &Geometry) {
    let members = group_members(level, geometry.primitives.len());
    round_members(level, geometry, &members);
}

/// As [`round_to_storage`] for the vertices of each group in `members`.
pub(super) fn round_members(level: &mut Mesh, geometry: &Geometry, members: &[Vec<u32>]) {
    for (primitive, vertices) in geometry.primitives.iter().zip(members) {
        for layout in &primitive.attributes {
            round_attribute(level, geometry, primitive, layout, vertices);
        }
        for (target, layouts) in primitive.targets.iter().enumerate() {
            for layout in layouts {
                round_values(level, level_storage(geometry, Some(target), layout), layout, vertices);
            }
        }
        round_skin(level, primitive, vertices);
    }
}

/// The vertices that each group's triangles use, ascending.
fn group_members(mesh: &Mesh, groups: usize) -> Vec<Vec<u32>> {
    let mut group_of = vec![u32::MAX; mesh.positions.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        for &v in triangle {
            group_of[v as usize] = mesh.group(t);
        }
    }
    group_members_of(&group_of, groups)
}

/// The vertices of each group, ascending.
pub(super) fn group_members_of(group_of: &[u32], groups: usize) -> Vec<Vec<u32>> {
    let mut members = vec![Vec::new(); groups];
    for (v, &group) in group_of.iter().enumerate() {
        if let Some(list) = members.get_mut(group as usize) {
            list.push(v as u32);
        }
    }
    members
}

fn round_attribute(
    level: &mut Mesh,
    geometry: &Geometry,
    primitive: &PrimitiveLayout,
    layout: &AttributeLayout,
    vertices: &[u32],
) {
    let storage = level_storage(geometry, None, layout);
    match (layout.name.as_str(), layout.channel) {
        ("NORMAL", Channel::Attribute(index)) => {
            normalize_vectors(level, index, storage, vertices);
        }
        ("TANGENT", Channel::Attribute(index)) => {
            normalize_vectors(level, index, storage, vertices);
            for_each_element(level, index, vertices, |t| t[3] = if t[3] < 0.0 { -1.0 } else { 1.0 });
        }
        (name, Channel::Attribute(index)) if name.starts_with("COLOR_") => {
            let (low, high) = colour_range(&geometry.mesh, primitive, index);
            for_each_element(level, index, vertices, |c| c.iter_mut().for_each(|x| *x = x.clamp(low, high)));
        }
        _ => {}
    }
    round_values(level, storage, layout, vertices);
}

fn round_values(level: &mut Mesh, storage: Storage, layout: &AttributeLayout, vertices: &[u32]) {
    match layout.channel {
        Channel::Position => {
            for &v in vertices {
                level.positions[v as usize].iter_mut().for_each(|x| storage.round(x));
            }
        }
        Channel::Attribute(index) => {
            let width = layout.shape.width();
            for_each_element(level, index, vertices, |values| {
                values.iter_mut().take(width).for_each(|x| storage.round(x));
            });
        }
        // Rounded together, in `round_skin`.
        Channel::Joints(_) | Channel::Weights(_) => {}
    }
}

fn for_each_element(level: &mut Mesh, attribute: usize, vertices: &[u32], mut edit: impl FnMut(&mut [f32])) {
    let Some(Attribute { width, values, .. }) = level.attributes.get_mut(attribute) else { return };
    for &v in vertices {
        let start = v as usize * *width;
        edit(&mut values[start..start + *width]);
    }
}

/// [0, 1], widened to what the primitive has in the source: one with brighter colours keeps them.
fn colour_range(source: &Mesh, primitive: &PrimitiveLayout, attribute: usize) -> (f32, f32) {
    let values = source.attributes.get(attribute).and_then(|a| {
        let [start, end] = [primitive.vertices.start, primitive.vertices.end].map(|v| v as usize * a.width);
        a.values.get(start..end)
    });
    values.unwrap_or_default().iter().fold((0.0f32, 1.0f32), |(low, high), &x| (low.min(x), high.max(x)))
}

/// Makes the first three numbers of each element a unit vector.
fn normalize_vectors(level: &mut Mesh, attribute: usize, storage: Storage, vertices: &[u32]) {
    let mut vanished = Vec::new();
    let mut vertex = vertices.iter();
    for_each_element(level, attribute, vertices, |values| {
        let v = *vertex.next().expect("one element a vertex");
        let vector = Vec3::from_slice(values);
        if is_stored_unit(vector, storage) {
            return;
        }
        match vector.try_normalize() {
            Some(unit) => values[..3].copy_from_slice(&unit.to_array()),
            None => vanished.push(v),
        }
    });
    if !vanished.is_empty() {
        replace_vanished(level, attribute, &vanished);
    }
}

/// Whether integers hold exactly this vector already and it is as long as rounding leaves a unit vector. Making it a
/// unit vector again and rounding again could end on a neighbour.
fn is_stored_unit(vector: Vec3, storage: Storage) -> bool {
    let exact = |x: f32| storage.decode(storage.encode(x)) == x;
    storage.component != Component::F32
        && (vector.length() - 1.0).abs() < 0.01
        && vector.to_array().into_iter().all(exact)
}

/// Gives vectors that vanished (opposite normals met) the direction of the faces around: their normal, or for a tangent
/// (four numbers) one at right angles to it.
fn replace_vanished(level: &mut Mesh, attribute: usize, vanished: &[u32]) {
    let mut sums: std::collections::BTreeMap<u32, Vec3> = vanished.iter().map(|&v| (v, Vec3::ZERO)).collect();
    for &[a, b, c] in &level.triangles {
        let [pa, pb, pc] = [a, b, c].map(|v| Vec3::from(level.positions[v as usize]));
        for v in [a, b, c] {
            if let Some(sum) = sums.get_mut(&v) {
                *sum += (pb - pa).cross(pc - pa);
            }
        }
    }
    let Attribute { width, values, .. } = &mut level.attributes[attribute];
    for (v, sum) in sums {
        let normal = sum.try_normalize().unwrap_or(Vec3::Z);
        let direction = if *width == 4 { normal.any_orthonormal_vector() } else { normal };
        let start = v as usize * *width;
        values[start..start + 3].copy_from_slice(&direction.to_array());
    }
}

/// Rounds weights over all sets of the group together, and clears joints that have no weight.
fn round_skin(level: &mut Mesh, primitive: &PrimitiveLayout, vertices: &[u32]) {
    let Some(skin) = &mut level.skin else { return };
    let weights: Vec<(usize, Storage)> = primitive
        .attributes
        .iter()
        .filter_map(|a| match a.channel {
            Channel::Weights(set) => Some((set, Storage::of(a))),
            _ => None,
        })
        .collect();
    let Some(&(_, storage)) = weights.first() else { return };
    // Sets of different types have no common unit: weights then stay within rounding of 1.
    let steps = (storage.component != Component::F32 && weights.iter().all(|&(_, s)| s == storage))
        .then(|| storage.range().1 as u32);
    for &v in vertices {
        let range = v as usize * skin.influences..(v as usize + 1) * skin.influences;
        let (joints, values) = (&mut skin.joints[range.clone()], &mut skin.weights[range]);
        merge_equal_joints(joints, values);
        normalize_weights(values, steps);
        if steps.is_none() {
            for &(set, storage) in &weights {
                values.iter_mut().skip(4 * set).take(4).for_each(|w| storage.round(w));
            }
        }
        for (joint, weight) in joints.iter_mut().zip(values.iter()) {
            if *weight == 0.0 {
                *joint = 0;
            }
        }
    }
}

/// Collapses bring the same joint in from both ends; glTF allows each joint once a vertex.
fn merge_equal_joints(joints: &[u16], weights: &mut [f32]) {
    for i in 1..joints.len() {
        if let Some(first) = (0..i).find(|&j| joints[j] == joints[i] && weights[j] > 0.0) {
            weights[first] += std::mem::take(&mut weights[i]);
        }
    }
}

/// Scales weights to the sum 1; with `steps` to whole steps that sum to exactly `steps`, the remainder going to those
/// that rounding down cost most. All-zero weights stay.
pub(super) fn normalize_weights(weights: &mut [f32], steps: Option<u32>) {
    let sum: f64 = weights.iter().map(|&w| f64::from(w.max(0.0))).sum();
    if sum <= 0.0 || !sum.is_finite() {
        return;
    }
    let Some(steps) = steps else {
        weights.iter_mut().for_each(|w| *w = (f64::from(w.max(0.0)) / sum) as f32);
        return;
    };
    let exact: Vec<f64> = weights.iter().map(|&w| f64::from(w.max(0.0)) / sum * f64::from(steps)).collect();
    let mut whole: Vec<u32> = exact.iter().map(|&x| (x + 1e-3).floor() as u32).collect();
    let mut order: Vec<usize> = (0..weights.len()).collect();
    order.sort_by(|&a, &b| (exact[b] - f64::from(whole[b])).total_cmp(&(exact[a] - f64::from(whole[a]))));
    let given: u32 = whole.iter().sum();
    for &i in order.iter().take(steps.saturating_sub(given) as usize) {
        whole[i] += 1;
    }
    for (weight, whole) in weights.iter_mut().zip(whole) {
        *weight = whole as f32 / steps as f32;
    }
}
