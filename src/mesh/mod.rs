//! Triangle meshes as plain arrays: what the simplifier takes and gives, and what the ruler measures.
//!
//! Knows nothing of glTF, files or presets.

pub(crate) mod edges;
pub(crate) mod order;
mod pose;
pub(crate) mod regions;
pub(crate) mod surface;
pub(crate) mod surgery;
mod validate;
pub(crate) mod wedges;
mod weld;

pub use pose::{Pose, choose_poses};

/// A triangle mesh in plain arrays; the same shape goes into the simplifier and comes out of it.
///
/// A *vertex* is a position with its attributes, as in an index buffer: vertices that share a position but differ in
/// an attribute (a seam) or belong to different groups are separate. All per-vertex arrays have
/// `positions.len()` entries; attribute `values` and skin arrays have `width` (or `influences`) numbers a vertex.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Positions in object units, one a vertex.
    pub positions: Vec<[f32; 3]>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// The group (material, glTF primitive) of each triangle; empty means that all are in group 0.
    /// A vertex is used by triangles of one group only.
    pub groups: Vec<u32>,
    /// Attributes other than position and skin, in a fixed order.
    pub attributes: Vec<Attribute>,
    /// Joint influences, if the mesh is skinned.
    pub skin: Option<Skin>,
}

/// One vertex attribute: `width` floats for each vertex, vertex by vertex.
#[derive(Debug, Clone, PartialEq)]
pub struct Attribute {
    /// What the numbers mean, hence how they are interpolated and what an error in them costs.
    pub semantic: Semantic,
    /// Numbers a vertex.
    pub width: usize,
    /// `positions.len() * width` numbers. Zero for vertices of groups that do not have the attribute.
    pub values: Vec<f32>,
}

/// What an attribute means to the simplifier and the ruler.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Semantic {
    /// Unit normal, width 3.
    Normal,
    /// Unit tangent and handedness (±1), width 4.
    Tangent,
    /// Texture coordinates of the set given, width 2.
    TexCoord(u32),
    /// Colour of the set given, linear, width 3 or 4.
    Color(u32),
    /// Position displacement of the morph target given, object units, width 3.
    MorphPosition(u32),
    /// Displacement in the pose given ([`Pose::attribute`]), object units, width 3: counts like the position; levels do not have it.
    Pose(u32),
    /// Any other morph displacement (normal, tangent, UV, colour): interpolated.
    MorphOther(u32),
    /// Application data that may be interpolated.
    Generic,
    /// Application data that must not be interpolated (identifiers): taken from the dominant vertex.
    Id,
}

/// Joint influences: `influences` joints and weights for each vertex (4 for each glTF set).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Skin {
    /// Influences a vertex: 4, 8, …
    pub influences: usize,
    /// Joint indices; where the weight is 0 the joint is 0.
    pub joints: Vec<u16>,
    /// Weights ≥ 0 that sum to 1 over a vertex (to 0 for vertices of groups without a skin).
    pub weights: Vec<f32>,
}

/// The wedge of each vertex (`u32::MAX` for unused ones), and the first vertex of each wedge: as a surface numbers them.
pub(crate) fn source_wedges(mesh: &Mesh) -> (Vec<u32>, Vec<u32>) {
    let welded = weld::weld(mesh);
    (welded.wedge_of, welded.wedge_vertex)
}

impl Mesh {
    /// The group of triangle `t`.
    pub fn group(&self, t: usize) -> u32 {
        self.groups.get(t).copied().unwrap_or(0)
    }

    /// Whether some triangle is in another group than 0.
    pub(crate) fn has_groups(&self) -> bool {
        self.groups.iter().any(|group| *group > 0)
    }

    /// Length of the bounding box's diagonal over the vertices that triangles use, in object units; 0 for an empty mesh.
    pub fn diagonal(&self) -> f32 {
        let (lo, hi) = self.bounds();
        if lo.x > hi.x { 0.0 } else { lo.distance(hi) }
    }

    /// Lower and upper corner of the bounding box over the vertices that triangles use; `(+∞, −∞)` for an empty mesh.
    pub fn bounds(&self) -> (glam::Vec3, glam::Vec3) {
        let start = (glam::Vec3::INFINITY, glam::Vec3::NEG_INFINITY);
        self.triangles.iter().flatten().fold(start, |(lo, hi), &v| {
            let p = glam::Vec3::from(self.positions[v as usize]);
            (lo.min(p), hi.max(p))
        })
    }

    /// These vertices with all they have, without triangles.
    pub(crate) fn pick_vertices(&self, vertices: &[u32]) -> Self {
        fn pick<T: Copy>(values: &[T], width: usize, vertices: &[u32]) -> Vec<T> {
            vertices.iter().flat_map(|&v| &values[v as usize * width..][..width]).copied().collect()
        }
        let attribute = |a: &Attribute| Attribute { values: pick(&a.values, a.width, vertices), ..*a };
        let skin = |s: &Skin| Skin {
            influences: s.influences,
            joints: pick(&s.joints, s.influences, vertices),
            weights: pick(&s.weights, s.influences, vertices),
        };
        Self {
            positions: pick(&self.positions, 1, vertices),
            attributes: self.attributes.iter().map(attribute).collect(),
            skin: self.skin.as_ref().map(skin),
            ..Self::default()
        }
    }

    /// The attribute with this meaning, if the mesh has it.
    pub fn attribute(&self, semantic: Semantic) -> Option<&Attribute> {
        self.attributes.iter().find(|a| a.semantic == semantic)
    }
}
