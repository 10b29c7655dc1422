//! What a mesh covers, seen from several sides: masks of pixels by parallel projection.

use glam::{DVec2, DVec3};
use gltf_lod::mesh::Mesh;

/// Pixels along each side of a mask.
const SIZE: usize = 192;

/// Along the axes and askew.
const DIRECTIONS: [[f64; 3]; 6] =
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 0.5], [0.3, -0.5, 1.0]];

/// Two meshes in the same frame, from all directions.
#[derive(Debug, Clone, Copy)]
pub struct Silhouette {
    /// Pixels that only one of them covers, over those that the first covers.
    pub off: f64,
    /// Pixels that the second covers, over those that the first covers.
    pub covered: f64,
}

/// Compares what `level` covers with what `source` does.
pub fn compare_silhouettes(source: &Mesh, level: &Mesh) -> Silhouette {
    let (low, high) = source.bounds();
    let (center, radius) = ((low + high).as_dvec3() * 0.5, f64::from(low.distance(high)) * 0.5);
    let (mut off, mut covered, mut all) = (0, 0, 0);
    for direction in DIRECTIONS {
        let masks = [source, level].map(|mesh| draw(mesh, DVec3::from(direction).normalize(), center, radius));
        let count = |mask: &[bool]| mask.iter().filter(|pixel| **pixel).count();
        off += masks[0].iter().zip(&masks[1]).filter(|(a, b)| a != b).count();
        all += count(&masks[0]);
        covered += count(&masks[1]);
    }
    Silhouette { off: off as f64 / all as f64, covered: covered as f64 / all as f64 }
}

fn draw(mesh: &Mesh, direction: DVec3, center: DVec3, radius: f64) -> Vec<bool> {
    let (right, scale) = (direction.any_orthonormal_vector(), SIZE as f64 / (2.0 * radius));
    let up = direction.cross(right);
    let mut mask = vec![false; SIZE * SIZE];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| {
            let p = DVec3::from(mesh.positions[v as usize].map(f64::from)) - center;
            (DVec2::new(p.dot(right), p.dot(up)) + radius) * scale
        });
        let low = a.min(b).min(c).max(DVec2::ZERO).floor();
        let high = a.max(b).max(c).min(DVec2::splat(SIZE as f64)).ceil();
        for (x, y) in
            (low.y as usize..high.y as usize).flat_map(|y| (low.x as usize..high.x as usize).map(move |x| (x, y)))
        {
            let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| (to - from).perp_dot(p - from));
            mask[y * SIZE + x] |= sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0);
        }
    }
    mask
}
