//! A quick two-sided distance to the source, for decisions on the way: which variant of a level is nearer, whether an error target holds.
//!
//! Vertices, edge midpoints and centroids of the level against the source, source vertices and centroids against the level. The ruler in
//! `measure` says what is reported.

use crate::bvh::{Bvh, Hit};
use crate::mesh::Mesh;
use glam::DVec3;

/// Source points asked at most.
const SOURCE_SAMPLES: usize = 20_000;

/// The source, ready for asking.
pub(crate) struct Deviation {
    source: Bvh,
    samples: Vec<DVec3>,
}

/// Largest and root mean square distance, object units.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Distance {
    pub max: f64,
    pub rms: f64,
}

impl Deviation {
    pub fn new(source: &Mesh) -> Self {
        let centroids = source.triangles.iter().map(|t| centroid(source, t));
        let all: Vec<DVec3> = used_vertices(source).into_iter().chain(centroids).collect();
        let step = all.len().div_ceil(SOURCE_SAMPLES).max(1);
        let samples = all.into_iter().step_by(step).collect();
        Self { source: Bvh::new(&source.positions, &source.triangles), samples }
    }

    /// Distance between the source and `level`, both ways.
    pub fn of(&self, level: &Mesh) -> Distance {
        let tree = Bvh::new(&level.positions, &level.triangles);
        let middles = level.triangles.iter().flat_map(|t| {
            let [a, b, c] = t.map(|v| position(level, v));
            [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5, (a + b + c) / 3.0]
        });
        let points: Vec<DVec3> = used_vertices(level).into_iter().chain(middles).collect();
        let (back, forth) = (distances(&self.source, &points), distances(&tree, &self.samples));
        let mean_square = |d: &[f64]| d.iter().map(|x| x * x).sum::<f64>() / d.len().max(1) as f64;
        Distance {
            max: back.iter().chain(&forth).copied().fold(0.0, f64::max),
            rms: ((mean_square(&back) + mean_square(&forth)) * 0.5).sqrt(),
        }
    }
}

fn distances(tree: &Bvh, points: &[DVec3]) -> Vec<f64> {
    tree.closest_to_each(points).iter().map(Hit::distance).collect()
}

fn used_vertices(mesh: &Mesh) -> Vec<DVec3> {
    let mut used = vec![false; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    (0..used.len()).filter(|&v| used[v]).map(|v| position(mesh, v as u32)).collect()
}

fn centroid(mesh: &Mesh, triangle: &[u32; 3]) -> DVec3 {
    let [a, b, c] = triangle.map(|v| position(mesh, v));
    (a + b + c) / 3.0
}

fn position(mesh: &Mesh, vertex: u32) -> DVec3 {
    DVec3::from(mesh.positions[vertex as usize].map(f64::from))
}
