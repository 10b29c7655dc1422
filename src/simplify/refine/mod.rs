//! Refinement: makes a level better at the same number of triangles.

mod attributes;
mod flip;
mod follow;
mod level;
mod patch;
mod peaks;
mod prices;
mod probe;
mod relocate;
mod source;
mod step;

use super::options::Effort;
use attributes::SourceAttributes;
use crate::mesh::edges::collect_edges;
use crate::mesh::surface::Surface;
use glam::Vec3;
use level::{Level, Lists, NONE};
use patch::Patch;
use prices::Prices;
use source::{Foot, Source};

pub(crate) fn env(name: &str, default: f32) -> f32 {
    static ALL: std::sync::LazyLock<Vec<(String, f32)>> =
        std::sync::LazyLock::new(|| std::env::vars().filter_map(|(k, v)| Some((k, v.parse().ok()?))).filter(|(k, _)| k.len() < 12 && k.chars().all(|c| c.is_ascii_uppercase() || c == '_')).collect());
    ALL.iter().find(|(k, _)| k == name).map_or(default, |x| x.1)
}

/// Refines the levels of one chain.
#[derive(Debug)]
pub(crate) struct Refiner {
    source: Source,
    attributes: Option<SourceAttributes>,
    /// For each sample a point of the level near it.
    anchors: Vec<u32>,
    lists: Lists,
    patch: Patch,
    effort: Effort,
}

impl Refiner {
    /// `surface` is the source.
    pub fn new(surface: &Surface, effort: Effort) -> Self {
        let source = Source::new(surface);
        let anchors = source.samples.iter().map(|s| source.corner(s)).collect();
        let attributes = SourceAttributes::new(surface);
        Self { source, attributes, anchors, lists: Lists::default(), patch: Patch::default(), effort }
    }

    /// Refines `surface`, made from the one before by collapses; its locked points stay.
    pub fn refine(&mut self, surface: &mut Surface, locked: &[bool], target: usize) {
        let mut fixed: Vec<bool> = locked.to_vec();
        fixed.resize(surface.points.len(), false);
        for e in collect_edges(surface).iter().filter(|e| !e.kind.is_plain()) {
            fixed[e.a as usize] = true;
            fixed[e.b as usize] = true;
        }
        let (a_face, sweeps) = match self.effort {
            Effort::Best => (env("A_FACE", 12.0), env("SWEEPS", 6.0)),
            _ => (env("A_FACE", 4.0), env("SWEEPS", 2.0)),
        };
        let chosen = self.source.choose((a_face * surface.face_count() as f32) as usize);
        let t = std::time::Instant::now();
        follow::assign(surface, &self.source, &mut self.anchors, chosen, &mut self.lists, &mut self.patch);
        let t1 = t.elapsed();
        let mut level = Level {
            surface,
            source: &self.source,
            lists: &mut self.lists,
            patch: &mut self.patch,
            feet: Vec::new(),
            prices: Prices::default(),
        };
        let t2 = t.elapsed();
        level.prices = Prices::of_level(&level);
        let t3 = t.elapsed();
        look_back(&mut level);
        let check = |level: &Level, what: &str| if std::env::var("CHECK").is_ok() {
            let positions: Vec<[f32; 3]> = level.surface.points.iter().map(|p| p.as_vec3().to_array()).collect();
            let triangles: Vec<[u32; 3]> = level.surface.live_faces().map(|f| level.surface.face(f)).collect();
            let tree = crate::bvh::Bvh::new(&positions, &triangles);
            let (mut ours, mut exact, mut all, mut w, mut wa, mut far, mut back) = (0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0);
            let mut active = vec![false; level.source.samples.len()];
            for f in level.surface.live_faces() { for s in level.lists.of(f) { active[s as usize] = true; } }
            for (s, sample) in level.source.samples.iter().enumerate() {
                let d = tree.closest(sample.position.as_dvec3(), 10.0).unwrap().distance_squared;
                all += d * sample.weight as f64; wa += sample.weight as f64;
                if active[s] { w += sample.weight as f64; exact += d * sample.weight as f64; ours += level.lists.squared[s] as f64 * sample.weight as f64; if level.lists.squared[s].sqrt() as f64 > d.sqrt() * 1.05 + 1e-5 { far += 1; } }
            }
            for p in 0..level.feet.len() { if level.feet[p].face != NONE && !level.surface.ring(p as u32).is_empty() { back += level.feet[p].distance_squared; } }
            eprintln!("  {what}: active {} ours {:.4e} exact {:.4e} all samples {:.4e}; wrong {far} back {:.3e}", active.iter().filter(|x| **x).count(), (ours / w).sqrt(), (exact / w).sqrt(), (all / wa).sqrt(), (back / level.surface.face_count() as f32 * 2.0).sqrt());
        };
        check(&level, "start");
        let (mut flips, mut moves) = (0, 0);
        let (mut tf, mut tm) = (0.0, 0.0);
        for _ in 0..sweeps as usize {
            let t = std::time::Instant::now();
            flips += flip::flip_edges(&mut level);
            tf += t.elapsed().as_secs_f64();
            let t = std::time::Instant::now();
            for p in 0..fixed.len() as u32 {
                moves += usize::from(!fixed[p as usize] && relocate::relocate(&mut level, p, env("THOROUGH", 0.0) > 0.0));
            }
            tm += t.elapsed().as_secs_f64();
            check(&level, "sweep");
        }
        let t = std::time::Instant::now();
        let most = (env("SPOTS", 0.05) * level.surface.face_count() as f32) as usize;
        let outcome = if most > 0 { peaks::lower_peaks(&mut level, &mut fixed, target, most) } else { Default::default() };
        let tp = t.elapsed().as_secs_f64();
        check(&level, "peaks");
        if std::env::var("WORST").is_ok() { worst(&level, &fixed); }
        if let Some(a) = &self.attributes { attributes::look_up(&mut level, a, &fixed); }
        follow::move_anchors(level.surface, level.lists, &mut self.anchors);
        if std::env::var("TRACE").is_ok() {
            let m = level.surface.face_count() as f64;
            let ns = |d: std::time::Duration| d.as_secs_f64() * 1e9 / m;
            eprintln!("faces {m}: assign {:.0} back {:.0} prices {:.0} flips {:.0} moves {:.0} ns/face; {flips} flips {moves} moves, peaks {:.0} {outcome:?}", ns(t1), ns(t2 - t1), ns(t3 - t2), tf * 1e9 / m, tm * 1e9 / m, tp * 1e9 / m);
        }
    }
}

/// Finds every point's closest one of the source.
fn look_back(level: &mut Level) {
    let unknown = Foot { distance_squared: 0.0, point: Vec3::ZERO, face: NONE };
    level.feet = vec![unknown; level.surface.points.len()];
    let mut missing = Vec::new();
    for p in 0..level.surface.points.len() as u32 {
        if level.surface.ring(p).is_empty() {
            continue;
        }
        match nearest_sample_around(level, p) {
            Some(start) => level.feet[p as usize] = level.look_back(level.point(p), start),
            None => missing.push(p),
        }
    }
    // No sample is near: start from what a neighbour has found.
    while !missing.is_empty() {
        let before = missing.len();
        missing.retain(|&p| {
            let start = level.surface.neighbours(p).into_iter().map(|q| level.foot(q).face).find(|&f| f != NONE);
            if let Some(start) = start {
                level.feet[p as usize] = level.look_back(level.point(p), start);
            }
            start.is_none()
        });
        if missing.len() == before {
            break;
        }
    }
}

fn nearest_sample_around(level: &Level, p: u32) -> Option<u32> {
    let x = level.point(p);
    let mut best = (f32::INFINITY, None);
    for &corner in level.surface.ring(p) {
        for s in level.lists.of(Surface::face_of(corner)) {
            let sample = &level.source.samples[s as usize];
            let squared = sample.position.distance_squared(x);
            if squared < best.0 {
                best = (squared, Some(sample.face));
            }
        }
    }
    best.1
}

fn worst(level: &Level, fixed: &[bool]) {
    let src = crate::bvh::Bvh::new(&level.source.positions(), level.source.triangles());
    let mut all = Vec::new();
    for f in level.surface.live_faces() {
        let [a, b, c] = level.triangle(f);
        let mut w = (0.0f64, [0.0f32; 3]);
        for i in 0..=8 { for j in 0..=8 - i { let (u, v) = (i as f32 / 8.0, j as f32 / 8.0); let p = a * u + b * v + c * (1.0 - u - v);
            let d = src.closest(p.as_dvec3(), 100.0).unwrap().distance(); if d > w.0 { w = (d, [u, v, 1.0 - u - v]); } } }
        all.push((w.0, w.1, f));
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    eprintln!(" worst back, rms {:.2e}:", level.prices.mean_square.sqrt());
    for (d, w, f) in all.iter().take(6) {
        let t = level.triangle(*f);
        let pts = level.surface.face(*f);
        eprintln!("   {d:.3e} at {w:.2?} face {f} {pts:?} fixed {:?} spot {:.3e} feet {:?} samples {} edges {:.1e} {:.1e} {:.1e} area {:.1e}", pts.map(|p| fixed[p as usize]), peaks::find_spot(level, *f).squared.sqrt(), pts.map(|p| level.foot(p).distance_squared.sqrt()), level.lists.of(*f).count(), t[0].distance(t[1]), t[1].distance(t[2]), t[2].distance(t[0]), level::area(&t));
    }
    let positions: Vec<[f32; 3]> = level.surface.points.iter().map(|p| p.as_vec3().to_array()).collect();
    let faces: Vec<usize> = level.surface.live_faces().collect();
    let triangles: Vec<[u32; 3]> = faces.iter().map(|&f| level.surface.face(f)).collect();
    let tree = crate::bvh::Bvh::new(&positions, &triangles);
    let mut active = vec![false; level.source.samples.len()];
    for &f in &faces { for s in level.lists.of(f) { active[s as usize] = true; } }
    let mut all: Vec<(f64, usize, u32)> = level.source.samples.iter().enumerate().map(|(i, s)| { let h = tree.closest(s.position.as_dvec3(), 100.0).unwrap(); (h.distance(), i, h.triangle) }).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    eprintln!(" worst forth:");
    for (d, s, t) in all.iter().take(6) {
        let f = faces[*t as usize];
        let pts = level.surface.face(f);
        eprintln!("   {d:.3e} sample {s} active {} known {:.3e} face {f} {pts:?} fixed {:?} spot {:.3e}", active[*s], level.lists.squared[*s].sqrt(), pts.map(|p| fixed[p as usize]), peaks::find_spot(level, f).squared.sqrt());
    }
}
