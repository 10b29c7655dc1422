//! A mesh with everything that a measurement asks of it, worked out once.

use super::sample::{Sample, sample_surface};
use super::{Sampling, topology::Topology};
use crate::bvh::Bvh;
use crate::mesh::Mesh;
use crate::mesh::order::order_in_space;
use glam::DVec3;

/// Fewest and most points on each open edge.
const BORDER_POINTS: [usize; 2] = [4, 16];

#[derive(Debug)]
pub struct Surface {
    pub triangles: Vec<[DVec3; 3]>,
    /// Unit; zero for a face without area.
    pub normals: Vec<DVec3>,
    pub areas: Vec<f64>,
    pub topology: Topology,
    pub bvh: Bvh,
    /// Mostly near the one before.
    pub samples: Vec<Sample>,
    /// One point for each position that a triangle uses.
    pub vertices: Vec<DVec3>,
    pub border: Vec<DVec3>,
}

impl Surface {
    pub fn new(mesh: &Mesh, sampling: Sampling) -> Self {
        let point = |v: u32| DVec3::from(mesh.positions[v as usize].map(f64::from));
        let triangles: Vec<[DVec3; 3]> = mesh.triangles.iter().map(|t| t.map(point)).collect();
        let (normals, areas): (Vec<_>, Vec<_>) = triangles.iter().map(orient).unzip();
        let bvh = Bvh::new(&mesh.positions, &mesh.triangles);
        let samples = sample_surface(&triangles, &areas, bvh.spatial_order(), sampling.samples, sampling.seed);
        let order = order_in_space(samples.iter().map(|sample| bvh.to_unit_frame(sample.point)));
        let topology = Topology::new(mesh);
        let open_edges = topology.open_edges.iter().map(|edge| edge.map(point));
        Self {
            border: spread_on_edges(open_edges, sampling.samples),
            vertices: topology.vertices.iter().map(|&v| point(v)).collect(),
            bvh,
            triangles,
            normals,
            areas,
            topology,
            samples: order.into_iter().map(|i| samples[i as usize]).collect(),
        }
    }
}

/// Unit normal (zero without area) and area.
fn orient(&[a, b, c]: &[DVec3; 3]) -> (DVec3, f64) {
    let normal = (b - a).cross(c - a);
    let length = normal.length();
    (if length > 0.0 { normal / length } else { DVec3::ZERO }, length / 2.0)
}

/// About `budget` points in all.
fn spread_on_edges(edges: impl ExactSizeIterator<Item = [DVec3; 2]>, budget: usize) -> Vec<DVec3> {
    let count = (budget / edges.len().max(1)).clamp(BORDER_POINTS[0], BORDER_POINTS[1]);
    edges.flat_map(|[a, b]| (0..count).map(move |i| a.lerp(b, (i as f64 + 0.5) / count as f64))).collect()
}
