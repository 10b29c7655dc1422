//! Discrete Gaussian curvature by angle deficit (ESQEM, eq. 8 and 9), and what else angles say of a surface.

use crate::lanes::{cross, dot, gather, minus};
use crate::mesh::edges::{Edge, EdgeKind};
use crate::mesh::surface::Surface;
use crate::tasks;
use glam::DVec3;
use smallvec::SmallVec;
use std::f32::consts::{FRAC_PI_2, PI, TAU};
use wide::f32x4;

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
        use std::f64::consts::PI;
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

/// What a surface is like around a point.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Form {
    /// |K|, 1 / length².
    pub curvature: f32,
    /// Mean of the smallest angles of the faces.
    pub angle: f32,
}

impl Form {
    pub fn mean(self, other: Self) -> Self {
        Self::mean_of([self, other].into_iter())
    }

    /// Of none: flat, without a face.
    pub fn mean_of(forms: impl Iterator<Item = Self>) -> Self {
        let (sum, count) = forms.fold((Self::default(), 0), |(sum, count), form| {
            (Self { curvature: sum.curvature + form.curvature, angle: sum.angle + form.angle }, count + 1)
        });
        let share = 1.0 / count.max(1) as f32;
        Self { curvature: sum.curvature * share, angle: sum.angle * share }
    }
}

/// Of all points, in single precision: quick rather than exact to the last digit.
pub(crate) fn forms(surface: &Surface, border: &[bool]) -> Vec<Form> {
    // Angles at the three corners, and the area.
    let mut faces = vec![[0.0; 4]; surface.face_slots()];
    tasks::for_some(&mut faces, |start, faces| {
        for (four, faces) in faces.chunks_mut(4).enumerate() {
            let first = start + 4 * four;
            let corners = [0, 1, 2, 3].map(|lane: usize| surface.triangle(first + lane.min(faces.len() - 1)));
            faces.iter_mut().zip(angles_and_areas(corners)).for_each(|(face, new)| *face = new);
        }
    });
    tasks::collect(surface.points.len(), |p| {
        let (mut angle, mut area, mut smallest) = (0.0, 0.0, 0.0);
        let ring = surface.ring(p as u32);
        for &corner in ring {
            let face = &faces[Surface::face_of(corner)];
            angle += face[(corner & 3) as usize];
            area += face[3];
            smallest += face[0].min(face[1]).min(face[2]);
        }
        let once = if border[p] { PI } else { TAU };
        // Several sheets through the point are flat where each of them is.
        let more = if angle - once > PI { ((angle - once) / TAU).round() } else { 0.0 };
        let full = once + TAU * more;
        let deficit = full - angle;
        let turn = if border[p] { deficit.abs().max(border_turn(surface, p as u32)) } else { deficit };
        let curvature = if area > f32::MIN_POSITIVE { (3.0 * turn / area).abs() } else { 0.0 };
        Form { curvature, angle: smallest / ring.len().max(1) as f32 }
    })
}

/// The angle by which the border turns at a point, in space: in a flat sheet that is the angle deficit, at the end of a tube it is that of the cap which is
/// not there. 0 where not exactly two border edges meet.
fn border_turn(surface: &Surface, p: u32) -> f32 {
    let ring = surface.ring(p);
    let links = || ring.iter().flat_map(|&corner| surface.opposite(corner));
    let ends: SmallVec<[u32; 4]> = links().filter(|&q| links().filter(|&r| r == q).count() == 1).collect();
    let &[a, b] = ends.as_slice() else { return 0.0 };
    let [before, here, after] = [a, p, b].map(|q| surface.points[q as usize]);
    (here - before).angle_between(after - here) as f32
}

fn angles_and_areas(triangles: [[DVec3; 3]; 4]) -> [[f32; 4]; 4] {
    let edge = |from: usize, to: usize| gather(triangles.map(|t| (t[to] - t[from]).as_vec3()));
    let (ab, ac) = (edge(0, 1), edge(0, 2));
    let bc = minus(ac, ab);
    let normal = cross(ab, ac);
    let double_area = dot(normal, normal).sqrt();
    let (alpha, beta) = (angle(double_area, dot(ab, ac)), angle(double_area, -dot(ab, bc)));
    let gamma = f32x4::PI - alpha - beta;
    f32x4::transpose([alpha, beta, gamma, double_area * f32x4::HALF]).map(f32x4::to_array)
}

/// The angle with this sine and cosine, up to a common factor, `sine` ≥ 0; within 2e-5 (Abramowitz & Stegun 4.4.49). Arithmetic alone gives the
/// same bits on every machine, which a library's arc tangent does not.
fn angle(sine: f32x4, cosine: f32x4) -> f32x4 {
    let splat = f32x4::splat;
    let length = cosine.abs();
    let x = sine.fast_min(length) / sine.fast_max(length).fast_max(splat(f32::MIN_POSITIVE));
    let s = x * x;
    let series = splat(0.180_141) + s * (splat(-0.085_133) + s * splat(0.020_835_1));
    let tangent = x * (splat(0.999_866) + s * (splat(-0.330_299_5) + s * series));
    let first = sine.simd_lt(length).select(tangent, splat(FRAC_PI_2) - tangent);
    let all = cosine.simd_lt(f32x4::ZERO).select(f32x4::PI - first, first);
    // Without a length there is no angle.
    sine.fast_max(length).simd_gt(f32x4::ZERO) & all
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::mesh::edges::collect_edges;

    fn forms_of(mesh: &Mesh) -> Vec<Form> {
        let surface = Surface::new(mesh);
        forms(&surface, &border_points(surface.points.len(), &collect_edges(&surface)))
    }

    fn curvatures(mesh: &Mesh) -> Vec<f32> {
        forms_of(mesh).into_iter().map(|form| form.curvature).collect()
    }

    #[test]
    fn the_angle_of_a_form_is_the_mean_of_the_smallest() {
        // At the first point a right-angled triangle with two equal sides, and one of 30 degrees.
        let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-3f32.sqrt(), 0.0, 0.0]];
        let forms = forms_of(&Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() });
        let expected = [(PI / 4.0 + PI / 6.0) / 2.0, PI / 4.0, (PI / 4.0 + PI / 6.0) / 2.0, PI / 6.0];
        assert!(forms.iter().zip(expected).all(|(form, angle)| (form.angle - angle).abs() < 1e-3), "{forms:?}");
        assert!((forms[1].mean(forms[3]).angle - (expected[1] + expected[3]) / 2.0).abs() < 1e-3);
    }

    /// A prism over a triangle, open at both ends: flat by its angles, but its ends turn by 120° at each point.
    #[test]
    fn the_end_of_a_tube_is_a_tip() {
        let ring = [[1.0, 0.0], [-0.5, 0.866_025_4], [-0.5, -0.866_025_4]];
        let positions: Vec<[f32; 3]> = [0.0, 1.0].iter().flat_map(|&z| ring.map(|[x, y]| [x, y, z])).collect();
        let triangles = (0..3).flat_map(|i| {
            let (a, b) = (i, (i + 1) % 3);
            [[a, b, b + 3], [a, b + 3, a + 3]]
        });
        let mesh = Mesh { triangles: triangles.collect(), positions, ..Mesh::default() };
        // Three faces of half of √3 at each point.
        let expected = 3.0 * (TAU / 3.0) / (1.5 * 3f32.sqrt());
        assert!(curvatures(&mesh).iter().all(|k| (k / expected - 1.0).abs() < 1e-3), "{:?}", curvatures(&mesh));
    }

    #[test]
    fn sheets_with_two_sides_are_as_flat_as_others() {
        let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
        let front = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]];
        let triangles = front.into_iter().chain(front.map(|[a, b, c]| [c, b, a])).collect();
        assert!(curvatures(&Mesh { positions, triangles, ..Mesh::default() })[0] < 1e-3);
    }
}
