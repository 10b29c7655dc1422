//! Four three-dimensional vectors, or boxes, at a time.

use glam::Vec3;
use wide::f32x4;

/// Numbers that are worked on together.
pub(crate) const LANES: usize = 4;

/// Four vectors, number by number.
pub(crate) type Vec3x4 = [f32x4; 3];

/// Side by side.
#[inline]
pub(crate) fn gather([a, b, c, d]: [Vec3; 4]) -> Vec3x4 {
    [[a.x, b.x, c.x, d.x], [a.y, b.y, c.y, d.y], [a.z, b.z, c.z, d.z]].map(f32x4::from)
}

#[inline]
pub(crate) fn dot(a: Vec3x4, b: Vec3x4) -> f32x4 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
pub(crate) fn minus(a: Vec3x4, b: Vec3x4) -> Vec3x4 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
pub(crate) fn cross(a: Vec3x4, b: Vec3x4) -> Vec3x4 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Four boxes side by side; those that are none hold nothing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Boxes {
    low: Vec3x4,
    high: Vec3x4,
}

impl Boxes {
    /// Up to four boxes, given by their lowest and highest corners.
    pub fn new(boxes: &[[Vec3; 2]]) -> Self {
        let corner =
            |k: usize, none: Vec3| gather(std::array::from_fn(|lane| boxes.get(lane).map_or(none, |bounds| bounds[k])));
        Self { low: corner(0, Vec3::INFINITY), high: corner(1, Vec3::NEG_INFINITY) }
    }

    /// Squared distances between the boxes and another one; infinite where there is none.
    #[inline]
    pub fn distance_squared(&self, [low, high]: [Vec3x4; 2]) -> f32x4 {
        let (below, above) = (minus(self.low, high), minus(low, self.high));
        let apart: Vec3x4 = std::array::from_fn(|k| below[k].fast_max(above[k]).fast_max(f32x4::ZERO));
        dot(apart, apart)
    }
}

/// The smallest box around points.
pub(crate) fn enclose(points: impl IntoIterator<Item = Vec3>) -> [Vec3; 2] {
    points.into_iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}
