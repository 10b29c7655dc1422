//! The ruler: how far a level is from its source. The same code measures our levels and the baseline's.
//!
//! Distances are exact point-to-triangle distances in f64, in both directions: means from area-uniform stratified
//! samples, maxima from these and besides all vertices, points along the borders, all centroids and a lattice on the
//! worst faces. A given source, level and sampling always give the same numbers, whatever the number of threads.
//!
//! Limits: a maximum between the points looked at is missed. Means carry the noise of the sampling: at 50 000 samples
//! below 1 % where the error is spread out, up to 5 % where it sits on a few spots of a large surface.

mod appearance;
mod distance;
mod gaps;
mod posed;
mod quality;
mod sample;
mod surface;
mod topology;

use crate::bvh::Bvh;
use crate::mesh::{Mesh, Pose};
use appearance::Appearance;
use distance::{mean_square, measure_distance};
use posed::PosedRuler;
use rayon::prelude::*;
use surface::Surface;

/// A source mesh made ready for measuring many levels against it.
#[derive(Debug)]
pub struct Ruler {
    sampling: Sampling,
    source: Surface,
    appearance: Appearance,
    border: Option<Bvh>,
    diagonal: f64,
    bounding_radius: f64,
    poses: Vec<PosedRuler>,
}

/// How to sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sampling {
    /// Area-uniform samples on each of the two surfaces.
    pub samples: usize,
    /// Seed of the sampling.
    pub seed: u64,
}

/// One direction of a distance: object units.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Distance {
    /// Largest distance over samples, vertices, borders, centroids and a lattice on the worst faces.
    pub max: f64,
    /// Root mean square over the area-uniform samples.
    pub rms: f64,
    /// Mean over the area-uniform samples.
    pub mean: f64,
}

/// What the ruler says of a level. Distances in object units; divide by `diagonal` for the relative figure.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Measurement {
    /// Triangles of the level.
    pub triangles: usize,
    /// Vertices of the level (wedges, as stored).
    pub vertices: usize,
    /// Diagonal of the source's bounding box.
    pub diagonal: f64,
    /// Source surface to level.
    pub to_level: Distance,
    /// Level to source surface.
    pub to_source: Distance,
    /// Mean angle between face normals, source samples to their closest points, degrees.
    pub normal_deg: f64,
    /// 95th percentile of that angle.
    pub normal_p95_deg: f64,
    /// Mean angle between interpolated vertex normals, degrees; `None` without normals.
    pub shading_deg: Option<f64>,
    /// Mean distance of UV set 0 at the closest points, UV units; `None` without UVs.
    pub uv_mean: Option<f64>,
    /// 95th percentile of that distance.
    pub uv_p95: Option<f64>,
    /// Share of triangles with a minimum angle below 5°.
    pub slivers5: f64,
    /// Share of triangles with a minimum angle below 10°.
    pub slivers10: f64,
    /// Faces whose nearest source face looks the other way.
    pub flipped: usize,
    /// Faces without area, or with a corner twice.
    pub degenerate: usize,
    /// Edges of more than two faces, on welded positions.
    pub nonmanifold_edges: usize,
    /// Open edges that have no counterpart among the source's open edges: cracks.
    pub gap_edges: usize,
    /// Distances in the asset's own poses, if it has any and the ruler knows them.
    pub posed: Option<Posed>,
}

/// How far a level is from its source in the same poses: extremes of morph targets, moments of animations. Object units, rigid motion and scale of
/// the pose taken out.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Posed {
    /// Poses that were measured.
    pub poses: usize,
    /// Two-sided RMS distance, root mean square over the poses.
    pub rms: f64,
    /// Largest distance in any of them, over samples and vertices.
    pub hausdorff: f64,
}

impl Measurement {
    /// Two-sided Hausdorff distance, object units.
    pub fn hausdorff(&self) -> f64 {
        self.to_level.max.max(self.to_source.max)
    }

    /// Two-sided RMS distance (root mean square of both directions), object units.
    pub fn rms(&self) -> f64 {
        ((self.to_level.rms.powi(2) + self.to_source.rms.powi(2)) / 2.0).sqrt()
    }

    /// Two-sided mean distance (mean of both directions), object units.
    pub fn mean(&self) -> f64 {
        (self.to_level.mean + self.to_source.mean) / 2.0
    }
}

impl Default for Sampling {
    fn default() -> Self {
        Self { samples: 100_000, seed: 0x5eed }
    }
}

impl Sampling {
    /// As many samples as a mesh of this size needs: 16 a triangle, but no fewer than 30 000 and no more than the
    /// default. Means then carry 1 to 2 % of noise; more only where all of a small error sits on a few spots.
    pub fn for_triangles(triangles: usize) -> Self {
        let full = Self::default();
        Self { samples: triangles.saturating_mul(16).clamp(30_000, full.samples), ..full }
    }
}

impl Ruler {
    /// Prepares `source`: welds it, samples it, builds its tree.
    ///
    /// # Panics
    /// When an index is out of range or an attribute's array is too short. Positions must be finite.
    pub fn new(source: &Mesh, sampling: Sampling) -> Self {
        let surface = Surface::new(source, sampling);
        let (diagonal, bounding_radius) = measure_extent(&surface);
        Self {
            sampling,
            appearance: Appearance::new(source, &surface),
            border: gaps::grow_border_tree(source, &surface.topology),
            source: surface,
            diagonal,
            bounding_radius,
            poses: Vec::new(),
        }
    }

    /// The same ruler, which measures levels in these poses as well; `source` is what it was made of.
    #[must_use]
    pub fn with_poses(self, source: &Mesh, poses: Vec<Pose>) -> Self {
        let poses = poses.into_par_iter().map(|pose| PosedRuler::new(source, pose, self.sampling)).collect();
        Self { poses, ..self }
    }

    /// Measures `level` against the source. Figures that cannot be had are 0 or `None`, never NaN; of two empty
    /// meshes all are. If only the level is empty, the distances to it are the source's diagonal: everything that was
    /// there is gone. The same the other way round, with the level's diagonal.
    ///
    /// Where the level has faces back to back, the one that looks the source's way counts for angles and flips. UV
    /// distances are taken within the same group; where the closest point may lie across a seam, the best match
    /// within 0.1 % of the diagonal counts.
    ///
    /// # Panics
    /// When an index is out of range or an attribute's array is too short. Positions must be finite.
    pub fn measure(&self, level: &Mesh) -> Measurement {
        let surface = Surface::new(level, self.sampling);
        let mut result = Measurement {
            triangles: level.triangles.len(),
            vertices: level.positions.len(),
            diagonal: self.diagonal,
            nonmanifold_edges: surface.topology.nonmanifold_edges,
            ..Measurement::default()
        };
        match (self.source.triangles.is_empty(), level.triangles.is_empty()) {
            (true, true) => {}
            (false, true) => result.to_level = Distance::everywhere(self.diagonal),
            (true, false) => result.to_source = Distance::everywhere(measure_extent(&surface).0),
            (false, false) => self.compare(level, &surface, &mut result),
        }
        result
    }

    /// Two-sided RMS distance over a tenth of the samples: enough to choose among candidates, not to report. Infinite
    /// where one of the meshes is empty.
    ///
    /// # Panics
    /// When an index is out of range. Positions must be finite.
    pub fn rough_rms(&self, level: &Mesh) -> f64 {
        const SHARE: usize = 10;
        let sampling = Sampling { samples: self.sampling.samples / SHARE, ..self.sampling };
        let surface = Surface::new(level, sampling);
        if self.source.triangles.is_empty() || surface.triangles.is_empty() {
            return f64::INFINITY;
        }
        let thinned: Vec<_> = self.source.samples.iter().step_by(SHARE).copied().collect();
        let (to_level, to_source) =
            (mean_square(&thinned, &surface.bvh), mean_square(&surface.samples, &self.source.bvh));
        ((to_level + to_source) / 2.0).sqrt()
    }

    /// Length of the diagonal of the source's bounding box, over the vertices that triangles use; 0 for an empty
    /// source.
    pub fn diagonal(&self) -> f64 {
        self.diagonal
    }

    /// Radius of the sphere about the centre of the source's bounding box that just holds the source; at most half the
    /// diagonal. 0 for an empty source.
    pub fn bounding_radius(&self) -> f64 {
        self.bounding_radius
    }

    fn compare(&self, level: &Mesh, surface: &Surface, result: &mut Measurement) {
        let (to_level, hits) = measure_distance(&self.source, &surface.bvh, self.diagonal);
        result.to_level = to_level;
        result.to_source = measure_distance(surface, &self.source.bvh, self.diagonal).0;
        self.appearance.compare(&self.source, level, surface, &hits, self.diagonal, result);
        quality::judge_faces(&self.source, surface, self.diagonal, result);
        result.posed = posed::measure(&self.poses, level);
        result.gap_edges = gaps::count_gaps(
            &self.source.border,
            self.border.as_ref(),
            level,
            &surface.topology,
            result.hausdorff(),
            self.diagonal,
        );
    }
}

impl Distance {
    fn everywhere(distance: f64) -> Self {
        Self { max: distance, rms: distance, mean: distance }
    }
}

/// Diagonal of the bounding box, and radius of the bounding sphere about the box's centre.
fn measure_extent(surface: &Surface) -> (f64, f64) {
    let points = &surface.vertices;
    let Some((lo, hi)) = points.iter().map(|&p| (p, p)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))) else {
        return (0.0, 0.0);
    };
    let centre = (lo + hi) / 2.0;
    let radius = points.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
    (lo.distance(hi), radius)
}

#[cfg(test)]
mod tests;
