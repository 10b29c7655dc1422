//! The distance from one surface to another: means over samples, and the maximum over every place where it may sit:
//! the samples, all vertices, points along the borders, the centroids of all faces, and a lattice on the worst faces.

use super::sample::{Sample, blend};
use super::{Distance, surface::Surface};
use crate::bvh::{Bvh, Hit};
use glam::DVec3;
use rayon::prelude::*;

/// Faces that get a lattice: those of the farthest samples and centroids.
const WORST_FACES: usize = 64;

/// As many of the farthest samples as are looked at for worst faces.
const WORST_SAMPLES: usize = 512;

/// A centroid at this share of the largest distance or more makes its face a candidate too. Dense meshes have more
/// faces than samples.
const NEARLY: f64 = 0.75;

/// Between samples no maximum below this share of the diagonal is looked for: it is rounding of f32 positions, and
/// surfaces that are the same would cost an exact search for every point.
const RESOLUTION: f64 = 1e-8;

/// Steps along each edge of the lattice on a worst face: 861 points.
const LATTICE: u32 = 40;

/// Distance from the surface `from` to the one in `to`, and the closest point for each of its samples. Both surfaces
/// have triangles. `diagonal` sets the scale of what counts as 0.
pub fn measure_distance(from: &Surface, to: &Bvh, diagonal: f64) -> (Distance, Vec<Hit>) {
    let hits = find_closest(&from.samples, to);
    let count = hits.len().max(1) as f64;
    let mean = hits.iter().map(Hit::distance).sum::<f64>() / count;
    let rms = (hits.iter().map(|hit| hit.distance_squared).sum::<f64>() / count).sqrt();
    let of_samples = hits.iter().map(Hit::distance).fold(0.0, f64::max);
    let floor = of_samples.max(diagonal * RESOLUTION);
    let max = to.largest_distance(&from.vertices, floor);
    let max = to.largest_distance(&from.border, max);
    let max = raise_by_worst_faces(max, from, &hits, to);
    (Distance { max: if max > floor { max } else { of_samples }, rms, mean }, hits)
}

/// Mean squared distance of the samples, and the largest of samples and vertices: without the search between them, which costs more than the rest.
pub fn measure_roughly(from: &Surface, to: &Bvh) -> (f64, f64) {
    let hits = find_closest(&from.samples, to);
    let square = hits.iter().map(|hit| hit.distance_squared).sum::<f64>() / hits.len().max(1) as f64;
    let of_samples = hits.iter().map(Hit::distance).fold(0.0, f64::max);
    (square, to.largest_distance(&from.vertices, of_samples))
}

/// Mean squared distance of samples to a surface.
pub fn mean_square(samples: &[Sample], to: &Bvh) -> f64 {
    let hits = find_closest(samples, to);
    hits.iter().map(|hit| hit.distance_squared).sum::<f64>() / hits.len().max(1) as f64
}

fn find_closest(samples: &[Sample], to: &Bvh) -> Vec<Hit> {
    let points: Vec<DVec3> = samples.iter().map(|sample| sample.point).collect();
    to.closest_to_each(&points)
}

fn raise_by_worst_faces(max: f64, from: &Surface, hits: &[Hit], to: &Bvh) -> f64 {
    let raise = |&(face, near): &(u32, Hit)| raise_by_lattice(max, from.triangles[face as usize], near, to);
    find_worst_faces(max, from, hits, to).par_iter().map(raise).reduce(|| max, f64::max)
}

/// The largest of `max` and the distances of a lattice on a triangle; `near` is the closest point to one of its points.
fn raise_by_lattice(mut max: f64, triangle: [DVec3; 3], mut near: Hit, to: &Bvh) -> f64 {
    let step = (triangle[2] - triangle[1]).length() / f64::from(LATTICE);
    for i in 0..=LATTICE {
        let mut j = 0;
        while j <= LATTICE - i {
            let barycentric = [i, j, LATTICE - i - j].map(|k| f64::from(k) / f64::from(LATTICE));
            let Some(hit) = to.closest_or_within(blend(triangle, barycentric), max, Some(&near)) else { break };
            max = max.max(hit.distance());
            // The distance grows no faster than the way along the row.
            let slack = (max - hit.distance()) / step;
            j = j.saturating_add(1).saturating_add(slack as u32);
            near = hit;
        }
    }
    max
}

/// Each with the closest point of its farthest sample or centroid.
fn find_worst_faces(max: f64, from: &Surface, hits: &[Hit], to: &Bvh) -> Vec<(u32, Hit)> {
    let of_samples = from.samples.iter().zip(hits).map(|(sample, &hit)| (sample.triangle, hit));
    let of_centroid = |&face: &u32| {
        let centroid = blend(from.triangles[face as usize], [1.0 / 3.0; 3]);
        Some((face, to.closest_beyond(centroid, max * NEARLY)?))
    };
    let mut worst = keep_farthest(of_samples.collect());
    worst.extend(keep_farthest(from.bvh.spatial_order().par_iter().filter_map(of_centroid).collect()));
    worst.sort_unstable_by(farther);
    let mut faces = Vec::with_capacity(WORST_FACES);
    worst.retain(|&(face, _)| {
        let new = faces.len() < WORST_FACES && !faces.contains(&face);
        faces.extend(new.then_some(face));
        new
    });
    worst
}

fn keep_farthest(mut candidates: Vec<(u32, Hit)>) -> Vec<(u32, Hit)> {
    if candidates.len() > WORST_SAMPLES {
        candidates.select_nth_unstable_by(WORST_SAMPLES, farther);
        candidates.truncate(WORST_SAMPLES);
    }
    candidates
}

/// Farthest first; the rest makes the order the same for any sort.
fn farther((a, x): &(u32, Hit), (b, y): &(u32, Hit)) -> std::cmp::Ordering {
    let by_place = || x.point.to_array().partial_cmp(&y.point.to_array()).unwrap_or(std::cmp::Ordering::Equal);
    y.distance_squared.total_cmp(&x.distance_squared).then(a.cmp(b)).then_with(by_place)
}
