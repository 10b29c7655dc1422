//! Exchanges: a point is put in where the level is farthest from the source, and paid for by one that is taken out where that loses less. Both are
//! measured before they are done, so that the number of faces stays and the sum of all errors falls.

use super::insert::{Insertion, find_insertion};
use super::level::{Level, Manner};
use super::relocate::relocate;
use super::remove::{Removal, find_removal, foretell_loss};
use crate::mesh::edges::collect_edges;
use std::cmp::Ordering;

/// Share of the faces at which insertions are measured, and as many edges whose removal is.
const LOOKED_AT: f32 = 0.03;
/// Share of the faces whose worst spots count as peaks.
const PEAKS: f32 = 0.05;
/// An insertion has to gain this factor more than its removal loses.
const MARGIN: f32 = 1.1;

/// Does all exchanges that pay.
pub(super) fn exchange(level: &mut Level) {
    let faces: Vec<usize> = level.surface.live_faces().collect();
    let most = (LOOKED_AT * faces.len() as f32).ceil() as usize;
    let peak = find_peak(level, &faces);
    level.prices.set_peak(peak);
    let insertions = find_insertions(level, &faces, most);
    let mut removals = find_removals(level, most).into_iter();
    // What has been measured holds as long as no face of it has changed.
    let mut touched = vec![false; level.surface.points.len()];
    for insertion in insertions {
        let is_touched = |points: &[u32]| points.iter().any(|&p| touched[p as usize]);
        if is_touched(&insertion.points) {
            continue;
        }
        let goes_with = |r: &Removal| !is_touched(&r.points) && !r.points.iter().any(|p| insertion.points.contains(p));
        let Some(removal) = removals.by_ref().find(goes_with) else { break };
        if insertion.gain <= removal.loss.max(0.0) * MARGIN {
            break;
        }
        insertion.points.iter().chain(&removal.points).for_each(|&p| touched[p as usize] = true);
        removal.carry_out(level);
        let point = insertion.carry_out(level);
        touched.push(true);
        relocate(level, point, Manner::Thorough);
    }
}

/// The squared distance that only the worst spots of some of the faces exceed.
fn find_peak(level: &mut Level, faces: &[usize]) -> f32 {
    let worst = faces.iter().map(|&f| level.spots(f).worst).collect();
    first_of(worst, (PEAKS * faces.len() as f32) as usize + 1, |a, b| b.total_cmp(a))
        .into_iter()
        .fold(f32::INFINITY, f32::min)
}

/// Insertions at the faces whose distances cost most, both ways; the best first.
fn find_insertions(level: &mut Level, faces: &[usize], most: usize) -> Vec<Insertion> {
    let costs = faces
        .iter()
        .map(|&f| {
            let spots = level.spots(f);
            let back = level.prices.density * spots.squares + level.prices.of_place(0.0, spots.worst);
            (level.cost_of_distances(f) + back, f)
        })
        .collect();
    let worst = first_of(costs, most, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut found: Vec<Insertion> = worst.into_iter().filter_map(|(_, f)| find_insertion(level, f)).collect();
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    found
}

/// Removals that seem to lose least; the best first.
fn find_removals(level: &mut Level, most: usize) -> Vec<Removal> {
    let edges = collect_edges(level.surface).into_iter().filter(|e| e.kind.is_plain()).map(|e| [e.a, e.b]);
    let costs = edges
        .filter(|edge| edge.iter().all(|&p| level.is_free(p)))
        .map(|edge| (foretell_loss(level, edge), edge))
        .collect();
    let best = first_of(costs, most, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut found: Vec<Removal> = best.into_iter().filter_map(|(_, edge)| find_removal(level, edge)).collect();
    found.sort_by(|a, b| a.loss.total_cmp(&b.loss));
    found
}

/// The first `count` in this order, and those in it.
fn first_of<T>(mut items: Vec<T>, count: usize, order: impl Fn(&T, &T) -> Ordering) -> Vec<T> {
    if items.len() > count {
        items.select_nth_unstable_by(count, &order);
        items.truncate(count);
    }
    items.sort_by(order);
    items
}
