//! Quadric error functions (Garland & Heckbert 1997) and the placement that minimises them.

use glam::DVec3;

/// `w · (squared distance to planes)` summed: `xᵀAx + 2bᵀx + c`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Quadric {
    /// A: xx, xy, xz, yy, yz, zz.
    a: [f64; 6],
    b: DVec3,
    c: f64,
}

impl Quadric {
    /// Squared distance to the plane through `point` with unit `normal`, times `weight`.
    pub fn plane(normal: DVec3, point: DVec3, weight: f64) -> Self {
        let d = -normal.dot(point);
        let n = normal * weight;
        Self {
            a: [n.x * normal.x, n.x * normal.y, n.x * normal.z, n.y * normal.y, n.y * normal.z, n.z * normal.z],
            b: n * d,
            c: weight * d * d,
        }
    }

    /// Adds `other`.
    pub fn add(&mut self, other: &Self) {
        self.add_scaled(other, 1.0);
    }

    /// Adds `scale` times `other`.
    fn add_scaled(&mut self, other: &Self, scale: f64) {
        for i in 0..6 {
            self.a[i] += other.a[i] * scale;
        }
        self.b += other.b * scale;
        self.c += other.c * scale;
    }

    /// Value at `x`; never negative.
    pub fn at(&self, x: DVec3) -> f64 {
        (x.dot(self.multiply(x)) + 2.0 * self.b.dot(x) + self.c).max(0.0)
    }

    fn multiply(&self, x: DVec3) -> DVec3 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        DVec3::new(xx * x.x + xy * x.y + xz * x.z, xy * x.x + yy * x.y + yz * x.z, xz * x.x + yz * x.y + zz * x.z)
    }

    /// The minimum, if A is well conditioned.
    pub fn minimum(&self) -> Option<DVec3> {
        Inverse::of(&self.a, 1e-9).map(|inverse| inverse.multiply(-self.b))
    }
}

/// The inverse of a symmetric 3×3 matrix.
struct Inverse([f64; 6]);

impl Inverse {
    /// `None` if the determinant is not above `threshold` relative to the cube of the mean eigenvalue.
    fn of(a: &[f64; 6], threshold: f64) -> Option<Self> {
        let [xx, xy, xz, yy, yz, zz] = *a;
        let c = [yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy];
        let det = xx * c[0] + xy * c[1] + xz * c[2];
        let mean = (xx + yy + zz) / 3.0;
        if !(det > threshold * mean * mean * mean && det > 0.0) {
            return None;
        }
        let s = 1.0 / det;
        let entries = [c[0], c[1], c[2], xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy].map(|e| e * s);
        entries.iter().all(|e| e.is_finite()).then_some(Self(entries))
    }

    fn multiply(&self, v: DVec3) -> DVec3 {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        DVec3::new(xx * v.x + xy * v.y + xz * v.z, xy * v.x + yy * v.y + yz * v.z, xz * v.x + yz * v.y + zz * v.z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner() -> Quadric {
        let mut q = Quadric::plane(DVec3::X, DVec3::new(1.0, 0.0, 0.0), 1.0);
        q.add(&Quadric::plane(DVec3::Y, DVec3::new(0.0, 2.0, 0.0), 1.0));
        q.add(&Quadric::plane(DVec3::Z, DVec3::new(0.0, 0.0, 3.0), 2.0));
        q
    }

    #[test]
    fn three_planes_meet_in_their_corner() {
        let q = corner();
        assert!(q.minimum().is_some_and(|x| x.distance(DVec3::new(1.0, 2.0, 3.0)) < 1e-12));
        assert_eq!(q.at(DVec3::new(2.0, 2.0, 4.0)), 1.0 + 2.0);
    }

    #[test]
    fn a_single_plane_has_no_minimum() {
        assert!(Quadric::plane(DVec3::Z, DVec3::ZERO, 1.0).minimum().is_none());
    }
}
