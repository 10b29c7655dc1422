//! The worst spots: where the level is farthest from the source, in either direction, edges flip, points move, and new points come onto the source.

use super::flip::try_flip;
use super::level::{Faces, Level, Triangles, centre, unit_normal};
use super::probe::EDGE_PLACES;
use super::relocate::relocate;
use super::source::Foot;
use crate::mesh::edges::edge_kind;
use crate::mesh::surface::Surface;
use crate::mesh::surgery::{Merge, split_edge, split_face};
use glam::Vec3;
use std::collections::BinaryHeap;

/// Squared distance from which a spot's neighbourhood pays for peaks, relative to the spot's own.
const PEAK_SHARE: f32 = 0.6;
/// A spot that got no lower than this share is given a new point.
const STUBBORN: f32 = 0.8;
/// A split may turn faces up to this cosine.
const TURN_COSINE: f32 = 0.1;

/// Where a face is farthest from the source.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub squared: f32,
    /// The source's point.
    target: Vec3,
}

/// A face by the distance of its worst spot: squared distances are never negative, so their bits order as they do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Ranked {
    squared: u32,
    face: u32,
    stamp: u32,
}

/// What was done; for tests and tuning.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(super) struct Work {
    pub spots: usize,
    pub moves: usize,
    pub flips: usize,
    pub splits: usize,
}

/// Works on up to `most` spots, the worst first, and splits until there are `target` faces.
pub(super) fn lower_peaks(level: &mut Level, fixed: &mut Vec<bool>, target: usize, most: usize) -> Work {
    let mut work = Work::default();
    let mut peaks = Peaks::new(level);
    while let Some((face, squared)) = peaks.pop(level) {
        let room = target.saturating_sub(level.surface.face_count());
        if room < 2 && work.spots >= most {
            break;
        }
        work.spots += 1;
        level.prices.set_peak(squared * super::env("PK", PEAK_SHARE));
        let corners = level.surface.face(face);
        let mut touched: Vec<u32> = Vec::new();
        if work.spots < most {
            for k in 0..3 {
                if level.surface.is_live(face) && try_flip(level, corners[k], corners[(k + 1) % 3], true) {
                    work.flips += 1;
                    audit(level, "flip", face, squared);
                    touched.extend(corners);
                }
            }
            for p in corners {
                if !fixed[p as usize] && relocate(level, p, true) {
                    work.moves += 1;
                    audit(level, "move", face, squared);
                    touched.push(p);
                }
            }
        }
        if room >= 2 && level.surface.is_live(face) {
            let spot = find_spot(level, face);
            if spot.squared > squared * STUBBORN
                && let Some(point) = split(level, face, spot.target)
            {
                fixed.push(false);
                work.splits += 1;
                touched.extend(corners);
                touched.push(point);
                polish(level, point, fixed, &mut touched);
            }
        }
        peaks.push_around(level, touched);
    }
    work
}

/// Faces by their worst spots.
struct Peaks {
    heap: BinaryHeap<Ranked>,
    /// Of each face: entries with another stamp are out of date.
    stamps: Vec<u32>,
}

impl Peaks {
    fn new(level: &Level) -> Self {
        let rank = |f: usize| Ranked { squared: find_spot(level, f).squared.to_bits(), face: f as u32, stamp: 0 };
        Self { heap: level.surface.live_faces().map(rank).collect(), stamps: vec![0; level.surface.face_slots()] }
    }

    fn pop(&mut self, level: &Level) -> Option<(usize, f32)> {
        while let Some(top) = self.heap.pop() {
            let face = top.face as usize;
            if level.surface.is_live(face) && self.stamps[face] == top.stamp {
                return Some((face, f32::from_bits(top.squared)));
            }
        }
        None
    }

    /// Ranks the faces at these points anew.
    fn push_around(&mut self, level: &Level, points: Vec<u32>) {
        self.stamps.resize(level.surface.face_slots(), 0);
        let mut faces: Vec<usize> =
            points.iter().flat_map(|&p| level.surface.ring(p)).map(|&c| Surface::face_of(c)).collect();
        faces.sort_unstable();
        faces.dedup();
        for f in faces {
            self.stamps[f] += 1;
            let squared = find_spot(level, f).squared.to_bits();
            self.heap.push(Ranked { squared, face: f as u32, stamp: self.stamps[f] });
        }
    }
}

/// Lets a new point and what is around it settle.
fn polish(level: &mut Level, point: u32, fixed: &[bool], touched: &mut Vec<u32>) {
    relocate(level, point, true);
    let ring: Faces = level.surface.ring(point).iter().map(|&c| Surface::face_of(c)).collect();
    for f in ring {
        let corners = level.surface.face(f);
        let Some(k) = corners.iter().position(|&p| p == point) else { continue };
        if try_flip(level, corners[(k + 1) % 3], corners[(k + 2) % 3], true) {
            touched.extend(corners);
        }
    }
    for p in level.surface.neighbours(point) {
        if !fixed[p as usize] && relocate(level, p, true) {
            touched.push(p);
        }
    }
    relocate(level, point, true);
}

/// The worst of a face's samples, corners, middles of edges and centre.
pub(super) fn find_spot(level: &Level, face: usize) -> Spot {
    let triangle = level.triangle(face);
    let mut spot = Spot { squared: 0.0, target: centre(&triangle) };
    for s in level.lists.of(face) {
        let squared = level.lists.squared[s as usize];
        if squared > spot.squared {
            spot = Spot { squared, target: level.source.samples[s as usize].position };
        }
    }
    let feet = level.surface.face(face).map(|p| level.foot(p));
    let [a, b, c] = triangle;
    let normal = unit_normal(&triangle);
    let mut note = |foot: Foot| {
        if foot.distance_squared > spot.squared {
            spot = Spot { squared: foot.distance_squared, target: foot.point };
        }
    };
    feet.into_iter().for_each(&mut note);
    note(look_back(level, face, centre(&triangle), normal, feet[0].face));
    for (k, (p, q)) in [(a, b), (b, c), (c, a)].into_iter().enumerate() {
        for (along, _) in EDGE_PLACES {
            note(look_back(level, face, p.lerp(q, along), normal, feet[k].face));
        }
    }
    spot
}

fn look_back(level: &Level, face: usize, place: Vec3, normal: Vec3, start: u32) -> Foot {
    let mut best = (f32::INFINITY, start);
    for s in level.lists.of(face) {
        let sample = &level.source.samples[s as usize];
        let squared = sample.position.distance_squared(place);
        if squared < best.0 && sample.normal.dot(normal) > 0.0 {
            best = (squared, sample.face);
        }
    }
    level.look_back(place, best.1)
}

/// Splits `face` or one of its edges at a point of the source, whichever is worth most; gives the new point.
fn split(level: &mut Level, face: usize, at: Vec3) -> Option<u32> {
    let mut best: Option<(f32, Plan)> = None;
    for edge in [None, Some(0), Some(1), Some(2)] {
        let Some(plan) = Plan::new(level, face, edge, at) else { continue };
        let before = level.gather(&plan.faces, &plan.old);
        let after = level.appraise(&plan.new);
        let gain = before.cost - after.cost;
        if after.turned <= before.turned && gain > best.as_ref().map_or(0.0, |(g, _)| *g) {
            best = Some((gain, plan));
        }
    }
    let (_, plan) = best?;
    level.gather(&plan.faces, &plan.old);
    level.appraise(&plan.new);
    let foot = level.look_back(at, level.foot(level.surface.face(face)[0]).face);
    let start = level.surface.face_slots();
    let point = match plan.edge {
        None => split_face(level.surface, face, at.as_dvec3()).0,
        Some([p, q]) => split_edge(level.surface, p, q, at.as_dvec3()).0,
    };
    let made: Faces = (start..start + plan.new.len()).collect();
    level.settle(&plan.faces, &made);
    level.feet.push(foot);
    Some(point)
}

/// A split: the faces it replaces, and the triangles in their place in the order in which surgery makes them.
struct Plan {
    edge: Option<[u32; 2]>,
    faces: Faces,
    old: Triangles,
    new: Triangles,
}

impl Plan {
    /// Of the face (`edge`: none) or its edge from corner `edge`; `None` where that may not be or turns faces.
    fn new(level: &Level, face: usize, edge: Option<usize>, at: Vec3) -> Option<Self> {
        let points = level.surface.face(face);
        let mut plan = Self { edge: None, faces: Faces::new(), old: Triangles::new(), new: Triangles::new() };
        match edge {
            None => {
                let [a, b, c] = level.triangle(face);
                plan.faces.push(face);
                plan.new.extend([[a, b, at], [b, c, at], [c, a, at]]);
            }
            Some(k) => {
                let (p, q) = (points[k], points[(k + 1) % 3]);
                if !edge_kind(level.surface, p, q)?.is_plain() {
                    return None;
                }
                plan.edge = Some([p, q]);
                for &f in &Merge::new(level.surface, p, q).faces {
                    plan.faces.push(f);
                    let (ids, t) = (level.surface.face(f), level.triangle(f));
                    for replaced in [q, p] {
                        plan.new.push([0, 1, 2].map(|i| if ids[i] == replaced { at } else { t[i] }));
                    }
                }
            }
        }
        plan.old = plan.faces.iter().map(|&f| level.triangle(f)).collect();
        let each = plan.new.len() / plan.old.len().max(1);
        let turned = |(i, t): (usize, &[Vec3; 3])| unit_normal(t).dot(unit_normal(&plan.old[i / each])) < TURN_COSINE;
        (!plan.new.iter().enumerate().any(turned)).then_some(plan)
    }
}

fn audit(level: &Level, what: &str, face: usize, squared: f32) {
    if std::env::var("AUDIT").is_err() { return; }
    use std::sync::Mutex;
    static LAST: Mutex<(f64, f64)> = Mutex::new((0.0, 0.0));
    let positions: Vec<[f32; 3]> = level.surface.points.iter().map(|p| p.as_vec3().to_array()).collect();
    let faces: Vec<usize> = level.surface.live_faces().collect();
    let triangles: Vec<[u32; 3]> = faces.iter().map(|&f| level.surface.face(f)).collect();
    let tree = crate::bvh::Bvh::new(&positions, &triangles);
    let src = crate::bvh::Bvh::new(&level.source.positions(), level.source.triangles());
    let fwd = level.source.samples.iter().map(|s| tree.closest(s.position.as_dvec3(), 100.0).unwrap().distance()).fold(0.0, f64::max);
    let mut back = (0.0, 0);
    for &f in &faces { let [a, b, c] = level.triangle(f); for p in [a, b, c, (a + b) * 0.5, (b + c) * 0.5, (a + c) * 0.5, (a + b + c) / 3.0] { let d = src.closest(p.as_dvec3(), 100.0).unwrap().distance(); if d > back.0 { back = (d, f); } } }
    let mut last = LAST.lock().unwrap();
    if fwd > last.0 * 1.2 || back.0 > last.1 * 1.2 { eprintln!("{what} at face {face} spot {:.3e}: fwd {:.3e} -> {fwd:.3e} back {:.3e} -> {:.3e} at {}: spot now {:.3e} face spot {:.3e} points {:?} triangle {:?}", squared.sqrt(), last.0, last.1, back.0, back.1, find_spot(level, face).squared.sqrt(), find_spot(level, back.1).squared.sqrt(), level.surface.face(back.1), level.triangle(back.1)); }
    *last = (fwd, back.0);
}
