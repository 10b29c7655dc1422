//! Area-uniform stratified samples of a triangle surface: the same for the same surface, count and seed.

use crate::random::Random;
use glam::DVec3;

/// A point of a surface.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    pub point: DVec3,
    pub triangle: u32,
    /// Weights of the triangle's corners.
    pub barycentric: [f64; 3],
}

/// Steps of Roberts's R₂ sequence (2018), 1/g and 1/g² for g³ = g + 1: any run of it covers the unit square evenly,
/// so that the samples of one triangle do not clump. Halves the noise of an RMS against independent random numbers.
const R2: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053_3];

/// `count` samples, one in each of `count` strata of equal area, the triangles taken in the order given (each once).
/// The nearer to each other they follow, the smaller the strata and the noise. Where the surface has no area at all,
/// every triangle gets the same share.
pub fn sample_surface(triangles: &[[DVec3; 3]], areas: &[f64], order: &[u32], count: usize, seed: u64) -> Vec<Sample> {
    let total: f64 = order.iter().map(|&t| areas[t as usize]).sum();
    let share = |i: usize| if total > 0.0 { areas[order[i] as usize] / total } else { 1.0 / order.len() as f64 };
    let Some(last) = (0..order.len()).rev().find(|&i| share(i) > 0.0) else { return Vec::new() };
    let mut random = Random(seed);
    let shift = [random.unit(), random.unit()];
    let mut place = 0;
    let mut covered = share(0);
    (0..count)
        .map(|i| {
            let wanted = (i as f64 + random.unit()) / count as f64;
            while covered <= wanted && place < last {
                place += 1;
                covered += share(place);
            }
            let triangle = order[place];
            let [r, s] = [0, 1].map(|k| (shift[k] + i as f64 * R2[k]).fract());
            let r = r.sqrt();
            let barycentric = [1.0 - r, r * (1.0 - s), r * s];
            Sample { point: blend(triangles[triangle as usize], barycentric), triangle, barycentric }
        })
        .collect()
}

/// The point with these barycentric weights.
pub fn blend([a, b, c]: [DVec3; 3], [u, v, w]: [f64; 3]) -> DVec3 {
    a * u + b * v + c * w
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

    #[test]
    fn samples_follow_the_area() {
        let big = UNIT.map(|p| p * 3.0);
        let flat = [DVec3::ZERO, DVec3::X, DVec3::X];
        let samples = sample_surface(&[UNIT, flat, big], &[0.5, 0.0, 4.5], &[2, 1, 0], 1000, 1);
        let count = |t| samples.iter().filter(|s| s.triangle == t).count();
        assert_eq!((count(0), count(1), count(2)), (100, 0, 900));
    }

    #[test]
    fn samples_are_spread_evenly_inside_a_triangle() {
        let samples = sample_surface(&[UNIT], &[0.5], &[0], 40_000, 7);
        let mean = samples.iter().map(|s| s.point).sum::<DVec3>() / 40_000.0;
        assert!((mean - DVec3::new(1.0, 1.0, 0.0) / 3.0).length() < 0.01);
        // A quarter of the area lies beyond half the way from any corner.
        for corner in 0..3 {
            let near = samples.iter().filter(|s| s.barycentric[corner] > 0.5).count();
            assert!((9_600..10_400).contains(&near), "{near}");
        }
    }

    #[test]
    fn a_surface_without_area_is_sampled_by_triangle() {
        let samples = sample_surface(&[[DVec3::ZERO; 3], [DVec3::X; 3]], &[0.0, 0.0], &[0, 1], 10, 1);
        assert_eq!(samples.iter().filter(|s| s.point == DVec3::X).count(), 5);
        assert!(sample_surface(&[], &[], &[], 10, 1).is_empty());
    }
}
