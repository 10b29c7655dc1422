//! The distance of a level from its source in poses.

use super::distance::measure_roughly;
use super::surface::Surface;
use super::{Posed, Sampling};
use crate::mesh::{Mesh, Pose};
use rayon::prelude::*;

/// There are several poses: each gets this share of the samples.
const SHARE: usize = 8;

/// The source in a pose.
#[derive(Debug)]
pub struct PosedRuler {
    pose: Pose,
    sampling: Sampling,
    source: Surface,
}

impl PosedRuler {
    pub fn new(source: &Mesh, pose: Pose, sampling: Sampling) -> Self {
        let sampling = Sampling { samples: sampling.samples / SHARE, ..sampling };
        Self { source: Surface::new(&pose.posed(source), sampling), pose, sampling }
    }
}

/// Of a level with triangles.
pub fn measure(rulers: &[PosedRuler], level: &Mesh) -> Option<Posed> {
    let measure = |ruler: &PosedRuler| {
        let level = Surface::new(&ruler.pose.posed(level), ruler.sampling);
        let to_level = measure_roughly(&ruler.source, &level.bvh);
        let to_source = measure_roughly(&level, &ruler.source.bvh);
        ((to_level.0 + to_source.0) / 2.0, to_level.1.max(to_source.1))
    };
    let found: Vec<(f64, f64)> = rulers.par_iter().map(measure).collect();
    let square = found.iter().map(|(square, _)| square).sum::<f64>() / found.len().max(1) as f64;
    let hausdorff = found.iter().map(|(_, max)| *max).fold(0.0, f64::max);
    (!found.is_empty()).then_some(Posed { poses: found.len(), rms: square.sqrt(), hausdorff })
}
