//! Meshes: what each attribute may be, and that the attributes of a primitive belong together.

use super::Document;
use crate::asset::accessor::Header;
use crate::asset::cursor::Cursor;
use crate::asset::geometry::{Component, Shape};
use crate::error::Result;
use Component::{F32, I8, I16, U8, U16, U32};

/// A component type and whether it is normalised.
type Format = (Component, bool);

/// What an attribute may be. glTF 2.0 §3.7.2.1 and KHR_mesh_quantization.
struct Rule {
    /// Name, or its beginning where a set number follows.
    name: &'static str,
    shapes: &'static [Shape],
    core: &'static [Format],
    /// Clear to every reader though not core: KHR_mesh_quantization, and colours that lack `normalized`.
    tolerated: &'static [Format],
}

const FLOAT: Format = (F32, false);
const UNORM: [Format; 3] = [FLOAT, (U8, true), (U16, true)];
const SNORM: [Format; 2] = [(I8, true), (I16, true)];
const QUANTIZED: [Format; 8] =
    [(I8, false), (I8, true), (U8, false), (U8, true), (I16, false), (I16, true), (U16, false), (U16, true)];

const RULES: [Rule; 7] = [
    Rule { name: "POSITION", shapes: &[Shape::Vec3], core: &[FLOAT], tolerated: &QUANTIZED },
    Rule { name: "NORMAL", shapes: &[Shape::Vec3], core: &[FLOAT], tolerated: &SNORM },
    Rule { name: "TANGENT", shapes: &[Shape::Vec4], core: &[FLOAT], tolerated: &SNORM },
    Rule { name: "TEXCOORD_", shapes: &[Shape::Vec2], core: &UNORM, tolerated: &QUANTIZED },
    Rule { name: "COLOR_", shapes: &[Shape::Vec3, Shape::Vec4], core: &UNORM, tolerated: &[(U8, false), (U16, false)] },
    Rule { name: "JOINTS_", shapes: &[Shape::Vec4], core: &[(U8, false), (U16, false)], tolerated: &[] },
    Rule { name: "WEIGHTS_", shapes: &[Shape::Vec4], core: &UNORM, tolerated: &[] },
];

pub(super) fn check_mesh(document: &Document, mesh: &Cursor) -> Result<()> {
    mesh.object()?;
    let primitives = mesh.need("primitives")?;
    let mut targets = None;
    for primitive in primitives.elements()? {
        check_primitive(document, &primitive)?;
        let found = primitive.get("targets").map_or(Ok(0), |t| t.elements().map(|t| t.len()))?;
        let first = *targets.get_or_insert(found);
        if found != first {
            let message = format!("{found} morph targets, but the mesh's first primitive has {first}");
            return Err(primitive.error(message).help("all primitives of a mesh share its morph weights"));
        }
    }
    Ok(())
}

fn check_primitive(document: &Document, primitive: &Cursor) -> Result<()> {
    primitive.object()?;
    if let Some(mode) = primitive.get("mode")
        && mode.value.as_u64().is_none_or(|m| m > 6)
    {
        return Err(mode.expected("a primitive mode from 0 to 6"));
    }
    document.check_index(primitive, "material", "materials")?;
    check_extensions(document, primitive)?;
    check_indices(document, primitive)?;
    let mut count = None;
    let attributes = primitive.need("attributes")?;
    for (name, index) in attributes.members()? {
        check_attribute(document, name, &index, false, &mut count)?;
    }
    check_skinning(&attributes)?;
    for target in primitive.get("targets").map(|t| t.elements()).transpose()?.into_iter().flatten() {
        for (name, index) in target.members()? {
            check_attribute(document, name, &index, true, &mut count)?;
        }
    }
    Ok(())
}

fn check_indices(document: &Document, primitive: &Cursor) -> Result<()> {
    let Some(indices) = document.check_index(primitive, "indices", "accessors")? else { return Ok(()) };
    let Some(header) = header(document, indices) else { return Ok(()) };
    if header.shape == Shape::Scalar && matches!(header.component, U8 | U16 | U32) {
        return Ok(());
    }
    let found = show(&header);
    Err(primitive.error(format!("indices must be SCALAR of 5121, 5123 or 5125; accessors[{indices}] is {found}")))
}

fn check_attribute(
    document: &Document,
    name: &str,
    index: &Cursor,
    target: bool,
    count: &mut Option<usize>,
) -> Result<()> {
    let accessor = index.index("accessors", document.length("accessors"))?;
    let Some(header) = header(document, accessor) else { return Ok(()) };
    let first = *count.get_or_insert(header.count);
    if header.count != first {
        let message = format!("{} elements, but the primitive's first attribute has {first}", header.count);
        return Err(index.error(message));
    }
    let Some(rule) = RULES.iter().find(|rule| rule.applies(name)) else { return Ok(()) };
    if target { rule.check_target(&header, index) } else { rule.check(document, &header, index) }
}

impl Rule {
    fn applies(&self, name: &str) -> bool {
        match self.name.strip_suffix('_') {
            None => name == self.name,
            Some(_) => name.strip_prefix(self.name).is_some_and(|set| set.parse::<u32>().is_ok()),
        }
    }

    fn check(&self, document: &Document, header: &Header, index: &Cursor) -> Result<()> {
        let format = (header.component, header.normalized && header.component != F32);
        let known = self.core.contains(&format) || self.tolerated.contains(&format);
        if !known || !self.shapes.contains(&header.shape) {
            let shapes: Vec<_> = self.shapes.iter().map(|s| s.name()).collect();
            let types: Vec<_> = self.core.iter().map(|(c, n)| show_format(*c, *n)).collect();
            let (shapes, types) = (shapes.join(" or "), types.join(", "));
            return Err(index.error(format!("expected {shapes} of {types}; found {}", show(header))));
        }
        if !self.core.contains(&format) && !document.uses("KHR_mesh_quantization") {
            let message = format!("{} is not core glTF 2.0 and KHR_mesh_quantization is not declared", show(header));
            document.warn(index.error(message).help("it is read as stored"));
        }
        Ok(())
    }

    /// Displacements: signed and unsigned types of any width; a tangent's has no handedness.
    fn check_target(&self, header: &Header, index: &Cursor) -> Result<()> {
        let shapes = if self.name == "TANGENT" { &[Shape::Vec3][..] } else { self.shapes };
        if shapes.contains(&header.shape) && header.component != U32 {
            return Ok(());
        }
        let shapes: Vec<_> = shapes.iter().map(|s| s.name()).collect();
        Err(index.error(format!("a displacement must be {}; found {}", shapes.join(" or "), show(header))))
    }
}

/// Joints without weights, or weights without joints, move a vertex nowhere that is known.
fn check_skinning(attributes: &Cursor) -> Result<()> {
    for (name, other) in [("JOINTS_", "WEIGHTS_"), ("WEIGHTS_", "JOINTS_")] {
        for (attribute, _) in attributes.members()? {
            let Some(set) = attribute.strip_prefix(name) else { continue };
            if attributes.get(&format!("{other}{set}")).is_none() {
                return Err(attributes.error(format!("{name}{set} without {other}{set}")));
            }
        }
    }
    Ok(())
}

fn check_extensions(document: &Document, primitive: &Cursor) -> Result<()> {
    if let Some(draco) = primitive.extension("KHR_draco_mesh_compression") {
        draco.need("bufferView")?.index("bufferViews", document.length("bufferViews"))?;
    }
    let Some(variants) = primitive.extension("KHR_materials_variants") else { return Ok(()) };
    let Some(mappings) = variants.get("mappings") else { return Ok(()) };
    for mapping in mappings.elements()? {
        document.check_index(&mapping, "material", "materials")?;
    }
    Ok(())
}

fn header(document: &Document, accessor: usize) -> Option<Header> {
    Header::parse(&document.top("accessors", accessor)?).ok()
}

fn show(header: &Header) -> String {
    format!("{} of {}", header.shape.name(), show_format(header.component, header.normalized))
}

fn show_format(component: Component, normalized: bool) -> String {
    let name = match component {
        I8 => "BYTE",
        U8 => "UNSIGNED_BYTE",
        I16 => "SHORT",
        U16 => "UNSIGNED_SHORT",
        U32 => "UNSIGNED_INT",
        F32 => "FLOAT",
    };
    if normalized { format!("normalized {name}") } else { name.to_owned() }
}

#[cfg(test)]
mod tests {
    use crate::asset::check::{Findings, check};
    use serde_json::{Value, json};

    fn run(primitive: Value) -> Findings {
        let accessor = |component: u32, shape: &str, normalized: bool, count: usize| json!({"componentType": component, "type": shape, "normalized": normalized, "count": count});
        check(&json!({
            "asset": {"version": "2.0"},
            "accessors": [
                accessor(5126, "VEC3", false, 3), accessor(5122, "VEC3", false, 3), accessor(5125, "VEC3", false, 3),
                accessor(5123, "SCALAR", false, 3), accessor(5126, "SCALAR", false, 3), accessor(5126, "VEC3", false, 4),
                accessor(5121, "VEC4", false, 3), accessor(5126, "VEC4", false, 3), accessor(5120, "VEC3", false, 3),
            ],
            "meshes": [{"primitives": [primitive]}],
        }))
    }

    fn problem(primitive: Value) -> Option<String> {
        run(primitive).problems.first().map(ToString::to_string)
    }

    #[test]
    fn attributes_have_the_types_of_their_semantic() {
        let with = |name: &str, accessor: usize| problem(json!({"attributes": {name: accessor}}));
        assert_eq!(with("POSITION", 0), None);
        assert_eq!(
            with("POSITION", 2).unwrap(),
            "/meshes/0/primitives/0/attributes/POSITION: expected VEC3 of FLOAT; found VEC3 of UNSIGNED_INT"
        );
        assert!(with("POSITION", 4).unwrap().contains("found SCALAR of FLOAT"));
        assert!(with("NORMAL", 8).unwrap().contains("found VEC3 of BYTE"));
        assert!(with("TEXCOORD_1", 0).unwrap().contains("expected VEC2"));
        assert_eq!(with("TEXCOORD_X", 0), None, "unknown names are left alone");
        assert_eq!(with("_ANY", 2), None);
        assert!(with("JOINTS_0", 6).unwrap().ends_with("JOINTS_0 without WEIGHTS_0"));
        assert!(with("JOINTS_0", 7).unwrap().contains("expected VEC4 of UNSIGNED_BYTE, UNSIGNED_SHORT"));
    }

    #[test]
    fn quantised_positions_without_the_extension_are_a_warning() {
        let findings = run(json!({"attributes": {"POSITION": 1}}));
        assert!(findings.problems.is_empty());
        assert!(findings.warnings[0].to_string().contains("VEC3 of SHORT is not core glTF 2.0"));
    }

    #[test]
    fn a_primitive_is_consistent() {
        let base = |more: Value| {
            let mut primitive = json!({"attributes": {"POSITION": 0}});
            primitive.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
            problem(primitive)
        };
        assert_eq!(base(json!({"indices": 3, "mode": 5})), None);
        assert!(base(json!({"indices": 4})).unwrap().contains("accessors[4] is SCALAR of FLOAT"));
        assert!(base(json!({"mode": 7})).unwrap().contains("expected a primitive mode from 0 to 6, found 7"));
        assert!(base(json!({"material": 0})).unwrap().contains("the document has no materials"));
        assert!(base(json!({"targets": [{"POSITION": 5}]})).unwrap().contains("4 elements, but"));
        assert!(base(json!({"targets": [{"TANGENT": 7}]})).unwrap().contains("a displacement must be VEC3"));
    }

    #[test]
    fn primitives_of_a_mesh_have_the_same_number_of_targets() {
        let root = json!({"asset": {"version": "2.0"}, "meshes": [{"primitives": [
            {"attributes": {}, "targets": [{}, {}]}, {"attributes": {}, "targets": [{}]}]}]});
        let message = check(&root).problems[0].to_string();
        assert!(message.starts_with("/meshes/0/primitives/1: 1 morph targets, but"), "{message}");
    }
}
