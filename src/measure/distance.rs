//! The distance from one surface to another: a mean over samples, a maximum over every place where it may sit.

use super::sample::{Sample, blend};
use super::{Distance, surface::Surface};
use crate::bvh::{Bvh, Hit};
use glam::DVec3;
use rayon::prelude::*;

/// Points that one task handles in turn, each a hint for the next. Fixed, so that nothing depends on the threads.
const CHUNK: usize = 512;

/// The farthest samples say on which faces a maximum may sit between the samples.
const WORST_SAMPLES: usize = 512;
const WORST_FACES: usize = 64;

/// Steps along each edge of the lattice on a worst face: 861 points.
const LATTICE: u32 = 40;

/// Distance from the surface `from` to the one in `to`, and the closest point for each of its samples. Both surfaces
/// have triangles.
pub fn measure_distance(from: &Surface, to: &Bvh) -> (Distance, Vec<Hit>) {
    let hits = find_closest(&from.samples, to);
    let count = hits.len().max(1) as f64;
    let mean = hits.iter().map(Hit::distance).sum::<f64>() / count;
    let rms = (hits.iter().map(|hit| hit.distance_squared).sum::<f64>() / count).sqrt();
    let max = hits.iter().map(Hit::distance).fold(0.0, f64::max);
    let max = raise_by_points(max, &from.vertices, to);
    let max = raise_by_points(max, &from.border, to);
    let max = raise_by_worst_faces(max, from, &hits, to);
    (Distance { max, rms, mean }, hits)
}

fn find_closest(samples: &[Sample], to: &Bvh) -> Vec<Hit> {
    let follow = |chunk: &[Sample]| {
        let mut last = None;
        let mut hits = Vec::with_capacity(chunk.len());
        for sample in chunk {
            last = to.closest_near(sample.point, last.as_ref());
            hits.extend(last);
        }
        hits
    };
    samples.par_chunks(CHUNK).flat_map_iter(follow).collect()
}

/// The largest of `max` and the distances of `points`.
pub fn raise_by_points(max: f64, points: &[DVec3], to: &Bvh) -> f64 {
    let raise = |chunk: &[DVec3]| {
        chunk.iter().fold(max, |max, &point| to.closest_beyond(point, max, None).map_or(max, |hit| hit.distance()))
    };
    points.par_chunks(CHUNK).map(raise).reduce(|| max, f64::max)
}

fn raise_by_worst_faces(max: f64, from: &Surface, hits: &[Hit], to: &Bvh) -> f64 {
    let raise = |&sample: &usize| {
        let triangle = from.triangles[from.samples[sample].triangle as usize];
        lattice().fold(max, |max, barycentric| {
            let hit = to.closest_beyond(blend(triangle, barycentric), max, Some(&hits[sample]));
            hit.map_or(max, |hit| hit.distance())
        })
    };
    worst_faces(&from.samples, hits).par_iter().map(raise).reduce(|| max, f64::max)
}

/// The farthest sample of each of the faces that the farthest samples lie on.
fn worst_faces(samples: &[Sample], hits: &[Hit]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..hits.len()).collect();
    let farther =
        |&a: &usize, &b: &usize| hits[b].distance_squared.total_cmp(&hits[a].distance_squared).then(a.cmp(&b));
    if order.len() > WORST_SAMPLES {
        order.select_nth_unstable_by(WORST_SAMPLES, farther);
        order.truncate(WORST_SAMPLES);
    }
    order.sort_unstable_by(farther);
    let mut faces = Vec::with_capacity(WORST_FACES);
    order.retain(|&sample| {
        let face = samples[sample].triangle;
        let new = faces.len() < WORST_FACES && !faces.contains(&face);
        faces.extend(new.then_some(face));
        new
    });
    order
}

fn lattice() -> impl Iterator<Item = [f64; 3]> {
    (0..=LATTICE).flat_map(|i| {
        (0..=LATTICE - i).map(move |j| [i, j, LATTICE - i - j].map(|k| f64::from(k) / f64::from(LATTICE)))
    })
}
