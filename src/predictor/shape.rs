//! What a surface looks like, in five numbers: the second predictor's eyes.

use crate::curvature::{Curvature, border_points, normal_and_area};
use crate::mesh::Mesh;
use crate::mesh::edges::{Edge, collect_edges};
use crate::mesh::surface::Surface;
use glam::DVec3;

/// Features of a surface that have no unit; the same for the same shape at any size.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Shape {
    /// Mean over the edges of 1 − cos of the angle between the normals at their ends.
    pub bend: f64,
    /// Standard deviation of that over its mean.
    pub bend_spread: f64,
    /// The same of the points' angle deficits, their integrated Gaussian curvature.
    pub deficit_spread: f64,
    /// The same of the edges' lengths.
    pub length_spread: f64,
    /// Euler characteristic, points − edges + faces: 2 for a sphere, 0 for a torus, and one more for each piece and one less for each hole.
    pub euler: f64,
}

/// Digits after the point that count: further ones may differ from machine to machine.
const PRECISION: f64 = 1e6;

impl Shape {
    /// Of a mesh, which must be valid.
    pub fn of_mesh(mesh: &Mesh) -> Self {
        let surface = Surface::new(mesh);
        let edges = collect_edges(&surface);
        Self::of(&surface, &edges)
    }

    /// Of a surface with these edges.
    pub(crate) fn of(surface: &Surface, edges: &[Edge]) -> Self {
        let points = surface.points.len() as u32;
        let normals: Vec<DVec3> = (0..points).map(|p| mean_normal(surface, p)).collect();
        let bends: Vec<f64> = edges.iter().map(|e| 1.0 - normals[e.a as usize].dot(normals[e.b as usize])).collect();
        let lengths: Vec<f64> =
            edges.iter().map(|e| surface.points[e.a as usize].distance(surface.points[e.b as usize])).collect();
        let border = border_points(surface.points.len(), edges);
        let used: Vec<u32> = (0..points).filter(|&p| !surface.ring(p).is_empty()).collect();
        let deficits: Vec<f64> = used
            .iter()
            .map(|&p| Curvature::at(surface, p, border[p as usize]))
            .map(|c| (c.gauss * c.area / 3.0).abs())
            .collect();
        let (bend, bend_spread) = mean_and_spread(&bends);
        Self {
            bend,
            bend_spread,
            deficit_spread: mean_and_spread(&deficits).1,
            length_spread: mean_and_spread(&lengths).1,
            euler: used.len() as f64 - edges.len() as f64 + surface.face_count() as f64,
        }
        .rounded()
    }

    /// The numbers as a list, in the order of the fields.
    pub fn to_array(self) -> [f64; 5] {
        [self.bend, self.bend_spread, self.deficit_spread, self.length_spread, self.euler]
    }

    /// From such a list.
    pub fn from_array([bend, bend_spread, deficit_spread, length_spread, euler]: [f64; 5]) -> Self {
        Self { bend, bend_spread, deficit_spread, length_spread, euler }
    }

    /// What a net gets to see: every number between −1 and 1.
    pub(super) fn inputs(self) -> [f64; 5] {
        let squash = |x: f64| x / (1.0 + x.abs());
        [
            self.bend.max(0.0).sqrt().min(1.0),
            squash(self.bend_spread),
            squash(self.deficit_spread),
            squash(self.length_spread),
            self.euler.clamp(-20.0, 20.0) / 20.0,
        ]
    }

    fn rounded(self) -> Self {
        Self::from_array(self.to_array().map(|x| (x * PRECISION).round() / PRECISION))
    }
}

fn mean_normal(surface: &Surface, point: u32) -> DVec3 {
    let faces = surface.ring(point).iter().map(|&c| normal_and_area(surface.triangle(Surface::face_of(c))).0);
    faces.sum::<DVec3>().normalize_or_zero()
}

/// Mean, and standard deviation over the mean; 0 where there is none.
fn mean_and_spread(values: &[f64]) -> (f64, f64) {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / count;
    (mean, if mean > 0.0 { variance.sqrt() / mean } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tetrahedron_is_even_and_closed() {
        let positions = vec![[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
        let triangles = vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        let shape = Shape::of_mesh(&Mesh { positions, triangles, ..Mesh::default() });
        // The normals at two vertices have a cosine of −1/3.
        assert!((shape.bend - 4.0 / 3.0).abs() < 1e-5, "{shape:?}");
        assert_eq!((shape.bend_spread, shape.deficit_spread, shape.length_spread, shape.euler), (0.0, 0.0, 0.0, 2.0));
        assert_eq!(Shape::from_array(shape.to_array()), shape);
    }

    #[test]
    fn a_sheet_is_flat_open_and_uneven() {
        let positions = vec![[0.0; 3], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0]];
        let shape = Shape::of_mesh(&Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() });
        assert_eq!((shape.bend, shape.bend_spread, shape.euler), (0.0, 0.0, 1.0));
        // Lengths 3, 4, 5.
        assert!((shape.length_spread - (2.0f64 / 3.0).sqrt() / 4.0).abs() < 1e-6);
    }
}
