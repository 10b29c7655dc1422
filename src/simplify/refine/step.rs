//! The least squares problem of one point: where it should go so that closest points near it come nearer.

use glam::{Mat3, Vec3};

/// Pull to the old place, relative to the trace.
const DAMPING: f32 = 0.02;
/// The same in directions that are forbidden.
const STIFFNESS: f32 = 1e3;

/// Normal equations of Σ slope · (pull · step − distance)², `pull` being the direction to the closest point times the share by which that follows
/// the step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Step {
    /// xx, xy, xz, yy, yz, zz.
    matrix: [f32; 6],
    right: [f32; 3],
}

impl Step {
    /// Adds sums of products: the six of the matrix, then the three of the right side.
    pub fn add_sums(&mut self, sums: [f32; 9]) {
        for (own, sum) in self.matrix.iter_mut().chain(&mut self.right).zip(sums) {
            *own += sum;
        }
    }

    /// Adds one place on the faces that follows the step by the share `lever` and should move by `residual`.
    pub fn add(&mut self, residual: Vec3, lever: f32, slope: f32) {
        let length = residual.length();
        if length > 0.0 {
            self.add_pull(residual * (lever / length), length, slope);
        }
    }

    /// Adds slope · (pull · step − distance)².
    pub fn add_pull(&mut self, p: Vec3, distance: f32, slope: f32) {
        let q = p * slope;
        self.add_sums([
            p.x * q.x,
            p.x * q.y,
            p.x * q.z,
            p.y * q.y,
            p.y * q.z,
            p.z * q.z,
            q.x * distance,
            q.y * distance,
            q.z * distance,
        ]);
    }

    /// The step, and the gain it promises. It does not go in `forbidden` directions (of unit length).
    pub fn solve(&self, forbidden: &[Vec3]) -> Option<(Vec3, f32)> {
        let [xx, xy, xz, yy, yz, zz] = self.matrix;
        let pull = (xx + yy + zz) * DAMPING;
        let mut matrix = Mat3::from_cols_array(&[xx + pull, xy, xz, xy, yy + pull, yz, xz, yz, zz + pull]);
        for &n in forbidden {
            let stiff = n * (STIFFNESS * (xx + yy + zz));
            matrix += Mat3::from_cols(stiff * n.x, stiff * n.y, stiff * n.z);
        }
        let right = Vec3::from_array(self.right);
        // Without any pull the matrix has no inverse.
        let step = matrix.inverse() * right;
        step.is_finite().then(|| (step, step.dot(right)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_pulls_along_the_axes_add_up() {
        let mut step = Step::default();
        for residual in [Vec3::X, Vec3::Y * -2.0, Vec3::Z * 0.5] {
            step.add(residual, 1.0, 1.0);
        }
        let (found, promise) = step.solve(&[]).unwrap_or_default();
        // The damping holds back by three times 2 %.
        let expected = Vec3::new(1.0, -2.0, 0.5) / 1.06;
        assert!(found.distance(expected) < 1e-6, "{found}");
        assert!((promise - 5.25 / 1.06).abs() < 1e-5);
    }

    #[test]
    fn no_step_goes_where_it_may_not() {
        let mut step = Step::default();
        for residual in [Vec3::new(1.0, 2.0, 0.0), Vec3::new(-1.0, 1.0, 3.0), Vec3::Z] {
            step.add(residual, 1.0, 1.0);
        }
        let across = Vec3::new(1.0, -1.0, 1.0).normalize();
        let (found, promise) = step.solve(&[across]).unwrap_or_default();
        assert!(found.dot(across).abs() < 1e-3 * found.length() && promise > 0.0, "{found}");
        let (held, _) = step.solve(&[Vec3::X, Vec3::Y]).unwrap_or_default();
        assert!(held.truncate().length() < 1e-3 * held.z, "{held}");
    }

    #[test]
    fn a_place_that_follows_by_half_moves_the_point_twice_as_far() {
        let mut step = Step::default();
        step.add(Vec3::X, 0.5, 1e3);
        let (found, _) = step.solve(&[]).unwrap_or_default();
        assert!(found.distance(Vec3::X * 2.0 / 1.02) < 1e-5, "{found}");
        assert!(Step::default().solve(&[]).is_none());
    }
}
