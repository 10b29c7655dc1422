//! Four three-dimensional vectors at a time.

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
