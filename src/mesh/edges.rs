//! The edges of a surface and what runs along them: open borders, seams, material borders, folds.

use super::regions::{Region, join_flags};
use super::surface::{Corner, Surface};
use crate::tasks;
use rayon::prelude::*;
use smallvec::SmallVec;
use wide::u32x8;

/// An undirected edge; `a < b` when collected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Edge {
    pub a: u32,
    pub b: u32,
    pub kind: EdgeKind,
}

impl Edge {
    fn between(surface: &Surface, a: u32, b: u32, sides: &[Side]) -> Self {
        let kind = match *sides {
            [_] => EdgeKind::BORDER,
            [first, second] => classify(surface, [first, second]),
            _ => EdgeKind::COMPLEX,
        };
        Self { a, b, kind }
    }
}

/// A set of properties of an edge.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct EdgeKind(u8);

impl EdgeKind {
    /// One face only.
    pub const BORDER: Self = Self(1);
    /// Attributes differ between its faces.
    pub const SEAM: Self = Self(2);
    /// Its faces belong to different groups.
    pub const MATERIAL: Self = Self(4);
    /// More than two faces, or two that run along it in the same direction.
    pub const COMPLEX: Self = Self(8);
    /// Two faces folded onto each other.
    pub const FOLD: Self = Self(16);

    /// Whether any property of `other` is set.
    pub fn has(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Whether nothing runs along the edge.
    pub fn is_plain(self) -> bool {
        self.0 == 0
    }

    /// Both sets together.
    pub fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// A corner at the first point of an edge, in a face of that edge; `forward` if the face runs from the first point to the second.
pub(crate) type Side = (Corner, bool);
/// Those of all faces of an edge.
pub(crate) type Sides = SmallVec<[Side; 8]>;

/// All edges, in the order of faces, those between irregular points last.
pub(crate) fn collect_edges(surface: &Surface) -> Vec<Edge> {
    let mut edges = Vec::new();
    recollect_edges(surface, &Irregular::find(surface), &mut edges);
    edges
}

/// The points at edges that are not plain, or with several wedges. Only edges between two of them can be anything but plain.
#[derive(Debug, Default)]
pub(crate) struct Irregular(Vec<bool>);

impl Irregular {
    /// Looks at all points.
    pub fn find(surface: &Surface) -> Self {
        Self(tasks::collect(surface.points.len(), |point| !is_regular(surface, point as u32)))
    }

    /// The points.
    pub fn points(&self) -> impl Iterator<Item = u32> {
        self.0.iter().zip(0..).filter(|(is, _)| **is).map(|(_, point)| point)
    }

    /// Follows a collapse. Of one that breaks the link condition (`breaking`) anything may have become of the edges around it.
    pub fn follow(&mut self, surface: &Surface, kept: u32, gone: u32, breaking: bool) {
        self.0[kept as usize] |= self.0[gone as usize] | breaking;
        if breaking {
            surface.around(kept).for_each(|p| self.0[p as usize] = true);
        }
    }

    /// Looks again at the points that were irregular.
    pub fn review(&mut self, surface: &Surface) {
        tasks::for_each(&mut self.0, |point, is| *is = *is && !is_regular(surface, point as u32));
    }

    /// What is known of some points.
    pub fn pick(&self, points: &[u32]) -> Self {
        Self(points.iter().map(|&p| self.0[p as usize]).collect())
    }

    /// Takes what has become of the `count` points there are now, each in one of the parts at least.
    pub fn join<'a>(&mut self, parts: impl Iterator<Item = (&'a Region, Self)>, count: usize) {
        self.0 = join_flags(parts.map(|(region, part)| (region, part.0)), count);
    }

    /// Makes room for points at plain edges only.
    pub fn grow(&mut self, points: usize) {
        self.0.resize(points, false);
    }

    /// Whether one of two points is irregular.
    pub fn is_either(&self, a: u32, b: u32) -> bool {
        self.0[a as usize] || self.0[b as usize]
    }

    fn are_both(&self, a: u32, b: u32) -> bool {
        self.0[a as usize] & self.0[b as usize]
    }
}

/// Whether a point has one wedge, and each edge at it two faces of opposite directions: then the points after its corners are all different, and
/// the same as those before them.
fn is_regular(surface: &Surface, point: u32) -> bool {
    let ring = surface.ring(point);
    surface.has_one_wedge(point)
        && match ring.len() {
            // Two faces back to back.
            2 => false,
            0..=8 => is_closed::<1>(surface, ring),
            9..=32 => is_closed::<4>(surface, ring),
            _ => false,
        }
}

/// Whether the points after the corners of a ring, eight times `N` at most, are all different, and the same as those before them.
fn is_closed<const N: usize>(surface: &Surface, ring: &[Corner]) -> bool {
    let Links { after, before } = Links::<N>::new(surface, ring);
    let after = after.map(u32x8::new);
    // Each point before has its place among those after, and one only.
    let (mut seen, mut is_once) = (0u32, true);
    for &p in &before.as_flattened()[..ring.len()] {
        let places = places_of(p, &after);
        seen |= places;
        is_once &= places & places.wrapping_sub(1) == 0;
    }
    is_once && seen.count_ones() as usize == ring.len()
}

/// Where `point` is among `points`: a bit for each place.
fn places_of<const N: usize>(point: u32, points: &[u32x8; N]) -> u32 {
    points.iter().rev().fold(0, |places, eight| places << 8 | eight.simd_eq(u32x8::splat(point)).to_bitmask())
}

/// All edges into `edges`, in the order of faces, those between irregular points last.
///
/// Between other points an edge has two faces of opposite directions: the one in which it runs upwards names it.
pub(crate) fn recollect_edges(surface: &Surface, irregular: &Irregular, edges: &mut Vec<Edge>) {
    const CHUNK: usize = 16384;
    // Fewer fit the caches of one thread.
    const MANY: usize = 6 * CHUNK;
    edges.clear();
    edges.reserve_exact(surface.face_count() * 3 / 2 + 64);
    let faces = surface.face_slots();
    if faces <= MANY {
        regular_edges(surface, irregular, 0..faces, edges);
    } else {
        let chunks: Vec<Vec<Edge>> = (0..faces.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut edges = Vec::with_capacity(3 * CHUNK / 2 + 64);
                regular_edges(surface, irregular, chunk * CHUNK..((chunk + 1) * CHUNK).min(faces), &mut edges);
                edges
            })
            .collect();
        edges.reserve_exact(chunks.iter().map(Vec::len).sum());
        chunks.iter().for_each(|chunk| edges.extend_from_slice(chunk));
    }
    for a in irregular.points() {
        edges_at(surface, a, |b| b > a && irregular.0[b as usize], |edge, _| edges.push(edge));
    }
}

fn regular_edges(surface: &Surface, irregular: &Irregular, faces: std::ops::Range<usize>, edges: &mut Vec<Edge>) {
    // Which way edges run cannot be foretold: all are written down, and those that run downwards written over.
    const BLOCK: usize = 64;
    let mut block = [Edge { a: 0, b: 0, kind: EdgeKind::default() }; 3 * BLOCK + 1];
    for start in faces.clone().step_by(BLOCK) {
        let mut count = 0;
        for f in (start..(start + BLOCK).min(faces.end)).filter(|&f| surface.is_live(f)) {
            let [p, q, r] = surface.face(f);
            for (a, b) in [(p, q), (q, r), (r, p)] {
                block[count] = Edge { a, b, kind: EdgeKind::default() };
                count += usize::from((a < b) & !irregular.are_both(a, b));
            }
        }
        edges.extend_from_slice(&block[..count]);
    }
}

/// The sides of the edge between `a` and `b`, at `a`.
pub(crate) fn sides_of(surface: &Surface, a: u32, b: u32) -> Sides {
    let links = surface.ring(a).iter().map(|&corner| (corner, surface.opposite(corner)));
    links.filter(|(_, link)| link.contains(&b)).map(|(corner, link)| (corner, link[0] == b)).collect()
}

/// The edge between `a` and `b`; `None` if no face has both.
pub(crate) fn find_edge(surface: &Surface, a: u32, b: u32) -> Option<Edge> {
    let sides = sides_of(surface, a, b);
    (!sides.is_empty()).then(|| Edge::between(surface, a, b, &sides))
}

/// Gives the edges at `point` that are not plain, with their sides there.
pub(crate) fn special_edges(surface: &Surface, point: u32, mut give: impl FnMut(&Edge, &[Side])) {
    let give_special = |edge: Edge, sides: &[Side]| {
        if !edge.kind.is_plain() {
            give(&edge, sides);
        }
    };
    edges_at(surface, point, |_| true, give_special);
}

/// Gives the edges from `point` to the points that are `wanted`, with their sides if they are not plain.
fn edges_at(surface: &Surface, point: u32, wanted: impl Fn(u32) -> bool, mut give: impl FnMut(Edge, &[Side])) {
    let ring = surface.ring(point);
    match ring.len() {
        0..=8 => Links::<1>::new(surface, ring).give_edges(surface, point, ring, wanted, give),
        9..=16 => Links::<2>::new(surface, ring).give_edges(surface, point, ring, wanted, give),
        17..=32 => Links::<4>::new(surface, ring).give_edges(surface, point, ring, wanted, give),
        _ => {
            for b in surface.neighbours(point).into_iter().filter(|b| wanted(*b)) {
                let sides = sides_of(surface, point, b);
                give(Edge::between(surface, point, b, &sides), &sides);
            }
        }
    }
}

/// The points after and before the corners of a ring, eight times `N` at most.
struct Links<const N: usize> {
    after: [[u32; 8]; N],
    before: [[u32; 8]; N],
}

impl<const N: usize> Links<N> {
    #[inline]
    fn new(surface: &Surface, ring: &[Corner]) -> Self {
        // Filled up with a name that no point has.
        let mut links = Self { after: [[u32::MAX; 8]; N], before: [[u32::MAX; 8]; N] };
        let places = links.after.as_flattened_mut().iter_mut().zip(links.before.as_flattened_mut());
        for (&corner, (after, before)) in ring.iter().zip(places) {
            [*after, *before] = surface.opposite(corner);
        }
        links
    }

    /// [`edges_at`] `point`, whose ring this is.
    fn give_edges(
        &self,
        surface: &Surface,
        point: u32,
        ring: &[Corner],
        wanted: impl Fn(u32) -> bool,
        mut give: impl FnMut(Edge, &[Side]),
    ) {
        let [after, before] = [self.after, self.before].map(|points| points.map(u32x8::new));
        let [firsts, lasts] = [&self.after, &self.before].map(|points| &points.as_flattened()[..ring.len()]);
        let below = |i: usize| (1u32 << i) - 1;
        let mut give_edge = |b: u32, forward: u32, backward: u32| {
            if forward.is_power_of_two() && backward.is_power_of_two() {
                let [i, j] = [forward, backward].map(|place| place.trailing_zeros() as usize);
                if firsts[j] != lasts[i] && !parts_wedges(surface, ring[i], ring[j]) {
                    return give(Edge { a: point, b, kind: EdgeKind::default() }, &[]);
                }
            }
            let mut sides = Sides::new();
            let mut places = forward | backward;
            while places != 0 {
                let place = places.trailing_zeros();
                sides.push((ring[place as usize], forward >> place & 1 != 0));
                places &= places - 1;
            }
            give(Edge::between(surface, point, b, &sides), &sides);
        };
        for (i, &p) in firsts.iter().enumerate().filter(|(_, p)| wanted(**p)) {
            let forward = places_of(p, &after);
            if forward & below(i) == 0 {
                give_edge(p, forward, places_of(p, &before));
            }
        }
        for (i, &p) in lasts.iter().enumerate().filter(|(_, p)| wanted(**p)) {
            let backward = places_of(p, &before);
            if backward & below(i) == 0 && places_of(p, &after) == 0 {
                give_edge(p, 0, backward);
            }
        }
    }
}

/// Whether two faces have different wedges along the edge from the first one's `corner` to the next; `partner`: the same point's in the second one.
fn parts_wedges(surface: &Surface, corner: Corner, partner: Corner) -> bool {
    let ends = |corner: Corner, side: usize| (surface.wedge_at(corner), surface.opposite_wedges(corner)[side]);
    surface.has_seams() && ends(corner, 0) != ends(partner, 1)
}

/// The properties of the edge between `a` and `b`; `None` if no face has both.
pub(crate) fn edge_kind(surface: &Surface, a: u32, b: u32) -> Option<EdgeKind> {
    find_edge(surface, a, b).map(|edge| edge.kind)
}

/// The properties of an edge of two faces.
#[inline]
fn classify(surface: &Surface, [first, second]: [Side; 2]) -> EdgeKind {
    let mut kind = EdgeKind::default();
    if first.1 == second.1 {
        kind = kind.with(EdgeKind::COMPLEX);
    }
    let third = |side: Side| surface.opposite(side.0)[usize::from(side.1)];
    if third(first) == third(second) {
        kind = kind.with(EdgeKind::FOLD);
    }
    if !surface.has_seams() {
        return kind;
    }
    let wedges = |side: Side| {
        let [next, previous] = surface.opposite_wedges(side.0);
        (surface.wedge_at(side.0), if side.1 { next } else { previous })
    };
    let (w1, w2) = (wedges(first), wedges(second));
    if w1 == w2 {
        return kind;
    }
    if surface.wedges.differ(w1.0, w2.0) || surface.wedges.differ(w1.1, w2.1) {
        kind = kind.with(EdgeKind::SEAM);
        if surface.wedges.group(w1.0) != surface.wedges.group(w2.0) {
            kind = kind.with(EdgeKind::MATERIAL);
        }
        // Two normals an edge are dear: without a seam only faces over the same points are a fold.
        let normal = |side: Side| {
            let [p, q, r] = surface.triangle(Surface::face_of(side.0));
            (q - p).cross(r - p).normalize_or_zero()
        };
        if normal(first).dot(normal(second)) < -0.95 {
            kind = kind.with(EdgeKind::FOLD);
        }
    }
    kind
}
