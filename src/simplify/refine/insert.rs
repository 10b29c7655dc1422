//! A new point on an edge: the edge's two faces become four.

use super::flip::find_diamond;
use super::level::{Level, turn_away};
use super::source::Foot;
use crate::attributes::fill_midpoint;
use crate::mesh::edges::edge_kind;
use crate::mesh::surface::Surface;
use crate::mesh::surgery::split_edge;
use glam::Vec3;

/// A new point that was measured.
pub(super) struct Insertion {
    /// Ends of the edge, and the points across.
    pub points: [u32; 4],
    /// By how much the level's cost falls.
    pub gain: f32,
    faces: [usize; 2],
    foot: Foot,
}

/// The best at a face that gains anything: on one of its edges, at the source's point nearest to the middle or at the face's farthest sample.
pub(super) fn find_insertion(level: &mut Level, face: usize) -> Option<Insertion> {
    let corners = level.surface.face(face);
    let samples = level.lists.of(face).flat_map(|four| four.samples().map(|(k, s)| (four.squared.as_array()[k], s)));
    let farthest = samples.max_by(|a, b| a.0.total_cmp(&b.0));
    let at_sample = farthest.map(|(_, s)| &level.source.samples[s as usize]).map(|s| Foot {
        distance_squared: 0.0,
        point: s.position,
        face: s.face,
    });
    let mut best: Option<Insertion> = None;
    for k in 0..3 {
        let edge = [corners[k], corners[(k + 1) % 3]];
        let middle = level.point(edge[0]).midpoint(level.point(edge[1]));
        let at_middle = level.look_back(middle, level.foot(edge[0]).face);
        for foot in at_sample.into_iter().chain([at_middle]) {
            let found = measure(level, edge, foot).filter(|new| best.as_ref().is_none_or(|best| new.gain > best.gain));
            best = found.or(best);
        }
    }
    best
}

fn measure(level: &mut Level, [a, b]: [u32; 2], foot: Foot) -> Option<Insertion> {
    let (first, second, c, d) = find_diamond(level.surface, a, b)?;
    if !edge_kind(level.surface, a, b).is_some_and(|kind| kind.is_plain()) {
        return None;
    }
    let (points, faces) = ([a, b, c, d], [first, second]);
    let (old, new) = around(level, points, foot.point);
    let halves = [old[0], old[0], old[1], old[1]];
    let before = level.gather(&faces, &old);
    if !level.patch.can_judge() || turn_away(&halves, &new) {
        return None;
    }
    let back = (level.spots(first).squares + level.spots(second).squares) * level.prices.density;
    let after = level.patch.attempt_any(&new, &level.prices);
    let gain = before.cost + back - after.cost - level.price(&level.probe_fan(&new, foot));
    let stays = after.turned <= before.turned && !level.comes_to_look_away(&old, &new, foot);
    (stays && gain > 0.0).then_some(Insertion { points, gain, faces, foot })
}

/// The two faces of an edge `ab` with `c` on its left and `d` on its right, and the four around `x` instead, neighbours side by side.
fn around(level: &Level, points: [u32; 4], x: Vec3) -> ([[Vec3; 3]; 2], [[Vec3; 3]; 4]) {
    let [a, b, c, d] = points.map(|p| level.point(p));
    ([[a, b, c], [b, a, d]], [[x, b, c], [x, c, a], [x, a, d], [x, d, b]])
}

impl Insertion {
    /// Does it; gives the new point.
    pub fn carry_out(&self, level: &mut Level) -> u32 {
        let ([a, b, c, d], x) = (self.points, self.foot.point);
        let (old, new) = around(level, self.points, x);
        level.gather(&self.faces, &old);
        level.patch.attempt_any(&new, &level.prices);
        let (point, made) = split_edge(level.surface, a, b, x.as_dvec3());
        for wedges in made {
            fill_midpoint(&mut level.surface.wedges, wedges);
        }
        level.grow();
        level.feet[point as usize] = self.foot;
        let ring = level.surface.ring(point).iter();
        let face_at = |rim: [u32; 2]| {
            let corner = ring.clone().find(|&&corner| level.surface.opposite(corner) == rim);
            corner.map_or(self.faces[0], |&corner| Surface::face_of(corner))
        };
        let faces = [[b, c], [c, a], [a, d], [d, b]].map(face_at);
        level.settle(&self.faces, &faces);
        point
    }
}
