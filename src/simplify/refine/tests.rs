use super::super::options::{EdgePolicy, Options};
use super::super::passes::{Workspace, run};
use super::super::reducer::Reducer;
use super::*;
use crate::measure::{Ruler, Sampling};
use crate::mesh::edges::{Edge, collect_edges};
use crate::mesh::{Attribute, Mesh, Semantic};
use proptest::prelude::*;

/// A sphere of 6 · 2 · n² triangles with bumps of this height.
pub(super) fn bumpy_sphere(n: u32, bumps: f32) -> Mesh {
    let mut mesh = Mesh::default();
    for side in 0..6 {
        let base = mesh.positions.len() as u32;
        let at = |i: u32| (i as f32 / n as f32 * 2.0 - 1.0) * std::f32::consts::FRAC_PI_4;
        for (j, i) in (0..=n).flat_map(|j| (0..=n).map(move |i| (j, i))) {
            let [u, v] = [at(i).tan(), at(j).tan()];
            let p = match side {
                0 => [1.0, u, v],
                1 => [-1.0, v, u],
                2 => [v, 1.0, u],
                3 => [u, -1.0, v],
                4 => [u, v, 1.0],
                _ => [v, u, -1.0],
            };
            let p = Vec3::from(p).normalize();
            let height = (p.x * 5.0).sin() * (p.y * 4.0).cos() + (p.z * 9.0).sin() * 0.5;
            // Rounded, so that the sides weld.
            mesh.positions.push((p * (1.0 + bumps * height) * 1e4).round().to_array().map(|x| x / 1e4));
        }
        for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))) {
            let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| base + j * (n + 1) + i);
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// A sheet with these heights at its points, by rows of `n + 1`.
fn sheet(n: u32, heights: &[f32]) -> Mesh {
    let mut mesh = Mesh::default();
    for (j, i) in (0..=n).flat_map(|j| (0..=n).map(move |i| (j, i))) {
        let height = heights.get((j * (n + 1) + i) as usize).copied().unwrap_or(0.0);
        mesh.positions.push([i as f32 / n as f32, j as f32 / n as f32, height]);
    }
    for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))) {
        let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| j * (n + 1) + i);
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

/// A flat sheet of 4 × 4 squares whose lower and upper half are parted by a seam, with texture coordinates that are linear in either half.
pub(super) fn two_charts() -> Mesh {
    let mut mesh = sheet(4, &[]);
    let (row, all) = (5, mesh.positions.len() as u32);
    let (first, seam) = (2 * row, mesh.positions[2 * row as usize..3 * row as usize].to_vec());
    mesh.positions.extend(seam);
    for triangle in &mut mesh.triangles[16..] {
        *triangle = triangle.map(|v| if v < first + row { v - first + all } else { v });
    }
    let upper = |v: u32| v >= first + row;
    let values = mesh.positions.iter().zip(0..).flat_map(|(p, v)| uv_of_two_charts(Vec3::from(*p), upper(v))).collect();
    mesh.attributes = vec![Attribute { semantic: Semantic::TexCoord(0), width: 2, values }];
    mesh
}

pub(super) fn uv_of_two_charts(p: Vec3, upper: bool) -> [f32; 2] {
    if upper { [5.0 + 3.0 * p.x, p.y - p.x] } else { [p.x + 2.0 * p.y, p.y] }
}

fn collapse(mesh: &Mesh, options: &Options, triangles: usize) -> (Reducer, Refiner) {
    let mut reducer = Reducer::new(mesh, options);
    let refiner = Refiner::new(&reducer.surface, options.effort);
    let mut workspace = Workspace::default();
    while reducer.surface.face_count() > triangles {
        let before = reducer.surface.face_count();
        run(&mut reducer, &mut workspace, triangles);
        if reducer.surface.face_count() == before {
            break;
        }
    }
    (reducer, refiner)
}

fn special_edges(surface: &Surface) -> Vec<(u32, u32, bool)> {
    let kind = |e: &Edge| (e.a, e.b, e.kind.has(crate::mesh::edges::EdgeKind::BORDER));
    let mut edges: Vec<_> = collect_edges(surface).iter().filter(|e| !e.kind.is_plain()).map(kind).collect();
    edges.sort_unstable();
    edges
}

/// Faces of a sheet that look down. Steep ones may lean over a little.
fn count_turned(surface: &Surface) -> usize {
    let looks_down = |&f: &usize| {
        let [a, b, c] = surface.triangle(f);
        (b - a).cross(c - a).normalize_or_zero().z < -0.3
    };
    surface.live_faces().filter(looks_down).count()
}

#[test]
fn levels_come_nearer_and_best_at_least_as_near() {
    let mesh = bumpy_sphere(24, 0.08);
    let ruler = Ruler::new(&mesh, Sampling { samples: 20_000, seed: 1 });
    let distances = [Effort::Default, Effort::Best].map(|effort| {
        let (reducer, mut refiner) = collapse(&mesh, &Options { effort, ..Options::default() }, 700);
        let mut surface = reducer.surface.clone();
        assert!(refiner.refine(&mut surface, reducer.locked(), reducer.cost.metric()));
        let (was, is) = (ruler.measure(&reducer.surface.to_mesh()), ruler.measure(&surface.to_mesh()));
        [is.rms() / was.rms(), is.hausdorff() / was.hausdorff()]
    });
    let [default, best] = distances;
    assert!(default[0] < 0.99 && default[1] < 0.95, "{default:?}");
    assert!(best[0] < default[0] && best[1] < default[1], "{best:?} {default:?}");
}

/// What refinement keeps is no worse by the ruler, which knows nothing of its samples: the mean never, the maximum but for what is between samples.
#[test]
fn levels_are_never_worse_by_the_ruler() {
    let relief: Vec<f32> =
        (0..41 * 41).map(|i| ((i % 41) as f32 * 0.7).sin() * ((i / 41) as f32 * 0.4).cos() * 0.03).collect();
    let steps: Vec<f32> = (0..41 * 41).map(|i| if (i % 41 + i / 41) % 14 < 7 { 0.05 } else { 0.0 }).collect();
    let meshes = [bumpy_sphere(20, 0.1), bumpy_sphere(16, 0.0), sheet(40, &relief), sheet(40, &steps)];
    let mut kept = 0;
    for (mesh, effort) in meshes.iter().flat_map(|mesh| [(mesh, Effort::Default), (mesh, Effort::Best)]) {
        let ruler = Ruler::new(mesh, Sampling { samples: 20_000, seed: 1 });
        for share in [0.12, 0.05, 0.02] {
            let target = (share * mesh.triangles.len() as f64) as usize;
            let (reducer, mut refiner) = collapse(mesh, &Options { effort, ..Options::default() }, target);
            let mut surface = reducer.surface.clone();
            if refiner.refine(&mut surface, reducer.locked(), reducer.cost.metric()) {
                kept += 1;
                let (was, is) = (ruler.measure(&reducer.surface.to_mesh()), ruler.measure(&surface.to_mesh()));
                assert!(is.rms() <= was.rms() * 1.01, "{} {}", is.rms(), was.rms());
                assert!(is.hausdorff() <= was.hausdorff() * 1.2, "{} {}", is.hausdorff(), was.hausdorff());
            }
        }
    }
    assert!(kept >= 12, "{kept} of 24");
}

/// A closed flat horn of 8 · 2 · `rings` triangles with its tip at x = 1, a fiftieth as broad as it is long.
fn horn(rings: u32) -> Mesh {
    let mut mesh = Mesh { positions: vec![[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]], ..Mesh::default() };
    for (ring, side) in (1..=rings).flat_map(|ring| (0..8).map(move |side| (ring, side))) {
        let (share, angle) = (ring as f32 / rings as f32, side as f32 * std::f32::consts::FRAC_PI_4);
        mesh.positions.push([1.0 - share, 0.02 * share * angle.cos(), 0.006 * share * angle.sin()]);
    }
    let at = |ring: u32, side: u32| 2 + (ring - 1) * 8 + side % 8;
    for side in 0..8 {
        mesh.triangles.extend([[0, at(1, side), at(1, side + 1)], [1, at(rings, side + 1), at(rings, side)]]);
        for ring in 1..rings {
            let [a, b, c, d] = [at(ring, side), at(ring + 1, side), at(ring + 1, side + 1), at(ring, side + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// On the way back samples near the tip turn over, from the face in front to the one behind.
#[test]
fn a_tip_that_sticks_out_comes_back() {
    let mesh = horn(60);
    let (mut reducer, mut refiner) = collapse(&mesh, &Options { effort: Effort::Best, ..Options::default() }, 48);
    let tip = |surface: &Surface| {
        let points = (0..surface.points.len()).filter(|&p| !surface.ring(p as u32).is_empty());
        points.max_by(|&p, &q| surface.points[p].x.total_cmp(&surface.points[q].x)).unwrap_or_default()
    };
    let first = tip(&reducer.surface);
    let was = reducer.surface.points[first].x;
    reducer.surface.points[first].x += 0.1;
    let mut surface = reducer.surface.clone();
    assert!(refiner.refine(&mut surface, reducer.locked(), reducer.cost.metric()));
    let out = surface.points[tip(&surface)].x - was;
    assert!(out.abs() < 0.01, "{out}");
}

#[test]
fn what_cannot_be_better_stays() {
    let flat = sheet(12, &[]);
    let (reducer, mut refiner) = collapse(&flat, &Options { effort: Effort::Best, ..Options::default() }, 60);
    let mut surface = reducer.surface.clone();
    refiner.refine(&mut surface, reducer.locked(), reducer.cost.metric());
    assert!(surface.points.iter().all(|p| p.z.abs() < 1e-6));
}

#[test]
fn normals_are_fitted_to_the_source() {
    let mut mesh = bumpy_sphere(16, 0.0);
    let values = mesh.positions.iter().flat_map(|p| *p).collect();
    mesh.attributes = vec![Attribute { semantic: Semantic::Normal, width: 3, values }];
    let (reducer, mut refiner) = collapse(&mesh, &Options { effort: Effort::Default, ..Options::default() }, 300);
    let mut surface = reducer.surface.clone();
    refiner.refine(&mut surface, reducer.locked(), reducer.cost.metric());
    let level = surface.to_mesh();
    let normals = level.attribute(Semantic::Normal).map_or(&[][..], |a| &a.values);
    assert_eq!(normals.len(), level.positions.len() * 3);
    for (p, n) in level.positions.iter().zip(normals.chunks(3)) {
        let cosine = Vec3::from(*p).normalize().dot(Vec3::from_slice(n));
        assert!(cosine > 0.995, "{p:?} {n:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]
    #[test]
    fn sheets_keep_their_edges_their_count_and_their_side(
        heights in prop::collection::vec(-0.012f32..0.012, 15 * 15),
        target in 60usize..300,
        best in any::<bool>(),
        lock in any::<bool>(),
    ) {
        let mesh = sheet(14, &heights);
        let border = if lock { EdgePolicy::Lock } else { EdgePolicy::Preserve };
        let effort = if best { Effort::Best } else { Effort::Default };
        let options = Options { effort, border, ..Options::default() };
        let (reducer, mut refiner) = collapse(&mesh, &options, target);
        let before = &reducer.surface;
        let mut after = before.clone();
        let is_kept = refiner.refine(&mut after, reducer.locked(), reducer.cost.metric());
        prop_assert_eq!(before.face_count(), after.face_count());
        let special = special_edges(before);
        prop_assert_eq!(&special, &special_edges(&after));
        let locked = (0..before.points.len()).filter(|&p| reducer.locked().has(p as u32));
        for p in special.iter().flat_map(|e| [e.0 as usize, e.1 as usize]).chain(locked) {
            prop_assert_eq!(before.points[p], after.points[p]);
        }
        prop_assert!(!is_kept || count_turned(&after) <= count_turned(before));
    }
}
