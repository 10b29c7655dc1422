//! Surfaces made by formulas: models that everybody has, of any number and size, the same on every machine.
//!
//! They are what the predictor is trained with, and what stands in for a model that is not there.

use crate::mesh::Mesh;
use crate::random::Random;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// A made surface with a name such as `horns-3`.
#[derive(Debug, Clone)]
pub(crate) struct Model {
    pub name: String,
    pub mesh: Mesh,
}

/// The kinds of surface, in turn.
const KINDS: [(&str, Maker); 6] = [
    ("horns", make_horns),
    ("knot", make_knot),
    ("gear", make_gear),
    ("hills", make_hills),
    ("vase", make_vase),
    ("pebble", make_pebble),
];

type Maker = fn(&mut Random, usize) -> Mesh;

/// The model with this number: its kind, then proportions and size (about 1 000 to 8 000 triangles) by chance.
pub(crate) fn make(number: usize, seed: u64) -> Model {
    let mut random = Random(seed.wrapping_add(number as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let triangles = 1000.0 * libm::pow(8.0, random.unit());
    let (kind, maker) = KINDS[number % KINDS.len()];
    Model { name: format!("{kind}-{number}"), mesh: maker(&mut random, triangles as usize) }
}

/// A body with horns and about this many triangles, in place of an animal or a scan.
pub(crate) fn make_stand_in(triangles: usize) -> Mesh {
    make_horns(&mut Random(1), triangles)
}

/// A closed body from which narrow cones rise: what heads, claws and tails are made of.
fn make_horns(random: &mut Random, triangles: usize) -> Mesh {
    let horns: Vec<(DVec3, f64, f64)> = (0..4 + (random.unit() * 6.0) as usize)
        .map(|_| {
            (direction(random.between(0.1, 0.9), random.unit()), random.between(0.4, 1.6), random.between(15.0, 120.0))
        })
        .collect();
    let bumps = Waves::new(random, 3, 0.08);
    sphere(triangles, |d| {
        let rise: f64 = horns.iter().map(|(at, height, sharp)| height * libm::exp(sharp * (d.dot(*at) - 1.0))).sum();
        d * (1.0 + rise + bumps.at(d)) * DVec3::new(1.4, 1.0, 0.8)
    })
}

/// A closed tube along a knot, with ripples: one handle, curved everywhere.
fn make_knot(random: &mut Random, triangles: usize) -> Mesh {
    let (twists, thickness) = (2.0 + (random.unit() * 3.0).floor(), random.between(0.15, 0.4));
    let (ripples, depth) = ((random.unit() * 12.0).floor(), random.between(0.0, 0.12));
    let (long, round) = split_count(triangles, random.between(4.0, 8.0));
    grid(long, round, [true, true], |u, v| {
        let (around, t) = (TAU * v, TAU * u);
        let radius = thickness * (1.0 + depth * libm::sin(ripples * t) * libm::cos(2.0 * around));
        let ring = 1.0 + radius * libm::cos(around) + 0.2 * libm::cos(twists * t);
        DVec3::new(ring * libm::cos(t), ring * libm::sin(t), radius * libm::sin(around) + 0.3 * libm::sin(twists * t))
    })
}

/// Teeth, flat faces and sharp edges. The outline goes round, then inwards to the axis on both sides.
fn make_gear(random: &mut Random, triangles: usize) -> Mesh {
    let (teeth, depth, height) =
        (5.0 + (random.unit() * 14.0).floor(), random.between(0.1, 0.35), random.between(0.1, 0.6));
    let (round, across) = split_count(triangles, random.between(4.0, 10.0));
    grid(round, across, [true, false], |u, v| {
        let tooth = if (u * teeth).fract() < 0.5 { 1.0 } else { 1.0 - depth };
        // Quarter of the way up the lower side, half on the rim, a quarter down the upper side.
        let (radius, z) = match v {
            v if v < 0.25 => (v / 0.25 * tooth, -height),
            v if v <= 0.75 => (tooth, height * (4.0 * v - 2.0)),
            v => ((1.0 - v) / 0.25 * tooth, height),
        };
        DVec3::new(radius * libm::cos(TAU * u), radius * libm::sin(TAU * u), z)
    })
}

/// A landscape with an open border: ridges, plains and a ravine.
fn make_hills(random: &mut Random, triangles: usize) -> Mesh {
    let waves: Vec<(DVec2, f64, f64)> = (0..7)
        .map(|i| {
            let turn = TAU * random.unit();
            let rate = 2.0 * libm::pow(1.6, f64::from(i));
            (DVec2::new(libm::cos(turn), libm::sin(turn)) * rate, TAU * random.unit(), 0.25 / rate)
        })
        .collect();
    let ravine = random.between(0.3, 0.7);
    let (long, wide) = split_count(triangles, 1.0);
    grid(long, wide, [false, false], |u, v| {
        let at = DVec2::new(u, v);
        // Ridges: the crest of a wave is sharp, its trough is round.
        let ridge: f64 =
            waves.iter().map(|(way, phase, high)| high * (1.0 - libm::sin(way.dot(at) * PI + phase).abs())).sum();
        let off = (u - ravine - 0.1 * libm::sin(5.0 * v)) * 18.0;
        DVec3::new(u, v, ridge.max(0.12) - 0.15 * libm::exp(-off * off))
    })
}

/// A turned vessel: open at the top, with a foot, grooves and a thick or thin wall.
fn make_vase(random: &mut Random, triangles: usize) -> Mesh {
    let (belly, neck, grooves) = (random.between(0.3, 1.0), random.between(0.15, 0.5), random.between(0.0, 0.05));
    let (pitch, flutes) = (6.0 + (random.unit() * 20.0).floor(), (random.unit() * 9.0).floor());
    let (round, high) = split_count(triangles, random.between(0.6, 1.6));
    grid(round, high, [true, false], |u, v| {
        let body = neck + belly * libm::sin(PI * libm::pow(v, 0.7)).max(0.0) + 0.3 * libm::pow(v, 8.0);
        let groove = 1.0 + grooves * libm::sin(pitch * PI * v).signum() + 0.04 * libm::cos(flutes * TAU * u);
        let radius = if v == 0.0 { 0.0 } else { body * groove };
        DVec3::new(radius * libm::cos(TAU * u), radius * libm::sin(TAU * u), 2.0 * v)
    })
}

/// A closed smooth body with waves of several lengths.
fn make_pebble(random: &mut Random, triangles: usize) -> Mesh {
    let waves = Waves::new(random, 8, random_depth(0.25));
    let stretch = DVec3::new(1.0, random.between(0.5, 1.0), random.between(0.3, 1.0));
    sphere(triangles, |d| d * (1.0 + waves.at(d)) * stretch)
}

fn random_depth(depth: f64) -> f64 {
    depth / 8f64.sqrt()
}

/// Waves in random directions over a sphere.
struct Waves(Vec<(DVec3, f64, f64)>);

impl Waves {
    fn new(random: &mut Random, count: usize, depth: f64) -> Self {
        let wave = |_| {
            let rate = random.between(2.0, 9.0);
            (direction(random.unit(), random.unit()) * rate, TAU * random.unit(), depth * 3.0 / rate)
        };
        Self((0..count).map(wave).collect())
    }

    fn at(&self, d: DVec3) -> f64 {
        self.0.iter().map(|(way, phase, depth)| depth * libm::sin(way.dot(d) + phase)).sum()
    }
}

/// Unit vector: `v` from the lower pole (0) to the upper (1), `u` around.
fn direction(v: f64, u: f64) -> DVec3 {
    let polar = PI * v;
    let ring = if v <= 0.0 || v >= 1.0 { 0.0 } else { libm::sin(polar) };
    DVec3::new(ring * libm::cos(TAU * u), ring * libm::sin(TAU * u), -libm::cos(polar))
}

fn sphere(triangles: usize, place: impl Fn(DVec3) -> DVec3) -> Mesh {
    let (round, high) = split_count(triangles, 2.0);
    grid(round, high, [true, false], |u, v| place(direction(v, u)))
}

/// Cells along and across for so many triangles, `ratio` times as many along.
fn split_count(triangles: usize, ratio: f64) -> (usize, usize) {
    let across = (triangles as f64 / (2.0 * ratio)).sqrt();
    (((across * ratio).round() as usize).max(4), (across.round() as usize).max(3))
}

/// A grid of cells over the unit square, `wraps` where it closes. Points at one place (poles) become one when the mesh is welded; triangles
/// without area there are left out.
fn grid(along: usize, across: usize, wraps: [bool; 2], place: impl Fn(f64, f64) -> DVec3) -> Mesh {
    let points = |cells: usize, wraps: bool| if wraps { cells } else { cells + 1 };
    let (width, height) = (points(along, wraps[0]), points(across, wraps[1]));
    let share = |i: usize, cells: usize| i as f64 / cells as f64;
    let positions: Vec<[f32; 3]> = (0..width * height)
        .map(|i| place(share(i % width, along), share(i / width, across)).as_vec3().to_array())
        .collect();
    let at = |x: usize, y: usize| (y % height * width + x % width) as u32;
    let cell = |i: usize| {
        let (x, y) = (i % along, i / along);
        let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
        // Diagonals alternate, so that no direction is favoured.
        if (x + y) % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
    };
    let spot = |v: u32| positions[v as usize].map(|x| (x + 0.0).to_bits());
    let is_whole = |t: &[u32; 3]| spot(t[0]) != spot(t[1]) && spot(t[1]) != spot(t[2]) && spot(t[2]) != spot(t[0]);
    let triangles = (0..along * across).flat_map(cell).filter(is_whole).collect();
    Mesh { positions, triangles, ..Mesh::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predictor::Shape;

    #[test]
    fn every_kind_is_what_its_name_says() {
        let euler: Vec<f64> = (0..6).map(|i| Shape::of_mesh(&make(i, 1).mesh).euler).collect();
        // Closed bodies have 2, a knot one handle, a landscape and a vase one border.
        assert_eq!(euler, [2.0, 0.0, 2.0, 1.0, 1.0, 2.0]);
        for number in 0..12 {
            let Model { name, mesh } = make(number, 1);
            mesh.validate().expect("valid");
            assert!((800..9000).contains(&mesh.triangles.len()), "{name}: {}", mesh.triangles.len());
            assert_ne!(mesh, make(number + 6, 1).mesh, "{name}");
        }
        assert!(make_stand_in(5804).triangles.len().abs_diff(5804) < 300);
    }
}
