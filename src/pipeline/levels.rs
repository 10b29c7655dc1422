//! From what a preset asks for to what the simplifier is told, and which of its levels are worth keeping.

use crate::coverage::error_of_pixels;
use crate::preset::{ErrorBound, LevelTarget, Settings};
use crate::report::{DroppedLevel, TargetReport};
use crate::simplify::{self, Level, Target};

/// The size of a mesh, which relative bounds refer to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    /// Diagonal of the bounding box, object units.
    pub(super) diagonal: f64,
    /// Radius of the bounding sphere, object units.
    pub(super) radius: f64,
}

/// The simplifier's options for a mesh of this size.
pub(super) fn choose_options(settings: &Settings, extent: Extent) -> simplify::Options {
    let levels = settings.levels.iter().map(|target| convert_target(target, extent, settings.screen_height)).collect();
    simplify::Options { levels, ..settings.simplify.clone() }
}

/// Percent and pixels become object units; the smallest bound on the error binds.
fn convert_target(target: &LevelTarget, extent: Extent, screen_height: f64) -> Target {
    let error = target.error.map(|bound| to_units(bound, extent.diagonal));
    let pixels = target.pixels.map(|bound| error_of_pixels(bound.pixels, extent.radius, bound.at, screen_height));
    let smallest = [error, pixels].into_iter().flatten().min_by(f64::total_cmp);
    Target { ratio: target.ratio, triangles: target.triangles, error: smallest }
}

/// A bound in object units.
pub(super) fn to_units(bound: ErrorBound, diagonal: f64) -> f64 {
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
