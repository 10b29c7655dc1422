//! Levels have the triangles that were asked for, stay closed, and carry attributes that make sense.

mod support;

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::LazyLock;
use support::lod_rules::{drawing_node, level_ids, mesh_of, new_roots};
use support::reader::Gltf;
use support::surface::{bounds, open_edges, volume};
use support::{Build, assets_below, build_shared, fixtures, index, items, report_of};

/// A level as it stands in the written file.
struct Level {
    /// LOD0's mesh and this level's.
    meshes: [usize; 2],
    /// 1 for the finest generated level.
    level: usize,
    /// Joints of the skin; 0 without one.
    joints: usize,
}

#[test]
fn every_level_meets_its_target_or_says_what_stopped_it() {
    let build = steep_levels();
    let mut met = 0;
    for (relative, mesh) in meshes_of(build, &fixtures()) {
        let source = index(&mesh["triangles"]);
        let mut above = source;
        for level in items(&mesh["levels"]) {
            let (triangles, target) = (index(&level["triangles"]), &level["target"]);
            let wanted = target["ratio"]
                .as_f64()
                .map(|ratio| (ratio * source as f64).round())
                .expect("the settings ask for ratios");
            match level["stop"].as_str() {
                Some("target") => {
                    assert!((triangles as f64 - wanted).abs() <= 1.0, "{relative}: {triangles} triangles for {wanted}");
                    met += 1;
                }
                Some("stuck") => {
                    let refusals: u64 =
                        level["refusals"].as_object().expect("an object").values().filter_map(Value::as_u64).sum();
                    assert!(
                        triangles as f64 > wanted && refusals > 0,
                        "{relative}: stuck at {triangles} without a cause"
                    );
                }
                other => panic!("{relative}: stopped by {other:?} although only ratios were given"),
            }
            assert!(triangles < above, "{relative}: {triangles} triangles after {above}");
            above = triangles;
        }
    }
    assert!(met >= 90, "only {met} levels met their targets");
}

#[test]
fn seams_and_facets_do_not_keep_a_mesh_from_its_targets() {
    let build = steep_levels();
    for name in
        ["storage/non_indexed_facets.glb", "shapes/gear.glb", "attributes/tangents.glb", "materials/two_primitives.glb"]
    {
        let mesh = &report_of(&build.report, Path::new(name))["meshes"][0];
        let stops: Vec<_> =
            items(&mesh["levels"]).iter().map(|level| level["stop"].as_str().unwrap_or_default()).collect();
        assert_eq!(stops, ["target"; 4], "{name}");
    }
}

#[test]
fn closed_surfaces_stay_closed_at_every_level() {
    let build = steep_levels();
    let mut closed = BTreeSet::new();
    for relative in assets_below(&fixtures()) {
        let (output, levels) = levels_of(build, &relative);
        for Level { meshes: [finest, level], level: number, .. } in levels {
            let (before, after) = (output.mesh_triangles(finest), output.mesh_triangles(level));
            if open_edges(&before) > 0 {
                continue;
            }
            let place = format!("{} level {number}", relative.display());
            assert_eq!(open_edges(&after), 0, "{place} has gaps");
            assert!(
                volume(&after) / volume(&before) > 0.8,
                "{place} lost its volume: {}",
                volume(&after) / volume(&before)
            );
            closed.insert(relative.clone());
        }
    }
    for name in ["materials/two_primitives.glb", "storage/strip_and_fans.glb", "storage/non_indexed_facets.glb"] {
        assert!(closed.contains(Path::new(name)), "{name} was not judged");
    }
}

/// Mean and largest distance together, and all levels one by one: small meshes are where chance could make more effort worse.
#[test]
fn each_effort_is_at_least_as_near_as_those_below() {
    let efforts = ["fast", "best"].map(|effort| {
        build_shared(&format!("quality-{effort}"), &fixtures(), &["--config", STEEP, "--effort", effort])
    });
    let builds = [expect_success(&efforts[0]), steep_levels(), expect_success(&efforts[1])];
    for (below, above) in [(0, 1), (0, 2), (1, 2)] {
        let (mut sum, mut count) = (0.0, 0);
        for ((name, below), (_, above)) in
            meshes_of(builds[below], &fixtures()).iter().zip(meshes_of(builds[above], &fixtures()))
        {
            for (below, above) in items(&below["levels"]).iter().zip(items(&above["levels"])) {
                let off = |level: &Value, figure: &str| level["error"][figure].as_f64().expect("a number");
                // What is off by less than this is rounding.
                let both = |level| (off(level, "rms_percent").powi(2) * off(level, "hausdorff_percent")).max(1e-9);
                let ratio = both(above) / both(below);
                assert!(ratio < 1.2, "{name} level {}: {ratio}", above["level"]);
                sum += ratio.ln();
                count += 1;
            }
        }
        let mean = (sum / f64::from(count)).exp();
        assert!(count > 100 && mean < 0.9, "{count} levels: {mean}");
    }
}

#[test]
fn two_materials_share_their_border_at_every_level() {
    let build = steep_levels();
    let (output, levels) = levels_of(build, Path::new("materials/two_primitives.glb"));
    assert_eq!(levels.len(), 4);
    for Level { meshes: [_, level], .. } in levels {
        let parts: Vec<_> =
            items(&output.list("meshes")[level]["primitives"]).iter().map(|p| output.triangles(p)).collect();
        assert_eq!(parts.len(), 2);
        // Each half is open along the border, the whole is not: so they meet there vertex by vertex.
        assert!(parts.iter().all(|part| open_edges(part) > 0));
        assert_eq!(open_edges(&parts.concat()), 0);
    }
}

#[test]
fn report_agrees_with_the_files() {
    let build = own_levels();
    for relative in assets_below(&fixtures()) {
        let (output, levels) = levels_of(build, &relative);
        let meshes = items(&report_of(&build.report, &relative)["meshes"]);
        for Level { meshes: [finest, level], level: number, .. } in levels {
            let mesh = meshes.iter().find(|mesh| index(&mesh["mesh"]) == finest).expect("the mesh is in the report");
            let stated = &mesh["levels"][number - 1];
            let place = format!("{} level {number}", relative.display());
            assert_eq!(index(&stated["triangles"]), output.mesh_triangles(level).len(), "{place}");
            assert_eq!(stated["gap_edges"], 0, "{place}");
            let coverage = items(&mesh["coverage"]);
            assert!(coverage.windows(2).all(|pair| pair[0].as_f64() > pair[1].as_f64()), "{place}: {coverage:?}");
            let errors = ["hausdorff", "rms", "mean"].map(|key| stated["error"][key].as_f64().expect("a number"));
            assert!(errors[0] >= errors[1] && errors[1] >= errors[2] && errors[2] >= 0.0, "{place}: {errors:?}");
            stays_within(&output, finest, level, errors[0], &place);
        }
    }
}

#[test]
fn attributes_of_levels_stay_in_their_domains() {
    let build = own_levels();
    let mut judged = BTreeSet::new();
    for relative in assets_below(&fixtures()) {
        let (output, levels) = levels_of(build, &relative);
        for Level { meshes: [finest, level], level: number, joints } in levels {
            let place = format!("{} level {number}", relative.display());
            for primitive in items(&output.list("meshes")[level]["primitives"]) {
                for (name, accessor) in primitive["attributes"].as_object().expect("an object") {
                    let values = output.elements(index(accessor));
                    let sources = values_of(&output, finest, name);
                    judge_attribute(name, &values, &sources, joints, &place);
                    judged.insert(name.clone());
                }
                judge_weights(&output, primitive, &place);
            }
        }
    }
    for name in ["NORMAL", "TANGENT", "TEXCOORD_1", "COLOR_0", "JOINTS_1", "WEIGHTS_1", "_TEMPERATURE", "_FEATURE_ID_0"]
    {
        assert!(judged.contains(name), "{name} was not judged");
    }
}

#[test]
fn morph_targets_still_move_the_same_way() {
    let build = own_levels();
    let (output, levels) = levels_of(build, Path::new("morph/talking_head.glb"));
    let extent = |mesh: usize, target: usize| {
        let primitive = &output.list("meshes")[mesh]["primitives"][0];
        let moves = output.elements(index(&primitive["targets"][target]["POSITION"]));
        moves.iter().flatten().fold(0.0_f64, |largest, x| largest.max(x.abs()))
    };
    for Level { meshes: [finest, level], .. } in levels {
        for target in 0..3 {
            let (before, after) = (extent(finest, target), extent(level, target));
            assert!((after / before - 1.0).abs() < 0.2, "target {target} moves by {after} instead of {before}");
        }
    }
}

#[test]
fn custom_levels_of_the_fixtures_rules_apply() {
    let build = own_levels();
    let skipped = &report_of(&build.report, Path::new("shapes/cube.glb"))["meshes"][0]["skipped"];
    assert!(skipped.as_str().is_some_and(|why| !why.is_empty()), "{skipped}");
}

#[test]
fn locked_borders_do_not_move() {
    // The settings of the fixtures take the terrain preset, whose borders are locked.
    let build = own_levels();
    let (output, levels) = levels_of(build, Path::new("terrain/tile.glb"));
    let on_border = |mesh: usize| -> BTreeSet<[u64; 3]> {
        let corners = output.mesh_triangles(mesh).into_iter().flatten();
        corners.filter(|p| p[0].abs() == 1.0 || p[2].abs() == 1.0).map(|p| p.map(f64::to_bits)).collect()
    };
    assert!(levels.len() >= 3);
    for Level { meshes: [finest, level], .. } in levels {
        assert_eq!(on_border(finest).len(), 128);
        assert_eq!(on_border(finest), on_border(level));
        assert_eq!(open_edges(&output.mesh_triangles(level)), 128);
    }
}

/// Settings with four steep levels instead of those that fixtures ask for.
const STEEP: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/support/steep.toml");

/// All fixtures with these levels.
fn steep_levels() -> &'static Build {
    static BUILD: LazyLock<Build> = LazyLock::new(|| build_shared("quality-steep", &fixtures(), &["--config", STEEP]));
    expect_success(&BUILD)
}

/// All fixtures with the levels that their settings ask for.
fn own_levels() -> &'static Build {
    static BUILD: LazyLock<Build> = LazyLock::new(|| build_shared("quality-own", &fixtures(), &[]));
    expect_success(&BUILD)
}

fn expect_success(build: &Build) -> &Build {
    assert_eq!(build.run.code, Some(0), "{}", build.run.stderr);
    build
}

/// All meshes of the report, with the name of their file.
fn meshes_of<'a>(build: &'a Build, input: &Path) -> Vec<(String, &'a Value)> {
    let with_name = |relative: std::path::PathBuf| {
        let name = relative.display().to_string();
        items(&report_of(&build.report, &relative)["meshes"])
            .iter()
            .map(move |mesh| (name.clone(), mesh))
            .collect::<Vec<_>>()
    };
    assets_below(input).into_iter().flat_map(with_name).collect()
}

fn levels_of(build: &Build, relative: &Path) -> (Gltf, Vec<Level>) {
    let (source, output) = (Gltf::open(&fixtures().join(relative)), Gltf::open(&build.out.path().join(relative)));
    let mut levels = Vec::new();
    for root in new_roots(&source, &output) {
        let skin = output.list("nodes")[drawing_node(&output, root)]["skin"].as_u64();
        let joints = skin.map_or(0, |skin| items(&output.list("skins")[skin as usize]["joints"]).len());
        let ids = level_ids(&output, root).into_iter().enumerate();
        levels.extend(ids.map(|(i, id)| Level {
            meshes: [mesh_of(&output, root), mesh_of(&output, id)],
            level: i + 1,
            joints,
        }));
    }
    (output, levels)
}

/// A level reaches no further out of LOD0's bounds than its measured distance allows.
fn stays_within(file: &Gltf, finest: usize, level: usize, distance: f64, place: &str) {
    let (source, reached) = (bounds(&file.mesh_triangles(finest)), bounds(&file.mesh_triangles(level)));
    let slack = distance * 1.01 + 1e-6 * (0..3).map(|k| source.1[k] - source.0[k]).fold(0.0, f64::max);
    for k in 0..3 {
        assert!(
            reached.0[k] >= source.0[k] - slack && reached.1[k] <= source.1[k] + slack,
            "{place}: {reached:?} leaves {source:?}"
        );
    }
}

fn values_of(file: &Gltf, mesh: usize, attribute: &str) -> Vec<Vec<f64>> {
    let primitives = items(&file.list("meshes")[mesh]["primitives"]).iter();
    primitives
        .filter_map(|p| p["attributes"].get(attribute))
        .flat_map(|accessor| file.elements(index(accessor)))
        .collect()
}

fn judge_attribute(name: &str, values: &[Vec<f64>], sources: &[Vec<f64>], joints: usize, place: &str) {
    let length = |v: &[f64]| v[..3].iter().map(|x| x * x).sum::<f64>().sqrt();
    let within = |v: &[f64], slack: f64| {
        v.iter().enumerate().all(|(k, x)| {
            let all = sources.iter().map(|s| s[k]);
            let (lo, hi) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)));
            *x >= lo - slack * (hi - lo) && *x <= hi + slack * (hi - lo)
        })
    };
    let sound = |v: &Vec<f64>| match name {
        // Bytes hold unit vectors to about half a percent.
        "NORMAL" => (length(v) - 1.0).abs() < 0.01,
        "TANGENT" => (length(v) - 1.0).abs() < 0.01 && v[3].abs() == 1.0,
        "COLOR_0" => v.iter().all(|x| (0.0..=1.0).contains(x)),
        "_FEATURE_ID_0" => sources.contains(v),
        "_TEMPERATURE" => within(v, 0.05),
        // Where a seam or a free border has moved, coordinates go on in a straight line, but not past the atlas.
        _ if name.starts_with("TEXCOORD_") => within(v, 1e-4),
        _ if name.starts_with("JOINTS_") => v.iter().all(|&joint| (joint as usize) < joints),
        _ => true,
    };
    if let Some(bad) = values.iter().find(|v| !sound(v)) {
        panic!("{place}: {name} {bad:?}");
    }
}

/// Weights over all sets sum to one, and no joint is named without a weight.
fn judge_weights(file: &Gltf, primitive: &Value, place: &str) {
    let sets = |kind: &str| -> Vec<Vec<Vec<f64>>> {
        (0..2)
            .filter_map(|set| primitive["attributes"].get(format!("{kind}_{set}")))
            .map(|a| file.elements(index(a)))
            .collect()
    };
    let (joints, weights) = (sets("JOINTS"), sets("WEIGHTS"));
    for vertex in 0..weights.first().map_or(0, Vec::len) {
        let sum: f64 = weights.iter().flat_map(|set| &set[vertex]).sum();
        assert!((sum - 1.0).abs() < 1e-5, "{place}: weights of vertex {vertex} sum to {sum}");
        let named = joints.iter().flat_map(|set| &set[vertex]).zip(weights.iter().flat_map(|set| &set[vertex]));
        assert!(
            named.clone().all(|(&joint, &weight)| weight >= 0.0 && (weight > 0.0 || joint == 0.0)),
            "{place}: vertex {vertex}"
        );
    }
}
