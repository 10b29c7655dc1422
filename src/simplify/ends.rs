//! What a collapse to an end of its edge costs.
//!
//! The surface is off by the volumes that its faces sweep, and a face of area `A` whose plane is at distance `d` from the end that stays becomes one of
//! area `A'` in whose plane the end that goes is at distance `d' = A d / A'`: the same volume. Where the end is a tip, `d` is small and `d'` says
//! how far the surface really goes; on the rim of one it is the other way around. So the mean of both counts. As no place makes up for a wrong order,
//! the farthest face counts besides, and the cost is over the root of the area: between a sum over the surface, which likes far distances on small
//! faces, and the distance alone.

use super::placement::Facet;
use crate::mesh::surface::Surface;
use glam::Vec3;

/// Weight of the farthest distance, as if the whole area were that far.
const FARTHEST: f32 = 0.4;

/// The faces around a point that goes to another one.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sweep {
    /// Σ area · distance² by the planes of the new faces.
    error: f32,
    farthest_squared: f32,
}

impl Sweep {
    pub fn new(surface: &Surface, facets: &[Facet], stays: u32, goes: u32) -> Self {
        let target = surface.points[stays as usize];
        let way = (target - surface.points[goes as usize]).as_vec3();
        let mut sweep = Self::default();
        for &corner in surface.ring(goes) {
            let [p, q] = surface.opposite(corner);
            if p == stays || q == stays {
                continue;
            }
            let [p, q] = [p, q].map(|p| (surface.points[p as usize] - target).as_vec3());
            sweep.add(facets[Surface::face_of(corner)].volume_along(way), p, q);
        }
        sweep
    }

    /// Adds the face between the target and two points. `volume`: area · distance by the old face.
    fn add(&mut self, volume: f32, p: Vec3, q: Vec3) {
        let area = 0.5 * p.cross(q).length();
        if area > 0.0 {
            let distance = volume / area;
            self.error += volume * distance;
            self.farthest_squared = self.farthest_squared.max(distance * distance);
        }
    }

    /// What it costs. `error`: Σ area · distance² by the planes of the old faces, of this `area`.
    pub fn cost(&self, error: f64, area: f32) -> f64 {
        let error = 0.5 * (error + f64::from(self.error)) + f64::from(FARTHEST * area * self.farthest_squared);
        error / f64::from(area.max(f32::MIN_POSITIVE).sqrt())
    }
}
