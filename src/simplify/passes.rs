//! The fast schedule: rank all edges, sort once, collapse greedily where nothing nearby has changed in this pass, repeat.

use super::guard::Strictness;
use super::reducer::Reducer;
use super::{Stop, prune};
use crate::simplify::guard::Cause;
use rayon::prelude::*;

/// Share of the collapses still needed that one pass aims at: less means stricter order, more means fewer passes.
const PASS_SHARE: f64 = 0.5;
/// A pass may go this factor above the cost of the last collapse it aims at, since neighbours of a collapse have to wait.
const COST_SLACK: f32 = 1.5;

/// Reduces to `target` faces (± 1).
pub(crate) fn run(reducer: &mut Reducer, target: usize) -> Stop {
    let mut strictness = Strictness::Full;
    while reducer.surface.face_count() > target {
        let before = reducer.surface.face_count();
        run_pass(reducer, target, strictness);
        if reducer.surface.face_count() < before {
            strictness = Strictness::Full;
            continue;
        }
        strictness = match strictness {
            Strictness::Full => Strictness::Seams,
            Strictness::Seams => Strictness::Topology,
            Strictness::Topology => return Stop::Stuck,
        };
    }
    Stop::Target
}

/// A collapse in the order of costs.
struct Ranked {
    cost: f32,
    edge: u32,
}

fn run_pass(reducer: &mut Reducer, target: usize, strictness: Strictness) {
    let edges = reducer.refresh();
    let mut ranked: Vec<Ranked> = edges
        .par_iter()
        .enumerate()
        .filter_map(|(i, e)| reducer.judge(e.a, e.b).map(|c| Ranked { cost: c.cost as f32, edge: i as u32 }))
        .collect();
    for e in &edges {
        if reducer.is_locked(e.a, e.b) {
            reducer.refusals.count(Cause::Border);
        }
    }
    ranked.par_sort_unstable_by(|x, y| x.cost.total_cmp(&y.cost).then(x.edge.cmp(&y.edge)));
    let excess = reducer.surface.face_count() - target;
    let limit = cost_limit(&ranked, excess);
    let pieces = prune::cheap_pieces(&reducer.surface, limit);
    let mut touched = vec![false; reducer.surface.points.len()];
    let mut left = excess;
    let (mut pieces, mut done) = (pieces.into_iter().peekable(), 0);
    for r in &ranked {
        while let Some(piece) = pieces.next_if(|p| p.cost <= f64::from(r.cost)) {
            left -= prune::remove(&mut reducer.surface, &piece, left, &mut touched);
        }
        if left == 0 || (r.cost > limit && done > 0) {
            break;
        }
        let e = &edges[r.edge as usize];
        if touched[e.a as usize] || touched[e.b as usize] {
            continue;
        }
        let Some(candidate) = reducer.judge(e.a, e.b) else { continue };
        if let Ok(removed) = reducer.collapse((e.a, e.b), candidate, strictness, left + 1) {
            touch(reducer, e.a, &mut touched);
            touched[e.b as usize] = true;
            left = left.saturating_sub(removed);
            done += 1;
        }
    }
}

/// What was judged before a neighbour moved is stale: it waits for the next pass.
fn touch(reducer: &Reducer, point: u32, touched: &mut [bool]) {
    touched[point as usize] = true;
    let surface = &reducer.surface;
    for &corner in surface.ring(point) {
        surface.opposite(corner).iter().for_each(|&p| touched[p as usize] = true);
    }
}

/// The cost up to which a pass collapses: that of the last of the collapses it aims at, with some slack.
fn cost_limit(ranked: &[Ranked], excess: usize) -> f32 {
    let aim = (excess as f64 * 0.5 * PASS_SHARE).ceil() as usize;
    ranked.get(aim.min(ranked.len().saturating_sub(1))).map_or(f32::INFINITY, |r| r.cost * COST_SLACK)
}
