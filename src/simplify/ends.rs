//! What a collapse to an end of its edge costs.
//!
//! The surface is off by the volumes that its faces sweep, and a face of area `A` whose plane is at distance `d` from the end that stays becomes one of
//! area `A'` in whose plane the end that goes is at distance `d' = A d / A'`: the same volume. Where the end is a tip, `d` is small and `d'` says
//! how far the surface really goes; on the rim of one it is the other way around. So the mean of both counts. As no place makes up for a wrong order,
//! the farthest face counts besides, and the cost is over the root of the area: between a sum over the surface, which likes far distances on small
//! faces, and the distance alone.

use super::placement::Facet;
use crate::mesh::surface::Surface;

/// Weight of the farthest distance, as if the whole area were that far.
const FARTHEST: f32 = 0.4;

/// The faces around a point that goes to another one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sweep {
    /// Σ area · distance² by the planes of the old faces, and by those of the new ones.
    pub by_old: f32,
    by_new: f32,
    farthest_squared: f32,
}

impl Sweep {
    pub fn new(surface: &Surface, facets: &[Facet], stays: u32, goes: u32) -> Self {
        let target = surface.points[stays as usize];
        let from = |p: u32| (surface.points[p as usize] - target).as_vec3();
        let way = from(goes);
        let (mut by_old, mut by_new, mut farthest_squared) = (0.0, 0.0, 0.0f32);
        for &corner in surface.ring(goes) {
            let [p, q] = surface.opposite(corner).map(from);
            // Faces that have both points have no area afterwards, and count nothing.
            let normal = p.cross(q);
            let square = normal.length_squared();
            // Six times the volume that the face sweeps.
            let volume = normal.dot(way);
            let distance_squared = volume * volume / square.max(f32::MIN_POSITIVE);
            by_old += volume * volume / facets[Surface::face_of(corner)].area().max(f32::MIN_POSITIVE);
            by_new += square.sqrt() * distance_squared;
            farthest_squared = farthest_squared.max(distance_squared);
        }
        Self { by_old: 0.25 * by_old, by_new: 0.5 * by_new, farthest_squared }
    }

    /// What it costs. `error`: Σ area · distance² by the planes of the old faces, of this `area`.
    pub fn cost(&self, error: f64, area: f32) -> f64 {
        let error = 0.5 * (error + f64::from(self.by_new)) + f64::from(FARTHEST * area * self.farthest_squared);
        error / f64::from(area.max(f32::MIN_POSITIVE).sqrt())
    }
}
