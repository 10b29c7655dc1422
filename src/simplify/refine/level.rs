//! A level under refinement: which samples each face stands for, and what its errors are worth.

use super::Budget;
use super::hold::Hold;
use super::lists::{Lists, NONE};
use super::patch::{Appraisal, Patch};
use super::prices::Prices;
use super::probe::Spots;
use super::source::{Foot, Source};
use super::wants::Wants;
use crate::mesh::surface::Surface;
use glam::Vec3;
use wide::f32x4;

/// How a move is judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Manner {
    /// By samples and points.
    Quick,
    /// By all places that the move changes.
    Thorough,
}

/// Cosines of the angles to the source's normal from which a face looks away, and from which it is turned over.
const AWAY_COSINES: [f32; 2] = [0.2, -0.3];

/// What the mean square over a whole face is of that over its places, which are exact for cubic functions: distances to a smooth surface are of degree
/// four, and come out 1.5 to 2.2 times too large.
const PLACES_SHARE: f32 = 0.55;

/// Relative difference of squared distances that is rounding.
const ROUNDING: f32 = 1e-5;

/// How far a level is from the source, or the source from it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Distance {
    /// Of the squares.
    pub mean: f32,
    /// The largest square.
    pub worst: f32,
}

impl Distance {
    /// The distance both ways.
    pub fn with(self, other: Self) -> Self {
        Self { mean: self.mean.midpoint(other.mean), worst: self.worst.max(other.worst) }
    }

    pub fn is_within(&self, other: &Self) -> bool {
        self.mean <= other.mean && self.reaches_no_farther(other)
    }

    pub fn reaches_no_farther(&self, other: &Self) -> bool {
        self.worst <= other.worst * (1.0 + ROUNDING)
    }
}

/// The faces around a point, neighbours side by side.
#[derive(Debug, Default)]
pub(super) struct Fan {
    pub faces: Vec<usize>,
    /// The first corner of each is the point.
    pub triangles: Vec<[Vec3; 3]>,
    /// The same with the point elsewhere.
    pub moved: Vec<[Vec3; 3]>,
    rims: Vec<[u32; 2]>,
}

pub(super) struct Level<'a> {
    pub surface: &'a mut Surface,
    pub source: &'a Source,
    pub lists: &'a mut Lists,
    pub patch: &'a mut Patch,
    pub fan: Fan,
    /// Of each point.
    pub holds: Vec<Hold>,
    /// For each point the closest of the source; face NONE for points without faces.
    pub feet: Vec<Foot>,
    pub prices: Prices,
    pub budget: Budget,
    /// Of each face, as far as they are known.
    pub spots: Vec<Spots>,
    /// `None` if no attribute counts.
    pub wants: Option<Wants<'a>>,
}

impl Level<'_> {
    pub fn triangle(&self, face: usize) -> [Vec3; 3] {
        self.surface.triangle(face).map(|p| p.as_vec3())
    }

    pub fn point(&self, p: u32) -> Vec3 {
        self.surface.points[p as usize].as_vec3()
    }

    /// The source's closest point to `x`, walking from the face `start`. A walk that starts on the wrong side of a thin part or of a sharp edge ends
    /// there: where a foot is suspiciously far it is searched for.
    pub fn look_back(&self, x: Vec3, start: u32) -> Foot {
        let foot = self.source.walk(x, start);
        if self.prices.is_suspicious(foot.distance_squared) { self.source.search(x, foot) } else { foot }
    }

    /// Whether some of the `new` triangles look away from the source at `foot`, although none of the `old` ones does.
    pub fn comes_to_look_away(&self, old: &[[Vec3; 3]], new: &[[Vec3; 3]], foot: Foot) -> bool {
        let normal = unit_normal(&self.source.triangle(foot.face));
        let least = |all: &[[Vec3; 3]]| all.iter().map(|t| unit_normal(t).dot(normal)).fold(1.0, f32::min);
        let (before, after) = (least(old), least(new));
        AWAY_COSINES.iter().any(|&limit| after < limit && before >= limit)
    }

    pub fn is_free(&self, p: u32) -> bool {
        self.holds[p as usize] == Hold::Free
    }

    pub fn foot(&self, p: u32) -> Foot {
        self.feet[p as usize]
    }

    /// Puts the samples of these faces, which are `triangles`, into the patch; gives what they and the shapes cost.
    pub fn gather(&mut self, faces: &[usize], triangles: &[[Vec3; 3]]) -> Appraisal {
        self.patch.clear();
        for &f in faces {
            self.patch.start_triangle();
            self.lists.of(f).for_each(|four| self.patch.push_four(four));
        }
        self.patch.look(triangles, &self.prices)
    }

    /// What the distances of a face's samples cost.
    pub fn cost_of_distances(&self, face: usize) -> f32 {
        self.lists.of(face).map(|four| four.weight * four.squared).sum::<f32x4>().reduce_add()
    }

    /// How far the level is from the source: the mean of its places, and the largest of these and of its samples.
    pub fn distance(&mut self) -> Distance {
        let (mut squares, mut whole, mut worst) = (0.0f64, 0.0f64, 0.0f32);
        for f in 0..self.surface.face_slots() {
            if self.surface.is_live(f) {
                let spots = self.spots(f);
                squares += f64::from(spots.squares);
                whole += f64::from(area(&self.triangle(f)));
                worst = worst.max(spots.worst);
            }
        }
        Distance { mean: PLACES_SHARE * (squares / whole.max(f64::MIN_POSITIVE)) as f32, worst }
    }

    /// Makes room for new faces and points.
    pub fn grow(&mut self) {
        let (faces, points) = (self.surface.face_slots(), self.surface.points.len());
        self.lists.grow(faces);
        self.spots.resize(faces, Spots::UNKNOWN);
        self.holds.resize(points, Hold::Free);
        self.feet.resize(points, Foot { distance_squared: 0.0, point: Vec3::ZERO, face: NONE });
    }

    /// How far a face is from the source.
    pub fn spots(&mut self, face: usize) -> Spots {
        if self.spots[face].worst < 0.0 {
            self.spots[face] = self.find_spots(face);
        }
        self.spots[face]
    }

    /// Gives the patch's samples to `faces`, which are the triangles appraised last; `old` are the faces they came from.
    pub fn settle(&mut self, old: &[usize], faces: &[usize]) {
        for &f in old {
            self.lists.empty(f);
            self.spots[f] = if faces.contains(&f) { self.spots[f].moved() } else { Spots::UNKNOWN };
        }
        self.patch.hand_over(faces, self.lists);
    }

    /// Fills `fan` with the faces around `p`.
    pub fn fill_fan(&self, p: u32, fan: &mut Fan) {
        let ring = self.surface.ring(p);
        fan.faces.clear();
        fan.faces.extend(ring.iter().map(|&c| Surface::face_of(c)));
        fan.rims.clear();
        fan.rims.extend(ring.iter().map(|&c| self.surface.opposite(c)));
        for k in 1..ring.len() {
            let end = fan.rims[k - 1][1];
            if let Some(next) = (k..ring.len()).find(|&j| fan.rims[j][0] == end) {
                fan.rims.swap(k, next);
                fan.faces.swap(k, next);
            }
        }
        let here = self.point(p);
        fan.triangles.clear();
        fan.triangles.extend(fan.rims.iter().map(|&[q, r]| [here, self.point(q), self.point(r)]));
    }
}

impl Fan {
    /// The mean normal of the faces; `None` if they have none.
    pub fn normal(&self) -> Option<Vec3> {
        self.triangles.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a)).sum::<Vec3>().try_normalize()
    }

    /// Puts the point elsewhere.
    pub fn move_to(&mut self, x: Vec3) {
        self.moved.clear();
        self.moved.extend(self.triangles.iter().map(|t| [x, t[1], t[2]]));
    }
}

/// Unit normal; zero without area.
pub(super) fn unit_normal([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (*b - *a).cross(*c - *a).normalize_or_zero()
}

/// Cosine of the angle by which faces may turn away from those that they replace.
pub(super) const TURN_COSINE: f32 = 0.3;

/// Whether any of these triangles turns away from the one in its place before.
pub(super) fn turn_away(old: &[[Vec3; 3]], new: &[[Vec3; 3]]) -> bool {
    old.iter().zip(new).any(|(old, new)| unit_normal(old).dot(unit_normal(new)) < TURN_COSINE)
}

pub(super) fn area([a, b, c]: &[Vec3; 3]) -> f32 {
    (*b - *a).cross(*c - *a).length() * 0.5
}

pub(super) fn centre([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (*a + *b + *c) / 3.0
}
