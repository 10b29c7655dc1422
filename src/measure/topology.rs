//! Edges of a mesh whose positions are welded by value: attribute seams and group borders are not topology.

use crate::mesh::Mesh;
use rayon::slice::ParallelSliceMut;

/// What the welded mesh is made of.
#[derive(Debug, Default)]
pub struct Topology {
    /// One vertex of each position that triangles use.
    pub vertices: Vec<u32>,
    /// Edges of exactly one face, as vertices of the mesh, each with its lower welded position first.
    pub open_edges: Vec<[u32; 2]>,
    /// Edges of more than two faces.
    pub nonmanifold_edges: usize,
    /// Whether a face has a corner twice, by position.
    pub repeats_corner: Vec<bool>,
}

impl Topology {
    /// Welds `mesh` (−0 equals 0) and counts the faces at each edge; faces with a repeated corner have no edges.
    pub fn new(mesh: &Mesh) -> Self {
        let weld = weld_positions(mesh);
        let faces: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|v| weld.position_of[v as usize])).collect();
        let repeats_corner: Vec<bool> = faces.iter().map(|[a, b, c]| a == b || b == c || c == a).collect();
        let mut edges: Vec<[u32; 2]> = faces
            .iter()
            .zip(&repeats_corner)
            .filter(|&(_, &repeats)| !repeats)
            .flat_map(|(&[a, b, c], _)| [[a, b], [b, c], [c, a]])
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        edges.par_sort_unstable();
        let mut open_edges = Vec::new();
        let mut nonmanifold_edges = 0;
        for edge in edges.chunk_by(|a, b| a == b) {
            match edge.len() {
                1 => open_edges.push(edge[0].map(|p| weld.vertices[p as usize])),
                2 => {}
                _ => nonmanifold_edges += 1,
            }
        }
        Self { vertices: weld.vertices, open_edges, nonmanifold_edges, repeats_corner }
    }
}

struct Weld {
    /// For each vertex the number of its position; only for vertices that triangles use.
    position_of: Vec<u32>,
    /// The lowest vertex of each position.
    vertices: Vec<u32>,
}

/// Sorts by value: as fast as a hash map for this, and deterministic.
fn weld_positions(mesh: &Mesh) -> Weld {
    let mut used = vec![false; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    let key = |v: usize| mesh.positions[v].map(|x| (x + 0.0).to_bits());
    let mut keyed: Vec<([u32; 3], u32)> = (0..used.len()).filter(|&v| used[v]).map(|v| (key(v), v as u32)).collect();
    keyed.par_sort_unstable();
    let mut position_of = vec![0; used.len()];
    let mut vertices = Vec::new();
    for same in keyed.chunk_by(|a, b| a.0 == b.0) {
        same.iter().for_each(|&(_, v)| position_of[v as usize] = vertices.len() as u32);
        vertices.push(same[0].1);
    }
    Weld { position_of, vertices }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seams_are_welded_and_negative_zero_is_zero() {
        let mesh = Mesh {
            positions: vec![
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [-0.0, 0.0, 0.0],
                [1.0, -0.0, 0.0],
                [0.0, -1.0, 0.0],
            ],
            triangles: vec![[0, 1, 2], [4, 3, 5], [3, 0, 1]],
            ..Mesh::default()
        };
        let topology = Topology::new(&mesh);
        assert_eq!(topology.vertices.len(), 4);
        assert_eq!(topology.open_edges.len(), 4);
        assert_eq!(topology.nonmanifold_edges, 0);
        assert_eq!(topology.repeats_corner, [false, false, true]);
    }

    #[test]
    fn three_faces_at_an_edge_are_not_manifold() {
        let mesh = Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]],
            ..Mesh::default()
        };
        assert_eq!(Topology::new(&mesh).nonmanifold_edges, 1);
    }
}
