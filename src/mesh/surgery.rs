//! Every edit of a surface's topology: collapse, split, removal. Wedges stay consistent with points.

use super::surface::{Corner, Surface};
use glam::DVec3;
use smallvec::SmallVec;

/// Pairs of wedges, one at either end of an edge.
pub(crate) type Pairs = SmallVec<[(u32, u32); 4]>;

/// What collapsing an edge would do: which faces go, which stay around the joined point, which wedges become one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Merge {
    /// Stays and moves.
    pub kept: u32,
    /// Becomes `kept`.
    pub gone: u32,
    /// The points across the edge, the third ones of the faces that have both, and their corners there.
    pub across: SmallVec<[(u32, Corner); 4]>,
    /// Pairs (wedge that stays, wedge that becomes it) that the faces join, each once. Those at `kept` stay.
    pub pairs: Pairs,
    /// See [`Self::spokes`] and [`Self::rims`]; only the first `count` mean anything.
    spokes: Vec<Corner>,
    rims: Vec<[u32; 2]>,
    count: usize,
    /// Where those at `gone` begin.
    from_gone: usize,
}

impl Merge {
    /// Looks at the edge from `kept` to `gone`.
    pub fn new(surface: &Surface, kept: u32, gone: u32) -> Self {
        let mut merge = Self::default();
        merge.look(surface, kept, gone);
        merge
    }

    /// Looks at another edge.
    pub fn look(&mut self, surface: &Surface, kept: u32, gone: u32) {
        (self.kept, self.gone) = (kept, gone);
        self.across.clear();
        self.pairs.clear();
        let rings = [surface.ring(kept), surface.ring(gone)];
        let most = rings[0].len() + rings[1].len();
        if self.spokes.len() < most {
            self.spokes.resize(most, 0);
            self.rims.resize(most, [0; 2]);
        }
        let (spokes, rims) = (&mut self.spokes[..most], &mut self.rims[..most]);
        let mut count = 0;
        for corners in rings[0].chunks(32) {
            // Which corners are at faces of the edge cannot be foretold: all are written down, and those that are not wanted written over.
            let mut shared = 0u32;
            for (i, &corner) in corners.iter().enumerate() {
                let rim = surface.opposite(corner);
                (spokes[count], rims[count]) = (corner, rim);
                let is_shared = (rim[0] == gone) | (rim[1] == gone);
                shared |= u32::from(is_shared) << i;
                count += usize::from(!is_shared);
            }
            while shared != 0 {
                let corner = corners[shared.trailing_zeros() as usize];
                let rim = surface.opposite(corner);
                let third = usize::from(rim[0] == gone);
                self.across.push((rim[third], Surface::corners_opposite(corner)[third]));
                shared &= shared - 1;
            }
        }
        self.from_gone = count;
        for &corner in rings[1] {
            let rim = surface.opposite(corner);
            (spokes[count], rims[count]) = (corner, rim);
            count += usize::from((rim[0] != kept) & (rim[1] != kept));
        }
        self.count = count;
        // Without seams all faces join the same pair.
        let joining = if surface.has_seams() { &self.across[..] } else { &self.across[..self.across.len().min(1)] };
        for &(_, across) in joining {
            let (points, wedges) = (surface.opposite(across), surface.opposite_wedges(across));
            let pair = if points[0] == kept { (wedges[0], wedges[1]) } else { (wedges[1], wedges[0]) };
            if !self.pairs.contains(&pair) {
                self.pairs.push(pair);
            }
        }
    }

    /// Faces that have both points.
    pub fn faces(&self) -> impl ExactSizeIterator<Item = usize> {
        self.across.iter().map(|&(_, corner)| Surface::face_of(corner))
    }

    /// Corners at either end whose faces survive: the ring of the joined point. Those at `kept` come first.
    pub fn spokes(&self) -> &[Corner] {
        &self.spokes[..self.count]
    }

    /// The points after each spoke in its face ([`Surface::opposite`]).
    pub fn rims(&self) -> &[[u32; 2]] {
        &self.rims[..self.count]
    }

    /// The first of each rim: in closed rings all points around the joined one, each once.
    pub fn firsts(&self) -> impl Iterator<Item = u32> {
        self.rims().iter().map(|rim| rim[0])
    }

    /// The points around the joined point, each once.
    pub fn around(&self, points: &mut Vec<u32>) {
        points.clear();
        for p in self.firsts().chain(self.rims().iter().map(|rim| rim[1])) {
            if !holds(points, p) {
                points.push(p);
            }
        }
    }

    /// Whether the collapse of an edge between two regular points keeps the link condition.
    pub fn keeps_regular(&self) -> bool {
        // Each rim goes from one of the points across the edge to the other: what they share beyond those is among the first points.
        let (near, far) = self.rims().split_at(self.from_gone);
        let is_near = |p: u32| near.iter().fold(false, |found, rim| found | (rim[0] == p));
        // With one face at either end both would lie on each other (the tetrahedron).
        self.across.len() == 2 && self.count > 2 && !far.iter().any(|rim| is_near(rim[0]))
    }

    /// Whether every wedge has one partner at most: otherwise a seam ends in this edge and would be torn into the surface.
    pub fn keeps_seams(&self, surface: &Surface) -> bool {
        let (pairs, wedges) = (&self.pairs, &surface.wedges);
        let torn = |p: &(u32, u32), q: &(u32, u32)| {
            (p.0 == q.0 && wedges.differ(p.1, q.1)) || (p.1 == q.1 && wedges.differ(p.0, q.0))
        };
        (1..pairs.len()).all(|i| pairs[..i].iter().all(|p| !torn(p, &pairs[i])))
    }

    /// Pairs up the wedges that would have to go without a partner: with the partner of one that looks the same, or else, if `lossy`, with the one at the
    /// other end that looks most alike in the same group. Gives whether none is left over.
    pub fn pair_up(&mut self, surface: &Surface, lossy: bool) -> bool {
        if !surface.has_seams() {
            return !self.pairs.is_empty();
        }
        let wedges = &surface.wedges;
        for i in 0..self.spokes_of_gone().len() {
            let wedge = surface.wedge_at(self.spokes_of_gone()[i]);
            if self.pairs.iter().any(|pair| pair.1 == wedge) {
                continue;
            }
            let alike = self.pairs.iter().find(|pair| !wedges.differ(pair.1, wedge)).map(|pair| pair.0);
            let Some(stays) = alike.or_else(|| if lossy { self.find_most_alike(surface, wedge) } else { None }) else {
                return false;
            };
            self.pairs.push((stays, wedge));
        }
        true
    }

    fn find_most_alike(&self, surface: &Surface, wedge: u32) -> Option<u32> {
        let wedges = &surface.wedges;
        let ring = surface.ring(self.kept);
        let same_group = ring.iter().map(|&c| surface.wedge_at(c)).filter(|&w| wedges.group(w) == wedges.group(wedge));
        let distance = |w: &u32| wedges.distance_squared(*w, wedge);
        same_group.min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)))
    }

    /// The wedge that `wedge` becomes; itself if no face joins it to one.
    pub fn target(&self, wedge: u32) -> u32 {
        self.pairs.iter().find(|p| p.1 == wedge).map_or(wedge, |p| p.0)
    }

    /// Corners at `kept` whose faces survive.
    pub fn spokes_of_kept(&self) -> &[Corner] {
        &self.spokes[..self.from_gone]
    }

    /// Corners at `gone` whose faces survive.
    pub fn spokes_of_gone(&self) -> &[Corner] {
        &self.spokes()[self.from_gone..]
    }

    /// Does it; the joined point moves to `position`. Wedge values are the caller's business.
    pub fn apply(&self, surface: &mut Surface, position: DVec3) {
        surface.collapse(self, position);
    }
}

/// Pairs (wedge at `a`, wedge at `b`) that the faces of an edge join, each once.
pub(crate) fn pair_wedges(surface: &Surface, a: u32, b: u32) -> Pairs {
    let mut pairs = Pairs::new();
    for &corner in surface.ring(a) {
        let points = surface.opposite(corner);
        if points.contains(&b) {
            let pair = (surface.wedge_at(corner), surface.opposite_wedges(corner)[usize::from(points[1] == b)]);
            if !pairs.contains(&pair) {
                pairs.push(pair);
            }
        }
    }
    pairs
}

/// Whether `point` is among `points`: a handful, so that comparing with all of them is faster than leaving early.
pub(crate) fn holds(points: &[u32], point: u32) -> bool {
    points.iter().fold(false, |found, &p| found | (p == point))
}

/// Turns the edge between `a` and `b`: `first`, which runs from `a` to `b`, and `second`, which runs back, share the other diagonal of their diamond
/// then. The edge must be plain; each face keeps its id.
pub(crate) fn flip_edge(surface: &mut Surface, first: usize, second: usize, a: u32, b: u32) {
    let place = |face: usize, p: u32| surface.face(face).iter().position(|&q| q == p);
    let (Some(b1), Some(a2)) = (place(first, b), place(second, a)) else { return };
    let (p1, w1) = (surface.face(first), surface.face_wedges(first));
    let (p2, w2) = (surface.face(second), surface.face_wedges(second));
    let (c, d) = ((b1 + 1) % 3, (a2 + 1) % 3);
    surface.replace_corner(first, b1, p2[d], w2[d]);
    surface.replace_corner(second, a2, p1[c], w1[c]);
}

/// Splits the edge between `a` and `b` at `position`: every face with both becomes two. The new wedges are copies of those at `a`; the pairs
/// (new wedge, wedge at `a`, wedge at `b`) are returned for the caller to fill, with the new point.
pub(crate) fn split_edge(surface: &mut Surface, a: u32, b: u32, position: DVec3) -> (u32, SmallVec<[[u32; 3]; 4]>) {
    let merge = Merge::new(surface, a, b);
    let middle = surface.add_point(position);
    let mut made: SmallVec<[[u32; 3]; 4]> = SmallVec::new();
    for &(wa, wb) in &merge.pairs {
        made.push([surface.wedges.duplicate(wa), wa, wb]);
    }
    for face in merge.faces() {
        let (points, wedges) = (surface.face(face), surface.face_wedges(face));
        let (Some(ka), Some(kb)) = (points.iter().position(|&p| p == a), points.iter().position(|&p| p == b)) else {
            continue;
        };
        let Some(new) = made.iter().find(|m| m[1] == wedges[ka] && m[2] == wedges[kb]).map(|m| m[0]) else { continue };
        surface.remove_face(face);
        for replaced in [kb, ka] {
            let (mut p, mut w) = (points, wedges);
            p[replaced] = middle;
            w[replaced] = new;
            surface.add_face(p, w);
        }
    }
    (middle, made)
}
