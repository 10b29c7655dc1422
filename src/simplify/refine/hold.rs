//! Which points may move, and where to: along a seam, but not across it.
//!
//! On game assets most points of a coarse level are on seams. What the seam parts are values, not the shape: the point may rise and sink as any other,
//! and slide along the seam, where either side's values go on linearly. Across it a texture would bleed into another chart.

use super::level::Fan;
use crate::mesh::edges::{EdgeKind, collect_edges};
use crate::mesh::surface::Surface;
use crate::simplify::constraints::Locked;
use glam::Vec3;
use smallvec::SmallVec;

/// What holds a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Hold {
    /// Nothing.
    Free,
    /// A seam, which goes through it from one of these points to the other.
    Seam([u32; 2]),
    /// Several seams meet, or one ends.
    Corner,
    /// It stays where it is: it is locked, or at an edge that has not got two faces side by side.
    Fixed,
}

impl Hold {
    /// Of all points.
    pub fn find(surface: &Surface, locked: &Locked) -> Vec<Self> {
        let hold = |p: u32| if locked.has(p) { Self::Fixed } else { Self::Free };
        let mut holds: Vec<Self> = (0..surface.points.len() as u32).map(hold).collect();
        let mut seams: Vec<[u32; 2]> = Vec::new();
        for edge in collect_edges(surface).iter().filter(|e| !e.kind.is_plain()) {
            if edge.kind.has(EdgeKind::BORDER.with(EdgeKind::COMPLEX).with(EdgeKind::FOLD)) {
                holds[edge.a as usize] = Self::Fixed;
                holds[edge.b as usize] = Self::Fixed;
            } else {
                seams.extend([[edge.a, edge.b], [edge.b, edge.a]]);
            }
        }
        seams.sort_unstable();
        for of_point in seams.chunk_by(|s, t| s[0] == t[0]) {
            let hold = &mut holds[of_point[0][0] as usize];
            *hold = match (*hold, of_point) {
                (Self::Fixed, _) => Self::Fixed,
                (_, [from, to]) => Self::Seam([from[1], to[1]]),
                _ => Self::Corner,
            };
        }
        holds
    }

    /// Unit directions in which the point, the hub of `fan`, may not go.
    pub fn forbidden(self, surface: &Surface, fan: &Fan) -> SmallVec<[Vec3; 2]> {
        let along = match self {
            Self::Free | Self::Fixed => return SmallVec::new(),
            Self::Seam([from, to]) => (surface.points[to as usize] - surface.points[from as usize]).as_vec3(),
            Self::Corner => Vec3::ZERO,
        };
        let Some(normal) = fan.normal() else { return [Vec3::X, Vec3::Y].into() };
        match normal.cross(along).try_normalize() {
            Some(across) => SmallVec::from_slice(&[across]),
            None => {
                let (u, v) = normal.any_orthonormal_pair();
                [u, v].into()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::two_charts;
    use super::*;
    use crate::simplify::Options;
    use crate::simplify::constraints::Constraints;

    #[test]
    fn points_of_a_seam_slide_along_it_and_borders_stay() {
        let surface = Surface::new(&two_charts());
        let none = Constraints::new(&Options::default()).lock_points(25, &[]);
        let holds = Hold::find(&surface, &none);
        let expected = |p: usize| match (p % 5, p / 5) {
            (0 | 4, _) | (_, 0 | 4) => Hold::Fixed,
            (_, 2) => Hold::Seam([p as u32 - 1, p as u32 + 1]),
            _ => Hold::Free,
        };
        assert!((0..25).all(|p| holds[p] == expected(p)), "{holds:?}");
        let mut fan = Fan::default();
        fan.triangles.push([Vec3::ZERO, Vec3::X, Vec3::Y]);
        let forbidden = |hold: Hold| hold.forbidden(&surface, &fan);
        assert!(forbidden(holds[6]).is_empty());
        assert!(matches!(forbidden(holds[12])[..], [across] if across.abs().distance(Vec3::Y) < 1e-6));
        let both = forbidden(Hold::Corner);
        assert!(both.len() == 2 && both.iter().all(|n| n.z.abs() < 1e-6 && n.is_normalized()), "{both:?}");
    }
}
