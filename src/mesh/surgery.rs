//! Every edit of a surface's topology: collapse, split, removal. Wedges stay consistent with points.

use super::surface::{Corner, Surface};
use glam::DVec3;
use smallvec::SmallVec;

/// What collapsing an edge would do: which faces go, which wedges become one.
#[derive(Debug, Clone)]
pub(crate) struct Merge {
    /// Stays and moves.
    pub kept: u32,
    /// Becomes `kept`.
    pub gone: u32,
    /// Faces that have both points.
    pub faces: SmallVec<[usize; 4]>,
    /// Pairs (wedge at `kept`, wedge at `gone`) that the faces join, each once.
    pub pairs: SmallVec<[(u32, u32); 4]>,
}

impl Merge {
    /// Looks at the edge from `kept` to `gone`.
    pub fn new(surface: &Surface, kept: u32, gone: u32) -> Self {
        let mut merge = Self { kept, gone, faces: SmallVec::new(), pairs: SmallVec::new() };
        for &corner in surface.ring(kept) {
            let points = surface.opposite(corner);
            let Some(side) = points.iter().position(|&p| p == gone) else { continue };
            merge.faces.push(Surface::face_of(corner));
            let pair = (surface.wedge_at(corner), surface.opposite_wedges(corner)[side]);
            if !merge.pairs.contains(&pair) {
                merge.pairs.push(pair);
            }
        }
        merge
    }

    /// Whether every wedge has one partner at most: otherwise a seam ends in this edge and would be torn into the surface.
    pub fn keeps_seams(&self, surface: &Surface) -> bool {
        let (pairs, wedges) = (&self.pairs, &surface.wedges);
        let torn = |p: &(u32, u32), q: &(u32, u32)| {
            (p.0 == q.0 && wedges.differ(p.1, q.1)) || (p.1 == q.1 && wedges.differ(p.0, q.0))
        };
        (1..pairs.len()).all(|i| pairs[..i].iter().all(|p| !torn(p, &pairs[i])))
    }

    /// The wedge at `kept` that `wedge` (at `gone`) becomes; itself if no face joins it to one.
    pub fn target(&self, wedge: u32) -> u32 {
        self.pairs.iter().find(|p| p.1 == wedge).map_or(wedge, |p| p.0)
    }

    /// Corners at either end, those of the edge's own faces once (at `kept`).
    pub fn corners<'a>(&'a self, surface: &'a Surface) -> impl Iterator<Item = Corner> + 'a {
        let far = surface.ring(self.gone).iter().filter(|&&c| !self.faces.contains(&Surface::face_of(c)));
        surface.ring(self.kept).iter().chain(far).copied()
    }

    /// Corners at either end whose faces survive.
    pub fn surviving<'a>(&'a self, surface: &'a Surface) -> impl Iterator<Item = Corner> + 'a {
        self.corners(surface).filter(|&c| !self.faces.contains(&Surface::face_of(c)))
    }

    /// Does it; the joined point moves to `position`. Wedge values are the caller's business.
    pub fn apply(&self, surface: &mut Surface, position: DVec3) {
        for &face in &self.faces {
            surface.remove_face(face);
        }
        surface.map_wedges(self.gone, |w| self.target(w));
        surface.join_points(self.kept, self.gone);
        surface.points[self.kept as usize] = position;
    }
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

/// Puts a point into a face, which becomes three: those of its edges 0, 1 and 2. The new wedge is a copy of the first; given with the new point for
/// the caller to fill.
pub(crate) fn split_face(surface: &mut Surface, face: usize, position: DVec3) -> (u32, u32) {
    let (points, wedges) = (surface.face(face), surface.face_wedges(face));
    let middle = surface.add_point(position);
    let wedge = surface.wedges.duplicate(wedges[0]);
    surface.remove_face(face);
    for k in 0..3 {
        surface.add_face([points[k], points[(k + 1) % 3], middle], [wedges[k], wedges[(k + 1) % 3], wedge]);
    }
    (middle, wedge)
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
    for &face in &merge.faces {
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
