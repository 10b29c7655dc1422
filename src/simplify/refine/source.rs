//! The source surface as refinement sees it: samples to be near to, and a way to find the closest point from a place nearby.

use super::nearest::NearestFace;
use crate::mesh::order::order_in_space;
use crate::mesh::surface::Surface;
use crate::simplify::cost::Room;
use glam::Vec3;
use std::ops::Range;

/// One in so many samples inside faces is held out.
const HELD_OUT: usize = 3;

/// A source surface in the unit frame, single precision: made once for a chain.
#[derive(Debug)]
pub(crate) struct Source {
    faces: Vec<[u32; 3]>,
    /// Positions of the faces, side by side: walks look at little else.
    triangles: Vec<[Vec3; 3]>,
    /// Faces around each point, `starts[p]..starts[p + 1]` of `around`.
    starts: Vec<u32>,
    around: Vec<u32>,
    pub samples: Vec<Sample>,
    /// The first so many samples are vertices; those from `held_out` on are for judging what the others have led to.
    vertices: usize,
    pub held_out: usize,
    nearest: NearestFace,
    /// Where points may go.
    pub room: Room,
}

/// A point of the source.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub position: Vec3,
    /// Area that it stands for.
    pub weight: f32,
    pub normal: Vec3,
    /// A face that has it.
    pub face: u32,
}

/// A closest point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Foot {
    pub distance_squared: f32,
    pub point: Vec3,
    pub face: u32,
}

impl Source {
    /// `inside`: samples inside faces, for each face in the mean.
    pub fn new(surface: &Surface, inside: f32) -> Self {
        let points: Vec<Vec3> = surface.points.iter().map(|p| p.as_vec3()).collect();
        let faces: Vec<[u32; 3]> = surface.live_faces().map(|f| surface.face(f)).collect();
        let (starts, around) = gather_faces(points.len(), &faces);
        let room = Room::of(&surface.points);
        let (vertices, between) = take_samples(&points, &faces, inside);
        let mut samples = sort_in_space(&vertices);
        let triangles: Vec<[Vec3; 3]> = faces.iter().map(|face| face.map(|p| points[p as usize])).collect();
        let nearest = NearestFace::new(&(0..faces.len() as u32).collect::<Vec<_>>(), |f| triangles[f as usize]);
        let is_held_out = |&(k, _): &(usize, &Sample)| k % HELD_OUT == HELD_OUT - 1;
        let between = sort_in_space(&between);
        let (judges, others): (Vec<_>, Vec<_>) = between.iter().enumerate().partition(is_held_out);
        samples.extend(others.into_iter().map(|(_, s)| s));
        let held_out = samples.len();
        samples.extend(judges.into_iter().map(|(_, s)| s));
        Self { faces, triangles, starts, around, samples, vertices: vertices.len(), held_out, nearest, room }
    }

    /// The samples for a level: the vertices, evenly thinned out to `most`, and as many of the others as give `wanted`, but half as
    /// many at least: vertices do not tell of what lies between them.
    pub fn choose(&self, wanted: usize, most: usize) -> impl Iterator<Item = usize> + use<> {
        let (vertices, all) = (self.vertices, self.held_out);
        let others = wanted.saturating_sub(vertices).max(wanted / 2);
        thin_out(0..vertices, most).chain(thin_out(vertices..all, others))
    }

    /// Of the samples that no move knows `most` at most.
    pub fn judges(&self, most: usize) -> impl Iterator<Item = usize> + Clone + use<> {
        thin_out(self.held_out..self.samples.len(), most)
    }

    /// Positions of a face.
    pub fn triangle(&self, face: u32) -> [Vec3; 3] {
        self.triangles[face as usize]
    }

    /// A point of the source near a sample: the vertex itself if it is one.
    pub fn corner(&self, sample: &Sample) -> u32 {
        let face = sample.face as usize;
        let at = self.triangles[face].iter().position(|&corner| corner == sample.position);
        self.faces[face][at.unwrap_or(0)]
    }

    /// The closest point that a walk downhill from the face `start` finds: the closest of all if the start is near it, or if there is no such face.
    pub fn walk(&self, x: Vec3, start: u32) -> Foot {
        const MOST_STEPS: usize = 100;
        if start as usize >= self.faces.len() {
            return self.search(x, Foot { distance_squared: f32::INFINITY, point: x, face: start });
        }
        let (mut best, mut corner) = self.foot(x, start);
        for _ in 0..MOST_STEPS {
            let before = best.face;
            let face = self.faces[before as usize];
            // Inside a face there is nothing nearer beside it; on an edge or corner there may be.
            match corner {
                Feature::Inside => break,
                Feature::Corner(k) => {
                    let p = face[k] as usize;
                    for &f in &self.around[self.starts[p] as usize..self.starts[p + 1] as usize] {
                        self.improve(x, f, &mut best, &mut corner);
                    }
                }
                Feature::Edge(k) => {
                    let (p, q) = (face[k], face[(k + 1) % 3]);
                    for &f in &self.around[self.starts[p as usize] as usize..self.starts[p as usize + 1] as usize] {
                        if f != before && self.faces[f as usize].contains(&q) {
                            self.improve(x, f, &mut best, &mut corner);
                        }
                    }
                }
            }
            if best.face == before {
                break;
            }
        }
        best
    }

    /// The closest of all points, if it is nearer than `known`.
    pub fn search(&self, x: Vec3, known: Foot) -> Foot {
        self.nearest.find(x, known)
    }

    fn improve(&self, x: Vec3, face: u32, best: &mut Foot, feature: &mut Feature) {
        let (foot, at) = self.foot(x, face);
        if foot.distance_squared < best.distance_squared {
            (*best, *feature) = (foot, at);
        }
    }

    fn foot(&self, x: Vec3, face: u32) -> (Foot, Feature) {
        let (point, _, feature) = closest_point(self.triangle(face), x);
        (Foot { distance_squared: point.distance_squared(x), point, face }, feature)
    }
}

/// Where on a triangle a closest point lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Feature {
    Inside,
    /// Between corner k and the next.
    Edge(usize),
    Corner(usize),
}

/// The closest point of a triangle, its barycentric weights and where it lies (Ericson, Real-Time Collision Detection, 5.1.5).
pub(crate) fn closest_point([a, b, c]: [Vec3; 3], x: Vec3) -> (Vec3, [f32; 3], Feature) {
    let (ab, ac, ax) = (b - a, c - a, x - a);
    let (d1, d2) = (ab.dot(ax), ac.dot(ax));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (a, [1.0, 0.0, 0.0], Feature::Corner(0));
    }
    let bx = x - b;
    let (d3, d4) = (ab.dot(bx), ac.dot(bx));
    if d3 >= 0.0 && d4 <= d3 {
        return (b, [0.0, 1.0, 0.0], Feature::Corner(1));
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3);
        return (a + ab * v, [1.0 - v, v, 0.0], Feature::Edge(0));
    }
    let cx = x - c;
    let (d5, d6) = (ab.dot(cx), ac.dot(cx));
    if d6 >= 0.0 && d5 <= d6 {
        return (c, [0.0, 0.0, 1.0], Feature::Corner(2));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        return (a + ac * w, [1.0 - w, 0.0, w], Feature::Edge(2));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return (b + (c - b) * w, [0.0, 1.0 - w, w], Feature::Edge(1));
    }
    let inverse = 1.0 / (va + vb + vc);
    let (v, w) = (vb * inverse, vc * inverse);
    (a + ab * v + ac * w, [1.0 - v - w, v, w], Feature::Inside)
}

/// `most` of these samples at most, evenly.
fn thin_out(samples: Range<usize>, most: usize) -> impl Iterator<Item = usize> + Clone {
    let (all, kept) = (samples.len(), samples.len().min(most));
    (0..kept).map(move |k| samples.start + k * all / kept)
}

/// Vertices, where the peaks are, and places inside of faces, evenly by area: large faces have more of them. Both kinds share the area.
fn take_samples(points: &[Vec3], faces: &[[u32; 3]], inside: f32) -> (Vec<Sample>, Vec<Sample>) {
    let mut vertices: Vec<Sample> =
        points.iter().map(|&position| Sample { position, weight: 0.0, normal: Vec3::ZERO, face: u32::MAX }).collect();
    let corners = |face: [u32; 3]| face.map(|p| points[p as usize]);
    let crosses: Vec<Vec3> = faces
        .iter()
        .map(|&face| {
            let [a, b, c] = corners(face);
            (b - a).cross(c - a)
        })
        .collect();
    let area: f64 = crosses.iter().map(|c| 0.5 * f64::from(c.length())).sum();
    let wanted = f64::from(inside) * faces.len() as f64;
    let share = (wanted / (wanted + points.len() as f64)) as f32;
    let mut between = Vec::with_capacity(wanted as usize + 1);
    let mut due = 0.5f64;
    for (f, (&face, cross)) in faces.iter().zip(&crosses).enumerate() {
        let face_area = 0.5 * cross.length();
        for p in face {
            let vertex = &mut vertices[p as usize];
            vertex.normal += *cross;
            vertex.weight += face_area * (1.0 - share) / 3.0;
            vertex.face = f as u32;
        }
        due += if area > 0.0 { wanted * f64::from(face_area) / area } else { 0.0 };
        let count = due as u32;
        due -= due.floor();
        let [a, b, c] = corners(face);
        let weight = area as f32 * share / wanted as f32;
        between.extend((0..count).map(|k| {
            let [u, v] = spread(k);
            let position = a + (b - a) * u + (c - a) * v;
            Sample { position, weight, normal: cross.normalize_or_zero(), face: f as u32 }
        }));
    }
    vertices.retain(|v| v.face != u32::MAX);
    vertices.iter_mut().for_each(|v| v.normal = v.normal.normalize_or_zero());
    (vertices, between)
}

/// Weights of a triangle's second and third corner at the k-th of its places: evenly spread, the centroid first (Roberts' R₂ sequence, folded).
pub fn spread(k: u32) -> [f32; 2] {
    let at = |step: f64| (1.0 / 3.0 + f64::from(k) * step).fract() as f32;
    let [u, v] = [at(0.754_877_666_246_692_8), at(0.569_840_290_998_053_3)];
    if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] }
}

fn sort_in_space(samples: &[Sample]) -> Vec<Sample> {
    order_in_space(samples.iter().map(|s| s.position)).into_iter().map(|i| samples[i as usize]).collect()
}

fn gather_faces(points: usize, faces: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; points + 1];
    for &p in faces.iter().flatten() {
        starts[p as usize + 1] += 1;
    }
    for p in 0..points {
        starts[p + 1] += starts[p];
    }
    let mut next = starts.clone();
    let mut around = vec![0; 3 * faces.len()];
    for (f, face) in faces.iter().enumerate() {
        for &p in face {
            around[next[p as usize] as usize] = f as u32;
            next[p as usize] += 1;
        }
    }
    (starts, around)
}

#[cfg(test)]
mod tests {
    use super::super::tests::bumpy_sphere;
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn samples_stand_for_the_whole_area() {
        let mut mesh = bumpy_sphere(8, 0.0);
        // One face as large as many.
        let corner = mesh.positions.len() as u32;
        mesh.positions.extend([[1.5, -1.0, 0.0], [1.5, 1.0, 0.0], [1.5, 0.0, 1.0]]);
        mesh.triangles.push([corner, corner + 1, corner + 2]);
        let source = Source::new(&Surface::new(&mesh), 2.0);
        let area = |f: u32| {
            let [a, b, c] = source.triangle(f);
            (b - a).cross(c - a).length() * 0.5
        };
        let (faces, last) = (source.faces.len() as u32, source.faces.len() as u32 - 1);
        let whole: f32 = (0..faces).map(area).sum();
        let of_samples: f32 = source.samples.iter().map(|s| s.weight).sum();
        assert!((of_samples / whole - 1.0).abs() < 0.01, "{of_samples} of {whole}");
        let inside = &source.samples[source.vertices..];
        let on_last = inside.iter().filter(|s| s.face == last).count() as f32 / inside.len() as f32;
        assert!((on_last / (area(last) / whole) - 1.0).abs() < 0.1, "{on_last}");
        let all: Vec<usize> = source.choose(faces as usize, usize::MAX).collect();
        assert!(all.len() >= faces as usize && (0..source.vertices).all(|v| all[v] == v));
        let at_corner = |s: &Sample| source.triangle(s.face).contains(&s.position);
        let vertices = &source.samples[..source.vertices];
        assert!(vertices.iter().all(|s| at_corner(s) && mesh_point(&source, source.corner(s)) == s.position));
        assert!(source.choose(faces as usize, 10).filter(|&s| s < source.vertices).count() < 20);
    }

    /// Where a point is, by a face that has it.
    fn mesh_point(source: &Source, p: u32) -> Vec3 {
        let face = source.around[source.starts[p as usize] as usize];
        let at = source.faces[face as usize].iter().position(|&q| q == p);
        at.map_or(Vec3::NAN, |k| source.triangle(face)[k])
    }

    #[test]
    fn places_are_spread_over_the_triangle() {
        let [u, v] = (0..64).map(spread).fold([0.0; 2], |sum, s| [sum[0] + s[0] / 64.0, sum[1] + s[1] / 64.0]);
        assert!((u - 1.0 / 3.0).abs() < 0.02 && (v - 1.0 / 3.0).abs() < 0.02, "{u} {v}");
        assert!((0..64).map(spread).all(|[u, v]| u >= 0.0 && v >= 0.0 && u + v <= 1.0));
    }

    proptest! {
        #[test]
        fn a_walk_from_the_same_side_finds_the_closest_point(direction in prop::array::uniform3(-1.0f32..1.0), height in 1.0f32..1.3) {
            let source = Source::new(&Surface::new(&bumpy_sphere(8, 0.0)), 1.0);
            let Some(direction) = Vec3::from(direction).try_normalize() else { return Ok(()) };
            let x = direction * height;
            let near = (0..source.faces.len() as u32)
                .filter(|&f| source.triangle(f)[0].dot(direction) > 0.0)
                .max_by(|&a, &b| source.triangle(a)[0].dot(direction).total_cmp(&source.triangle(b)[0].dot(direction)));
            let Some(start) = near else { return Ok(()) };
            let walked = source.walk(x, start);
            let none = Foot { distance_squared: f32::INFINITY, point: x, face: u32::MAX };
            let searched = source.search(x, none);
            // Rounded positions make shallow dents that a walk may end in.
            prop_assert!(walked.distance_squared.sqrt() <= searched.distance_squared.sqrt() * 1.01 + 1e-4);
            prop_assert_eq!(source.walk(x, u32::MAX).face, searched.face);
        }
    }

    #[test]
    fn closest_points_of_a_triangle() {
        let triangle = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let cases = [
            (Vec3::new(0.25, 0.25, 1.0), Vec3::new(0.25, 0.25, 0.0), Feature::Inside),
            (Vec3::new(-1.0, -1.0, 0.0), Vec3::ZERO, Feature::Corner(0)),
            (Vec3::new(0.5, -1.0, 0.0), Vec3::new(0.5, 0.0, 0.0), Feature::Edge(0)),
            (Vec3::new(1.0, 1.0, 0.0), Vec3::new(0.5, 0.5, 0.0), Feature::Edge(1)),
            (Vec3::new(-1.0, 0.5, 0.0), Vec3::new(0.0, 0.5, 0.0), Feature::Edge(2)),
        ];
        for (x, expected, feature) in cases {
            let (point, weights, found) = closest_point(triangle, x);
            assert_eq!((point, found), (expected, feature), "{x}");
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        }
    }
}
