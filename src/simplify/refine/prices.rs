//! What errors cost: one sum in which distance, its peaks, turned normals and needles are weighed against each other.

use super::level::{Level, area, unit_normal};
use glam::{Vec3, Vec4};

/// Weight of the fourth power of distances, in units of the mean square: prefers even errors.
const EVENNESS: f32 = 0.0;
/// All turned normals together, relative to all distances.
const NORMAL_SHARE: f32 = 0.6;
/// A degenerate face, relative to the mean face.
const NEEDLE_SHARE: f32 = 32.0;
/// Quality (4√3·area / Σ edge²: 1 equilateral) from which a shape costs nothing. A smallest angle of 10° is between 0.20 and 0.30.
const GOOD_QUALITY: f32 = 0.45;
/// Rounding of single precision in the unit frame, squared: below it nothing is worth a change.
const ROUNDING: f32 = 1e-14;

/// In area · squared length of the unit frame.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Prices {
    evenness: f32,
    /// Squared distance from which peaks count, and what its excess costs.
    peak: f32,
    peak_area: f32,
    normal: f32,
    needle: f32,
    /// Area that a face's samples have in the mean.
    face_area: f32,
    pub mean_square: f32,
    /// Area of the samples in the lists, relative to the level's.
    pub density: f32,
}

impl Prices {
    /// Balances the parts as they are on `level`.
    pub fn of_level(level: &Level) -> Self {
        let (mut squares, mut turned, mut whole, mut surface, mut faces) = (0.0f64, 0.0f64, 0.0f64, 0.0f64, 0);
        for f in level.surface.live_faces() {
            let triangle = level.triangle(f);
            let normal = unit_normal(&triangle);
            faces += 1;
            surface += f64::from(area(&triangle));
            for s in level.lists.of(f) {
                let sample = &level.source.samples[s as usize];
                squares += f64::from(sample.weight * level.lists.squared[s as usize]);
                turned += f64::from(sample.weight * (1.0 - sample.normal.dot(normal)));
                whole += f64::from(sample.weight);
            }
        }
        if !(whole > 0.0 && surface > 0.0) {
            return Self::default();
        }
        let mean_square = ((squares / whole) as f32).max(ROUNDING);
        let face_area = whole as f32 / faces as f32;
        Self {
            evenness: EVENNESS / mean_square,
            peak: f32::INFINITY,
            peak_area: 0.0,
            normal: if turned > 0.0 { NORMAL_SHARE * mean_square * (whole / turned) as f32 } else { 0.0 },
            needle: NEEDLE_SHARE * mean_square * face_area,
            face_area,
            mean_square,
            density: (whole / surface) as f32,
        }
    }

    /// Squared distances above `squared` become dear.
    pub fn set_peak(&mut self, squared: f32) {
        self.peak = squared;
        self.peak_area = self.face_area;
    }

    /// Of samples of these areas, at these squared distances from faces whose normals have the cosines `turn` to their own.
    pub fn of_samples(&self, area: Vec4, squared: Vec4, turn: Vec4) -> Vec4 {
        let excess = (squared - Vec4::splat(self.peak)).max(Vec4::ZERO);
        let peak = Vec4::select(area.cmpgt(Vec4::ZERO), excess * self.peak_area, Vec4::ZERO);
        area * (squared + squared * squared * self.evenness + (Vec4::ONE - turn) * self.normal) + peak
    }

    /// How much squared distances count in the least squares problem that lowers [`Self::of_samples`]: its derivative.
    pub fn slopes(&self, area: Vec4, squared: Vec4) -> Vec4 {
        let counts = squared.cmpgt(Vec4::splat(self.peak)) & area.cmpgt(Vec4::ZERO);
        let peak = Vec4::select(counts, Vec4::splat(self.peak_area), Vec4::ZERO);
        area * (Vec4::ONE + squared * (2.0 * self.evenness)) + peak
    }

    /// Of a place on the level that stands for this area, at this squared distance from the source.
    pub fn of_place(&self, area: f32, squared: f32) -> f32 {
        area * squared * (1.0 + squared * self.evenness) + self.peak_area * (squared - self.peak).max(0.0)
    }

    pub fn slope(&self, area: f32, squared: f32) -> f32 {
        area * (1.0 + 2.0 * squared * self.evenness) + if squared > self.peak { self.peak_area } else { 0.0 }
    }

    pub fn of_shape(&self, [a, b, c]: &[Vec3; 3]) -> f32 {
        let edges = a.distance_squared(*b) + b.distance_squared(*c) + c.distance_squared(*a);
        let quality = if edges > 0.0 { 4.0 * 3f32.sqrt() * area(&[*a, *b, *c]) / edges } else { 0.0 };
        let lack = (GOOD_QUALITY - quality) / GOOD_QUALITY;
        if lack > 0.0 { self.needle * lack * lack } else { 0.0 }
    }
}
