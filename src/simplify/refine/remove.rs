//! A point less: the two ends of an edge become one, and its two faces go.

use super::level::{Level, turn_away};
use super::source::Foot;
use crate::attributes::Solution;
use crate::mesh::surface::Surface;
use crate::mesh::surgery::Merge;
use glam::Vec3;

/// A collapse that was measured.
pub(super) struct Removal {
    /// All points of the faces that it changes.
    pub points: Vec<u32>,
    /// By how much the level's cost rises.
    pub loss: f32,
    edge: [u32; 2],
    place: Vec3,
    foot: Foot,
}

/// About what the collapse of an edge loses: the tents between the old faces and the new point, less the shapes of the faces that go.
pub(super) fn foretell_loss(level: &Level, [a, b]: [u32; 2]) -> f32 {
    let (pa, pb) = (level.point(a), level.point(b));
    let places = [pa, pb, pa.midpoint(pb)];
    let (mut moved, mut shapes) = ([0.0f32; 3], 0.0);
    for (here, other) in [(a, b), (b, a)] {
        for &corner in level.surface.ring(here) {
            let triangle = level.triangle(Surface::face_of(corner));
            if level.surface.opposite(corner).contains(&other) {
                shapes += 0.5 * level.prices.of_shape(&triangle);
                continue;
            }
            let [p, q, r] = triangle;
            let cross = (q - p).cross(r - p);
            let length = cross.length().max(f32::MIN_POSITIVE);
            for (sum, x) in moved.iter_mut().zip(places) {
                *sum += cross.dot(x - p).powi(2) / length;
            }
        }
    }
    // A tent of height h over an area is h²/6 in the mean square; the cross product has twice the area.
    moved.into_iter().fold(f32::INFINITY, f32::min) * level.prices.density / 12.0 - shapes
}

/// The best collapse of an edge between regular points: to either end, or to the source's point nearest to the middle.
pub(super) fn find_removal(level: &mut Level, edge: [u32; 2]) -> Option<Removal> {
    let [a, b] = edge;
    let merge = Merge::new(level.surface, a, b);
    // The point keeps the values that it has, until all are fitted.
    if !merge.keeps_regular() || !is_closed(merge.rims()) || Solution::default().turns_charts(level.surface, &merge) {
        return None;
    }
    let (faces, old) = faces_of(level, &merge);
    let before = level.gather(&faces, &old);
    if !level.patch.can_judge() {
        return None;
    }
    let back = faces.iter().map(|&f| level.spots(f).squares).sum::<f32>() * level.prices.density;
    let middle = level.look_back(level.point(a).midpoint(level.point(b)), level.foot(a).face);
    let mut best: Option<Removal> = None;
    for (place, foot) in [(level.point(a), level.foot(a)), (level.point(b), level.foot(b)), (middle.point, middle)] {
        let new = fan(level, &merge, place);
        if turn_away(&old[..new.len()], &new) || level.comes_to_look_away(&old, &new, foot) {
            continue;
        }
        let after = level.patch.attempt_any(&new, &level.prices);
        let loss = after.cost + level.price(&level.probe_fan(&new, foot)) - before.cost - back
            + harm_to_attributes(level, &merge, &faces, &old, &new);
        if after.turned <= before.turned && loss.is_finite() && best.as_ref().is_none_or(|best| loss < best.loss) {
            best = Some(Removal { points: points_of(&merge), loss, edge, place, foot });
        }
    }
    best
}

/// The faces that a collapse changes: those that stay come first.
fn faces_of(level: &Level, merge: &Merge) -> (Vec<usize>, Vec<[Vec3; 3]>) {
    let stay = merge.spokes().iter().map(|&corner| Surface::face_of(corner));
    let faces: Vec<usize> = stay.chain(merge.faces()).collect();
    let triangles = faces.iter().map(|&f| level.triangle(f)).collect();
    (faces, triangles)
}

/// What the collapse costs in attributes: the joined point keeps the values that it has, until all are fitted.
fn harm_to_attributes(level: &Level, merge: &Merge, faces: &[usize], old: &[[Vec3; 3]], new: &[[Vec3; 3]]) -> f32 {
    let Some(wants) = &level.wants else { return 0.0 };
    let old_wedges: Vec<_> = faces.iter().map(|&f| level.surface.face_wedges(f)).collect();
    let new_wedges = merge.spokes().iter().map(|&corner| {
        let [p, q] = level.surface.opposite_wedges(corner);
        [merge.target(level.surface.wedge_at(corner)), p, q]
    });
    wants.harm(level, faces, (old, &old_wedges), (new, &new_wedges.collect::<Vec<_>>()))
}

fn points_of(merge: &Merge) -> Vec<u32> {
    [merge.kept, merge.gone].into_iter().chain(merge.rims().iter().flatten().copied()).collect()
}

fn fan(level: &Level, merge: &Merge, x: Vec3) -> Vec<[Vec3; 3]> {
    merge.rims().iter().map(|&[p, q]| [x, level.point(p), level.point(q)]).collect()
}

/// Whether the rims make one ring.
fn is_closed(rims: &[[u32; 2]]) -> bool {
    let after = |p: u32| rims.iter().find(|rim| rim[0] == p).map(|rim| rim[1]);
    let Some(&[start, _]) = rims.first() else { return false };
    let way = std::iter::successors(Some(start), |&p| after(p).filter(|&next| next != start));
    way.take(rims.len() + 1).count() == rims.len() && rims.iter().any(|rim| rim[1] == start)
}

impl Removal {
    /// Does it.
    pub fn carry_out(&self, level: &mut Level) {
        let merge = Merge::new(level.surface, self.edge[0], self.edge[1]);
        let (faces, old) = faces_of(level, &merge);
        level.gather(&faces, &old);
        let new = fan(level, &merge, self.place);
        level.patch.attempt_any(&new, &level.prices);
        merge.apply(level.surface, self.place.as_dvec3());
        level.feet[merge.kept as usize] = level.look_back(self.place, self.foot.face);
        level.settle(&faces, &faces[..new.len()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_ring_is_closed() {
        assert!(is_closed(&[[0, 1], [2, 0], [1, 2]]));
        assert!(!is_closed(&[[0, 1], [1, 2]]));
        // Two rings that meet in the joined point.
        assert!(!is_closed(&[[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3]]));
    }
}
