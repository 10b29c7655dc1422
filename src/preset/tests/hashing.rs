//! What counts as the same settings.

use super::*;

#[test]
fn the_hash_is_of_what_is_said_not_of_how() {
    let hash = |files: &[(&str, &str)]| read(files, "a/x.glb").hash();
    let plain = hash(&[("gltf-lod.toml", "screen_height = 720\npixel_tolerance = 2")]);
    assert_eq!(plain.len(), 64);
    for same in [
        &[("gltf-lod.toml", "# as JSON\npixel_tolerance   = 2.0\nscreen_height = 7_20 # phone")][..],
        &[("gltf-lod.toml", "screen_height = 1\npixel_tolerance = 2"), ("a/gltf-lod.toml", "screen_height = 720")],
        &[("gltf-lod.toml", "screen_height = 720\npixel_tolerance = 2\n[[rule]]\npath = 'b/**'\nskip = true")],
        &[("gltf-lod.toml", "[[rule]]\npath = 'a/**'\nscreen_height = 720\npixel_tolerance = 2")],
        &[("gltf-lod.toml", "extends = 'm'\n[preset.m]\nscreen_height = 720\npixel_tolerance = 2")],
    ] {
        assert_eq!(hash(same), plain, "{same:?}");
    }
    for other in [
        "screen_height = 720",
        "screen_height = 720\npixel_tolerance = 3",
        "screen_height = 720\npixel_tolerance = 2\n[[rule]]\nmesh = 'b'\nskip = true",
        "screen_height = 720\npixel_tolerance = 2\n[[rule]]\nnode = 'b'\nskip = true",
    ] {
        assert_ne!(hash(&[("gltf-lod.toml", other)]), plain, "{other}");
    }
}

#[test]
fn effective_settings_read_back_as_a_preset() {
    let text = "levels = [0.5, { error = '0.5%' }]\nsplit_factor = 0\n[gates]\nmax_error = 3\n[[rule]]\nmesh = 'm'\nskip = true";
    let effective = read(&[("gltf-lod.toml", text)], "x.glb").effective(&mesh("m")).unwrap();
    assert_eq!(effective["levels"], serde_json::json!([{ "ratio": 0.5 }, { "error": "0.5%" }]));
    assert_eq!(effective["split_factor"], false);
    assert_eq!(effective["skip"], true);
    assert_eq!(effective["gates"]["max_error"], serde_json::json!({ "value": 3.0, "on": "fail" }));
    let again = toml::to_string(&effective).unwrap();
    let reread = read(&[("gltf-lod.toml", &format!("extends = 'mobile'\n{again}"))], "x.glb");
    assert_eq!(reread.effective(&MeshNames::default()).unwrap(), effective);
}
