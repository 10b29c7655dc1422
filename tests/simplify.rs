//! The simplifier's promises on meshes of every kind, through the public library.

use gltf_lod::baseline;
use gltf_lod::measure::{Ruler, Sampling};
use gltf_lod::mesh::{Attribute, Mesh, Semantic, Skin};
use gltf_lod::simplify::{Algorithm, EdgePolicy, Effort, Mode, Options, Placement, Schedule, Stop, Target, simplify};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

const ALGORITHMS: [Algorithm; 6] = [
    Algorithm::Esqem(Mode::Enhanced),
    Algorithm::Esqem(Mode::Paper),
    Algorithm::Qem,
    Algorithm::Qfvp,
    Algorithm::Fms,
    Algorithm::Melax,
];

/// A bumpy closed sphere: `rings` × `2·rings` quads with poles; one vertex a position.
fn sphere(rings: u32, bump: f32) -> Mesh {
    let columns = 2 * rings;
    let mut mesh = Mesh::default();
    let radius = |u: f32, v: f32| 1.0 + bump * (5.0 * u).sin() * (4.0 * v).cos();
    mesh.positions.push([0.0, 0.0, 1.0]);
    for r in 1..rings {
        for c in 0..columns {
            let (v, u) =
                (std::f32::consts::PI * r as f32 / rings as f32, std::f32::consts::TAU * c as f32 / columns as f32);
            let d = radius(u, v);
            mesh.positions.push([d * v.sin() * u.cos(), d * v.sin() * u.sin(), d * v.cos()]);
        }
    }
    mesh.positions.push([0.0, 0.0, -1.0]);
    let at = |r: u32, c: u32| 1 + (r - 1) * columns + c % columns;
    let last = mesh.positions.len() as u32 - 1;
    for c in 0..columns {
        mesh.triangles.push([0, at(1, c), at(1, c + 1)]);
        mesh.triangles.push([last, at(rings - 1, c + 1), at(rings - 1, c)]);
        for r in 1..rings - 1 {
            mesh.triangles.push([at(r, c), at(r + 1, c), at(r + 1, c + 1)]);
            mesh.triangles.push([at(r, c), at(r + 1, c + 1), at(r, c + 1)]);
        }
    }
    mesh
}

/// A height field over the unit square with UVs and an open border.
fn terrain(n: u32, height: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let mut uvs = Vec::new();
    for y in 0..=n {
        for x in 0..=n {
            let (u, v) = (x as f32 / n as f32, y as f32 / n as f32);
            mesh.positions.push([u, v, height * ((9.0 * u).sin() + (7.0 * v).cos())]);
            uvs.extend([u, v]);
        }
    }
    let at = |x: u32, y: u32| y * (n + 1) + x;
    for y in 0..n {
        for x in 0..n {
            mesh.triangles.push([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
            mesh.triangles.push([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
        }
    }
    mesh.attributes.push(Attribute { semantic: Semantic::TexCoord(0), width: 2, values: uvs });
    mesh
}

/// Every triangle with vertices and a flat normal of its own.
fn faceted(mesh: &Mesh) -> Mesh {
    let mut flat = Mesh::default();
    let mut normals = Vec::new();
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| glam::Vec3::from(mesh.positions[v as usize]));
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let base = flat.positions.len() as u32;
        flat.positions.extend([a.to_array(), b.to_array(), c.to_array()]);
        flat.triangles.push([base, base + 1, base + 2]);
        (0..3).for_each(|_| normals.extend(normal.to_array()));
    }
    flat.attributes.push(Attribute { semantic: Semantic::Normal, width: 3, values: normals });
    flat
}

/// The mesh cut into two groups by the sign of x of each triangle's first vertex, without shared vertices.
fn two_groups(mesh: &Mesh) -> Mesh {
    let mut cut = Mesh::default();
    let mut vertex = BTreeMap::new();
    for t in &mesh.triangles {
        let group = u32::from(mesh.positions[t[0] as usize][0] < 0.1);
        cut.triangles.push(t.map(|v| {
            *vertex.entry((group, v)).or_insert_with(|| {
                cut.positions.push(mesh.positions[v as usize]);
                cut.positions.len() as u32 - 1
            })
        }));
        cut.groups.push(group);
    }
    cut
}

/// How many faces each edge has, on welded positions.
fn edge_faces(mesh: &Mesh) -> BTreeMap<[[u32; 3]; 2], usize> {
    let mut count = BTreeMap::new();
    for t in &mesh.triangles {
        let p = t.map(|v| mesh.positions[v as usize].map(|x| (x + 0.0).to_bits()));
        for k in 0..3 {
            let mut edge = [p[k], p[(k + 1) % 3]];
            edge.sort_unstable();
            *count.entry(edge).or_insert(0) += 1;
        }
    }
    count
}

fn open_edges(mesh: &Mesh) -> usize {
    edge_faces(mesh).values().filter(|&&n| n == 1).count()
}

fn options(ratios: &[f64]) -> Options {
    Options { levels: ratios.iter().map(|&r| Target::ratio(r)).collect(), ..Options::default() }
}

/// What holds for every level of every mesh.
fn check_levels(source: &Mesh, options: &Options) {
    let chain = simplify(source, options).expect("a valid mesh simplifies");
    assert_eq!(chain.levels.len(), options.levels.len());
    for (level, target) in chain.levels.iter().zip(&options.levels) {
        let mesh = &level.mesh;
        mesh.validate().expect("a level is a valid mesh");
        assert!(!mesh.triangles.is_empty());
        assert_eq!(mesh.attributes.len(), source.attributes.len());
        let used: BTreeSet<u32> = mesh.triangles.iter().flatten().copied().collect();
        assert_eq!(used.len(), mesh.positions.len(), "no unused vertices");
        let wanted = (source.triangles.len() as f64 * target.ratio.expect("ratios only")).round() as usize;
        let wanted = wanted.max(options.min_triangles);
        if level.stop == Stop::Target {
            assert!(mesh.triangles.len() <= wanted + 1, "{} of {wanted}", mesh.triangles.len());
        }
        let (low, high) = source.bounds();
        let slack = source.diagonal() * 0.1;
        for p in &mesh.positions {
            let p = glam::Vec3::from(*p);
            assert!(p.cmpge(low - slack).all() && p.cmple(high + slack).all(), "{p} left {low}..{high}");
        }
    }
}

#[test]
fn a_closed_surface_stays_closed_and_reaches_its_targets() {
    let source = sphere(24, 0.1);
    for schedule in [Schedule::Passes, Schedule::Queue, Schedule::Vertices] {
        for algorithm in ALGORITHMS {
            let options = Options { schedule, algorithm, ..options(&[0.5, 0.25, 0.1, 0.02]) };
            let chain = simplify(&source, &options).expect("valid");
            for (level, ratio) in chain.levels.iter().zip([0.5, 0.25, 0.1, 0.02]) {
                let wanted = (source.triangles.len() as f64 * ratio).round() as usize;
                assert!(level.mesh.triangles.len().abs_diff(wanted) <= 1, "{schedule:?} {algorithm:?} {ratio}");
                assert_eq!(open_edges(&level.mesh), 0, "{schedule:?} {algorithm:?} {ratio}");
            }
        }
    }
}

#[test]
fn groups_stay_closed_along_their_common_border() {
    let source = two_groups(&sphere(20, 0.15));
    assert_eq!(open_edges(&source), 0);
    let chain = simplify(&source, &options(&[0.6, 0.3, 0.1, 0.03])).expect("valid");
    for level in &chain.levels {
        assert_eq!(open_edges(&level.mesh), 0);
        assert_eq!(level.mesh.groups.iter().collect::<BTreeSet<_>>().len(), 2, "no group vanishes");
    }
}

#[test]
fn a_faceted_mesh_reaches_its_target_with_flat_faces() {
    let source = faceted(&sphere(16, 0.0));
    let chain = simplify(&source, &options(&[0.5, 0.1])).expect("valid");
    for (level, ratio) in chain.levels.iter().zip([0.5, 0.1]) {
        let wanted = (source.triangles.len() as f64 * ratio).round() as usize;
        assert!(level.mesh.triangles.len().abs_diff(wanted) <= 1);
        assert_eq!(open_edges(&level.mesh), 0);
    }
}

#[test]
fn a_flat_sheet_costs_nothing_down_to_its_corners() {
    let chain = simplify(
        &terrain(16, 0.0),
        &Options { levels: vec![Target::triangles(2)], min_triangles: 2, ..Options::default() },
    )
    .expect("valid");
    let mesh = &chain.levels[0].mesh;
    assert_eq!(mesh.triangles.len(), 2);
    let corners: BTreeSet<[i32; 2]> =
        mesh.positions.iter().map(|p| [(p[0] * 1000.0).round() as i32, (p[1] * 1000.0).round() as i32]).collect();
    assert_eq!(corners, BTreeSet::from([[0, 0], [0, 1000], [1000, 0], [1000, 1000]]));
    let uvs = &mesh.attributes[0].values;
    for (p, uv) in mesh.positions.iter().zip(uvs.chunks(2)) {
        assert!((p[0] - uv[0]).abs() < 1e-3 && (p[1] - uv[1]).abs() < 1e-3, "{p:?} {uv:?}");
    }
}

#[test]
fn a_locked_border_keeps_its_vertices() {
    let source = terrain(20, 0.1);
    let border = |mesh: &Mesh| -> BTreeSet<[u32; 3]> {
        edge_faces(mesh).into_iter().filter(|(_, n)| *n == 1).flat_map(|(e, _)| e).collect()
    };
    let options = Options { border: EdgePolicy::Lock, ..options(&[0.3]) };
    let level = &simplify(&source, &options).expect("valid").levels[0];
    assert!(level.mesh.triangles.len() < source.triangles.len() / 2);
    assert_eq!(border(&level.mesh), border(&source));
}

#[test]
fn an_error_target_is_kept() {
    let source = sphere(24, 0.0);
    let target = Target { error: Some(0.01), ..Target::default() };
    let level = &simplify(&source, &Options { levels: vec![target], ..Options::default() }).expect("valid").levels[0];
    assert_eq!(level.stop, Stop::Error);
    assert!(level.mesh.triangles.len() < source.triangles.len());
    for p in &level.mesh.positions {
        assert!((glam::Vec3::from(*p).length() - 1.0).abs() <= 0.011);
    }
}

#[test]
fn small_shells_go_and_the_last_one_stays() {
    let (big, mut mesh) = (sphere(12, 0.0), Mesh::default());
    for i in 0..60u32 {
        let (shell, scale) = if i == 0 { (big.clone(), 1.0) } else { (sphere(3, 0.0), 0.01) };
        let base = mesh.positions.len() as u32;
        let offset = i as f32 * 0.1;
        mesh.positions.extend(shell.positions.iter().map(|p| [p[0] * scale + offset, p[1] * scale, p[2] * scale]));
        mesh.triangles.extend(shell.triangles.iter().map(|t| t.map(|v| v + base)));
    }
    let chain =
        simplify(&mesh, &Options { levels: vec![Target::triangles(100)], ..Options::default() }).expect("valid");
    let level = &chain.levels[0];
    assert!(level.mesh.triangles.len().abs_diff(100) <= 1, "{}", level.mesh.triangles.len());
    assert!(level.mesh.diagonal() > 3.0, "the sphere is still there");
}

#[test]
fn pieces_of_one_size_all_stay() {
    let (ball, mut mesh) = (sphere(8, 0.0), Mesh::default());
    for i in 0..10u32 {
        let base = mesh.positions.len() as u32;
        mesh.positions.extend(ball.positions.iter().map(|p| [p[0] + 4.0 * i as f32, p[1], p[2]]));
        mesh.triangles.extend(ball.triangles.iter().map(|t| t.map(|v| v + base)));
    }
    for algorithm in ALGORITHMS {
        let chain = simplify(&mesh, &Options { algorithm, ..options(&[0.5, 0.2]) }).expect("valid");
        for level in &chain.levels {
            let pieces: BTreeSet<i32> = level.mesh.positions.iter().map(|p| (p[0] / 4.0).round() as i32).collect();
            assert_eq!(pieces.len(), 10, "{algorithm:?}");
        }
    }
}

#[test]
fn influences_stay_normalised_and_ids_stay_ids() {
    let mut source = terrain(12, 0.2);
    let n = source.positions.len();
    let mut skin = Skin { influences: 4, ..Skin::default() };
    let mut ids = Vec::new();
    for p in &source.positions {
        skin.joints.extend([0, 1, 0, 0]);
        skin.weights.extend([1.0 - p[0], p[0], 0.0, 0.0]);
        ids.push((p[1] * 3.0).floor());
    }
    assert_eq!(ids.len(), n);
    source.skin = Some(skin);
    source.attributes.push(Attribute { semantic: Semantic::Id, width: 1, values: ids });
    let level = &simplify(&source, &options(&[0.2])).expect("valid").levels[0].mesh;
    let skin = level.skin.as_ref().expect("skinned");
    for (v, p) in level.positions.iter().enumerate() {
        let weights = &skin.weights[v * 4..][..4];
        assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        let of_joint_1: f32 = (0..4).filter(|&i| skin.joints[v * 4 + i] == 1).map(|i| weights[i]).sum();
        assert!((of_joint_1 - p[0]).abs() < 0.1, "weights follow the surface: {of_joint_1} at x = {}", p[0]);
    }
    assert!(level.attributes[1].values.iter().all(|id| [0.0, 1.0, 2.0, 3.0].contains(id)));
}

#[test]
fn bad_meshes_are_refused_with_a_reason() {
    let good = sphere(4, 0.0);
    let mut out_of_range = good.clone();
    out_of_range.triangles[3][1] = 9999;
    let mut infinite = good.clone();
    infinite.positions[5][2] = f32::INFINITY;
    let mut short = good;
    short.attributes.push(Attribute { semantic: Semantic::Normal, width: 3, values: vec![0.0; 7] });
    for (mesh, part) in [(out_of_range, "9999"), (infinite, "vertex 5"), (short, "attributes[0]")] {
        let error = simplify(&mesh, &Options::default()).expect_err("refused");
        assert!(error.to_string().contains(part), "{error}");
    }
}

fn any_options() -> impl Strategy<Value = Options> {
    let policy = prop_oneof![Just(EdgePolicy::Free), Just(EdgePolicy::Preserve), Just(EdgePolicy::Lock)];
    let algorithm = prop::sample::select(&ALGORITHMS[..]);
    let schedule = prop::sample::select(&[Schedule::Passes, Schedule::Queue, Schedule::Vertices][..]);
    (algorithm, schedule, policy.clone(), policy.clone(), policy, 0.02..0.9f64).prop_map(
        |(algorithm, schedule, border, seam, material_border, ratio)| Options {
            algorithm,
            schedule,
            border,
            seam,
            material_border,
            ..options(&[ratio, ratio * 0.5])
        },
    )
}

/// Each effort is at least as near to the source as the one below, and all are nearer than meshoptimizer's plain levels of the same counts: geometric means
/// over levels, as a single one may miss.
#[test]
fn more_effort_is_nearer_and_all_are_nearer_than_meshoptimizer() {
    let levels = [0.5, 0.25, 0.1, 0.05, 0.02].map(Target::ratio).to_vec();
    let mut open = terrain(60, 0.1);
    open.attributes.clear();
    for (mesh, floor) in [(sphere(48, 0.2), 0.75), (open, 0.75)] {
        let ruler = Ruler::new(&mesh, Sampling { samples: 20_000, seed: 1 });
        let mean = |meshes: Vec<Mesh>| {
            let logs = meshes.iter().map(|level| ruler.measure(level).rms().ln());
            (logs.sum::<f64>() / meshes.len() as f64).exp()
        };
        let by_effort = [Effort::Fast, Effort::Default, Effort::Best].map(|effort| {
            let options = Options { levels: levels.clone(), effort, ..Options::default() };
            simplify(&mesh, &options).expect("valid").levels.into_iter().map(|l| l.mesh).collect::<Vec<_>>()
        });
        let plain = baseline::Prepared::new(&mesh).expect("valid");
        let theirs = by_effort[0]
            .iter()
            .map(|l| plain.run(l.triangles.len(), baseline::Settings::default()).expect("valid").mesh)
            .collect();
        let theirs = mean(theirs);
        let [fast, default, best] = by_effort.map(|meshes| mean(meshes) / theirs);
        assert!(fast < floor, "fast is at {fast} of meshoptimizer's");
        assert!(default < fast, "default is at {default}, fast at {fast}");
        assert!(best < default * 1.01, "best is at {best}, default at {default}");
    }
}

#[test]
fn the_parts_of_a_large_surface_depend_on_no_thread_count() {
    let levels = [0.5, 0.45, 0.1, 0.01].map(Target::ratio).to_vec();
    let closed = sphere(200, 0.2);
    let mut open = terrain(280, 0.1);
    open.attributes.clear();
    for (mesh, placement) in [(&closed, Placement::Optimal), (&open, Placement::Optimal), (&closed, Placement::Subset)]
    {
        let options = Options { levels: levels.clone(), effort: Effort::Fast, placement, ..Options::default() };
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| {
                simplify(mesh, &options).expect("valid").levels.into_iter().map(|l| l.mesh).collect::<Vec<_>>()
            })
        };
        let alone = with(1);
        for (level, target) in alone.iter().zip(&levels) {
            let wanted = target.count(mesh.triangles.len(), 4);
            assert!(level.triangles.len().abs_diff(wanted) <= 1, "{} for {wanted}", level.triangles.len());
        }
        for threads in [2, 5] {
            assert!(alone == with(threads), "other levels on {threads} threads");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn any_triangle_soup_is_survived(
        triangles in prop::collection::vec(prop::array::uniform3(0u32..24), 1..120),
        positions in prop::collection::vec(prop::array::uniform3(-4i8..4), 24),
        options in any_options(),
    ) {
        // Small integer coordinates: coincident points, flat folds, duplicates and non-manifold fans are the rule.
        let positions = positions.into_iter().map(|p| p.map(f32::from)).collect();
        let mesh = Mesh { positions, triangles, ..Mesh::default() };
        let solid = mesh.triangles.iter().any(|t| {
            let p = t.map(|v| mesh.positions[v as usize]);
            p[0] != p[1] && p[1] != p[2] && p[2] != p[0]
        });
        prop_assume!(solid);
        check_levels(&mesh, &options);
    }

    #[test]
    fn surfaces_keep_the_rules_under_any_options(rings in 3u32..14, bump in 0.0f32..0.3, options in any_options()) {
        check_levels(&sphere(rings, bump), &options);
        check_levels(&two_groups(&sphere(rings, bump)), &options);
        check_levels(&faceted(&sphere(rings, bump)), &options);
        check_levels(&terrain(rings, bump), &options);
    }

    #[test]
    fn the_result_depends_on_no_thread_count(rings in 6u32..16, options in any_options()) {
        let mesh = two_groups(&sphere(rings, 0.1));
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| simplify(&mesh, &options).expect("valid").levels.into_iter().map(|l| l.mesh).collect::<Vec<_>>())
        };
        prop_assert_eq!(with(1), with(3));
    }
}
