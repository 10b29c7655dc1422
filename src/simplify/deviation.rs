//! A quick two-sided distance to the source, for decisions on the way: which variant of a level is nearer, whether an error target holds.
//!
//! Both ways from vertices and places inside faces, from edge midpoints of the level, too. The ruler in `measure` says what is reported.

use super::refine::spread;
use crate::bvh::{Bvh, Hit};
use crate::mesh::Mesh;
use glam::DVec3;

/// Places on a surface beyond one a face: fewer say little about large faces.
const MORE_PLACES: f64 = 1000.0;
/// Points of the source of either kind that are asked, at most.
const MOST_OF_SOURCE: usize = 10_000;

/// The source, ready for asking.
pub(crate) struct Deviation {
    tree: Bvh,
    samples: Samples,
}

/// Largest and root mean square distance, object units.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Distance {
    pub max: f64,
    pub rms: f64,
}

/// Points of a surface.
struct Samples {
    /// Where the largest distance may be.
    ends: Vec<DVec3>,
    /// Inside faces, and how much area each stands for.
    places: Vec<DVec3>,
    areas: Vec<f64>,
}

impl Deviation {
    pub fn new(source: &Mesh) -> Self {
        let Samples { ends, places, areas } = Samples::of(source);
        let samples = Samples { ends: thin_out(ends), places: thin_out(places), areas: thin_out(areas) };
        Self { tree: grow_tree(source), samples }
    }

    /// Distance between the source and `level`, both ways.
    pub fn of(&self, level: &Mesh) -> Distance {
        let mut samples = Samples::of(level);
        let middles = corners(level).flat_map(|[a, b, c]| [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5]);
        samples.ends.extend(middles);
        let (back, forth) = (samples.distance_to(&self.tree), self.samples.distance_to(&grow_tree(level)));
        Distance { max: back.max.max(forth.max), rms: ((back.rms.powi(2) + forth.rms.powi(2)) * 0.5).sqrt() }
    }
}

impl Distance {
    /// Whether this is the smaller of two distances, the largest one and the mean taken together.
    pub fn is_nearer_than(&self, other: &Self) -> bool {
        let both = |distance: &Self| distance.rms.powi(2) * distance.max;
        both(self) < both(other)
    }
}

impl Samples {
    fn of(mesh: &Mesh) -> Self {
        let mut is_used = vec![false; mesh.positions.len()];
        mesh.triangles.iter().flatten().for_each(|&v| is_used[v as usize] = true);
        let ends = (0..is_used.len()).filter(|&v| is_used[v]).map(|v| position(mesh, v as u32)).collect();
        let area = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length() * 0.5;
        let total: f64 = corners(mesh).map(area).sum();
        let (mut places, mut areas) = (Vec::with_capacity(mesh.triangles.len()), Vec::new());
        for [a, b, c] in corners(mesh) {
            let area = area([a, b, c]);
            let count = 1 + (area / total * MORE_PLACES) as usize;
            let next = places.len() as u32;
            places.extend((next..next + count as u32).map(|k| {
                let [v, w] = spread(k).map(f64::from);
                a + (b - a) * v + (c - a) * w
            }));
            areas.resize(places.len(), area / count as f64);
        }
        Self { ends, places, areas }
    }

    fn distance_to(&self, tree: &Bvh) -> Distance {
        let hits = tree.closest_to_each(&self.places);
        let squares: f64 = hits.iter().zip(&self.areas).map(|(hit, area)| hit.distance_squared * area).sum();
        let area: f64 = self.areas.iter().sum();
        let of_places = hits.iter().map(Hit::distance).fold(0.0, f64::max);
        Distance {
            max: tree.largest_distance(&self.ends, of_places),
            rms: if area > 0.0 { (squares / area).sqrt() } else { 0.0 },
        }
    }
}

fn thin_out<T>(items: Vec<T>) -> Vec<T> {
    let step = items.len().div_ceil(MOST_OF_SOURCE).max(1);
    items.into_iter().step_by(step).collect()
}

fn grow_tree(mesh: &Mesh) -> Bvh {
    Bvh::new(&mesh.positions, &mesh.triangles)
}

fn corners(mesh: &Mesh) -> impl Iterator<Item = [DVec3; 3]> {
    mesh.triangles.iter().map(|triangle| triangle.map(|v| position(mesh, v)))
}

fn position(mesh: &Mesh, vertex: u32) -> DVec3 {
    DVec3::from(mesh.positions[vertex as usize].map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::make_stand_in;

    #[test]
    fn a_shifted_copy_is_as_far_as_it_was_shifted() {
        let positions = vec![[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];
        let shifted = positions.iter().map(|[x, y, _]| [*x, *y, 0.25]).collect();
        let mesh = |positions| Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let distance = Deviation::new(&mesh(positions)).of(&mesh(shifted));
        assert!((distance.max - 0.25).abs() < 1e-12 && (distance.rms - 0.25).abs() < 1e-12, "{distance:?}");
    }

    #[test]
    fn the_mean_goes_by_area() {
        // A large square in place and a small one, a hundredth of its area, that is one off.
        let square = |side: f32, x: f32, z: f32| [[x, 0.0, z], [x + side, 0.0, z], [x + side, side, z], [x, side, z]];
        let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let mesh = |z: f32| Mesh {
            positions: [square(10.0, 0.0, 0.0), square(1.0, 100.0, z)].concat(),
            triangles: triangles.clone(),
            ..Mesh::default()
        };
        let distance = Deviation::new(&mesh(0.0)).of(&mesh(1.0));
        assert!((distance.rms - (1.0f64 / 101.0).sqrt()).abs() < 1e-9, "{distance:?}");
        assert_eq!(distance.max, 1.0);
    }

    #[test]
    fn the_source_is_nowhere_off() {
        let mesh = make_stand_in(700);
        let distance = Deviation::new(&mesh).of(&mesh);
        assert!(distance.max < 1e-12 && !distance.is_nearer_than(&distance));
    }
}
