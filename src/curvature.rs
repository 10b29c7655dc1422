//! Discrete Gaussian curvature by angle deficit (ESQEM, eq. 8 and 9).

use crate::mesh::edges::{Edge, EdgeKind};
use crate::mesh::surface::Surface;
use glam::DVec3;
use rayon::prelude::*;
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

/// Gaussian curvature of all points, in single precision: quick rather than exact to the last digit.
pub(crate) fn gauss_curvatures(surface: &Surface, border: &[bool]) -> Vec<f32> {
    const TASK: usize = 4096;
    // Angles at the three corners, and the area.
    let faces: Vec<[f32; 4]> = (0..surface.face_slots())
        .into_par_iter()
        .with_min_len(TASK)
        .map(|f| if surface.is_live(f) { angles_and_area(surface.triangle(f)) } else { [0.0; 4] })
        .collect();
    (0..surface.points.len())
        .into_par_iter()
        .with_min_len(TASK)
        .map(|p| {
            let (mut angle, mut area) = (0.0, 0.0);
            for &corner in surface.ring(p as u32) {
                let face = &faces[Surface::face_of(corner)];
                angle += face[(corner & 3) as usize];
                area += face[3];
            }
            let full = if border[p] { std::f32::consts::PI } else { 2.0 * std::f32::consts::PI };
            if area > f32::MIN_POSITIVE { 3.0 * (full - angle) / area } else { 0.0 }
        })
        .collect()
}

fn angles_and_area([a, b, c]: [DVec3; 3]) -> [f32; 4] {
    let (ab, ac, bc) = ((b - a).as_vec3(), (c - a).as_vec3(), (c - b).as_vec3());
    let cross = ab.cross(ac).length();
    let (alpha, beta) = (angle(cross, ab.dot(ac)), angle(cross, -ab.dot(bc)));
    [alpha, beta, std::f32::consts::PI - alpha - beta, cross * 0.5]
}

/// The angle with this sine and cosine, up to a common factor, `sine` ≥ 0; within 2e-5 (Abramowitz & Stegun 4.4.49). Arithmetic alone gives the
/// same bits on every machine, which a library's arc tangent does not.
fn angle(sine: f32, cosine: f32) -> f32 {
    let (small, large) = if sine < cosine.abs() { (sine, cosine.abs()) } else { (cosine.abs(), sine) };
    if large == 0.0 {
        return 0.0;
    }
    let x = small / large;
    let s = x * x;
    let tangent = x * (0.999_866 + s * (-0.330_299_5 + s * (0.180_141 + s * (-0.085_133 + s * 0.020_835_1))));
    let first = if sine < cosine.abs() { tangent } else { std::f32::consts::FRAC_PI_2 - tangent };
    if cosine < 0.0 { std::f32::consts::PI - first } else { first }
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
