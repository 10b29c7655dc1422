//! Normals and areas of faces, kept from judging to judging: costs that look at whole rings would compute each a dozen times.

use crate::curvature::normal_and_area;
use crate::mesh::surface::{Corner, Surface};
use glam::DVec3;

/// Unit normal and area of every live face.
#[derive(Debug, Default)]
pub(crate) struct FaceNormals {
    faces: Vec<(DVec3, f64)>,
    /// The point that the last collapse made: its faces are the ones that have changed.
    joined: u32,
    /// Whether they have been looked at since.
    is_fresh: bool,
}

impl FaceNormals {
    /// Looks at the whole surface.
    pub fn refresh(&mut self, surface: &Surface) {
        self.faces.clear();
        self.faces.resize(surface.face_slots(), Default::default());
        for f in surface.live_faces() {
            self.faces[f] = normal_and_area(surface.triangle(f));
        }
    }

    /// Unit normal (zero without an area) and area of the face at a corner.
    #[inline]
    pub fn at(&self, corner: Corner) -> (DVec3, f64) {
        self.faces[Surface::face_of(corner)]
    }

    /// A collapse has made the point `joined`.
    pub fn follow(&mut self, joined: u32) {
        (self.joined, self.is_fresh) = (joined, false);
    }

    /// Brings the faces around `point` up to date. After the joined point's there is nothing left to do at its neighbours; a schedule that asks
    /// for neighbours alone gets theirs.
    pub fn update(&mut self, surface: &Surface, point: u32) {
        if self.is_fresh {
            return;
        }
        for &corner in surface.ring(point) {
            let face = Surface::face_of(corner);
            self.faces[face] = normal_and_area(surface.triangle(face));
        }
        self.is_fresh = point == self.joined;
    }
}
