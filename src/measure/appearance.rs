//! What the eye compares besides the silhouette: orientation, shading normals, texture coordinates.

use super::Measurement;
use super::surface::Surface;
use crate::bvh::{Bvh, Hit};
use crate::mesh::{Attribute, Mesh, Semantic};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Faces nearer to each other than this share of the diagonal are two sides of one sheet.
const SHEET: f64 = 1e-6;

/// Cosine between the normals of two sides of a sheet: at most this.
const BACK_TO_BACK: f64 = -0.999;

/// How far from the closest point, as a share of the diagonal, a better match of the texture coordinates is looked
/// for: a pixel where the object fills a thousand.
const SEAM_REACH: f64 = 1e-3;

/// Attributes of the source at its samples.
#[derive(Debug, Default)]
pub struct Appearance {
    groups: Vec<u32>,
    normals: Option<Vec<DVec3>>,
    tex_coords: Option<Vec<DVec2>>,
    /// Length in UV units of a unit of surface, over all.
    tex_coord_density: f64,
}

impl Appearance {
    pub fn new(source: &Mesh, surface: &Surface) -> Self {
        let at_samples = |attribute: &Attribute| -> Vec<DVec3> {
            let value =
                |s: &super::sample::Sample| interpolate(attribute, &source.triangles, s.triangle, s.barycentric);
            surface.samples.iter().map(value).collect()
        };
        let tex_coords = source.attribute(Semantic::TexCoord(0));
        Self {
            groups: surface.samples.iter().map(|s| source.group(s.triangle as usize)).collect(),
            normals: source.attribute(Semantic::Normal).map(at_samples),
            tex_coords: tex_coords.map(|uv| at_samples(uv).into_iter().map(DVec3::truncate).collect()),
            tex_coord_density: tex_coords.map_or(0.0, |uv| measure_density(uv, source, surface)),
        }
    }

    /// Fills in the angles and texture coordinate distances of `level`; `hits` are the points of `to`, the surface of
    /// `level`, closest to the samples of `from`.
    pub fn compare(
        &self,
        from: &Surface,
        level: &Mesh,
        to: &Surface,
        hits: &[Hit],
        diagonal: f64,
        result: &mut Measurement,
    ) {
        let normal = |i: usize| from.normals[from.samples[i].triangle as usize];
        let hits: Vec<Hit> = hits
            .par_iter()
            .enumerate()
            .map(|(i, hit)| choose_side(*hit, from.samples[i].point, normal(i), &to.bvh, &to.normals, diagonal))
            .collect();
        let mut angles: Vec<f64> =
            hits.iter().enumerate().map(|(i, hit)| angle(normal(i), to.normals[hit.triangle as usize])).collect();
        result.normal_deg = mean(&angles);
        result.normal_p95_deg = percentile(&mut angles, 0.95);
        if let (Some(normals), Some(attribute)) = (&self.normals, level.attribute(Semantic::Normal)) {
            result.shading_deg = compare_normals(normals, attribute, level, &hits);
        }
        if let (Some(tex_coords), Some(attribute)) = (&self.tex_coords, level.attribute(Semantic::TexCoord(0))) {
            let points: Vec<DVec3> = from.samples.iter().map(|s| s.point).collect();
            let mut distances =
                self.compare_tex_coords(tex_coords, &points, attribute, level, &to.bvh, &hits, diagonal);
            if !distances.is_empty() {
                result.uv_mean = Some(mean(&distances));
                result.uv_p95 = Some(percentile(&mut distances, 0.95));
            }
        }
    }

    /// UV distance at the closest point of the same group. Where that is more than a pixel's worth of UV away, it may
    /// lie across a seam: then the best match within a pixel counts. Samples with no such point are left out.
    #[allow(clippy::too_many_arguments)]
    fn compare_tex_coords(
        &self,
        tex_coords: &[DVec2],
        points: &[DVec3],
        attribute: &Attribute,
        level: &Mesh,
        bvh: &Bvh,
        hits: &[Hit],
        diagonal: f64,
    ) -> Vec<f64> {
        let reach = SEAM_REACH * diagonal;
        let pixel = reach * self.tex_coord_density;
        let distance = |i: usize, hit: &Hit| {
            let same_group = level.group(hit.triangle as usize) == self.groups[i];
            let uv = || interpolate(attribute, &level.triangles, hit.triangle, hit.barycentric).truncate();
            same_group.then(|| uv().distance(tex_coords[i]))
        };
        let at_best = |(i, hit): (usize, &Hit)| {
            let mut best = distance(i, hit);
            if best.is_none_or(|d| d > pixel) {
                bvh.visit_within(points[i], hit.distance() + reach, |near| {
                    best = [best, distance(i, &near)].into_iter().flatten().reduce(f64::min);
                });
            }
            best
        };
        let found: Vec<Option<f64>> = hits.par_iter().enumerate().map(at_best).collect();
        found.into_iter().flatten().collect()
    }
}

/// The hit on the side of a sheet that looks along `normal`: where two faces lie back to back, which of the two is
/// closest is chance. Faces that merely share an edge are left alone.
pub fn choose_side(hit: Hit, point: DVec3, normal: DVec3, bvh: &Bvh, normals: &[DVec3], diagonal: f64) -> Hit {
    let back = normals[hit.triangle as usize];
    if back.dot(normal) >= 0.0 {
        return hit;
    }
    let mut best: Option<Hit> = None;
    bvh.visit_within(point, hit.distance() + SHEET * diagonal, |near| {
        if normals[near.triangle as usize].dot(back) < BACK_TO_BACK
            && best.as_ref().is_none_or(|best| near.precedes(best))
        {
            best = Some(near);
        }
    });
    best.unwrap_or(hit)
}

fn compare_normals(normals: &[DVec3], attribute: &Attribute, level: &Mesh, hits: &[Hit]) -> Option<f64> {
    let angles: Vec<f64> = hits
        .iter()
        .zip(normals)
        .map(|(hit, &normal)| (normal, interpolate(attribute, &level.triangles, hit.triangle, hit.barycentric)))
        .filter(|(a, b)| a.length_squared() > 0.0 && b.length_squared() > 0.0)
        .map(|(a, b)| angle(a.normalize(), b.normalize()))
        .collect();
    (!angles.is_empty()).then(|| mean(&angles))
}

/// Up to three numbers of an attribute inside a triangle, the others 0.
fn interpolate(attribute: &Attribute, triangles: &[[u32; 3]], triangle: u32, barycentric: [f64; 3]) -> DVec3 {
    let width = attribute.width.min(3);
    let mut value = [0.0; 3];
    for (&vertex, weight) in triangles[triangle as usize].iter().zip(barycentric) {
        let start = vertex as usize * attribute.width;
        for (sum, &x) in value.iter_mut().zip(&attribute.values[start..start + width]) {
            *sum += f64::from(x) * weight;
        }
    }
    DVec3::from(value)
}

fn measure_density(attribute: &Attribute, mesh: &Mesh, surface: &Surface) -> f64 {
    let tex_coord_area = |t: usize| {
        let corner =
            |k| interpolate(attribute, &mesh.triangles, t as u32, [0, 1, 2].map(|i| f64::from(u8::from(i == k))));
        let [a, b, c] = [corner(0), corner(1), corner(2)].map(DVec3::truncate);
        (b - a).perp_dot(c - a).abs() / 2.0
    };
    let area: f64 = surface.areas.iter().sum();
    let tex_coords: f64 = (0..mesh.triangles.len()).map(tex_coord_area).sum();
    if area > 0.0 { (tex_coords / area).sqrt() } else { 0.0 }
}

/// Degrees; 90 against a zero normal.
fn angle(a: DVec3, b: DVec3) -> f64 {
    if a == DVec3::ZERO || b == DVec3::ZERO { 90.0 } else { a.cross(b).length().atan2(a.dot(b)).to_degrees() }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Linear between the two nearest ranks; 0 for no values.
fn percentile(values: &mut [f64], share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let rank = share * values.len().saturating_sub(1) as f64;
    let at = |i: usize| values.get(i).or(values.last()).copied().unwrap_or(0.0);
    let below = rank.floor();
    at(below as usize) + (at(below as usize + 1) - at(below as usize)) * (rank - below)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_interpolate() {
        assert_eq!(percentile(&mut [3.0, 1.0, 2.0], 0.75), 2.5);
        assert_eq!(percentile(&mut [3.0, 1.0, 2.0], 1.0), 3.0);
        assert_eq!(percentile(&mut [], 0.95), 0.0);
    }
}
