//! Which face of the level each sample belongs to: followed from where it was, not searched.
//!
//! Every sample has an anchor, a point of the level near it: at first a corner of its source face, later a corner of its face at the level before.
//! Collapses tell which point an anchor has become part of. From there the nearest face is a few steps downhill.

use super::level::{Lists, NONE};
use super::nearest::NearestFace;
use super::patch::Patch;
use super::source::{Foot, Source, closest_point};
use crate::mesh::surface::Surface;
use glam::Vec3;

/// Rounds in which samples move on to a nearer corner; the rest stays where it is, a little farther than need be.
const MOST_ROUNDS: usize = 6;

/// Squared distance, relative to the mean, from which a face found downhill is not trusted.
const SUSPICIOUS: f32 = 16.0;

/// Finds the nearest faces of the `chosen` samples, and moves their anchors; those that moves may know of come into their faces' lists.
pub(super) fn assign(
    surface: &Surface,
    source: &Source,
    anchors: &mut [u32],
    chosen: impl Iterator<Item = usize>,
    lists: &mut Lists,
    patch: &mut Patch,
) {
    // By point first: all samples of a point are measured against its ring at once.
    let mut by_point = Lists::default();
    by_point.reset(surface.points.len(), source.samples.len());
    lists.reset(surface.face_slots(), source.samples.len());
    for s in chosen {
        let anchor = surface.heir(anchors[s]);
        anchors[s] = anchor;
        lists.squared[s] = f32::INFINITY;
        by_point.push(anchor as usize, s as u32);
    }
    // The face found for each sample; pushed to the lists at the end.
    let mut found = vec![NONE; source.samples.len()];
    let mut active: Vec<u32> =
        (0..surface.points.len() as u32).filter(|&p| by_point.head[p as usize] != NONE).collect();
    let mut triangles: Vec<[Vec3; 3]> = Vec::new();
    for _ in 0..MOST_ROUNDS {
        let mut moved = Vec::new();
        for &p in &active {
            let ring = surface.ring(p);
            triangles.clear();
            triangles.extend(ring.iter().map(|&c| surface.triangle(Surface::face_of(c)).map(|x| x.as_vec3())));
            patch.clear();
            patch.start_triangle();
            let mut at = std::mem::replace(&mut by_point.head[p as usize], NONE);
            while at != NONE {
                patch.push(at, &source.samples[at as usize], 0.0);
                at = by_point.next[at as usize];
            }
            if ring.is_empty() {
                continue;
            }
            patch.find_nearest(&triangles);
            for (id, squared, which) in patch.found() {
                let s = id as usize;
                if squared >= lists.squared[s] {
                    continue;
                }
                lists.squared[s] = squared;
                let face = Surface::face_of(ring[which]);
                found[s] = face as u32;
                let corner = surface.face(face)[weightiest_corner(triangles[which], source.samples[s].position)];
                anchors[s] = corner;
                if corner != p {
                    moved.push((corner, id));
                }
            }
        }
        active.clear();
        for (p, s) in moved {
            if by_point.head[p as usize] == NONE {
                active.push(p);
            }
            by_point.push(p as usize, s);
        }
        if active.is_empty() {
            break;
        }
    }
    search_far_ones(surface, source, anchors, lists, &mut found);
    for (s, &face) in found.iter().enumerate().take(source.held_out) {
        if face != NONE {
            lists.push(face as usize, s as u32);
        }
    }
}

/// Samples that have ended suspiciously far from the surface may have gone down on the wrong side of a thin part: their nearest face is searched for.
fn search_far_ones(surface: &Surface, source: &Source, anchors: &mut [u32], lists: &mut Lists, found: &mut [u32]) {
    let known = |&s: &usize| found[s] != NONE;
    let (sum, count) =
        (0..found.len()).filter(known).fold((0.0, 0), |(sum, n), s| (sum + f64::from(lists.squared[s]), n + 1));
    let limit = SUSPICIOUS * (sum / f64::from(count.max(1))) as f32;
    let far: Vec<usize> = (0..found.len()).filter(known).filter(|&s| lists.squared[s] > limit).collect();
    if far.is_empty() {
        return;
    }
    let triangle = |f: u32| surface.triangle(f as usize).map(|x| x.as_vec3());
    let faces: Vec<u32> = surface.live_faces().map(|f| f as u32).collect();
    let nearest = NearestFace::new(&faces, triangle);
    for s in far {
        let x = source.samples[s].position;
        let foot = nearest.find(x, Foot { distance_squared: lists.squared[s], point: x, face: found[s] });
        (lists.squared[s], found[s]) = (foot.distance_squared, foot.face);
        anchors[s] = surface.face(foot.face as usize)[weightiest_corner(triangle(foot.face), x)];
    }
}

/// The corner that counts most at the closest point: beyond it faces may be nearer. The corner nearest to `x` may lie on the wrong side.
fn weightiest_corner(triangle: [Vec3; 3], x: Vec3) -> usize {
    let (_, [a, b, c], _) = closest_point(triangle, x);
    if a >= b && a >= c {
        0
    } else if b >= c {
        1
    } else {
        2
    }
}

/// Corners of the faces that samples lie on now become their anchors.
pub(super) fn move_anchors(surface: &Surface, lists: &Lists, anchors: &mut [u32]) {
    for f in surface.live_faces() {
        let corner = surface.face(f)[0];
        for s in lists.of(f) {
            anchors[s as usize] = corner;
        }
    }
}
