//! Reduction in parts of a surface: each fits the caches, and several are worked on at once.
//!
//! All parts go up to the same cost, in rounds, so that what is gone then is what would be gone of the whole surface. Only edges at the rims of parts
//! have to wait until the parts are together again; then they go first, being the cheapest.

use super::{Order, Workspace};
use crate::mesh::regions::Region;
use crate::simplify::buckets::{BUCKETS, least_of};
use crate::simplify::prune::Piece;
use crate::simplify::reducer::Reducer;
use rayon::prelude::*;

/// Faces from which on taking a surface apart is worth it: from there on that costs no more than waiting for memory does.
const LEAST: usize = 72 * 1024;
/// Most faces of a part.
const MOST: usize = 24 * 1024;
/// Share of the faces that have to go at least.
const LEAST_SHARE: f64 = 0.2;
/// How far from their goal the parts end, as a share of the way: the rest is the whole surface's.
const SLACK: f64 = 0.02;
/// Some parts go ahead, so that the others come by once or twice only: so many at least, and one of so many.
const SAMPLES: usize = 2;
const SAMPLE: usize = 8;
/// How much of the way the sample shows.
const SAMPLE_GOAL: f64 = 0.95;
/// Rounds after which the whole surface goes on, wherever the parts are.
const ROUNDS: usize = 16;
/// Faces that an edge takes along up to the first cost: fewer than that, so that the first round does not go too far.
const FIRST_YIELD: f64 = 4.0;
/// Where the first costs of edges say nothing any more, a round doubles the cost.
const OCTAVE: usize = 64;

/// Whether so many faces are worth reducing in parts.
pub(super) fn is_worthwhile(reducer: &Reducer, target: usize) -> bool {
    let faces = reducer.surface.face_count();
    let is_far = faces.saturating_sub(target) as f64 > LEAST_SHARE * faces as f64;
    faces >= LEAST && is_far && reducer.is_separable()
}

/// Reduces the surface to a little above `target` faces; gives whether it came near.
pub(super) fn reduce(reducer: &mut Reducer, target: usize, order: Order) -> bool {
    let faces = reducer.surface.face_count();
    let gone = Gone::of(&reducer.pieces());
    let count = faces.div_ceil(MOST).max(2);
    let mut parts: Vec<Part> = reducer.split(count).into_par_iter().map(|part| Part::new(part, order)).collect();
    let rim: usize = parts.iter().map(Part::rim_faces).sum();
    // The rim will have its share gone, too.
    let goal = rim + (target as f64 / faces as f64 * (faces - rim) as f64) as usize;
    let to_do = (1.0 - SLACK) * (faces - goal) as f64;
    reduce_parts(&mut parts, order.kept, |end| to_do - gone.get_up_to(end));
    let parts: Vec<_> = parts.into_iter().map(|part| (part.region, part.reducer)).collect();
    reducer.join(parts);
    reducer.surface.face_count() < target.midpoint(faces)
}

/// Faces that go with whole pieces, which the whole surface lets go as soon as it is their turn: the costs of the pieces in order, and all faces up to
/// each.
struct Gone(Vec<(f64, f64)>);

impl Gone {
    fn of(pieces: &[Piece]) -> Self {
        let up_to = |faces: &mut f64, piece: &Piece| {
            *faces += piece.faces.len() as f64;
            Some((piece.cost, *faces))
        };
        Self(pieces.iter().scan(0.0, up_to).collect())
    }

    fn get_up_to(&self, end: usize) -> f64 {
        let limit = f64::from(least_of(end));
        self.0[..self.0.partition_point(|(cost, _)| *cost <= limit)].last().map_or(0.0, |(_, faces)| *faces)
    }
}

struct Part {
    region: Region,
    reducer: Reducer,
    workspace: Workspace,
}

impl Part {
    fn new((region, mut reducer): (Region, Reducer), order: Order) -> Self {
        let mut workspace = Workspace::default();
        workspace.look_at_all(&mut reducer, order, region.inner, 1.0);
        Self { region, reducer, workspace }
    }

    fn face_count(&self) -> usize {
        self.reducer.surface.face_count()
    }

    /// Faces that cannot go.
    fn rim_faces(&self) -> usize {
        let surface = &self.reducer.surface;
        let is_at_rim = |f: &usize| surface.face(*f).iter().any(|&p| p as usize >= self.region.inner);
        surface.live_faces().filter(is_at_rim).count()
    }

    /// How many of the edges below a bucket are left of those known from the start.
    fn edges_below(&self, end: usize) -> usize {
        self.workspace.queue.counts()[..end].iter().sum::<u32>() as usize
    }

    /// Collapses by all buckets below `end`, but for `most` faces at most; gives whether that was enough.
    fn drain(&mut self, end: usize, most: usize) -> bool {
        // Since its last round all others have been worked on.
        self.reducer.read_through();
        let limit = self.face_count().saturating_sub(most).max(1);
        !self.workspace.drain(&mut self.reducer, 0, limit, end)
    }
}

/// How many edges were cheaper than each bucket when parts were new, and how many faces there were.
struct Start {
    faces: usize,
    below: Vec<usize>,
}

impl Start {
    fn of<'a>(parts: impl Iterator<Item = &'a Part>) -> Self {
        let (mut faces, mut below) = (0, vec![0; BUCKETS + 1]);
        for part in parts {
            faces += part.face_count();
            part.workspace.queue.counts().iter().zip(&mut below[1..]).for_each(|(count, sum)| *sum += *count as usize);
        }
        (0..BUCKETS).for_each(|bucket| below[bucket + 1] += below[bucket]);
        Self { faces, below }
    }
}

/// Reduces parts by as many faces together as is `to_do` up to a bucket, up to the same cost in all of them.
fn reduce_parts(parts: &mut [Part], kept: f64, to_do: impl Fn(usize) -> f64) {
    let whole = Start::of(parts.iter());
    if kept < 1.0 {
        let most = kept * whole.below[BUCKETS] as f64;
        let dear = whole.below.partition_point(|below| (*below as f64) < most);
        parts.iter_mut().for_each(|part| part.workspace.queue.leave_out(dear));
    }
    let step = (parts.len() / SAMPLES).min(SAMPLE);
    let mut end = 0;
    if step > 1 {
        let sample = Start::of(parts.iter().step_by(step));
        let mut chosen: Vec<&mut Part> = parts.iter_mut().step_by(step).collect();
        let share = |end: usize| (sample.below[end] + 1) as f64 / (whole.below[end] + step) as f64;
        end = reduce_together(&mut chosen, &sample, 0, |end| SAMPLE_GOAL * share(end) * to_do(end));
    }
    reduce_together(&mut parts.iter_mut().collect::<Vec<_>>(), &whole, end, to_do);
}

/// Does that in rounds, first by all buckets below `end`; gives the bucket.
fn reduce_together(parts: &mut [&mut Part], start: &Start, mut end: usize, to_do: impl Fn(usize) -> f64) -> usize {
    let below = &start.below;
    let mut is_reached = end == 0;
    for _ in 0..ROUNDS {
        let done = (start.faces - parts.iter().map(|part| part.face_count()).sum::<usize>()) as f64;
        let all = to_do(end.max(1));
        let left = if end == 0 { start.faces as f64 } else { all } - done;
        if left <= SLACK * all {
            break;
        }
        if is_reached {
            let per_edge = if end == 0 { FIRST_YIELD } else { done / below[end].max(1) as f64 };
            let wanted = |next: usize| below[end] as f64 + (to_do(next) - done) / per_edge.max(1e-3);
            let next = (end + 1..=BUCKETS).find(|&next| below[next] as f64 >= wanted(next));
            end = next.unwrap_or((end + OCTAVE).min(BUCKETS));
        }
        // However wrong that is: all together take what is left at most, each as it has edges.
        let all: usize = parts.iter().map(|part| part.edges_below(end) + 1).sum();
        let each = (to_do(end) - done).max(0.0) / all as f64;
        let drain = |part: &mut &mut Part| part.drain(end, ((part.edges_below(end) + 1) as f64 * each) as usize);
        is_reached = parts.par_iter_mut().map(drain).reduce(|| true, |a, b| a && b);
        if is_reached && end == BUCKETS {
            break;
        }
    }
    end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::shapes::make_stand_in;
    use crate::simplify::deviation::Deviation;
    use crate::simplify::{Effort, Options, Placement};

    /// Reduces in parts, once for each share, or as a whole, and to the last share exactly.
    fn reduce_to(mesh: &Mesh, shares: &[f64], placement: Placement, in_parts: bool) -> Mesh {
        let mut reducer = Reducer::new(mesh, &Options { effort: Effort::Fast, placement, ..Options::default() });
        for share in shares {
            let target = (mesh.triangles.len() as f64 * share) as usize;
            if in_parts {
                let before = reducer.surface.face_count();
                let order = Order::of(&reducer, before == mesh.triangles.len());
                assert!(reduce(&mut reducer, target, order));
                let rest = reducer.surface.face_count().abs_diff(target);
                assert!(rest * 5 < before - target, "{rest} faces from the goal");
            }
            super::super::run(&mut reducer, &mut Workspace::default(), target);
            assert!(reducer.surface.face_count().abs_diff(target) <= 1);
        }
        match placement {
            Placement::Optimal => reducer.surface.to_mesh(),
            Placement::Subset => reducer.surface.to_subset(mesh).0,
        }
    }

    #[test]
    fn parts_give_what_the_whole_gives() {
        let mesh = make_stand_in(12_000);
        let deviation = Deviation::new(&mesh);
        for placement in [Placement::Optimal, Placement::Subset] {
            for shares in [&[0.5][..], &[0.6, 0.3, 0.1]] {
                let distance = |in_parts| deviation.of(&reduce_to(&mesh, shares, placement, in_parts));
                let [parts, whole] = [true, false].map(distance);
                assert!(parts.rms < 1.05 * whole.rms, "{parts:?} {whole:?}");
                assert!(parts.max < 1.4 * whole.max, "{parts:?} {whole:?}");
            }
        }
    }

    #[test]
    fn a_flat_surface_is_reduced_alike_everywhere() {
        // All edges cost the same: no cost says where to stop.
        let n = 64u32;
        let positions = (0..n * n).map(|i| [(i % n) as f32, (i / n) as f32, 0.0]).collect();
        let quad = |i: u32| [[i, i + 1, i + n + 1], [i, i + n + 1, i + n]];
        let triangles = (0..n * (n - 1)).filter(|i| i % n != n - 1).flat_map(quad).collect();
        let mesh = Mesh { positions, triangles, ..Mesh::default() };
        let target = mesh.triangles.len() / 2;
        let mut reducer = Reducer::new(&mesh, &Options::default());
        let order = Order::of(&reducer, true);
        reduce(&mut reducer, target, order);
        assert!(reducer.surface.face_count() >= target);
    }
}
