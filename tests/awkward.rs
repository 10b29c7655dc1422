//! Meshes that simplifiers stumble over: targets are met, levels are sound, and never much worse than meshoptimizer's best mode in the same run.

mod support;

use glam::DVec3;
use gltf_lod::baseline;
use gltf_lod::measure::{Measurement, Ruler, Sampling};
use gltf_lod::mesh::{Mesh, Semantic};
use gltf_lod::simplify::{Chain, Effort, Options, Stop, Target, simplify};
use std::collections::BTreeSet;
use support::awkward::{Awkward, awkward_meshes};
use support::projection::compare_silhouettes;

const RATIOS: [f64; 6] = [0.5, 0.25, 0.1, 0.05, 0.02, 0.01];

/// Below this share of the diagonal a level is as good as exact.
const EXACT: f64 = 3e-4;

fn chain(mesh: &Mesh, effort: Effort) -> Chain {
    let levels = RATIOS.map(Target::ratio).to_vec();
    simplify(mesh, &Options { levels, effort, ..Options::default() }).expect("a valid mesh")
}

#[test]
fn targets_are_met_and_levels_are_sound() {
    for Awkward { name, mesh, .. } in awkward_meshes() {
        for effort in [Effort::Fast, Effort::Default] {
            let chain = chain(&mesh, effort);
            let ruler = Ruler::new(&mesh, Sampling { samples: 1000, seed: 1 });
            for (level, ratio) in chain.levels.iter().zip(RATIOS) {
                let place = format!("{name}, {effort:?}, {ratio}");
                let wanted = (mesh.triangles.len() as f64 * ratio).round() as usize;
                let least = Options::default().min_triangles;
                assert!(
                    level.mesh.triangles.len().abs_diff(wanted.max(least)) <= 1,
                    "{place}: {}",
                    level.mesh.triangles.len()
                );
                assert_eq!(level.stop, if wanted < least { Stop::Floor } else { Stop::Target }, "{place}");
                level.mesh.validate().expect("a level is a valid mesh");
                let measured = ruler.measure(&level.mesh);
                assert_eq!(measured.degenerate, 0, "{place}");
            }
        }
    }
}

/// How a mesh's levels compare with meshoptimizer's.
#[derive(Default)]
struct Means {
    hausdorff: f64,
    rms: f64,
    levels: f64,
}

#[test]
fn levels_are_never_much_worse_than_those_of_meshoptimizer() {
    let mut faults = Vec::new();
    for Awkward { name, mesh, closed } in awkward_meshes() {
        let ruler = Ruler::new(&mesh, Sampling { samples: 20_000, seed: 1 });
        let mut means = Means::default();
        for level in chain(&mesh, Effort::Fast).levels {
            let theirs = baseline::simplify_by(&mesh, level.mesh.triangles.len(), &ruler, false).expect("a valid mesh");
            if !theirs.reached {
                continue;
            }
            let (ours, their) = (ruler.measure(&level.mesh), ruler.measure(&theirs.mesh));
            let ratio = |of: fn(&Measurement) -> f64| {
                let floor = EXACT * ruler.diagonal();
                of(&ours).max(floor) / of(&their).max(floor)
            };
            let (hausdorff, rms) = (ratio(Measurement::hausdorff), ratio(Measurement::rms));
            means.hausdorff += hausdorff.ln();
            means.rms += rms.ln();
            means.levels += 1.0;
            let place = format!("{name} at {}", level.mesh.triangles.len());
            let mut expect = |holds: bool, what: String| {
                if !holds {
                    faults.push(format!("{place}: {what}"))
                }
            };
            expect(hausdorff < 4.0, format!("Hausdorff × {hausdorff:.2}"));
            expect(rms < 2.0, format!("RMS × {rms:.2}"));
            let [a, b] = [&level.mesh, &theirs.mesh].map(|level| compare_silhouettes(&mesh, level).off);
            expect(a < 1.25 * b + 0.1, format!("silhouette off by {a:.3}, theirs by {b:.3}"));
            if closed {
                let [a, b] = [&level.mesh, &theirs.mesh].map(|level| (volume(level) / volume(&mesh) - 1.0).abs());
                expect(a < 1.25 * b + 0.05, format!("volume off by {a:.3}, theirs by {b:.3}"));
            }
        }
        let [hausdorff, rms] = [means.hausdorff, means.rms].map(|sum| (sum / means.levels).exp());
        println!("{name:14} Hausdorff × {hausdorff:.2}  RMS × {rms:.2}  over {} levels", means.levels);
        if hausdorff > 1.7 || rms > 1.15 {
            faults.push(format!("{name}: Hausdorff × {hausdorff:.2}, RMS × {rms:.2} in the mean"));
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

/// `keep_area`: whole cards go, the others cover what all did, and no texture coordinate changes.
#[test]
fn foliage_keeps_the_area_that_it_covers() {
    let source = awkward_meshes().into_iter().find(|m| m.name == "foliage").expect("it is one of them").mesh;
    let levels = RATIOS.map(Target::ratio).to_vec();
    let simplified = |keep_area| {
        let options = Options { levels: levels.clone(), keep_area, ..Options::default() };
        simplify(&source, &options).expect("a valid mesh").levels
    };
    let coordinates = |mesh: &Mesh| -> BTreeSet<[u32; 2]> {
        let values = &mesh.attribute(Semantic::TexCoord(0)).expect("they are there").values;
        values.as_chunks().0.iter().map(|uv: &[f32; 2]| uv.map(f32::to_bits)).collect()
    };
    let (low, high) = source.bounds();
    for ((kept, bare), ratio) in simplified(true).into_iter().zip(simplified(false)).zip(RATIOS) {
        let theirs = baseline::simplify(&source, kept.mesh.triangles.len()).expect("a valid mesh");
        let [kept_cover, bare_cover, their_cover] =
            [&kept.mesh, &bare.mesh, &theirs.mesh].map(|level| compare_silhouettes(&source, level).covered);
        println!(
            "{ratio}: covers {kept_cover:.2} of the source, {bare_cover:.2} without growth, theirs {their_cover:.2}"
        );
        assert!(kept.mesh.triangles.len().abs_diff((1000.0 * ratio) as usize) <= 1);
        assert!(kept_cover > 1.15 * bare_cover.max(their_cover) && kept_cover < 1.2, "{ratio}");
        if ratio >= 0.05 {
            assert!(kept_cover > 0.9, "{ratio}: {kept_cover}");
        }
        if ratio >= 0.1 {
            assert!((area(&kept.mesh) / area(&source) - 1.0).abs() < 0.01, "{ratio}: {}", area(&kept.mesh));
        }
        assert!(coordinates(&kept.mesh).is_subset(&coordinates(&source)), "{ratio}");
        let (level_low, level_high) = kept.mesh.bounds();
        assert!((low - level_low).max_element() < 1e-4 && (level_high - high).max_element() < 1e-4, "{ratio}");
    }
}

fn area(mesh: &Mesh) -> f64 {
    let corner = |v: u32| DVec3::from(mesh.positions[v as usize].map(f64::from));
    mesh.triangles.iter().map(|t| t.map(corner)).map(|[a, b, c]| (b - a).cross(c - a).length() * 0.5).sum()
}

/// Of closed surfaces; copies of faces count as often as they are there.
fn volume(mesh: &Mesh) -> f64 {
    let corner = |v: u32| DVec3::from(mesh.positions[v as usize].map(f64::from));
    mesh.triangles.iter().map(|t| t.map(corner)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}
