//! The stages of a build over bumpy spheres of several sizes: `cargo bench`. How they compare with meshoptimizer is
//! `gltf-lod bench`'s to say.

#![allow(dead_code)] // The generators have more than is needed here.

#[path = "../examples/make_fixtures/builder.rs"]
mod builder;
#[path = "../examples/make_fixtures/portable.rs"]
mod portable;
#[path = "../examples/make_fixtures/shape.rs"]
mod shape;
#[path = "../examples/make_fixtures/surfaces.rs"]
mod surfaces;

use builder::Builder;
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use gltf_lod::asset::{Asset, Limits};
use gltf_lod::emit::{self, Existing, Layout, LodLevel, MeshLods};
use gltf_lod::measure::{Ruler, Sampling};
use gltf_lod::mesh::{Attribute, Mesh, Semantic};
use gltf_lod::simplify::{Effort, Options, Target, simplify};
use serde_json::json;
use shape::Shape;
use std::path::Path;
use surfaces::bumpy_sphere;

/// Triangles, about.
const SIZES: [usize; 3] = [10_000, 100_000, 1_000_000];
/// What a file of the generators can hold: its indices have 16 bits.
const FILE_SIZES: [usize; 2] = [10_000, 100_000];

fn main() {
    divan::main();
}

/// A sphere of about `triangles` triangles, with a seam.
fn sphere(triangles: usize) -> Shape {
    let rows = (triangles as f64 / 4.0).sqrt() as usize;
    bumpy_sphere(2 * rows, rows, 0.25, 1)
}

fn plain(shape: &Shape) -> Mesh {
    let welded = shape.welded();
    Mesh { positions: welded.positions, triangles: welded.triangles, ..Mesh::default() }
}

fn with_attributes(shape: &Shape) -> Mesh {
    let attribute = |semantic, width, values: &[f32]| Attribute { semantic, width, values: values.to_vec() };
    Mesh {
        positions: shape.positions.clone(),
        triangles: shape.triangles.clone(),
        attributes: vec![
            attribute(Semantic::Normal, 3, shape.normals.as_flattened()),
            attribute(Semantic::TexCoord(0), 2, shape.uvs.as_flattened()),
        ],
        ..Mesh::default()
    }
}

fn chain(ratios: &[f64], effort: Effort) -> Options {
    Options { levels: ratios.iter().map(|&ratio| Target::ratio(ratio)).collect(), effort, ..Options::default() }
}

const RATIOS: [f64; 4] = [0.5, 0.25, 0.125, 0.0625];

fn bench_simplify(bencher: Bencher, mesh: &Mesh, options: &Options) {
    bencher.counter(ItemsCount::new(mesh.triangles.len())).bench(|| simplify(black_box(mesh), options));
}

/// A level that keeps every triangle: checking, welding, the working surface, and the way back.
#[divan::bench(args = SIZES, sample_count = 10)]
fn weld(bencher: Bencher, triangles: usize) {
    bench_simplify(bencher, &plain(&sphere(triangles)), &chain(&[1.0], Effort::Fast));
}

#[divan::bench(args = SIZES, sample_count = 10)]
fn weld_attributes(bencher: Bencher, triangles: usize) {
    bench_simplify(bencher, &with_attributes(&sphere(triangles)), &chain(&[1.0], Effort::Fast));
}

#[divan::bench(args = SIZES, sample_count = 10)]
fn simplify_fast(bencher: Bencher, triangles: usize) {
    bench_simplify(bencher, &plain(&sphere(triangles)), &chain(&RATIOS, Effort::Fast));
}

#[divan::bench(args = SIZES, sample_count = 10)]
fn simplify_fast_attributes(bencher: Bencher, triangles: usize) {
    bench_simplify(bencher, &with_attributes(&sphere(triangles)), &chain(&RATIOS, Effort::Fast));
}

#[divan::bench(args = FILE_SIZES, sample_count = 5)]
fn simplify_default(bencher: Bencher, triangles: usize) {
    bench_simplify(bencher, &plain(&sphere(triangles)), &chain(&RATIOS, Effort::Default));
}

#[divan::bench(args = FILE_SIZES, sample_count = 5)]
fn measure_half(bencher: Bencher, triangles: usize) {
    let mesh = with_attributes(&sphere(triangles));
    let ruler = Ruler::new(&mesh, Sampling::for_triangles(triangles));
    let level = simplify_to_half(&mesh);
    bencher.counter(ItemsCount::new(mesh.triangles.len())).bench(|| ruler.measure(black_box(&level)));
}

#[divan::bench(args = FILE_SIZES, sample_count = 10)]
fn read(bencher: Bencher, triangles: usize) {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let file = write_sphere(directory.path(), triangles);
    bencher.counter(ItemsCount::new(triangles)).bench(|| {
        let asset = Asset::read(&file, directory.path(), &Limits::default()).expect("a sound file");
        asset.geometry(0, &Limits::default())
    });
}

/// The bytes of a file with a level of half the triangles, not written.
#[divan::bench(args = FILE_SIZES, sample_count = 10)]
fn emit_half(bencher: Bencher, triangles: usize) {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let file = write_sphere(directory.path(), triangles);
    let asset = Asset::read(&file, directory.path(), &Limits::default()).expect("a sound file");
    let geometry = asset.geometry(0, &Limits::default()).expect("a mesh");
    let level = simplify_to_half(&geometry.mesh);
    let levels = vec![LodLevel { mesh: level, source_vertices: None }];
    let lods = [MeshLods { mesh: 0, geometry, levels, coverage: vec![0.5, 0.01], extras: json!({}) }];
    let options =
        emit::Options { layout: Layout::Append, naming: "{name}_LOD{level}".into(), existing: Existing::Keep };
    bencher.counter(ItemsCount::new(triangles)).bench(|| emit::emit(&asset, black_box(&lods), &options));
}

fn simplify_to_half(mesh: &Mesh) -> Mesh {
    let mut chain = simplify(mesh, &chain(&[0.5], Effort::Fast)).expect("a sound mesh");
    chain.levels.swap_remove(0).mesh
}

fn write_sphere(directory: &Path, triangles: usize) -> std::path::PathBuf {
    let file = directory.join("sphere.glb");
    std::fs::write(&file, Builder::showing("Sphere", &sphere(triangles)).glb()).expect("a writable directory");
    file
}
