//! Switch values: at which size on screen each level ends.
//!
//! A sphere of radius `r` that fills the share `c` of a screen `H` pixels high is `c·H/2` pixels in radius, so an error `e` in
//! object units shows as `e/r · c·H/2` pixels. It stays below a tolerance of `t` pixels while `c ≤ 2·t·r / (e·H)`: the *switch-in*
//! coverage of the level with that error. `MSFT_screencoverage` lists where each level ends, so entry `i` is the switch-in
//! of level `i + 1`, and the last entry is where nothing is drawn any more.
//!
//! Limits: the sphere is that of the mesh at rest; skinning, morphing and non-uniform scale are not looked at.

use crate::error::{Error, Kind, Result};
use crate::preset::{Basis, Coverage, Settings};

/// Each switch is at most this share of the one before, so that the list falls strictly even where errors do not rise
/// (and still does after an engine has read it as 32-bit floats).
const LARGEST_STEP: f64 = 0.99;

/// No switch is smaller than this: below a millionth of the screen's height there is nothing to see.
const SMALLEST: f64 = 1e-6;

/// Disc of diameter 1 over a screen of height 1 and width 16/9.
const AREA_OF_FULL_HEIGHT: f64 = std::f64::consts::PI / 4.0 * 9.0 / 16.0;

/// The switch values of one mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Switches {
    /// `MSFT_screencoverage`: one for each level and one for LOD0, strictly falling, in [0, 1].
    pub values: Vec<f64>,
    /// What had to be changed to keep the list falling.
    pub notes: Vec<String>,
}

/// Pixels that `error` (object units) shows at `coverage` (share of the screen's height); 0 for a mesh without extent.
pub fn pixels_of_error(error: f64, radius: f64, coverage: f64, screen_height: f64) -> f64 {
    if radius > 0.0 { error / radius * coverage * screen_height / 2.0 } else { 0.0 }
}

/// The error in object units that shows as `pixels` at `coverage` (share of the screen's height).
pub fn error_of_pixels(pixels: f64, radius: f64, coverage: f64, screen_height: f64) -> f64 {
    2.0 * pixels * radius / (coverage * screen_height)
}

/// A share of the screen's height, expressed in `basis`.
pub fn from_height(coverage: f64, basis: Basis) -> f64 {
    match basis {
        Basis::Height => coverage,
        Basis::Area => AREA_OF_FULL_HEIGHT * coverage * coverage,
    }
}

/// A coverage in `basis`, expressed as a share of the screen's height.
pub fn to_height(coverage: f64, basis: Basis) -> f64 {
    match basis {
        Basis::Height => coverage,
        Basis::Area => (coverage / AREA_OF_FULL_HEIGHT).sqrt(),
    }
}

/// Places the switches of a mesh whose levels have these `errors` (largest distance, object units, finest first).
///
/// `requested[i]` is the position of level `i` in the preset's list of levels: explicit coverage numbers go by it, since
/// levels may have been dropped.
///
/// # Errors
/// [`Kind::Preset`] when explicit numbers are missing, do not fall, or are outside (0, 1].
pub fn place_switches(errors: &[f64], requested: &[usize], radius: f64, settings: &Settings) -> Result<Switches> {
    let mut values = match &settings.coverage {
        Coverage::Auto => switches_from_errors(errors, radius, settings),
        Coverage::Explicit(numbers) => pick_explicit(numbers, requested)?,
    };
    let mut notes = Vec::new();
    if let Some(&last) = values.last() {
        let cull = settings.cull_coverage;
        if cull < last {
            values.push(cull.max(0.0));
        } else {
            // A level must not be lost because it would only be drawn below the cull size.
            values.push(last / 2.0);
            notes.push(format!(
                "the last level switches in at coverage {last:.4}, not above cull_coverage {cull}: it is culled at {:.4} instead",
                last / 2.0
            ));
        }
    }
    Ok(Switches { values, notes })
}

fn switches_from_errors(errors: &[f64], radius: f64, settings: &Settings) -> Vec<f64> {
    let mut previous = f64::INFINITY;
    let switch_in = |&error: &f64| {
        // No error, no limit: the level is as good as its source at any size.
        let coverage = if error > 0.0 {
            2.0 * settings.pixel_tolerance * radius / (error * settings.screen_height)
        } else {
            f64::INFINITY
        };
        let in_basis = from_height(coverage, settings.basis).clamp(SMALLEST, 1.0);
        previous = in_basis.min(previous * LARGEST_STEP);
        previous
    };
    errors.iter().map(switch_in).collect()
}

fn pick_explicit(numbers: &[f64], requested: &[usize]) -> Result<Vec<f64>> {
    let pick = |&level: &usize| {
        numbers.get(level).copied().ok_or_else(|| {
            Error::new(
                Kind::Preset,
                format!("coverage lists {} numbers, but there is a level {}", numbers.len(), level + 1),
            )
            .help("give one coverage number for each level, or coverage = \"auto\"")
        })
    };
    let values = requested.iter().map(pick).collect::<Result<Vec<_>>>()?;
    let in_range = values.iter().all(|&c| c > 0.0 && c <= 1.0);
    if !in_range || values.windows(2).any(|pair| pair[0] <= pair[1]) {
        return Err(Error::new(Kind::Preset, format!("coverage numbers {values:?} must fall strictly within (0, 1]")));
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// 1080 lines, one pixel.
    fn settings(coverage: Coverage, basis: Basis, cull_coverage: f64) -> Settings {
        Settings { screen_height: 1080.0, pixel_tolerance: 1.0, coverage, basis, cull_coverage, ..Settings::default() }
    }

    fn auto(errors: &[f64], radius: f64, basis: Basis, cull: f64) -> Switches {
        let requested: Vec<usize> = (0..errors.len()).collect();
        place_switches(errors, &requested, radius, &settings(Coverage::Auto, basis, cull)).unwrap()
    }

    #[test]
    fn a_switch_shows_exactly_the_tolerated_error() {
        // 2 · 1 px · 1 unit / (0.01 units · 1080 px), and twice the error at half the size.
        let switches = auto(&[0.01, 0.02], 1.0, Basis::Height, 0.0);
        assert_eq!(switches.values, [2.0 / 10.8, 1.0 / 10.8, 0.0]);
        assert!((pixels_of_error(0.01, 1.0, switches.values[0], 1080.0) - 1.0).abs() < 1e-12);
        assert!((error_of_pixels(1.0, 1.0, switches.values[0], 1080.0) - 0.01).abs() < 1e-12);
    }

    #[test]
    fn a_level_without_error_takes_over_at_once() {
        let switches = auto(&[0.0, 0.01], 1.0, Basis::Height, 0.001);
        assert_eq!(switches.values, [1.0, 2.0 / 10.8, 0.001]);
    }

    #[test]
    fn switches_fall_where_errors_do_not_rise() {
        let switches = auto(&[0.02, 0.02, 0.01], 1.0, Basis::Height, 0.0);
        let first = 1.0 / 10.8;
        assert_eq!(switches.values, [first, first * 0.99, first * 0.99 * 0.99, 0.0]);
    }

    #[test]
    fn no_level_is_lost_to_culling() {
        let switches = auto(&[0.01], 1.0, Basis::Height, 0.5);
        assert_eq!(switches.values, [2.0 / 10.8, 1.0 / 10.8]);
        assert_eq!(switches.notes.len(), 1);
    }

    #[test]
    fn area_is_the_disc_over_a_wide_screen() {
        // A sphere as high as the screen: π/4 of a square, which is 9/16 of the screen.
        assert_eq!(from_height(1.0, Basis::Area), std::f64::consts::PI * 9.0 / 64.0);
        assert!((to_height(from_height(0.3, Basis::Area), Basis::Area) - 0.3).abs() < 1e-15);
    }

    #[test]
    fn explicit_numbers_go_by_the_level_asked_for() {
        let settings = settings(Coverage::Explicit(vec![0.5, 0.25, 0.1]), Basis::Height, 0.01);
        let place = |requested: &[usize]| place_switches(&vec![0.1; requested.len()], requested, 1.0, &settings);
        assert_eq!(place(&[0, 2]).unwrap().values, [0.5, 0.1, 0.01]);
        assert_eq!(place(&[3]).unwrap_err().kind, Kind::Preset);
    }

    #[test]
    fn explicit_numbers_must_fall() {
        let settings = settings(Coverage::Explicit(vec![0.25, 0.5]), Basis::Height, 0.0);
        assert_eq!(place_switches(&[0.1, 0.2], &[0, 1], 1.0, &settings).unwrap_err().kind, Kind::Preset);
    }

    proptest! {
        #[test]
        fn switches_always_fall_strictly_within_bounds(
            errors in prop::collection::vec(prop_oneof![Just(0.0), 0.0..1e-3f64, 0.0..10.0f64, Just(f64::MAX), Just(f64::MIN_POSITIVE)], 1..12),
            radius in prop_oneof![Just(0.0), 1e-30..1e30f64],
            cull in 0.0..=1.0f64,
            area in any::<bool>(),
        ) {
            let basis = if area { Basis::Area } else { Basis::Height };
            let values = auto(&errors, radius, basis, cull).values;
            prop_assert_eq!(values.len(), errors.len() + 1);
            prop_assert!(values.iter().all(|v| (0.0..=1.0).contains(v)));
            prop_assert!(values.windows(2).all(|pair| (pair[1] as f32) < pair[0] as f32));
        }
    }
}
