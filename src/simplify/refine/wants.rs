//! What moves cost in attributes: where all is flat distances do not speak for an edge, but normals, colours and textures may.

use super::attributes::{SourceAttributes, blend_rows};
use super::level::Level;
use super::source::closest_point;
use glam::Vec3;

/// Share by which attributes may be farther off after a move for nothing: values are fitted to the samples later.
const SPREAD: f32 = 0.3;

/// What samples want of the source's attributes, and how much that counts.
pub(super) struct Wants<'a> {
    pub source: &'a SourceAttributes,
    /// See [`Metric::scales`](crate::attributes::Metric::scales).
    pub scales: Vec<(usize, f32)>,
}

/// Faces by the places of their corners, and their wedges.
pub(super) type Faces<'a> = (&'a [[Vec3; 3]], &'a [[u32; 3]]);

impl Wants<'_> {
    /// What it costs in attributes that some of the level's faces, which are `old`, become `new`: by their samples.
    pub fn harm(&self, level: &Level, faces: &[usize], old: Faces, new: Faces) -> f32 {
        let here = &level.surface.wedges;
        let group = here.group(old.1[0][0]);
        let [mut before, mut after] = [0.0; 2];
        for s in faces.iter().flat_map(|&face| level.lists.samples(face)) {
            let sample = &level.source.samples[s as usize];
            if self.source.group(sample.face) != group {
                continue;
            }
            let wanted = self.source.row_at(level.source, s);
            for ((triangles, wedges), cost) in [(old, &mut before), (new, &mut after)] {
                let near = triangles.iter().zip(wedges).map(|(&triangle, &wedges)| {
                    let (foot, shares, _) = closest_point(triangle, sample.position);
                    (foot.distance_squared(sample.position), shares, wedges)
                });
                let Some((_, shares, wedges)) = near.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
                let now = blend_rows(here, wedges, shares);
                let off = |&(i, scale): &(usize, f32)| (scale * (wanted[i] - now[i])).powi(2);
                *cost += sample.weight * self.scales.iter().map(off).sum::<f32>();
            }
        }
        if after > before * (1.0 + SPREAD) { after - before } else { 0.0 }
    }
}
