//! The shape of the level's triangles.

use super::Measurement;
use super::appearance::choose_side;
use super::surface::Surface;
use glam::DVec3;
use rayon::prelude::*;

/// A face counts as degenerate at this share of the squared diagonal: what f32 positions cannot tell from a line.
const NO_AREA: f64 = 1e-14;

/// Fills in slivers, flipped and degenerate faces of `level`.
pub fn judge_faces(source: &Surface, level: &Surface, diagonal: f64, result: &mut Measurement) {
    let angles: Vec<f64> = level.triangles.iter().map(smallest_angle).collect();
    let share_below = |limit: f64| angles.iter().filter(|&&a| a < limit).count() as f64 / angles.len().max(1) as f64;
    result.slivers5 = share_below(5.0);
    result.slivers10 = share_below(10.0);
    let no_area = NO_AREA * diagonal * diagonal;
    result.degenerate = level
        .areas
        .iter()
        .zip(&level.topology.repeats_corner)
        .filter(|&(&area, &twice)| twice || area <= no_area)
        .count();
    result.flipped = count_flipped(source, level, diagonal);
}

/// Degrees; 0 for a face without area.
fn smallest_angle(&[a, b, c]: &[DVec3; 3]) -> f64 {
    let angle = |at: DVec3, p: DVec3, q: DVec3| {
        let (u, v) = (p - at, q - at);
        u.cross(v).length().atan2(u.dot(v))
    };
    angle(a, b, c).min(angle(b, c, a)).min(angle(c, a, b)).to_degrees()
}

/// Faces whose centroid's nearest source face looks the other way.
fn count_flipped(source: &Surface, level: &Surface, diagonal: f64) -> usize {
    let faces = level.bvh.spatial_order();
    let centroid = |&face: &u32| level.triangles[face as usize].iter().sum::<DVec3>() / 3.0;
    let centroids: Vec<DVec3> = faces.iter().map(centroid).collect();
    let hits = source.bvh.closest_to_each(&centroids);
    let is_flipped = |i: &usize| {
        let normal = level.normals[faces[*i] as usize];
        let hit = choose_side(hits[*i], centroids[*i], normal, &source.bvh, &source.normals, diagonal);
        source.normals[hit.triangle as usize].dot(normal) < 0.0
    };
    (0..hits.len()).into_par_iter().filter(is_flipped).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smallest_angles() {
        let triangle = |x: f64, y: f64| smallest_angle(&[DVec3::ZERO, DVec3::X, DVec3::new(x, y, 0.0)]);
        assert!((triangle(0.0, 1.0) - 45.0).abs() < 1e-12);
        assert!((triangle(1.0, 5f64.to_radians().tan()) - 5.0).abs() < 1e-12);
        assert_eq!(triangle(0.5, 0.0), 0.0);
        assert_eq!(triangle(0.0, 0.0), 0.0);
    }
}
