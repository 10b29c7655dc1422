//! Edge flips: the other diagonal of two faces where that is nearer to the source or better shaped.

use super::level::{Level, Manner, area, unit_normal};
use crate::attributes::turns_over;
use crate::mesh::edges::edge_kind;
use crate::mesh::surface::Surface;
use crate::mesh::surgery::flip_edge;
use crate::mesh::wedges::Wedges;
use glam::{Vec2, Vec3};

/// Relative gain below which a flip is noise.
const LEAST_GAIN: f32 = 1e-3;
/// Cosine of the angle by which the new faces may turn from the nearer of the old, and against either.
const TURN_COSINE: f32 = 0.3;

/// Tries all edges.
pub(super) fn flip_edges(level: &mut Level) {
    for f in 0..level.surface.face_slots() {
        for k in 0..3 {
            if level.surface.is_live(f) {
                let face = level.surface.face(f);
                let (a, b) = (face[k], face[(k + 1) % 3]);
                if a < b {
                    try_flip(level, a, b, Manner::Quick);
                }
            }
        }
    }
}

/// Flips the edge between `a` and `b` if that is worth it.
pub(super) fn try_flip(level: &mut Level, a: u32, b: u32, manner: Manner) -> bool {
    let Some((first, second, c, d)) = find_diamond(level.surface, a, b) else { return false };
    let [pa, pb, pc, pd] = [a, b, c, d].map(|p| level.point(p));
    // The shared edge comes first in either pair.
    let (faces, old, new) = ([first, second], [[pa, pb, pc], [pb, pa, pd]], [[pc, pd, pb], [pd, pc, pa]]);
    if manner == Manner::Quick && cannot_pay(level, &faces, &old, &new) {
        return false;
    }
    let mut before = level.gather(&faces, &old);
    if !level.patch.can_judge() || turns(&old, &new) {
        return false;
    }
    let mut after = level.patch.attempt(&new, &level.prices);
    if after.turned > before.turned || (manner != Manner::Thorough && after.cost > before.cost * (1.0 - LEAST_GAIN)) {
        return false;
    }
    before.cost += level.price(&level.probe_pair(&old, level.foot(a).face));
    let probes = level.probe_pair(&new, level.foot(c).face);
    after.cost += level.price(&probes);
    let most = before.cost * (1.0 - LEAST_GAIN);
    let taken = || level.surface.ring(c).iter().any(|&corner| level.surface.opposite(corner).contains(&d));
    if after.cost > most || taken() || !edge_kind(level.surface, a, b).is_some_and(|k| k.is_plain()) {
        return false;
    }
    if probes.iter().any(|probe| level.comes_to_look_away(&old, &new, probe.foot)) {
        return false;
    }
    let Some(wedges) = wedges_of_diamond(level.surface, faces, [a, b, c, d]) else { return false };
    if turns_charts(&level.surface.wedges, wedges)
        || harm_to_attributes(level, &faces, wedges, [&old, &new]) > most - after.cost
    {
        return false;
    }
    flip_edge(level.surface, first, second, a, b);
    // `first` keeps a and c, `second` b and d.
    level.settle(&faces, &[second, first]);
    true
}

/// Whether a flip changes more than its faces' samples could gain. Between the diagonals the surface moves by a tent of height `h`, that is by h²/6 in
/// the mean square; residuals that get less by that are at least half as large (Cauchy–Schwarz).
fn cannot_pay(level: &Level, faces: &[usize; 2], old: &[[Vec3; 3]; 2], new: &[[Vec3; 3]; 2]) -> bool {
    let ([[a, b, _], _], [[c, d, _], _]) = (old, new);
    let across = (*b - *a).cross(*d - *c);
    let height = (*c - *a).dot(across) / across.length().max(f32::MIN_POSITIVE);
    let moved = level.prices.density * (area(&old[0]) + area(&old[1])) * height * height / 6.0;
    let residuals: f32 = faces.iter().map(|&f| level.cost_of_distances(f)).sum();
    let shapes = |pair: &[[Vec3; 3]; 2]| pair.iter().map(|t| level.prices.of_shape(t)).sum::<f32>();
    4.0 * residuals < moved && shapes(old) - shapes(new) < moved
}

fn turns(old: &[[Vec3; 3]; 2], new: &[[Vec3; 3]; 2]) -> bool {
    let old = [unit_normal(&old[0]), unit_normal(&old[1])];
    new.iter().any(|t| {
        let n = unit_normal(t);
        old.iter().all(|o| o.dot(n) < TURN_COSINE) || old.iter().any(|o| o.dot(n) < -TURN_COSINE)
    })
}

/// The wedges of the points in the diamond: of the first two in its first face.
fn wedges_of_diamond(surface: &Surface, [first, second]: [usize; 2], [a, b, c, d]: [u32; 4]) -> Option<[u32; 4]> {
    let wedge = |face: usize, p: u32| {
        let corner = surface.face(face).iter().position(|&q| q == p)?;
        Some(surface.face_wedges(face)[corner])
    };
    Some([wedge(first, a)?, wedge(first, b)?, wedge(first, c)?, wedge(second, d)?])
}

/// What the other diagonal costs in attributes.
fn harm_to_attributes(
    level: &Level,
    faces: &[usize; 2],
    [a, b, c, d]: [u32; 4],
    [old, new]: [&[[Vec3; 3]; 2]; 2],
) -> f32 {
    let (old_wedges, new_wedges) = ([[a, b, c], [b, a, d]], [[c, d, b], [d, c, a]]);
    level.wants.as_ref().map_or(0.0, |wants| wants.harm(level, faces, (old, &old_wedges), (new, &new_wedges)))
}

/// Whether the other diagonal would turn a face over in a texture: there the diamond may have another shape.
fn turns_charts(wedges: &Wedges, diamond: [u32; 4]) -> bool {
    wedges.tex_coords().any(|offset| {
        let [a, b, c, d] = diamond.map(|wedge| Vec2::from_slice(&wedges.row(wedge)[offset..]));
        turns_over([c, a], b, d) || turns_over([b, c], a, d)
    })
}

/// The two faces of an edge, the first running from `a` to `b`, and the points opposite.
pub(super) fn find_diamond(surface: &Surface, a: u32, b: u32) -> Option<(usize, usize, u32, u32)> {
    let (mut first, mut second) = (None, None);
    for &corner in surface.ring(a) {
        let [next, previous] = surface.opposite(corner);
        if next == b && first.replace((Surface::face_of(corner), previous)).is_some() {
            return None;
        }
        if previous == b && second.replace((Surface::face_of(corner), next)).is_some() {
            return None;
        }
    }
    let ((f, c), (g, d)) = (first?, second?);
    (c != d).then_some((f, g, c, d))
}
