//! What errors cost: one sum in which distance, its peaks, turned normals and needles are weighed against each other.

use super::level::{Level, area, unit_normal};
use super::step::Step;
use crate::lanes::dot;
use glam::Vec3;
use wide::f32x4;

/// All turned normals together, relative to all distances.
const NORMAL_SHARE: f32 = 0.6;
/// A degenerate face, relative to the mean face.
const NEEDLE_SHARE: f32 = 32.0;
/// Quality from which a shape costs nothing. A smallest angle of 10° is between 0.20 and 0.30.
const GOOD_QUALITY: f32 = 0.45;
/// How much of a shape's price draws points: the way to a good one is long, and distances are known near the point only.
const SHAPE_PULL: f32 = 0.5;
/// Squared distance, relative to the mean, of a peak as long as the largest is not known.
const FIRST_PEAK: f32 = 16.0;
/// Squared distance, relative to the mean, from which none is trusted that was found by walking; peaks never are.
const SUSPICIOUS: f32 = 100.0;
/// Rounding of single precision in the unit frame, squared: below it nothing is worth a change.
const ROUNDING: f32 = 1e-14;

/// In area · squared length of the unit frame.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Prices {
    /// Squared distance from which peaks count, and what its excess costs.
    peak: f32,
    peak_area: f32,
    normal: f32,
    needle: f32,
    /// Area that a face's samples have in the mean.
    face_area: f32,
    mean_square: f32,
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
            let normal = normal.to_array().map(f32x4::splat);
            for four in level.lists.of(f) {
                squares += f64::from((four.weight * four.squared).reduce_add());
                turned += f64::from((four.weight * (f32x4::ONE - dot(four.normal, normal))).reduce_add());
                whole += f64::from(four.weight.reduce_add());
            }
        }
        if !(whole > 0.0 && surface > 0.0) {
            return Self::default();
        }
        let mean_square = ((squares / whole) as f32).max(ROUNDING);
        let face_area = whole as f32 / faces as f32;
        Self {
            peak: FIRST_PEAK * mean_square,
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

    #[cfg(test)]
    pub fn of_normals_and_needles(normal: f32, needle: f32) -> Self {
        Self { normal, needle, ..Self::default() }
    }

    pub fn peak(&self) -> f32 {
        self.peak
    }

    /// Whether a squared distance that was found by walking may be wrong.
    pub fn is_suspicious(&self, squared: f32) -> bool {
        squared > self.peak.min(SUSPICIOUS * self.mean_square)
    }

    /// Of samples of these areas, at these squared distances from faces whose normals have the cosines `turn` to their own.
    pub fn of_samples(&self, area: f32x4, squared: f32x4, turn: f32x4) -> f32x4 {
        let excess = (squared - f32x4::splat(self.peak)).fast_max(f32x4::ZERO);
        let peak = area.simd_gt(f32x4::ZERO) & (excess * f32x4::splat(self.peak_area));
        area * (squared + (f32x4::ONE - turn) * f32x4::splat(self.normal)) + peak
    }

    /// How much squared distances count in the least squares problem that lowers [`Self::of_samples`]: its derivative.
    pub fn slopes(&self, area: f32x4, squared: f32x4) -> f32x4 {
        let counts = squared.simd_gt(f32x4::splat(self.peak)) & area.simd_gt(f32x4::ZERO);
        area + (counts & f32x4::splat(self.peak_area))
    }

    /// Of a place on the level that stands for this area, at this squared distance from the source.
    pub fn of_place(&self, area: f32, squared: f32) -> f32 {
        area * squared + self.peak_area * (squared - self.peak).max(0.0)
    }

    pub fn slope(&self, area: f32, squared: f32) -> f32 {
        area + if squared > self.peak { self.peak_area } else { 0.0 }
    }

    /// Half of this, times a small angle squared and an area, is what turned normals cost there.
    pub fn of_turning(&self) -> f32 {
        self.normal
    }

    /// Of a triangle.
    pub fn of_shape(&self, triangle: &[Vec3; 3]) -> f32 {
        self.of_shapes(f32x4::splat(quality(triangle))).as_array()[0]
    }

    /// Of triangles of these qualities (4√3 · area / Σ edge²: 1 equilateral).
    pub fn of_shapes(&self, quality: f32x4) -> f32x4 {
        let lack = (f32x4::ONE - quality * f32x4::splat(1.0 / GOOD_QUALITY)).fast_max(f32x4::ZERO);
        lack * lack * f32x4::splat(self.needle)
    }

    /// Draws a point to where the shape of a triangle of this quality is good; `rise`: the gradient of its quality.
    pub fn draw_to_shape(&self, step: &mut Step, quality: f32, rise: Vec3) {
        let lack = 1.0 - quality / GOOD_QUALITY;
        if lack > 0.0 {
            step.add_pull(rise / GOOD_QUALITY, lack, SHAPE_PULL * self.needle);
        }
    }
}

fn quality(triangle: &[Vec3; 3]) -> f32 {
    let [a, b, c] = triangle;
    let edges = a.distance_squared(*b) + b.distance_squared(*c) + c.distance_squared(*a);
    if edges > 0.0 { 4.0 * 3f32.sqrt() * area(triangle) / edges } else { 0.0 }
}
