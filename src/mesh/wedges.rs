//! Wedge data: one row of attribute values, one group and one set of joint influences for each wedge.

use super::{Attribute, Mesh, Semantic, Skin};
use glam::Vec3;

/// Where an attribute stands in a wedge's row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Column {
    pub semantic: Semantic,
    pub offset: usize,
    pub width: usize,
}

/// Attributes of all wedges.
#[derive(Debug, Clone)]
pub(crate) struct Wedges {
    columns: Vec<Column>,
    stride: usize,
    values: Vec<f32>,
    /// Least and greatest source value of each number of a row: a texture atlas ends there.
    range: Vec<(f32, f32)>,
    /// Empty where all are in group 0.
    groups: Vec<u32>,
    skin: Option<Skin>,
    count: usize,
    /// The source vertex that each wedge came from; empty where nobody asks.
    origins: Vec<u32>,
}

impl Wedges {
    /// Wedge `w` takes the data of vertex `vertices[w]`.
    pub fn new(mesh: &Mesh, vertices: &[u32]) -> Self {
        let mut stride = 0;
        let columns: Vec<Column> = mesh
            .attributes
            .iter()
            .map(|a| {
                let column = Column { semantic: a.semantic, offset: stride, width: a.width };
                stride += a.width;
                column
            })
            .collect();
        let mut values = Vec::with_capacity(stride * vertices.len());
        for &v in vertices {
            for a in &mesh.attributes {
                values.extend_from_slice(&a.values[v as usize * a.width..][..a.width]);
            }
        }
        let groups = if mesh.has_groups() { pick_groups(mesh, vertices) } else { Vec::new() };
        let skin = mesh.skin.as_ref().map(|s| pick_skin(s, vertices));
        let mut range = vec![(f32::INFINITY, f32::NEG_INFINITY); stride];
        for row in values.chunks_exact(stride.max(1)) {
            for (bounds, &value) in range.iter_mut().zip(row) {
                *bounds = (bounds.0.min(value), bounds.1.max(value));
            }
        }
        Self { columns, stride, values, range, groups, skin, count: vertices.len(), origins: vertices.to_vec() }
    }

    /// Some of the wedges; they carry nothing.
    pub fn pick(&self, wedges: &[u32]) -> Self {
        let origins = wedges.iter().filter_map(|&w| self.origins.get(w as usize)).copied().collect();
        let (columns, values, range, groups) = Default::default();
        Self { columns, values, range, groups, skin: None, count: wedges.len(), origins, ..*self }
    }

    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there are several groups, as far as the source says.
    pub fn has_groups(&self) -> bool {
        !self.groups.is_empty()
    }

    /// Whether wedges carry nothing that a collapse could change.
    pub fn is_plain(&self) -> bool {
        self.stride == 0 && self.skin.is_none()
    }

    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Where texture coordinates begin in a row, for each set.
    pub fn tex_coords(&self) -> impl Iterator<Item = usize> {
        self.columns.iter().filter(|c| matches!(c.semantic, Semantic::TexCoord(_))).map(|c| c.offset)
    }

    /// `value` within the source's range of the number `index` of a row.
    pub fn within_range(&self, index: usize, value: f32) -> f32 {
        let (low, high) = self.range[index];
        value.max(low).min(high)
    }

    pub fn group(&self, wedge: u32) -> u32 {
        self.groups.get(wedge as usize).copied().unwrap_or(0)
    }

    /// The source vertex that a wedge came from: it still is that vertex, if nothing has moved or changed it.
    pub fn origin(&self, wedge: u32) -> u32 {
        self.origins[wedge as usize]
    }

    /// Nobody will ask for [origins](Self::origin).
    pub fn forget_origins(&mut self) {
        self.origins = Vec::new();
    }

    /// There are `count` others from now on; they carry nothing.
    pub fn renumber(&mut self, count: usize) {
        self.count = count;
        if !self.origins.is_empty() {
            self.origins = vec![0; count];
        }
    }

    /// Takes where wedges of a part came from: each wedge here, and what it is there.
    pub fn take_origins(&mut self, part: &Self, wedges: impl Iterator<Item = (usize, u32)>) {
        if !self.origins.is_empty() {
            wedges.for_each(|(here, there)| self.origins[here] = part.origins[there as usize]);
        }
    }

    pub fn row(&self, wedge: u32) -> &[f32] {
        &self.values[wedge as usize * self.stride..][..self.stride]
    }

    pub fn row_mut(&mut self, wedge: u32) -> &mut [f32] {
        &mut self.values[wedge as usize * self.stride..][..self.stride]
    }

    /// Whether a viewer could tell two wedges at one point apart. Exporters split vertices by noise in normals or morph displacements; that is no
    /// seam.
    pub fn differ(&self, a: u32, b: u32) -> bool {
        if a == b {
            return false;
        }
        let (row_a, row_b) = (self.row(a), self.row(b));
        let differs = |column: &Column| {
            let tolerance = match column.semantic {
                Semantic::Normal => 0.02,
                Semantic::Tangent => 0.1,
                Semantic::TexCoord(_) => 1e-4,
                Semantic::Color(_) => 1.0 / 255.0,
                Semantic::Id => 0.0,
                Semantic::MorphPosition(_) | Semantic::Pose(_) | Semantic::MorphOther(_) | Semantic::Generic => {
                    return false;
                }
            };
            (column.offset..column.offset + column.width).any(|i| (row_a[i] - row_b[i]).abs() > tolerance)
        };
        self.group(a) != self.group(b) || self.columns.iter().any(differs)
    }

    /// How far the rows of two wedges lie apart; morph displacements and identifiers do not count.
    pub fn distance_squared(&self, a: u32, b: u32) -> f32 {
        let (row_a, row_b) = (self.row(a), self.row(b));
        let counts =
            |column: &&Column| matches!(column.semantic, Semantic::Normal | Semantic::TexCoord(_) | Semantic::Color(_));
        let numbers = self.columns.iter().filter(counts).flat_map(|c| c.offset..c.offset + c.width);
        numbers.map(|i| (row_a[i] - row_b[i]) * (row_a[i] - row_b[i])).sum()
    }

    /// A copy of `wedge` under a new id.
    pub fn duplicate(&mut self, wedge: u32) -> u32 {
        let (w, stride) = (wedge as usize, self.stride);
        self.values.extend_from_within(w * stride..(w + 1) * stride);
        if self.has_groups() {
            self.groups.push(self.groups[w]);
        }
        self.origins.extend(self.origins.get(w).copied());
        self.count += 1;
        if let Some(skin) = &mut self.skin {
            let n = skin.influences;
            skin.joints.extend_from_within(w * n..(w + 1) * n);
            skin.weights.extend_from_within(w * n..(w + 1) * n);
        }
        self.count as u32 - 1
    }

    /// Joint influences halfway (`t`) from wedge `a` to wedge `b`, as (joint, weight), strongest first.
    pub fn mix_influences(&self, a: u32, b: u32, t: f32, out: &mut Vec<(u16, f32)>) {
        out.clear();
        let Some(skin) = &self.skin else { return };
        let n = skin.influences;
        for (wedge, share) in [(a, 1.0 - t), (b, t)] {
            let range = wedge as usize * n..(wedge as usize + 1) * n;
            for (&joint, &weight) in skin.joints[range.clone()].iter().zip(&skin.weights[range]) {
                let weight = weight * share;
                if weight <= 0.0 {
                    continue;
                }
                match out.iter_mut().find(|(j, _)| *j == joint) {
                    Some((_, w)) => *w += weight,
                    None => out.push((joint, weight)),
                }
            }
        }
        out.sort_by(|x, y| y.1.total_cmp(&x.1).then(x.0.cmp(&y.0)));
        out.truncate(n);
        let sum: f32 = out.iter().map(|(_, w)| w).sum();
        out.iter_mut().for_each(|(_, w)| *w /= sum);
    }

    /// Joints and weights of a wedge, if the mesh is skinned.
    pub fn influences(&self, wedge: u32) -> Option<(&[u16], &[f32])> {
        let skin = self.skin.as_ref()?;
        let range = wedge as usize * skin.influences..(wedge as usize + 1) * skin.influences;
        Some((&skin.joints[range.clone()], &skin.weights[range]))
    }

    /// Joint influences inside a face of these wedges, as (joint, weight), strongest first; empty without a skin.
    pub fn blend_influences(&self, corners: [u32; 3], weights: [f32; 3]) -> Vec<(u16, f32)> {
        let mut found: Vec<(u16, f32)> = Vec::new();
        let Some(skin) = &self.skin else { return found };
        let n = skin.influences;
        for (wedge, share) in corners.into_iter().zip(weights) {
            let range = wedge as usize * n..(wedge as usize + 1) * n;
            for (&joint, &weight) in skin.joints[range.clone()].iter().zip(&skin.weights[range]) {
                match found.iter_mut().find(|(j, _)| *j == joint) {
                    _ if weight * share <= 0.0 => {}
                    Some((_, w)) => *w += weight * share,
                    None => found.push((joint, weight * share)),
                }
            }
        }
        found.sort_by(|x, y| y.1.total_cmp(&x.1).then(x.0.cmp(&y.0)));
        found.truncate(n);
        let sum: f32 = found.iter().map(|(_, w)| w).sum();
        found.iter_mut().for_each(|(_, w)| *w /= sum);
        found
    }

    /// Numbers a row.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Whether the wedge has joint influences.
    pub fn is_skinned(&self, wedge: u32) -> bool {
        self.skin
            .as_ref()
            .is_some_and(|s| s.weights[wedge as usize * s.influences..][..s.influences].iter().any(|&w| w > 0.0))
    }

    /// Replaces the influences of a wedge.
    pub fn set_influences(&mut self, wedge: u32, influences: &[(u16, f32)]) {
        let Some(skin) = &mut self.skin else { return };
        let n = skin.influences;
        for i in 0..n {
            let (joint, weight) = influences.get(i).copied().unwrap_or((0, 0.0));
            skin.joints[wedge as usize * n + i] = joint;
            skin.weights[wedge as usize * n + i] = weight;
        }
    }

    /// Fills `mesh.attributes` and `mesh.skin` with the rows of `order`; directions come out with unit length.
    pub fn write(&self, order: &[u32], mesh: &mut Mesh) {
        mesh.attributes = self
            .columns
            .iter()
            .map(|column| {
                let mut values = Vec::with_capacity(order.len() * column.width);
                for &w in order {
                    values.extend_from_slice(&self.row(w)[column.offset..][..column.width]);
                }
                Attribute { semantic: column.semantic, width: column.width, values }
            })
            .collect();
        normalize_directions(&mut mesh.attributes);
        mesh.skin = self.skin.as_ref().map(|s| pick_skin(s, order));
    }
}

fn pick_groups(mesh: &Mesh, vertices: &[u32]) -> Vec<u32> {
    let mut group_of = vec![0; mesh.positions.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        triangle.iter().for_each(|&v| group_of[v as usize] = mesh.group(t));
    }
    vertices.iter().map(|&v| group_of[v as usize]).collect()
}

fn pick_skin(skin: &Skin, rows: &[u32]) -> Skin {
    let n = skin.influences;
    let mut picked = Skin { influences: n, ..Skin::default() };
    for &r in rows {
        picked.joints.extend_from_slice(&skin.joints[r as usize * n..][..n]);
        picked.weights.extend_from_slice(&skin.weights[r as usize * n..][..n]);
    }
    picked
}

/// Unit normals; tangents orthogonal to them, of unit length, with a handedness of ±1. Zero vectors stay.
pub(crate) fn normalize_directions(attributes: &mut [Attribute]) {
    let mut normals = Vec::new();
    for a in attributes.iter_mut().filter(|a| a.semantic == Semantic::Normal && a.width == 3) {
        for n in a.values.chunks_exact_mut(3) {
            unit_unless_exact(Vec3::from_slice(n)).write_to_slice(n);
        }
        normals.clone_from(&a.values);
    }
    for a in attributes.iter_mut().filter(|a| a.semantic == Semantic::Tangent && a.width == 4) {
        for (i, t) in a.values.chunks_exact_mut(4).enumerate() {
            let tangent = Vec3::from_slice(&t[..3]);
            let normal = normals.get(i * 3..i * 3 + 3).map_or(Vec3::ZERO, Vec3::from_slice);
            let dot = tangent.dot(normal);
            let straight = if dot.abs() > 1e-3 { tangent - normal * dot } else { tangent };
            unit_unless_exact(straight).write_to_slice(&mut t[..3]);
            t[3] = if t[3] < 0.0 { -1.0 } else { 1.0 };
        }
    }
}

/// A vector that is of unit length already stays to the bit.
fn unit_unless_exact(v: Vec3) -> Vec3 {
    let length = v.length();
    if (length - 1.0).abs() < 1e-4 || length == 0.0 { v } else { v / length }
}
