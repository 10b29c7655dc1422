//! A surface taken apart into smaller ones, over regions of space, and put together again.
//!
//! Every face belongs to one region. So does every point, if all its faces do; the others are on the rims of several regions, and stay where they are
//! as long as the surface is apart.

use super::surface::Surface;
use crate::tasks;
use glam::{DVec3, UVec3};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

/// Most bits of a cell's place along an axis.
const MOST_BITS: u32 = 6;

/// Which points and faces of a surface make up a smaller one. Its own points have the numbers that they have here.
#[derive(Debug, Default)]
pub(crate) struct Region {
    /// First the inner ones, then those of the rim, both in order; [`NOWHERE`] for those that are gone, if the whole is numbered anew.
    pub points: Vec<u32>,
    /// How many of the points are inner ones.
    pub inner: usize,
    /// The wedge of each point; empty if they have the same numbers.
    pub(super) wedges: Vec<u32>,
}

impl Region {
    /// The wedge of each point.
    pub fn wedges(&self) -> &[u32] {
        if self.wedges.is_empty() { &self.points } else { &self.wedges }
    }

    /// `values` of the part's points, with the points of the whole.
    pub fn in_whole<T>(&self, values: impl IntoIterator<Item = T>) -> impl Iterator<Item = (usize, T)> {
        let points = self.points.iter().zip(values);
        points.filter(|(p, _)| **p != NOWHERE).map(|(&p, value)| (p as usize, value))
    }
}

/// A point that is gone.
const NOWHERE: u32 = u32::MAX;

/// Numbers the points that are left, of a whole of `count`, anew, part after part: those that lie together come together. Gives how many there are.
pub(crate) fn renumber<'a>(parts: impl Iterator<Item = (&'a mut Region, &'a Surface)>, count: usize) -> usize {
    // One more than the number; several parts meet at a rim.
    let mut of_rim = vec![0u32; count];
    let mut next = 0;
    for (region, part) in parts {
        for (p, point) in region.points.iter_mut().enumerate() {
            let is_gone = part.ring(p as u32).is_empty();
            let known = if p < region.inner { &mut 0 } else { &mut of_rim[*point as usize] };
            if *known == 0 && !is_gone {
                next += 1;
                *known = next;
            }
            *point = if is_gone { NOWHERE } else { *known - 1 };
        }
    }
    next as usize
}

/// Flags of the `count` points of a whole: what any part has.
pub(crate) fn join_flags<'a>(parts: impl Iterator<Item = (&'a Region, Vec<bool>)>, count: usize) -> Vec<bool> {
    let mut flags = vec![false; count];
    for (region, part) in parts {
        region.in_whole(part).for_each(|(p, is)| flags[p] |= is);
    }
    flags
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
    // The rim is one point wide: the last region has the faces between two.
    let region_of_face = tasks::collect(surface.face_slots(), |f| match surface.is_live(f) {
        true => surface.face(f).map(of).into_iter().fold(0, u16::max),
        false => NONE,
    });
    let region_inside = tasks::collect(surface.points.len(), |p| {
        let (region, ring) = (region_of[p], surface.ring(p as u32));
        let is_inner =
            ring.iter().fold(!ring.is_empty(), |is, &c| is & (region_of_face[Surface::face_of(c)] == region));
        if is_inner { region } else { NONE }
    });
    drop(region_of);
    let (faces, inner) = rayon::join(|| Sorted::new(&region_of_face, count), || Sorted::new(&region_inside, count));
    drop(region_of_face);
    let is_on_rim = |p: u32| region_inside[p as usize] == NONE;
    // Of the inner points: only the task of a region knows of its own.
    let numbers: Vec<AtomicU32> = surface.points.iter().map(|_| AtomicU32::default()).collect();
    let part = |region: usize| {
        for (p, number) in inner.of(region).zip(0..) {
            numbers[p as usize].store(number, Relaxed);
        }
        let corners = faces.of(region).flat_map(|f| surface.face(f as usize));
        let mut rim: Vec<u32> = corners.filter(|p| is_on_rim(*p)).collect();
        rim.sort_unstable();
        rim.dedup();
        let count = inner.count(region);
        let number = |p: u32| match is_on_rim(p) {
            true => (count + rim.partition_point(|&q| q < p)) as u32,
            false => numbers[p as usize].load(Relaxed),
        };
        let mut new_faces = Vec::with_capacity(faces.count(region));
        new_faces.extend(faces.of(region).map(|f| surface.face(f as usize).map(number)));
        let mut points = Vec::with_capacity(count + rim.len());
        points.extend(inner.of(region).chain(rim));
        let wedges = surface.wedges_of(&points);
        let region = Region { points, inner: count, wedges };
        let part = surface.part(&region, new_faces);
        (region, part)
    };
    (0..count).into_par_iter().map(part).unzip()
}

/// The region of what belongs to none.
const NONE: u16 = u16::MAX;

/// What belongs to each region, in order.
struct Sorted(Vec<Chunk>);

/// Some of it, sorted by region: first to last, then what belongs to none.
struct Chunk {
    items: Vec<u32>,
    /// Where each region begins, and the last one ends.
    starts: Vec<u32>,
}

impl Sorted {
    fn new(region_of: &[u16], count: usize) -> Self {
        const CHUNK: usize = 1 << 16;
        let chunks = region_of.par_chunks(CHUNK).enumerate();
        Self(chunks.map(|(chunk, regions)| Chunk::new(regions, (chunk * CHUNK) as u32, count)).collect())
    }

    fn of(&self, region: usize) -> impl Iterator<Item = u32> {
        self.0.iter().flat_map(move |chunk| chunk.of(region)).copied()
    }

    fn count(&self, region: usize) -> usize {
        self.0.iter().map(|chunk| chunk.of(region).len()).sum()
    }
}

impl Chunk {
    /// Of items from `first` on.
    fn new(region_of: &[u16], first: u32, count: usize) -> Self {
        let place = |region: &u16| usize::from(*region).min(count);
        let mut starts = vec![0; count + 2];
        region_of.iter().for_each(|region| starts[place(region) + 1] += 1);
        (1..starts.len()).for_each(|region| starts[region] += starts[region - 1]);
        starts.pop();
        let (mut next, mut items) = (starts.clone(), vec![0; region_of.len()]);
        for (region, item) in region_of.iter().zip(first..) {
            let next = &mut next[place(region)];
            items[*next as usize] = item;
            *next += 1;
        }
        Self { items, starts }
    }

    fn of(&self, region: usize) -> &[u32] {
        &self.items[self.starts[region] as usize..self.starts[region + 1] as usize]
    }
}

/// The region of each point.
fn assign_points(surface: &Surface, count: usize) -> Vec<u16> {
    let points = &surface.points;
    let is_used = |p: &usize| !surface.ring(*p as u32).is_empty();
    let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let bounds = |(low, high): (DVec3, DVec3), (other_low, other_high)| (low.min(other_low), high.max(other_high));
    let used = (0..points.len()).into_par_iter().with_min_len(1 << 14).filter(is_used);
    let (low, high) = used.map(|p| (points[p], points[p])).reduce(|| nowhere, bounds);
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
    cells_of.iter().enumerate().for_each(|(p, cell)| counts[*cell as usize] += u32::from(is_used(&p)));
    let place = |cell: u32| [cell >> (2 * bits), cell >> bits & mask, cell & mask];
    let cells = counts.iter().zip(0..).filter(|(points, _)| **points > 0);
    let cells = cells.map(|(&points, index)| Cell { index, at: place(index), points }).collect();
    let mut region_of = counts;
    assign_cells(cells, 0..count, &mut |cell, region| region_of[cell as usize] = region as u32);
    tasks::collect(points.len(), |p| region_of[cells_of[p] as usize] as u16)
}

struct Cell {
    index: u32,
    at: [u32; 3],
    points: u32,
}

/// Halves the cells, which are in order, across their longest side, again and again.
fn assign_cells(cells: Vec<Cell>, regions: Range<usize>, assign: &mut impl FnMut(u32, usize)) {
    if regions.len() <= 1 {
        cells.iter().for_each(|cell| assign(cell.index, regions.start));
        return;
    }
    let extent = |axis: &usize| {
        let along = || cells.iter().map(|cell| cell.at[*axis]);
        along().max().unwrap_or(0) - along().min().unwrap_or(0)
    };
    let axis = (0..3).max_by_key(extent).unwrap_or(0);
    let half = regions.len() / 2;
    let mut slabs = [0; 1 << MOST_BITS];
    cells.iter().for_each(|cell| slabs[cell.at[axis] as usize] += cell.points as usize);
    let all: usize = slabs.iter().sum();
    let is_less = |points: usize| points * regions.len() < all * half;
    // The slab that the middle is in is taken apart, too.
    let (mut before, mut middle) = (0, 0);
    while is_less(before + slabs[middle]) {
        before += slabs[middle];
        middle += 1;
    }
    let is_first = |cell: &Cell| {
        let is_in_middle = cell.at[axis] as usize == middle;
        let is_first = (cell.at[axis] as usize) < middle || (is_in_middle && is_less(before));
        before += if is_in_middle && is_first { cell.points as usize } else { 0 };
        is_first
    };
    let (first, second): (Vec<Cell>, Vec<Cell>) = cells.into_iter().partition(is_first);
    assign_cells(first, regions.start..regions.start + half, assign);
    assign_cells(second, regions.start + half..regions.end, assign);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::shapes::make_stand_in;
    use glam::Vec3;
    use std::collections::BTreeSet;

    #[test]
    fn what_is_all_of_one_group_may_be_taken_apart() {
        let mesh = make_stand_in(1000);
        let in_group = |group| Surface::new(&Mesh { groups: vec![group; mesh.triangles.len()], ..mesh.clone() });
        assert!(in_group(0).is_bare() && !in_group(1).is_bare());
    }

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
        }
        surface.join(parts.iter().map(|(region, part)| (region, part.clone())), before.points.len());
        assert!(surface.points == before.points);
        let faces = |surface: &Surface| {
            let mut faces: Vec<_> = surface.live_faces().map(|f| surface.face(f)).collect();
            faces.sort_unstable();
            faces
        };
        assert!(faces(&surface) == faces(&before));
    }

    #[test]
    fn what_is_left_is_numbered_anew() {
        let mesh = make_stand_in(12_000);
        let mut surface = Surface::new(&mesh);
        surface.forget_heirs();
        let before = surface.points.len();
        let mut parts = cut(&mut surface, 8);
        // A point of each part goes with its faces.
        for (_, part) in &mut parts {
            part.ring(7).to_vec().into_iter().for_each(|corner| part.remove_face(Surface::face_of(corner)));
        }
        let faces: usize = parts.iter().map(|(_, part)| part.face_count()).sum();
        let (mut regions, parts): (Vec<Region>, Vec<Surface>) = parts.into_iter().unzip();
        let count = renumber(regions.iter_mut().zip(&parts), before);
        assert_eq!(count, before - parts.len());
        surface.join(regions.iter().zip(parts), count);
        assert!((0..count as u32).all(|p| !surface.ring(p).is_empty()));
        let (left, vertices) = surface.to_subset(&mesh);
        assert_eq!((left.triangles.len(), vertices.len()), (faces, count));
        let in_source: BTreeSet<_> = mesh.triangles.iter().map(|&t| place(&mesh, t)).collect();
        assert!(left.triangles.iter().all(|&t| in_source.contains(&place(&left, t))));
        let places = left.positions.iter().zip(surface.to_mesh().positions);
        assert!(places.into_iter().all(|(&p, q)| Vec3::from(p).distance(q.into()) < 1e-6));
    }

    /// Where a triangle is, its least corner first.
    fn place(mesh: &Mesh, triangle: [u32; 3]) -> [[u32; 3]; 3] {
        let [a, b, c] = triangle.map(|v| mesh.positions[v as usize].map(|x| (x + 0.0).to_bits()));
        [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap_or_default()
    }
}
