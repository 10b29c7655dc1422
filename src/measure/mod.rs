//! The ruler: how far a level is from its source. The same code measures our levels and the baseline's.

use crate::mesh::Mesh;

/// A source mesh made ready for measuring many levels against it.
#[derive(Debug)]
pub struct Ruler {}

/// How to sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sampling {
    /// Area-uniform samples on each of the two surfaces, besides all vertices and border points.
    pub samples: usize,
    /// Seed of the sampling.
    pub seed: u64,
}

/// One direction of a distance: object units.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Distance {
    /// Largest distance over samples, vertices, borders and a lattice on the worst faces.
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
        Self { samples: 50_000, seed: 0x5eed }
    }
}

impl Ruler {
    /// Prepares `source`: welds it, samples it, builds its tree.
    pub fn new(_source: &Mesh, _sampling: Sampling) -> Self {
        Self {}
    }

    /// Measures `level` against the source.
    pub fn measure(&self, _level: &Mesh) -> Measurement {
        Measurement::default()
    }
}
