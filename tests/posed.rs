//! Levels of meshes that move stay near their source in its poses, too: measured on written files, against meshoptimizer's levels in the same poses.

mod support;

use serde_json::Value;
use std::path::Path;
use support::lod_rules::{drawing_node, level_ids, mesh_of, new_roots};
use support::reader::Gltf;
use support::{Build, build, fixtures, index, items, report_of};

type Point = [f64; 3];
/// Column by column.
type Matrix = [[f64; 4]; 4];

/// A joint turned about z by so many degrees, or weights of morph targets.
enum Pose {
    Bent(usize, f64),
    Morphed(&'static [f64]),
}

const LEVELS: &str = "0.4,0.2,0.1";

#[test]
fn bent_skins_stay_near() {
    let poses = |joint| [Pose::Bent(joint, 60.0), Pose::Bent(joint, 30.0)];
    for (name, joint) in [("skinned/bending_cylinder.glb", 1), ("skinned/tentacle_eight_influences.glb", 5)] {
        let [ours, theirs] = compare(name, &poses(joint));
        // 0.53 and 0.36 when this was written; the first is 1.12 without poses in the cost.
        assert!(ours < 0.8 * theirs, "{name}: {ours} against {theirs}");
    }
}

#[test]
fn morph_extremes_stay_near_and_so_does_rest() {
    let extremes = [Pose::Morphed(&[1.0, 0.0, 0.0]), Pose::Morphed(&[0.0, 1.0, 0.0]), Pose::Morphed(&[0.0, 0.0, 1.0])];
    let [ours, theirs] = compare("morph/talking_head.glb", &extremes);
    assert!(ours < 0.85 * theirs, "extremes: {ours} against {theirs}");
    let [ours, theirs] = compare("morph/talking_head.glb", &[Pose::Morphed(&[])]);
    assert!(ours < theirs, "rest: {ours} against {theirs}");
}

#[test]
fn the_report_measures_poses_of_both() {
    let build = build_levels("skinned/bending_cylinder.glb", "esqem");
    let levels = items(&report_of(&build.report, Path::new("bending_cylinder.glb"))["meshes"][0]["levels"]);
    assert!(!levels.is_empty());
    for level in levels {
        for measured in [level, &level["baseline"]] {
            let [rest, posed] = [&measured["error"], &measured["posed"]]
                .map(|figures| figures["rms_percent"].as_f64().expect("a figure"));
            assert!(index(&measured["posed"]["poses"]) >= 1);
            // A straight arm needs fewer faces than a bent one.
            assert!(posed > rest && posed < 1.0, "{posed} at rest {rest}");
        }
    }
    let still = build_levels("attributes/normals_and_seam.glb", "esqem");
    let levels = items(&report_of(&still.report, Path::new("normals_and_seam.glb"))["meshes"][0]["levels"]);
    assert!(levels.iter().all(|level| level["posed"].is_null() && level["baseline"]["posed"].is_null()));
}

#[test]
fn poses_guide_and_are_not_written() {
    for name in ["skinned/bending_cylinder.glb", "skinned/skin_and_morph.glb"] {
        let (source, build) = (Gltf::open(&fixtures().join(name)), build_levels(name, "esqem"));
        let output = open_output(&build, name);
        let names = |file: &Gltf, mesh: usize| {
            let primitive = &items(&file.list("meshes")[mesh]["primitives"])[0];
            let keys: Vec<String> = primitive["attributes"].as_object().expect("an object").keys().cloned().collect();
            (keys, primitive["targets"].as_array().map(Vec::len))
        };
        for root in new_roots(&source, &output) {
            let finest = mesh_of(&output, root);
            for id in level_ids(&output, root) {
                assert_eq!(names(&output, mesh_of(&output, id)), names(&output, finest), "{name}");
            }
        }
    }
}

/// Geometric means over poses and levels of the RMS distances from source to level, ours and meshoptimizer's.
fn compare(name: &str, poses: &[Pose]) -> [f64; 2] {
    ["esqem", "meshopt"].map(|algorithm| {
        let source = Gltf::open(&fixtures().join(name));
        let output = open_output(&build_levels(name, algorithm), name);
        let mut logs = Vec::new();
        for root in new_roots(&source, &output) {
            let (finest, skin) = (mesh_of(&output, root), skin_of(&output, root));
            let levels = level_ids(&output, root);
            assert_eq!(levels.len(), 3, "{name}, {algorithm}");
            for (id, pose) in levels.iter().flat_map(|&id| poses.iter().map(move |pose| (id, pose))) {
                let from = posed_triangles(&output, finest, skin, pose);
                let to = posed_triangles(&output, mesh_of(&output, id), skin, pose);
                logs.push(root_mean_square(&from, &to).ln());
            }
        }
        (logs.iter().sum::<f64>() / logs.len() as f64).exp()
    })
}

fn build_levels(name: &str, algorithm: &str) -> Build {
    let input = fixtures().join(name);
    let build = build(&input, &["--levels", LEVELS, "--algorithm", algorithm]);
    assert_eq!(build.run.code, Some(0), "{}", build.run.stderr);
    build
}

fn open_output(build: &Build, name: &str) -> Gltf {
    Gltf::open(&build.out.path().join(Path::new(name).file_name().expect("a file")))
}

fn skin_of(file: &Gltf, root: usize) -> Option<usize> {
    file.list("nodes")[drawing_node(file, root)]["skin"].as_u64().map(|skin| skin as usize)
}

fn posed_triangles(file: &Gltf, mesh: usize, skin: Option<usize>, pose: &Pose) -> Vec<[Point; 3]> {
    let primitive = &items(&file.list("meshes")[mesh]["primitives"])[0];
    let points = |accessor: &Value| -> Vec<Point> {
        file.elements(index(accessor)).iter().map(|p| [p[0], p[1], p[2]]).collect()
    };
    let mut positions = points(&primitive["attributes"]["POSITION"]);
    match pose {
        Pose::Bent(joint, degrees) => {
            let matrices = joint_matrices(file, skin.expect("a skin"), *joint, *degrees);
            let influences = influences(file, primitive);
            for (position, influences) in positions.iter_mut().zip(&influences) {
                let moved = influences
                    .iter()
                    .map(|&(joint, weight)| transform(&matrices[joint], *position).map(|x| x * weight));
                *position = moved.fold([0.0; 3], |sum, p| std::array::from_fn(|k| sum[k] + p[k]));
            }
        }
        Pose::Morphed(weights) => {
            for (target, weight) in items(&primitive["targets"]).iter().zip(*weights) {
                for (position, step) in positions.iter_mut().zip(points(&target["POSITION"])) {
                    *position = std::array::from_fn(|k| position[k] + weight * step[k]);
                }
            }
        }
    }
    file.triangle_indices(primitive).into_iter().map(|t| t.map(|v| positions[v])).collect()
}

/// Joints and weights of each vertex, over all sets.
fn influences(file: &Gltf, primitive: &Value) -> Vec<Vec<(usize, f64)>> {
    let mut all: Vec<Vec<(usize, f64)>> = Vec::new();
    for set in 0..2 {
        let read = |kind: &str| primitive["attributes"].get(format!("{kind}_{set}")).map(|a| file.elements(index(a)));
        let (Some(joints), Some(weights)) = (read("JOINTS"), read("WEIGHTS")) else { continue };
        all.resize(joints.len(), Vec::new());
        for (vertex, (joints, weights)) in joints.iter().zip(&weights).enumerate() {
            all[vertex].extend(joints.iter().zip(weights).map(|(&joint, &weight)| (joint as usize, weight)));
        }
    }
    all
}

/// The chains of the fixtures: translations alone, one joint turned.
fn joint_matrices(file: &Gltf, skin: usize, turned: usize, degrees: f64) -> Vec<Matrix> {
    let skin = &file.list("skins")[skin];
    let binds = file.elements(index(&skin["inverseBindMatrices"]));
    let (sine, cosine) = degrees.to_radians().sin_cos();
    let mut world = identity();
    let mut matrices = Vec::new();
    for (k, (joint, bind)) in items(&skin["joints"]).iter().zip(&binds).enumerate() {
        let mut local = identity();
        for (i, x) in items(&file.list("nodes")[index(joint)]["translation"]).iter().enumerate() {
            local[3][i] = x.as_f64().expect("a number");
        }
        if k == turned {
            (local[0], local[1]) = ([cosine, sine, 0.0, 0.0], [-sine, cosine, 0.0, 0.0]);
        }
        world = multiply(&world, &local);
        let bind: Matrix = std::array::from_fn(|c| std::array::from_fn(|r| bind[4 * c + r]));
        matrices.push(multiply(&world, &bind));
    }
    matrices
}

fn identity() -> Matrix {
    std::array::from_fn(|c| std::array::from_fn(|r| if c == r { 1.0 } else { 0.0 }))
}

fn multiply(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|c| std::array::from_fn(|r| (0..4).map(|k| a[k][r] * b[c][k]).sum()))
}

fn transform(m: &Matrix, p: Point) -> Point {
    std::array::from_fn(|r| m[0][r] * p[0] + m[1][r] * p[1] + m[2][r] * p[2] + m[3][r])
}

/// Of the corners' and middles' distances.
fn root_mean_square(from: &[[Point; 3]], to: &[[Point; 3]]) -> f64 {
    let middle = |t: &[Point; 3]| std::array::from_fn(|k| (t[0][k] + t[1][k] + t[2][k]) / 3.0);
    let points: Vec<Point> = from.iter().flat_map(|t| [t[0], middle(t)]).collect();
    let nearest = |p: &Point| to.iter().map(|t| distance_squared(*p, t)).fold(f64::INFINITY, f64::min);
    (points.iter().map(nearest).sum::<f64>() / points.len() as f64).sqrt()
}

fn distance_squared(p: Point, &[a, b, c]: &[Point; 3]) -> f64 {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
    let (d11, d12, d22, d1, d2) = (dot(ab, ab), dot(ab, ac), dot(ac, ac), dot(ab, ap), dot(ac, ap));
    let determinant = d11 * d22 - d12 * d12;
    let (v, w) = ((d22 * d1 - d12 * d2) / determinant, (d11 * d2 - d12 * d1) / determinant);
    if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
        let foot: Point = std::array::from_fn(|k| ap[k] - v * ab[k] - w * ac[k]);
        return dot(foot, foot);
    }
    let to_edge = |start: Point, end: Point| {
        let (along, off) = (sub(end, start), sub(p, start));
        let t = (dot(off, along) / dot(along, along)).clamp(0.0, 1.0);
        let foot: Point = std::array::from_fn(|k| off[k] - t * along[k]);
        dot(foot, foot)
    };
    [to_edge(a, b), to_edge(b, c), to_edge(c, a)].into_iter().filter(|d| d.is_finite()).fold(f64::INFINITY, f64::min)
}

fn sub(a: Point, b: Point) -> Point {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: Point, b: Point) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}
