//! The ruler: every level of ours, and meshoptimizer's at the same triangle count in each of its modes.

use super::Mode;
use crate::baseline::{Baseline, Prepared, simplify_with};
use crate::error::Result;
use crate::measure::{Measurement, Ruler};
use crate::report::{PosedFigures, name_stop};
use crate::simplify::Chain;
use rayon::prelude::*;
use serde::Serialize;

/// What is compared of a level. Lower is better throughout.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    /// Triangles.
    pub triangles: usize,
    /// Two-sided Hausdorff distance, percent of the source's diagonal.
    pub hausdorff_percent: f64,
    /// Two-sided RMS distance, percent of the source's diagonal.
    pub rms_percent: f64,
    /// Mean angle between face normals, degrees.
    pub normal_deg: f64,
    /// Share of triangles with a minimum angle below 10°.
    pub slivers10: f64,
    /// Mean angle between interpolated normals, degrees; `None` without normals.
    pub shading_deg: Option<f64>,
    /// Mean UV distance; `None` without UVs.
    pub uv_mean: Option<f64>,
    /// Open edges that the source does not have.
    pub gap_edges: usize,
    /// Faces that look the other way.
    pub flipped: usize,
    /// Distances in the asset's own poses, if it has any.
    pub posed: Option<PosedFigures>,
}

/// One level.
#[derive(Debug, Clone, Serialize)]
pub struct LevelRow {
    /// Position in the chain, from 1.
    pub level: usize,
    /// Why ours has the triangles it has.
    pub stop: &'static str,
    /// Ours.
    pub ours: Figures,
    /// meshoptimizer's, in every mode.
    pub meshopt: Vec<Rival>,
}

/// A mode of meshoptimizer at our triangle count.
#[derive(Debug, Clone, Serialize)]
pub struct Rival {
    /// Its mode.
    pub mode: Mode,
    /// Whether it met the count, so that it may be compared.
    pub reached: bool,
    /// Its figures.
    pub figures: Figures,
}

impl Figures {
    fn of(measured: &Measurement) -> Self {
        let percent = |distance: f64| if measured.diagonal > 0.0 { distance / measured.diagonal * 100.0 } else { 0.0 };
        Self {
            triangles: measured.triangles,
            hausdorff_percent: percent(measured.hausdorff()),
            rms_percent: percent(measured.rms()),
            normal_deg: measured.normal_deg,
            slivers10: measured.slivers10,
            shading_deg: measured.shading_deg,
            uv_mean: measured.uv_mean,
            gap_edges: measured.gap_edges,
            flipped: measured.flipped,
            posed: PosedFigures::of(measured),
        }
    }
}

impl LevelRow {
    /// The figures of `mode`, if it met the count.
    pub fn reached(&self, mode: Mode) -> Option<&Figures> {
        self.meshopt.iter().find(|rival| rival.mode == mode && rival.reached).map(|rival| &rival.figures)
    }

    /// Those attribute modes, from the source, that met the count.
    pub fn attribute_modes(&self) -> impl Iterator<Item = &Rival> {
        let counts = |rival: &&Rival| rival.mode.settings.attributes && !rival.mode.chained && rival.reached;
        self.meshopt.iter().filter(counts)
    }
}

/// Measures the levels of `chain` and all of their rivals.
pub(super) fn compare_levels(
    chain: &Chain,
    prepared: &Prepared,
    modes: &[Mode],
    ruler: &Ruler,
) -> Result<Vec<LevelRow>> {
    let counts: Vec<usize> = chain.levels.iter().map(|level| level.mesh.triangles.len()).collect();
    let ours = || chain.levels.par_iter().map(|level| Figures::of(&ruler.measure(&level.mesh))).collect::<Vec<_>>();
    let theirs = || modes.par_iter().map(|mode| measure_mode(*mode, prepared, &counts, ruler)).collect();
    let (ours, theirs): (_, Result<Vec<Vec<Rival>>>) = rayon::join(ours, theirs);
    let theirs = theirs?;
    let row = |(index, figures): (usize, Figures)| LevelRow {
        level: index + 1,
        stop: name_stop(chain.levels[index].stop),
        ours: figures,
        meshopt: theirs.iter().map(|levels| levels[index].clone()).collect(),
    };
    Ok(ours.into_iter().enumerate().map(row).collect())
}

fn measure_mode(mode: Mode, prepared: &Prepared, counts: &[usize], ruler: &Ruler) -> Result<Vec<Rival>> {
    let mut before: Option<Baseline> = None;
    let mut rivals = Vec::new();
    for &count in counts {
        let result = match before.filter(|_| mode.chained) {
            Some(finer) => simplify_with(&finer.mesh, count, mode.settings)?,
            None => prepared.run(count, mode.settings)?,
        };
        let figures = Figures::of(&ruler.measure(&result.mesh));
        rivals.push(Rival { mode, reached: result.reached, figures });
        before = Some(result);
    }
    Ok(rivals)
}
