//! A glTF mesh as one plain [`Mesh`]: its triangle primitives are the groups.

use crate::mesh::Mesh;

/// The triangle geometry of one glTF mesh and how it was stored.
#[derive(Debug, Clone)]
pub struct Geometry {
    /// All decodable triangle primitives (lists, strips, fans) as one mesh; group `g` is `primitives[g]`.
    /// Vertices of a primitive are consecutive, in its accessor order, primitive after primitive.
    pub mesh: Mesh,
    /// How each group was stored.
    pub primitives: Vec<PrimitiveLayout>,
    /// Primitives that are not in `mesh`: points, lines, compressed geometry.
    pub passed_over: Vec<PassedOver>,
}

/// A primitive that goes through unchanged.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PassedOver {
    /// Its index in the mesh.
    pub primitive: usize,
    /// Why, for the report: "points", "compressed with KHR_draco_mesh_compression".
    pub why: String,
    /// Whether the levels carry it over unchanged (points and lines) or the mesh gets no levels at all (compressed triangles).
    pub carried: bool,
}

/// How a primitive's vertices were stored, so that its levels can be stored likewise.
#[derive(Debug, Clone, PartialEq)]
pub struct PrimitiveLayout {
    /// Index into `meshes[m].primitives`.
    pub primitive: usize,
    /// Its vertices in the plain mesh.
    pub vertices: std::ops::Range<u32>,
    /// Its attributes, in the document's order, `POSITION` among them.
    pub attributes: Vec<AttributeLayout>,
    /// Its morph targets' attributes.
    pub targets: Vec<Vec<AttributeLayout>>,
}

/// How one attribute was stored.
#[derive(Debug, Clone, PartialEq)]
pub struct AttributeLayout {
    /// glTF name: `POSITION`, `TEXCOORD_0`, `_TEMPERATURE`.
    pub name: String,
    /// Component type.
    pub component: Component,
    /// Whether integers stand for [0, 1] or [−1, 1].
    pub normalized: bool,
    /// Element type.
    pub shape: Shape,
    /// Where its numbers are in the plain mesh.
    pub channel: Channel,
}

/// Where in a [`Mesh`] an attribute's numbers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// `mesh.positions`.
    Position,
    /// `mesh.attributes[i]`; of its `width` numbers the first `Shape::width()` count (a VEC3 colour in a mesh
    /// whose other primitive has VEC4 is widened with 1).
    Attribute(usize),
    /// `mesh.skin.joints`, influences `4·set..4·set+4`.
    Joints(usize),
    /// `mesh.skin.weights`, influences `4·set..4·set+4`.
    Weights(usize),
}

/// glTF component types.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Component {
    /// 5120
    I8 = 5120,
    /// 5121
    U8 = 5121,
    /// 5122
    I16 = 5122,
    /// 5123
    U16 = 5123,
    /// 5125
    U32 = 5125,
    /// 5126
    F32 = 5126,
}

/// glTF element types.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Shape {
    /// One number.
    Scalar,
    /// Two numbers.
    Vec2,
    /// Three numbers.
    Vec3,
    /// Four numbers.
    Vec4,
    /// Four numbers, column by column (columns of 1- and 2-byte components are padded to 4 bytes).
    Mat2,
    /// Nine numbers.
    Mat3,
    /// Sixteen numbers.
    Mat4,
}

impl Component {
    /// Bytes of one component.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// The component type with this glTF code.
    pub fn from_code(code: u64) -> Option<Self> {
        [Self::I8, Self::U8, Self::I16, Self::U16, Self::U32, Self::F32].into_iter().find(|c| *c as u64 == code)
    }
}

impl Shape {
    /// Numbers an element.
    pub fn width(self) -> usize {
        match self {
            Self::Scalar => 1,
            Self::Vec2 => 2,
            Self::Vec3 => 3,
            Self::Vec4 | Self::Mat2 => 4,
            Self::Mat3 => 9,
            Self::Mat4 => 16,
        }
    }

    /// glTF name: `VEC3`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scalar => "SCALAR",
            Self::Vec2 => "VEC2",
            Self::Vec3 => "VEC3",
            Self::Vec4 => "VEC4",
            Self::Mat2 => "MAT2",
            Self::Mat3 => "MAT3",
            Self::Mat4 => "MAT4",
        }
    }
}
