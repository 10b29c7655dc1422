//! From what a preset asks for to what the simplifier is told, and which of its levels are worth keeping.

use crate::coverage::error_of_pixels;
use crate::preset::{ErrorBound, LevelTarget, Settings};
use crate::report::{DroppedLevel, TargetReport};
use crate::simplify::{self, Level, Target};

/// The simplifier's options for a mesh with this diagonal and bounding radius, in object units.
pub(super) fn choose_options(settings: &Settings, diagonal: f64, radius: f64) -> simplify::Options {
    let convert = |target| convert_target(target, diagonal, radius, settings.screen_height);
    let levels = settings.levels.iter().map(convert).collect();
    simplify::Options { levels, ..settings.simplify.clone() }
}

/// Percent and pixels become object units; the smallest bound on the error binds.
fn convert_target(target: &LevelTarget, diagonal: f64, radius: f64, screen_height: f64) -> Target {
    let error = target.error.map(|bound| to_units(bound, diagonal));
    let pixels = target.pixels.map(|bound| error_of_pixels(bound.pixels, radius, bound.at, screen_height));
    let smallest = [error, pixels].into_iter().flatten().min_by(f64::total_cmp);
    Target { ratio: target.ratio, triangles: target.triangles, error: smallest }
}

/// A bound in object units.
fn to_units(bound: ErrorBound, diagonal: f64) -> f64 {
    match bound {
        ErrorBound::Units(units) => units,
        ErrorBound::Percent(percent) => percent / 100.0 * diagonal,
    }
}

/// What the report says of a target.
pub(super) fn report_target(target: &Target) -> TargetReport {
    TargetReport { ratio: target.ratio, triangles: target.triangles, error: target.error }
}

/// The levels worth keeping, each with its position in the preset's list, and the others with the reason.
pub(super) fn keep_levels(
    levels: Vec<Level>,
    source_triangles: usize,
    min_saving: f64,
) -> (Vec<(usize, Level)>, Vec<DroppedLevel>) {
    let mut kept: Vec<(usize, Level)> = Vec::new();
    let mut dropped = Vec::new();
    let mut above = source_triangles;
    for (index, level) in levels.into_iter().enumerate() {
        let triangles = level.mesh.triangles.len();
        match find_fault(triangles, above, min_saving) {
            Some(why) => dropped.push(DroppedLevel { requested: index + 1, triangles, why }),
            None => {
                above = triangles;
                kept.push((index, level));
            }
        }
    }
    (kept, dropped)
}

fn find_fault(triangles: usize, above: usize, min_saving: f64) -> Option<String> {
    if triangles == 0 {
        Some("nothing is left of it".to_owned())
    } else if triangles >= above {
        Some(format!("its {triangles} triangles are not fewer than the {above} of the level above"))
    } else if triangles as f64 > min_saving * above as f64 {
        Some(format!(
            "its {triangles} triangles are more than min_saving = {min_saving} of the {above} of the level above"
        ))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::preset::PixelBound;
    use crate::simplify::{Refusals, Stop};

    #[test]
    fn the_smallest_bound_on_the_error_binds() {
        let target = LevelTarget {
            ratio: Some(0.5),
            error: Some(ErrorBound::Percent(1.0)),
            pixels: Some(PixelBound { pixels: 1.0, at: 0.5 }),
            ..LevelTarget::default()
        };
        // 1 % of 10 units is 0.1; one pixel of a radius of 4 units that is 0.5 · 1000 / 2 pixels long is 0.016.
        let converted = convert_target(&target, 10.0, 4.0, 1000.0);
        assert_eq!(converted, Target { ratio: Some(0.5), triangles: None, error: Some(0.016) });
        let loose = LevelTarget { pixels: None, ..target };
        assert_eq!(convert_target(&loose, 10.0, 4.0, 1000.0).error, Some(0.1));
    }

    #[test]
    fn levels_that_save_too_little_are_dropped_against_the_level_kept_above() {
        let level = |triangles| Level {
            mesh: Mesh { triangles: vec![[0, 1, 2]; triangles], ..Mesh::default() },
            source_vertices: None,
            stop: Stop::Target,
            refusals: Refusals::default(),
        };
        let (kept, dropped) = keep_levels([95, 80, 80, 40, 0].map(level).into(), 100, 0.9);
        assert_eq!(
            kept.iter().map(|(index, level)| (*index, level.mesh.triangles.len())).collect::<Vec<_>>(),
            [(1, 80), (3, 40)]
        );
        assert_eq!(dropped.iter().map(|level| level.requested).collect::<Vec<_>>(), [1, 3, 5]);
    }
}
