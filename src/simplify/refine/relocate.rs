//! Relocation: a point goes where its faces are nearest to the source.
//!
//! The least squares problem of Hoppe et al. (1993) in point-to-plane form: closest points stay in their faces' planes but may slide, so a step
//! goes as far as several of the original ones. The point's own distance to the source takes part: nothing else holds back a point that sticks
//! out, as no sample is near it.

use super::attributes::go_along;
use super::hold::Hold;
use super::level::{Fan, Level, Manner, TURN_COSINE, area};
use super::step::Step;
use std::mem::take;

/// Relative gain below which a step is noise.
const LEAST_GAIN: f32 = 2e-3;
/// Lengths of the steps tried; in sweeps as many as the budget has.
const SCALES: [f32; 3] = [1.0, 0.4, 0.15];
/// At peaks, share of the faces' area of which samples may turn over, for moves that lower the cost to [`MOST_TURNING`] of what it was: at the tip of
/// a thin part the nearest face is now the front and now the back.
const TURNING_SHARE: f32 = 0.05;
const MOST_TURNING: f32 = 0.5;
/// Share of the faces' area that the point alone stands for.
const POINT_SHARE: f32 = 0.02;

/// Tries to move `p`; whether it moved.
pub(super) fn relocate(level: &mut Level, p: u32, manner: Manner) -> bool {
    if level.holds[p as usize] == Hold::Fixed {
        return false;
    }
    let mut fan = take(&mut level.fan);
    level.fill_fan(p, &mut fan);
    let moves = !fan.faces.is_empty() && relocate_hub(level, p, &mut fan, manner);
    level.fan = fan;
    moves
}

fn relocate_hub(level: &mut Level, p: u32, fan: &mut Fan, manner: Manner) -> bool {
    let thorough = manner == Manner::Thorough;
    let (here, foot) = (fan.triangles[0][0], level.foot(p));
    let whole = fan.triangles.iter().map(area).sum::<f32>() * level.prices.density;
    let own_area = whole * POINT_SHARE;
    let mut before = level.gather(&fan.faces, &fan.triangles);
    if !level.patch.can_judge() {
        return false;
    }
    let mut step = Step::default();
    level.patch.add_to(&mut step, &level.prices);
    // Distances leave a point free to slide where all is flat. There attributes may have wanted it where it is.
    if level.wants.is_none() {
        level.patch.planes.add_shapes_to(&mut step, &level.prices);
    }
    if thorough {
        let probes = level.probe_fan(&fan.triangles, foot);
        before.cost += level.price(&probes);
        level.add_probes(&probes, &mut step);
    } else {
        before.cost += level.prices.of_place(own_area, foot.distance_squared);
        step.add(foot.point - here, 1.0, level.prices.slope(own_area, foot.distance_squared));
    }
    let forbidden = level.holds[p as usize].forbidden(level.surface, fan);
    let Some((step, promise)) = step.solve(&forbidden) else { return false };
    if promise < before.cost * level.budget.promise {
        return false;
    }
    let scales = if thorough { &SCALES[..] } else { &SCALES[..level.budget.scales] };
    for &scale in scales {
        let new = here + step * scale;
        if !level.source.room.contains(new.as_dvec3()) {
            continue;
        }
        fan.move_to(new);
        let mut after = level.patch.attempt(&fan.moved, &level.prices);
        let most = before.cost * (1.0 - LEAST_GAIN);
        let turns = level.patch.planes.least_cosine(&level.patch.tried) < TURN_COSINE;
        let may_turn = thorough && after.cost < before.cost * MOST_TURNING;
        let most_turned = before.turned + if may_turn { whole * TURNING_SHARE } else { 0.0 };
        if turns || after.cost > most || after.turned > most_turned {
            continue;
        }
        let foot = level.look_back(new, foot.face);
        after.cost += if thorough {
            level.price(&level.probe_fan(&fan.moved, foot))
        } else {
            level.prices.of_place(own_area, foot.distance_squared)
        };
        if after.cost < most && !level.comes_to_look_away(&fan.triangles, &fan.moved, foot) {
            if !level.is_free(p) {
                go_along(level.surface, p, new - here);
            }
            level.surface.points[p as usize] = new.as_dvec3();
            level.feet[p as usize] = foot;
            level.settle(&fan.faces, &fan.faces);
            return true;
        }
    }
    false
}
