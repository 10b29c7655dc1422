//! A glTF mesh as one plain [`Mesh`]: its triangle primitives are the groups.

use super::accessor::{Reader, compression};
use super::cursor::Cursor;
use super::merge::{Joints, Part, Source, merge};
use super::primitive::Mode;
use super::{Asset, Document, Limits};
use crate::error::{Error, Kind, Result};
use crate::mesh::Mesh;
use serde_json::Value;

/// The triangle geometry of one glTF mesh and how it was stored.
#[derive(Debug, Clone)]
pub struct Geometry {
    /// All decodable triangle primitives (lists, strips, fans) as one mesh; group `g` is `primitives[g]`.
    /// Vertices of a primitive are consecutive, in its accessors' order, primitive after primitive; elements that no
    /// triangle uses are left out, so that many primitives over one large vertex buffer cost only what each draws.
    pub mesh: Mesh,
    /// How each group was stored.
    pub primitives: Vec<PrimitiveLayout>,
    /// Primitives that are not in `mesh`: points, lines, compressed geometry.
    pub passed_over: Vec<PassedOver>,
    /// What was put right on the way: numbers that are not finite, indices that make no triangle.
    pub warnings: Vec<Error>,
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
    /// Its vertices in the plain mesh: those elements of its accessors that its triangles use.
    pub vertices: std::ops::Range<u32>,
    /// The element of its accessors that each of those vertices is, ascending; `None` if they are all elements in order.
    pub elements: Option<Vec<u32>>,
    /// Its attributes, in the document's order, `POSITION` among them.
    pub attributes: Vec<AttributeLayout>,
    /// Its morph targets' attributes.
    pub targets: Vec<Vec<AttributeLayout>>,
}

impl PrimitiveLayout {
    /// The element of its accessors that a vertex of the plain mesh, one of [`Self::vertices`], is.
    pub fn element(&self, vertex: u32) -> u32 {
        let index = vertex.saturating_sub(self.vertices.start);
        match &self.elements {
            Some(elements) => elements.get(index as usize).copied().unwrap_or(index),
            None => index,
        }
    }
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
    /// `mesh.skin.joints`, influences `4·set..4·set+4`; sets are counted in the order of their numbers.
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

    /// The element type of this glTF name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Scalar, Self::Vec2, Self::Vec3, Self::Vec4, Self::Mat2, Self::Mat3, Self::Mat4]
            .into_iter()
            .find(|shape| shape.name() == name)
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

/// The triangle primitives of `meshes[index]`; `balance` puts their weights right.
pub(super) fn read(asset: &Asset, index: usize, balance: bool, limits: &Limits) -> Result<Geometry> {
    let root = asset.document.root();
    let Some(mesh) = Cursor::top(root, "meshes", index) else {
        return Err(Error::new(Kind::Internal, format!("there is no meshes[{index}]")));
    };
    let mut parts = Vec::new();
    let mut passed_over = Vec::new();
    for (primitive, object) in mesh.need("primitives")?.elements()?.enumerate() {
        match find_obstacle(asset, &object) {
            Some((why, carried)) => passed_over.push(PassedOver { primitive, why, carried }),
            None => parts.push(open_part(asset, primitive, &object)?),
        }
    }
    let skinned = parts.iter().flat_map(|part| &part.attributes).any(|source| source.name.starts_with("JOINTS_"));
    let joints = if skinned { find_joints(&asset.document, index) } else { None };
    let mut geometry = merge(&parts, passed_over, joints, balance, limits)?;
    geometry.warnings = geometry.warnings.into_iter().map(|warning| warning.in_file(&asset.path)).collect();
    Ok(geometry)
}

/// Why a primitive is passed over, if it is, and whether levels carry it unchanged.
fn find_obstacle(asset: &Asset, primitive: &Cursor) -> Option<(String, bool)> {
    if let Err(what) = Mode::of(mode(primitive)) {
        return Some((what.to_owned(), true));
    }
    let accessors = list_accessors(primitive);
    let compressed = || {
        let compression = |&accessor: &usize| compression(asset.document.root(), &asset.buffers, accessor);
        accessors.iter().find_map(compression).or_else(|| draco(asset, primitive, &accessors))
    };
    if let Some(extension) = compressed() {
        return Some((format!("compressed with {extension}"), false));
    }
    let Some(positions) = index(primitive.get("attributes").and_then(|a| a.get("POSITION"))) else {
        return Some(("without positions".to_owned(), true));
    };
    let corners = count(asset, index(primitive.get("indices")).unwrap_or(positions));
    let mode = Mode::of(mode(primitive)).ok()?;
    (mode.triangles(corners) == 0).then(|| ("without triangles".to_owned(), true))
}

/// Draco data stands beside the accessors; where all of those have data of their own, that is what is read.
fn draco(asset: &Asset, primitive: &Cursor, accessors: &[usize]) -> Option<&'static str> {
    const NAME: &str = "KHR_draco_mesh_compression";
    primitive.extension(NAME)?;
    let objects = asset.document.array("accessors");
    let bare = |&a: &usize| objects.get(a).is_none_or(|o| o.get("bufferView").is_none() && o.get("sparse").is_none());
    accessors.iter().any(bare).then_some(NAME)
}

fn mode(primitive: &Cursor) -> u64 {
    primitive.get("mode").and_then(|mode| mode.value.as_u64()).unwrap_or(4)
}

fn index(cursor: Option<Cursor>) -> Option<usize> {
    cursor?.integer().ok()
}

fn count(asset: &Asset, accessor: usize) -> usize {
    let accessor = Cursor::top(asset.document.root(), "accessors", accessor);
    index(accessor.and_then(|a| a.get("count"))).unwrap_or(0)
}

/// All accessors that a primitive names.
fn list_accessors(primitive: &Cursor) -> Vec<usize> {
    let targets = primitive.get("targets").and_then(|t| t.elements().ok()).into_iter().flatten();
    let sets = primitive.get("attributes").into_iter().chain(targets);
    let attributes = sets.filter_map(|set| set.members().ok()).flatten().map(|(_, index)| index);
    attributes.chain(primitive.get("indices")).filter_map(|i| index(Some(i))).collect()
}

fn open_part<'a>(asset: &'a Asset, primitive: usize, object: &Cursor) -> Result<Part<'a>> {
    let root = asset.document.root();
    let open = |accessor: usize| Reader::open(root, &asset.buffers, accessor);
    let open_sources = |set: &Cursor| -> Result<Vec<Source<'a>>> {
        let sources = set.members()?.map(|(name, index)| {
            Ok(Source { name: name.to_owned(), reader: open(index.integer()?)?, place: index.place })
        });
        sources.collect()
    };
    let attributes = object.need("attributes")?;
    let targets = object.get("targets").map(|t| t.elements()).transpose()?.into_iter().flatten();
    Ok(Part {
        primitive,
        place: object.place.clone(),
        mode: Mode::of(mode(object)).unwrap_or(Mode::List),
        indices: index(object.get("indices")).map(open).transpose()?,
        count: count(asset, attributes.need("POSITION")?.integer()?),
        attributes: open_sources(&attributes)?,
        targets: targets.map(|target| open_sources(&target)).collect::<Result<_>>()?,
    })
}

/// The smallest of the skins that nodes with this mesh have.
fn find_joints(document: &Document, mesh: usize) -> Option<Joints> {
    let number = |node: &Value, name: &str| node.get(name).and_then(Value::as_u64);
    let nodes = document.array("nodes").iter().filter(|node| number(node, "mesh") == Some(mesh as u64));
    let joints = nodes.filter_map(|node| {
        let skin = usize::try_from(number(node, "skin")?).ok()?;
        let count = document.array("skins").get(skin)?.get("joints")?.as_array()?.len();
        Some(Joints { skin, count })
    });
    joints.min_by_key(|joints| joints.count)
}
