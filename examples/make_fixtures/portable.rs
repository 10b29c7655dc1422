//! Functions whose results are the same bits on every machine.
//!
//! `f64::sin` and friends come from the platform's C library and differ in the last bit between systems; the
//! committed fixtures are compared byte for byte, so only `+ - * / sqrt floor round` are used here.

use glam::DVec3;
use std::f64::consts::TAU;

/// Cosine and sine of `turns` full turns.
pub fn cos_sin(turns: f64) -> (f64, f64) {
    let rest = turns - turns.round();
    let quarter = (rest * 4.0).round();
    let x = (rest - quarter / 4.0) * TAU;
    let s = x * x;
    // Taylor series on [-π/4, π/4]: the first term left out is below 1e-16.
    let sin = x * series(s, &[2.0 * 3.0, 4.0 * 5.0, 6.0 * 7.0, 8.0 * 9.0, 10.0 * 11.0, 12.0 * 13.0, 14.0 * 15.0]);
    let cos =
        series(s, &[1.0 * 2.0, 3.0 * 4.0, 5.0 * 6.0, 7.0 * 8.0, 9.0 * 10.0, 11.0 * 12.0, 13.0 * 14.0, 15.0 * 16.0]);
    match quarter as i64 {
        0 => (cos, sin),
        1 => (-sin, cos),
        -1 => (sin, -cos),
        _ => (-cos, -sin),
    }
}

/// `1 - s/d0 (1 - s/d1 (1 - …))`
fn series(s: f64, divisors: &[f64]) -> f64 {
    divisors.iter().rev().fold(1.0, |sum, d| 1.0 - s / d * sum)
}

/// Smooth noise in [-1, 1]: random values on the integer lattice, blended in between.
pub fn noise(p: DVec3, seed: u32) -> f64 {
    let cell = p.floor();
    let (f, mut sum) = (p - cell, 0.0);
    let w = f * f * (DVec3::splat(3.0) - 2.0 * f);
    for corner in 0..8_u32 {
        let bit = DVec3::new((corner & 1).into(), (corner >> 1 & 1).into(), (corner >> 2).into());
        let weight = bit * w + (DVec3::ONE - bit) * (DVec3::ONE - w);
        sum += weight.x * weight.y * weight.z * lattice_value(cell + bit, seed);
    }
    sum
}

/// Three octaves of [`noise`], in [-1, 1].
pub fn rough_noise(p: DVec3, seed: u32) -> f64 {
    (4.0 * noise(p, seed) + 2.0 * noise(p * 2.0, seed + 1) + noise(p * 4.0, seed + 2)) / 7.0
}

fn lattice_value(p: DVec3, seed: u32) -> f64 {
    let mixed = [p.x, p.y, p.z].iter().fold(seed, |h, &c| scramble(h ^ (c as i64 as u32)));
    f64::from(mixed) / f64::from(u32::MAX) * 2.0 - 1.0
}

/// A bijective mix of all bits (constants of the "lowbias32" hash).
fn scramble(mut x: u32) -> u32 {
    x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
    x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
    x ^ x >> 16
}

/// The `index`-th of a fixed sequence of numbers in [0, 1).
pub fn random(index: u32, seed: u32) -> f64 {
    f64::from(scramble(scramble(index) ^ seed)) / 4_294_967_296.0
}
