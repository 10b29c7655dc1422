//! Grids for what is not of the source: fine enough to be unseen beside the source's edges, coarse enough to cost a byte.

use crate::mesh::{Mesh, Semantic};

/// Exponents of the steps of a mesh's numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Steps {
    /// Of positions.
    pub position: Option<i8>,
    /// Of each attribute; none where values must stay what they are.
    pub attributes: Vec<Option<i8>>,
}

/// Steps in the mean difference along an edge of the source.
const STEPS_AN_EDGE: f64 = 64.0;
/// The step is no more than this share of the largest value: unit vectors have to stay such.
const LARGEST_SHARE: f64 = 1.0 / 512.0;
/// A value has no more than 2²³ steps, so that a float holds every multiple.
const SMALLEST_SHARE: f64 = 1.0 / 8_388_608.0;

impl Steps {
    /// The steps for what is made from `source`.
    pub fn of(source: &Mesh) -> Self {
        let step = |semantic, width, values: &[f32]| match semantic {
            Semantic::Id => None,
            _ => choose_step(source, width, values),
        };
        let attributes = source.attributes.iter().map(|a| step(a.semantic, a.width, &a.values)).collect();
        Self { position: choose_step(source, 3, source.positions.as_flattened()), attributes }
    }
}

fn choose_step(source: &Mesh, width: usize, values: &[f32]) -> Option<i8> {
    let row = |v: u32| &values[v as usize * width..][..width];
    let difference = |a: u32, b: u32| {
        let along = row(a).iter().zip(row(b)).map(|(x, y)| f64::from(x - y).abs());
        along.fold(0.0, f64::max)
    };
    let edges = source.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    let sum: f64 = edges.map(|(a, b)| difference(a, b)).sum();
    let mean = sum / (3 * source.triangles.len()).max(1) as f64;
    let used = source.triangles.iter().flatten().flat_map(|&v| row(v));
    let largest = used.fold(0.0f64, |most, &x| most.max(f64::from(x).abs()));
    let step = (mean / STEPS_AN_EDGE).clamp(largest * SMALLEST_SHARE, largest * LARGEST_SHARE);
    // 2⁻¹⁰⁰ is nothing, and far from where floats end.
    (step > 0.0).then(|| step.log2().floor().clamp(-100.0, 100.0) as i8)
}
