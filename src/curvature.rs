//! Discrete Gaussian curvature by angle deficit (ESQEM, eq. 8 and 9).

use crate::mesh::edges::{Edge, EdgeKind};
use crate::mesh::surface::Surface;
use glam::DVec3;
use std::f64::consts::PI;

/// Gaussian curvature and surrounding area of a point.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Curvature {
    /// (2π − Σθ) / (ΣS / 3) inside, (π − Σθ) / (ΣS / 3) on the border; 1 / length².
    pub gauss: f64,
    /// ΣS, the area of the faces around the point.
    pub area: f64,
}

impl Curvature {
    /// Of the point `p`; `border` if an open edge ends there.
    pub fn at(surface: &Surface, p: u32, border: bool) -> Self {
        let (mut angle, mut area) = (0.0, 0.0);
        let here = surface.points[p as usize];
        for &corner in surface.ring(p) {
            let [a, b] = surface.opposite(corner).map(|q| surface.points[q as usize] - here);
            let cross = a.cross(b).length();
            angle += cross.atan2(a.dot(b));
            area += cross * 0.5;
        }
        let full = if border { PI } else { 2.0 * PI };
        // A point whose faces have no area has no curvature that could be told from noise.
        let gauss = if area > f64::MIN_POSITIVE { 3.0 * (full - angle) / area } else { 0.0 };
        Self { gauss, area }
    }

    /// Curvature of the edge between two points: |K|, weighted by the areas around its ends (eq. 10 and 11).
    pub fn of_edge(a: Self, b: Self) -> f64 {
        let area = a.area + b.area;
        if area > 0.0 { (a.gauss.abs() * a.area + b.gauss.abs() * b.area) / area } else { 0.0 }
    }
}

/// Which points lie on an open edge.
pub(crate) fn border_points(points: usize, edges: &[Edge]) -> Vec<bool> {
    let mut border = vec![false; points];
    for edge in edges.iter().filter(|e| e.kind.has(EdgeKind::BORDER)) {
        border[edge.a as usize] = true;
        border[edge.b as usize] = true;
    }
    border
}

/// Unit normal and area of a triangle; a zero normal if it has no area.
pub(crate) fn normal_and_area([a, b, c]: [DVec3; 3]) -> (DVec3, f64) {
    let cross = (b - a).cross(c - a);
    let length = cross.length();
    if length > 0.0 { (cross / length, length * 0.5) } else { (DVec3::ZERO, 0.0) }
}
