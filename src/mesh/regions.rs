//! A surface taken apart into smaller ones, over regions of space, and put together again.
//!
//! Every face belongs to one region. So does every point, if all its faces do; the others are on the rims of several regions, and stay where they are
//! as long as the surface is apart.

use super::surface::Surface;
use crate::tasks;
use glam::{DVec3, UVec3};
use rayon::prelude::*;

/// Most bits of a cell's place along an axis.
const MOST_BITS: u32 = 6;

/// Which points and faces of a surface make up a smaller one. Its own points have the numbers that they have here.
#[derive(Debug, Default)]
pub(crate) struct Region {
    /// First the inner ones, then those of the rim, both in order.
    pub points: Vec<u32>,
    /// How many of the points are inner ones.
    pub inner: usize,
    /// The wedge of each point; empty if they have the same numbers.
    pub(super) wedges: Vec<u32>,
    faces: Vec<u32>,
}

impl Region {
    /// The wedge of each point.
    pub fn wedges(&self) -> &[u32] {
        if self.wedges.is_empty() { &self.points } else { &self.wedges }
    }
}

/// Takes a surface apart, which is empty then: into `count` regions of about as many points each.
pub(crate) fn cut(surface: &mut Surface, count: usize) -> Vec<(Region, Surface)> {
    let (regions, parts) = copy_parts(surface, count);
    surface.drop_points_and_faces();
    regions.into_iter().zip(parts).collect()
}

fn copy_parts(surface: &Surface, count: usize) -> (Vec<Region>, Vec<Surface>) {
    let region_of = assign_points(surface, count);
    let of = |p: u32| region_of[p as usize];
    let mut regions: Vec<Region> = (0..count).map(|_| Region::default()).collect();
    let mut on_rim = vec![false; surface.points.len()];
    for f in surface.live_faces() {
        let face = surface.face(f);
        let [a, b, c] = face.map(of);
        // The rim is one point wide: the last region has the faces between two.
        let region = a.max(b).max(c);
        regions[region as usize].faces.push(f as u32);
        for p in face {
            on_rim[p as usize] |= of(p) != region;
        }
    }
    let mut numbers = vec![0; surface.points.len()];
    for p in (0..surface.points.len() as u32).filter(|&p| !on_rim[p as usize] && !surface.ring(p).is_empty()) {
        let points = &mut regions[of(p) as usize].points;
        numbers[p as usize] = points.len() as u32;
        points.push(p);
    }
    let parts = regions.par_iter_mut().map(|region| {
        region.inner = region.points.len();
        let corners = region.faces.iter().flat_map(|&f| surface.face(f as usize));
        let mut rim: Vec<u32> = corners.filter(|&p| on_rim[p as usize]).collect();
        rim.sort_unstable();
        rim.dedup();
        let number = |p: u32| match on_rim[p as usize] {
            true => region.inner as u32 + rim.partition_point(|&q| q < p) as u32,
            false => numbers[p as usize],
        };
        let faces = region.faces.iter().map(|&f| surface.face(f as usize).map(number)).collect();
        region.faces = Vec::new();
        region.points.extend_from_slice(&rim);
        region.wedges = surface.wedges_of(&region.points);
        surface.part(region, faces)
    });
    let parts = parts.collect();
    (regions, parts)
}

/// The region of each point.
fn assign_points(surface: &Surface, count: usize) -> Vec<u16> {
    let points = &surface.points;
    let used = || (0..points.len()).filter(|&p| !surface.ring(p as u32).is_empty());
    let bounds = |(low, high): (DVec3, DVec3), p: usize| (low.min(points[p]), high.max(points[p]));
    let (low, high) = used().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), bounds);
    // A surface meets about as many cells as it has points for every sixteenth of them.
    let bits = ((points.len() as f64).log2() / 2.0 - 2.0).clamp(2.0, f64::from(MOST_BITS)) as u32;
    let scale = f64::from(1 << bits) * (1.0 - 1e-9) / (high - low).max_element().max(f64::MIN_POSITIVE);
    let mask = (1 << bits) - 1;
    let cell_of = |p: DVec3| {
        // Points that are gone may be anywhere.
        let at = ((p - low) * scale).as_uvec3().min(UVec3::splat(mask));
        (at.x << bits | at.y) << bits | at.z
    };
    let cells_of = tasks::collect(points.len(), |p| cell_of(points[p]));
    let mut counts = vec![0u32; 1 << (3 * bits)];
    used().for_each(|p| counts[cells_of[p] as usize] += 1);
    let place = |cell: usize| {
        let cell = cell as u32;
        UVec3::new(cell >> (2 * bits), cell >> bits & mask, cell & mask)
    };
    let mut cells: Vec<Cell> = (0..counts.len())
        .filter(|&cell| counts[cell] > 0)
        .map(|cell| Cell { index: cell, at: place(cell).to_array(), points: counts[cell] })
        .collect();
    let mut region_of = counts;
    assign_cells(&mut cells, 0..count, &mut |cell, region| region_of[cell] = region as u32);
    cells_of.into_iter().map(|cell| region_of[cell as usize] as u16).collect()
}

struct Cell {
    index: usize,
    at: [u32; 3],
    points: u32,
}

/// Halves the cells across their longest side, again and again.
fn assign_cells(cells: &mut [Cell], regions: std::ops::Range<usize>, assign: &mut impl FnMut(usize, usize)) {
    if regions.len() <= 1 {
        cells.iter().for_each(|cell| assign(cell.index, regions.start));
        return;
    }
    let extent = |axis: &usize| {
        let along = || cells.iter().map(|cell| cell.at[*axis]);
        along().max().unwrap_or(0) - along().min().unwrap_or(0)
    };
    let axis = (0..3).max_by_key(extent).unwrap_or(0);
    cells.sort_unstable_by_key(|cell| (cell.at[axis], cell.index));
    let half = regions.len() / 2;
    let all: usize = cells.iter().map(|cell| cell.points as usize).sum();
    let (mut before, mut middle) = (0, 0);
    while middle < cells.len() && before * regions.len() < all * half {
        before += cells[middle].points as usize;
        middle += 1;
    }
    let (first, second) = cells.split_at_mut(middle);
    assign_cells(first, regions.start..regions.start + half, assign);
    assign_cells(second, regions.start + half..regions.end, assign);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::make_stand_in;

    #[test]
    fn parts_make_the_whole_again() {
        let mesh = make_stand_in(12_000);
        let mut surface = Surface::new(&mesh);
        let before = surface.clone();
        let parts = cut(&mut surface, 8);
        for (region, part) in &parts {
            assert!((1000..2000).contains(&part.face_count()), "{} faces of 12 000 in one of 8", part.face_count());
            for (p, &point) in region.points.iter().enumerate() {
                let has_all = part.ring(p as u32).len() == before.ring(point).len();
                assert!(has_all || p >= region.inner, "point {point}");
            }
            let rim = region.points.len() - region.inner;
            assert!(rim * 3 < region.points.len(), "{rim} of {} points on the rim", region.points.len());
            surface.append(part, region, before.points.len());
        }
        surface.close();
        assert!(surface.points == before.points);
        let faces = |surface: &Surface| {
            let mut faces: Vec<_> = surface.live_faces().map(|f| surface.face(f)).collect();
            faces.sort_unstable();
            faces
        };
        assert!(faces(&surface) == faces(&before));
    }
}
