//! Whole pieces: a shell smaller than the error of the collapses around it goes at once, as no collapse can remove its last faces.

use super::cost::Cost;
use crate::curvature::normal_and_area;
use crate::mesh::surface::Surface;
use glam::DVec3;
use std::mem::replace;

/// A rope is seen for its length: no piece counts less area than this share of its squared diagonal.
const SEEN_SHARE: f64 = 0.1;

/// 2³² over the golden ratio, an odd number: its multiples lie far apart.
const GOLDEN: u32 = 0x9e37_79b9;

/// A connected piece of the surface.
#[derive(Debug, Clone)]
pub(crate) struct Piece {
    /// Its faces in order.
    pub faces: Vec<u32>,
    /// Cost of losing it, comparable with a collapse: all of it is off by about its own size.
    pub cost: f64,
}

/// Whether there is more than one connected piece.
pub(crate) fn are_there_pieces(surface: &Surface) -> bool {
    let points = surface.points.len() as u32;
    let Some(first) = (0..points).find(|&p| !surface.ring(p).is_empty()) else { return false };
    let mut is_reached = vec![false; points as usize];
    is_reached[first as usize] = true;
    // All that are met are written down, and those that were reached before written over: which ones cannot be foretold.
    let mut reached = vec![first; points as usize + 1];
    let (mut next, mut count) = (0, 1);
    while next < count {
        for &corner in surface.ring(reached[next]) {
            // From each point of a face to the one after it: that way all are met.
            let [point, _] = surface.opposite(corner);
            reached[count] = point;
            count += usize::from(!replace(&mut is_reached[point as usize], true));
        }
        next += 1;
    }
    (first..points).any(|p| !is_reached[p as usize] && !surface.ring(p).is_empty())
}

/// The connected pieces, cheapest first, without the dearest: that one stays.
pub(crate) fn pieces(surface: &Surface, cost: &dyn Cost) -> Vec<Piece> {
    let mut pieces = split_pieces(surface, cost);
    // Of equal ones neighbours in the order of faces are mostly neighbours in space: they must not go one after the other.
    let scattered = |piece: &Piece| piece.faces.first().map_or(0, |f| f.wrapping_mul(GOLDEN));
    pieces.sort_by(|a, b| a.cost.total_cmp(&b.cost).then(scattered(a).cmp(&scattered(b))));
    pieces.pop();
    pieces
}

/// Whether so many faces may go that a piece may be removed, of which some may be gone already.
pub(crate) fn may_remove(surface: &Surface, piece: &Piece, most: usize) -> bool {
    let left = piece.faces.iter().filter(|f| surface.is_live(**f as usize)).count();
    0 < left && 0 < most && left <= most + 1
}

/// Removes what is left of a piece that [may be removed](may_remove); gives the faces removed, at most `most`.
pub(crate) fn remove(surface: &mut Surface, piece: &Piece, most: usize) -> usize {
    if !may_remove(surface, piece, most) {
        return 0;
    }
    let before = surface.face_count();
    for &face in &piece.faces {
        if surface.is_live(face as usize) {
            surface.remove_face(face as usize);
        }
    }
    (before - surface.face_count()).min(most)
}

fn split_pieces(surface: &Surface, cost: &dyn Cost) -> Vec<Piece> {
    let weigh = |Part { faces, area, low, high }: Part| {
        let square = low.distance_squared(high);
        let mut points = faces.iter().flat_map(|&f| surface.face(f as usize));
        let emphasis = cost.emphasis(&mut points, square);
        Piece { cost: emphasis * cost.weigh(area.max(SEEN_SHARE * square), square), faces }
    };
    find_parts(surface).into_iter().map(weigh).collect()
}

/// Faces that hang together.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    /// In order.
    pub faces: Vec<u32>,
    pub area: f64,
    /// Corners of the bounding box.
    pub low: DVec3,
    pub high: DVec3,
}

/// The connected parts of the surface, in the order of their first faces.
pub(crate) fn find_parts(surface: &Surface) -> Vec<Part> {
    let mut parent = join_faces(surface);
    let mut index = vec![u32::MAX; surface.points.len()];
    let mut parts: Vec<Part> = Vec::new();
    for f in surface.live_faces() {
        let root = find(&mut parent, surface.face(f)[0]) as usize;
        if index[root] == u32::MAX {
            index[root] = parts.len() as u32;
            parts.push(Part { faces: Vec::new(), area: 0.0, low: DVec3::INFINITY, high: DVec3::NEG_INFINITY });
        }
        let part = &mut parts[index[root] as usize];
        part.faces.push(f as u32);
        let triangle = surface.triangle(f);
        part.area += normal_and_area(triangle).1;
        for p in triangle {
            part.low = part.low.min(p);
            part.high = part.high.max(p);
        }
    }
    parts
}

/// A forest of points with one tree for each piece.
fn join_faces(surface: &Surface) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..surface.points.len() as u32).collect();
    for f in surface.live_faces() {
        let [a, b, c] = surface.face(f);
        let [pa, pb, pc] = [a, b, c].map(|p| parent[p as usize]);
        if pa != pb || pa != pc {
            join(&mut parent, a, b);
            join(&mut parent, a, c);
        }
    }
    parent
}

fn find(parent: &mut [u32], mut p: u32) -> u32 {
    while parent[p as usize] != p {
        parent[p as usize] = parent[parent[p as usize] as usize];
        p = parent[p as usize];
    }
    p
}

fn join(parent: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(parent, a), find(parent, b));
    // The smaller id wins, so that the roots do not depend on the order of joins.
    parent[a.max(b) as usize] = a.min(b);
}
