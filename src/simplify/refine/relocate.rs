//! Relocation: a point goes where its faces are nearest to the source.
//!
//! The least squares problem of Hoppe et al. (1993) in point-to-plane form: closest points stay in their faces' planes but may slide, so a step
//! goes as far as several of the original ones. The point's own distance to the source takes part: nothing else holds back a point that sticks
//! out, as no sample is near it.

use super::level::{Level, Manner, Triangles, area, unit_normal};
use super::step::Step;

/// Relative gain below which a step is noise, promised and kept.
const LEAST_PROMISE: f32 = 5e-3;
const LEAST_GAIN: f32 = 2e-3;
/// Lengths of the steps tried.
const SCALES: [f32; 2] = [1.0, 0.4];
/// Cosine of the angle by which a face may turn.
const TURN_COSINE: f32 = 0.3;
/// Share of the faces' area that the point alone stands for.
const POINT_SHARE: f32 = 0.02;

/// Tries to move `p`; whether it moved.
pub(super) fn relocate(level: &mut Level, p: u32, manner: Manner) -> bool {
    let thorough = manner == Manner::Thorough;
    let (faces, fan) = level.fan(p);
    if faces.is_empty() {
        return false;
    }
    let own_area = fan.iter().map(area).sum::<f32>() * level.prices.density * POINT_SHARE;
    let foot = level.foot(p);
    let mut before = level.gather(&faces, &fan);
    let mut step = Step::default();
    level.patch.add_to(&mut step, &level.prices);
    if thorough {
        let probes = level.probe_fan(&fan, foot);
        before.cost += level.price(&probes);
        level.add_probes(&probes, &mut step);
    } else {
        before.cost += level.prices.of_place(own_area, foot.distance_squared);
        step.add(foot.point - fan[0][0], 1.0, level.prices.slope(own_area, foot.distance_squared));
    }
    let Some((step, promise)) = step.solve() else { return false };
    if promise < before.cost * LEAST_PROMISE {
        return false;
    }
    for scale in SCALES {
        let new = fan[0][0] + step * scale;
        if !level.source.room.contains(new.as_dvec3()) {
            continue;
        }
        let moved: Triangles = fan.iter().map(|t| [new, t[1], t[2]]).collect();
        if fan.iter().zip(&moved).any(|(o, n)| unit_normal(o).dot(unit_normal(n)) < TURN_COSINE) {
            continue;
        }
        let mut after = level.appraise(&moved);
        let most = before.cost * (1.0 - LEAST_GAIN);
        if after.cost > most || !after.faces_like(&before) {
            continue;
        }
        let foot = level.look_back(new, foot.face);
        after.cost += if thorough {
            level.price(&level.probe_fan(&moved, foot))
        } else {
            level.prices.of_place(own_area, foot.distance_squared)
        };
        if after.cost < most {
            level.surface.points[p as usize] = new.as_dvec3();
            level.feet[p as usize] = foot;
            level.settle(&faces, &faces);
            return true;
        }
    }
    false
}
