//! A quick two-sided distance to the source, for decisions on the way: which variant of a level is nearer, whether an error target holds.
//!
//! Both ways from vertices and places inside faces, from edge midpoints of the level, too. The ruler in `measure` says what is reported.

use super::refine::spread;
use crate::bvh::Bvh;
use crate::mesh::Mesh;
use glam::DVec3;

/// Places on a surface beyond one a face, by area: fewer say little about large faces.
const PLACES: f64 = 1000.0;
/// And then by how much of the distance was found on each face: what is off may be off on few.
const PLACES_WHERE_OFF: f64 = 2000.0;
/// Vertices, and faces, of the source that are asked, at most.
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

/// What of a surface is asked for its distance.
struct Samples {
    /// Where the largest distance may be.
    ends: Vec<DVec3>,
    faces: Vec<Face>,
}

struct Face {
    corners: [DVec3; 3],
    area: f64,
}

/// What was found on a face.
#[derive(Clone, Copy, Default)]
struct Found {
    places: usize,
    /// Sum of the squared distances.
    squares: f64,
}

impl Deviation {
    pub fn new(source: &Mesh) -> Self {
        let Samples { ends, faces } = Samples::of(source);
        Self { tree: grow_tree(source), samples: Samples { ends: thin_out(ends), faces: thin_out(faces) } }
    }

    /// Distance between the source and `level`, both ways.
    pub fn of(&self, level: &Mesh) -> Distance {
        let mut samples = Samples::of(level);
        let middles = |face: &Face| {
            let [a, b, c] = face.corners;
            [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5]
        };
        samples.ends.extend(samples.faces.iter().flat_map(middles));
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
        let position = |vertex: u32| DVec3::from(mesh.positions[vertex as usize].map(f64::from));
        let mut is_used = vec![false; mesh.positions.len()];
        mesh.triangles.iter().flatten().for_each(|&v| is_used[v as usize] = true);
        let ends = (0..is_used.len()).filter(|&v| is_used[v]).map(|v| position(v as u32)).collect();
        let face = |triangle: &[u32; 3]| {
            let corners @ [a, b, c] = triangle.map(position);
            Face { corners, area: (b - a).cross(c - a).length() * 0.5 }
        };
        Self { ends, faces: mesh.triangles.iter().map(face).collect() }
    }

    fn distance_to(&self, tree: &Bvh) -> Distance {
        let mut found = vec![Found::default(); self.faces.len()];
        let area: f64 = self.faces.iter().map(|face| face.area).sum();
        let evenly = self.faces.iter().map(|face| 1 + (face.area / area * PLACES) as usize).collect();
        let furthest = self.look(tree, evenly, &mut found);
        let sum: f64 = self.squares(&found).sum();
        let where_off = self.squares(&found).map(|square| (square / sum * PLACES_WHERE_OFF) as usize).collect();
        let furthest = furthest.max(self.look(tree, where_off, &mut found));
        let sum: f64 = self.squares(&found).sum();
        Distance {
            max: tree.largest_distance(&self.ends, furthest.sqrt()),
            rms: if area > 0.0 { (sum / area).sqrt() } else { 0.0 },
        }
    }

    /// Squared distance, over the area of each face.
    fn squares(&self, found: &[Found]) -> impl Iterator<Item = f64> {
        self.faces.iter().zip(found).map(|(face, found)| found.squares / found.places as f64 * face.area)
    }

    /// Asks so many places on each of the faces, and gives the largest squared distance.
    fn look(&self, tree: &Bvh, counts: Vec<usize>, found: &mut [Found]) -> f64 {
        let mut places = Vec::with_capacity(counts.iter().sum());
        let mut next = found.iter().map(|found| found.places as u32).sum();
        for (face, &count) in self.faces.iter().zip(&counts) {
            let [a, b, c] = face.corners;
            places.extend((next..).take(count).map(|k| {
                let [v, w] = spread(k).map(f64::from);
                a + (b - a) * v + (c - a) * w
            }));
            next += count as u32;
        }
        let hits = tree.closest_to_each(&places);
        let mut rest = hits.iter().map(|hit| hit.distance_squared);
        for (found, count) in found.iter_mut().zip(counts) {
            found.places += count;
            found.squares += rest.by_ref().take(count).sum::<f64>();
        }
        hits.iter().map(|hit| hit.distance_squared).fold(0.0, f64::max)
    }
}

fn thin_out<T>(items: Vec<T>) -> Vec<T> {
    let step = items.len().div_ceil(MOST_OF_SOURCE).max(1);
    items.into_iter().step_by(step).collect()
}

fn grow_tree(mesh: &Mesh) -> Bvh {
    Bvh::new(&mesh.positions, &mesh.triangles)
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
    fn what_only_a_small_face_is_off_by_is_looked_at_closely() {
        // A corner of a triangle of a ten thousandth of the area goes up: its height squared is a sixth in the mean, a ninth at the centroid.
        let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6]];
        let square = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 10.0, 0.0], [0.0, 10.0, 0.0]];
        let mesh = |z: f32| Mesh {
            positions: [&square[..], &[[20.0, 0.0, 0.0], [20.141_4, 0.0, 0.0], [20.0, 0.141_4, z]]].concat(),
            triangles: triangles.clone(),
            ..Mesh::default()
        };
        let rms = Deviation::new(&mesh(0.0)).of(&mesh(0.001)).rms;
        let expected = (0.001f64.powi(2) / 6.0 / 10_001.0).sqrt();
        assert!((rms / expected - 1.0).abs() < 0.02, "{rms}, expected {expected}");
    }

    #[test]
    fn the_source_is_nowhere_off() {
        let mesh = make_stand_in(700);
        let distance = Deviation::new(&mesh).of(&mesh);
        assert!(distance.max < 1e-12 && !distance.is_nearer_than(&distance));
    }
}
