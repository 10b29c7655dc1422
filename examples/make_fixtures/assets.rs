//! Static meshes: attributes, materials, shapes that are hard to simplify, meshes that must be left alone.

use super::File;
use super::builder::{Builder, Component, Use};
use super::png::{checkerboard, encode};
use super::portable::noise;
use super::shape::Shape;
use super::surfaces::{bumpy_sphere, cube, gear, head, plant, rounded_box, terrain, thin_bowl, torus_knot};
use glam::DVec3;
use serde_json::json;

pub fn files() -> Vec<File> {
    vec![
        ("attributes/positions_only.glb", positions_only()),
        ("attributes/normals_and_seam.glb", normals_and_seam()),
        ("attributes/tangents.glb", tangents()),
        ("attributes/color_u8.glb", color_u8()),
        ("attributes/color_f32.glb", color_f32()),
        ("attributes/two_uv_sets.glb", two_uv_sets()),
        ("attributes/custom.glb", custom()),
        ("materials/two_primitives.glb", two_primitives()),
        ("materials/variants.glb", variants()),
        ("shapes/gear.glb", gear_with_hard_edges()),
        ("shapes/thin_bowl.glb", Builder::showing("Bowl", &thin_bowl(32, 14)).glb()),
        ("shapes/cube.glb", Builder::showing("Cube", &cube()).glb()),
        ("terrain/tile.glb", terrain_tile()),
        ("foliage/plant.glb", foliage_plant()),
        ("existing_lod/sphere.glb", sphere_with_levels()),
    ]
}

fn positions_only() -> Vec<u8> {
    let mut file = Builder::new();
    let primitive = file.bare_primitive(&torus_knot(12, 100).welded());
    file.show("Knot", primitive);
    file.glb()
}

fn normals_and_seam() -> Vec<u8> {
    let mut file = Builder::new();
    let mut primitive = file.primitive(&bumpy_sphere(48, 24, 0.25, 1));
    let picture = checkerboard(32, 8, [60, 70, 90, 255], [220, 215, 200, 255]);
    primitive["material"] = json!(file.textured_material("Stone", &picture));
    file.show("Boulder", primitive);
    file.glb()
}

fn tangents() -> Vec<u8> {
    let mut file = Builder::new();
    let shape = rounded_box(DVec3::new(1.0, 0.6, 0.8), 0.2, 11);
    let mut primitive = file.primitive(&shape);
    primitive["attributes"]["TANGENT"] = json!(file.floats(&shape.tangents()));
    let picture = encode(32, |x, y| if x % 8 == 0 || y % 8 == 0 { [128, 200, 220, 255] } else { [128, 128, 255, 255] });
    let view = file.view(&picture, Use::Other);
    let image = file.push("images", json!({"name": "grooves", "mimeType": "image/png", "bufferView": view}));
    let texture = file.push("textures", json!({"source": image}));
    let material = json!({"name": "Grooved", "normalTexture": {"index": texture, "scale": 0.5}});
    primitive["material"] = json!(file.push("materials", material));
    file.show("Crate", primitive);
    file.glb()
}

/// Normalised 8-bit RGBA, the painted stripes follow the height.
fn color_u8() -> Vec<u8> {
    let mut file = Builder::new();
    let shape = bumpy_sphere(40, 20, 0.15, 5);
    let mut primitive = file.primitive(&shape);
    let colors = shape.per_vertex(|p| {
        let shade = (127.5 + 127.5 * noise(p * 3.0, 9)) as u8;
        [shade, 255 - shade / 2, if p.y > 0.0 { 255 } else { 40 }, 255]
    });
    let view = file.view(colors.as_flattened(), Use::Vertices(4));
    let accessor = file.accessor(view, Component::U8, "VEC4", colors.len());
    file.amend_accessor(accessor, "normalized", json!(true));
    primitive["attributes"]["COLOR_0"] = json!(accessor);
    file.show("Marble", primitive);
    file.glb()
}

/// Float RGB, without normals.
fn color_f32() -> Vec<u8> {
    let mut file = Builder::new();
    let shape = torus_knot(10, 80).welded();
    let mut primitive = file.bare_primitive(&shape);
    let colors = shape.per_vertex(|p| [0.5 + 0.4 * noise(p, 2), 0.5 + 0.4 * noise(p, 3), 0.5].map(|c| c as f32));
    primitive["attributes"]["COLOR_0"] = json!(file.floats(&colors));
    file.show("Painted knot", primitive);
    file.glb()
}

/// The second set unfolds the shape from above, as lightmaps do, with seams in other places than the first.
fn two_uv_sets() -> Vec<u8> {
    let mut file = Builder::new();
    let shape = rounded_box(DVec3::ONE, 0.4, 10);
    let mut primitive = file.primitive(&shape);
    let second =
        shape.per_vertex(|p| [0.25 + 0.2 * p.x + if p.y > 0.0 { 0.5 } else { 0.0 }, 0.5 + 0.4 * p.z].map(|c| c as f32));
    primitive["attributes"]["TEXCOORD_1"] = json!(file.floats(&second));
    let picture = checkerboard(16, 4, [200, 120, 60, 255], [240, 230, 210, 255]);
    let material = file.textured_material("Painted", &picture);
    file.root()["materials"][material]["occlusionTexture"] = json!({"index": 0, "texCoord": 1});
    primitive["material"] = json!(material);
    file.show("Die", primitive);
    file.glb()
}

/// A measured quantity that may be interpolated and an identifier that may not (16 bits in a stride of 4).
fn custom() -> Vec<u8> {
    let mut file = Builder::new();
    let shape = bumpy_sphere(36, 18, 0.2, 7);
    let mut primitive = file.primitive(&shape);
    let temperature = shape.per_vertex(|p| [(20.0 + 15.0 * p.y) as f32]);
    primitive["attributes"]["_TEMPERATURE"] = json!(file.floats(&temperature));
    let ids = shape.per_vertex(|p| [u16::from(p.x > 0.0) + 2 * u16::from(p.z > 0.3), 0]);
    let bytes: Vec<u8> = ids.as_flattened().iter().flat_map(|id| id.to_le_bytes()).collect();
    let view = file.view(&bytes, Use::Vertices(4));
    primitive["attributes"]["_FEATURE_ID_0"] = json!(file.accessor(view, Component::U16, "SCALAR", ids.len()));
    file.show("Sensor", primitive);
    file.glb()
}

/// A closed surface in two materials: its wavy border must not open at any level.
fn two_primitives() -> Vec<u8> {
    let mut file = Builder::new();
    let (upper, lower) = bumpy_sphere(48, 30, 0.12, 11).split(|p| p.y > 0.3 * noise(p * 3.0, 4));
    let mut primitives = [file.primitive(&upper), file.primitive(&lower)];
    primitives[0]["material"] = json!(file.material("Snow", [0.9, 0.9, 0.95, 1.0]));
    primitives[1]["material"] = json!(file.material("Rock", [0.3, 0.28, 0.25, 1.0]));
    let mesh = file.mesh("Summit", &primitives);
    let node = file.push("nodes", json!({"name": "Summit", "mesh": mesh}));
    file.scene(&[node]);
    file.glb()
}

fn variants() -> Vec<u8> {
    let mut file = Builder::new();
    let mut primitive = file.primitive(&head(32, 24));
    let bronze = file.material("Bronze", [0.5, 0.3, 0.1, 1.0]);
    let marble = file.material("Marble", [0.9, 0.88, 0.85, 1.0]);
    file.uses("KHR_materials_variants");
    let names = json!([{"name": "bronze"}, {"name": "marble"}]);
    file.root()["extensions"] = json!({"KHR_materials_variants": {"variants": names}});
    primitive["material"] = json!(bronze);
    let mappings = json!([{"material": bronze, "variants": [0]}, {"material": marble, "variants": [1]}]);
    primitive["extensions"] = json!({"KHR_materials_variants": {"mappings": mappings}});
    file.show("Bust", primitive);
    file.glb()
}

/// Off the lathe: all edges hard, so that most vertices are doubled.
fn gear_with_hard_edges() -> Vec<u8> {
    let mut file = Builder::new();
    let mut primitive = file.primitive(&gear(14));
    primitive["material"] = json!(file.material("Steel", [0.6, 0.6, 0.62, 1.0]));
    file.show("Gear", primitive);
    file.glb()
}

fn terrain_tile() -> Vec<u8> {
    let mut file = Builder::new();
    let mut primitive = file.primitive(&terrain(32, 0.3, 21));
    let picture = checkerboard(32, 16, [70, 90, 50, 255], [100, 110, 70, 255]);
    primitive["material"] = json!(file.textured_material("Grass", &picture));
    file.show("Terrain_0_0", primitive);
    file.glb()
}

fn foliage_plant() -> Vec<u8> {
    let mut file = Builder::new();
    let mut primitive = file.primitive(&plant(60, 6));
    let leaf = encode(32, |x, y| {
        let from_middle = (2 * x + 1).abs_diff(32);
        [60, 130, 50, if from_middle <= 32 - y { 255 } else { 0 }]
    });
    let material = file.textured_material("Leaf", &leaf);
    file.root()["materials"][material]["alphaMode"] = json!("MASK");
    file.root()["materials"][material]["doubleSided"] = json!(true);
    primitive["material"] = json!(material);
    file.show("Plant", primitive);
    file.glb()
}

/// Levels made by hand: they must survive.
fn sphere_with_levels() -> Vec<u8> {
    let mut file = Builder::new();
    let level = |file: &mut Builder, name: &str, shape: Shape| {
        let primitive = file.primitive(&shape);
        let mesh = file.mesh(name, &[primitive]);
        file.push("nodes", json!({"name": name, "mesh": mesh}))
    };
    let finest = level(&mut file, "Planet", bumpy_sphere(32, 16, 0.1, 31));
    let ids = [
        level(&mut file, "Planet_LOD1", bumpy_sphere(16, 8, 0.1, 31)),
        level(&mut file, "Planet_LOD2", bumpy_sphere(8, 4, 0.1, 31)),
    ];
    file.uses("MSFT_lod");
    file.root()["nodes"][finest]["extensions"] = json!({"MSFT_lod": {"ids": ids}});
    file.root()["nodes"][finest]["extras"] = json!({"MSFT_screencoverage": [0.4, 0.1, 0.01]});
    file.scene(&[finest]);
    file.glb()
}
