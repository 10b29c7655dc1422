//! All meshes together: geometric means of ratios, so that no mesh counts more than another.

use super::Mode;
use super::quality::{Figures, LevelRow, Rival};
use super::report::{MeshBench, Times};
use crate::baseline::Settings;
use crate::report::PosedFigures;
use serde::Serialize;

/// Below these, figures are nothing: rounding of 32-bit positions and normals.
const NO_DISTANCE_PERCENT: f64 = 1e-4;
const NO_ANGLE_DEG: f64 = 1e-2;
const NO_UV: f64 = 1e-6;

/// Ours against meshoptimizer; below 1 ours is better. Times are of whole chains; figures are of every level where
/// meshoptimizer reached our triangle count.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Summary {
    /// Meshes.
    pub meshes: usize,
    /// Levels of all meshes.
    pub levels: usize,
    /// Processor time over that of plain `simplify` calls, each on what the one before left.
    pub chain_time_vs_meshopt_chained: Option<f64>,
    /// The same on the wall.
    pub chain_wall_vs_meshopt_chained: Option<f64>,
    /// Processor time over that of chained `simplifyWithAttributes` calls, over meshes with attributes.
    pub chain_time_vs_meshopt_attributes_chained: Option<f64>,
    /// The same on the wall.
    pub chain_wall_vs_meshopt_attributes_chained: Option<f64>,
    /// Hausdorff distance over plain `simplify`'s.
    pub hausdorff_vs_meshopt: Option<f64>,
    /// RMS distance over plain `simplify`'s.
    pub rms_vs_meshopt: Option<f64>,
    /// Mean angle between face normals over plain `simplify`'s.
    pub normals_vs_meshopt: Option<f64>,
    /// Mean share of our triangles with an angle below 10°.
    pub slivers: Option<f64>,
    /// Mean share of plain `simplify`'s.
    pub slivers_meshopt: Option<f64>,
    /// Triangles of the source that ours takes in a second on the wall, geometric mean.
    pub triangles_per_second: Option<f64>,
    /// Largest peak memory of ours for each vertex of the source.
    pub peak_bytes_per_vertex: Option<f64>,
    /// Ours against the better of the attribute modes, over meshes with attributes.
    pub attributes: Option<AgainstAttributes>,
    /// Ours and every mode of meshoptimizer relative to its plain `simplify`.
    pub modes: Vec<ModeSummary>,
}

/// Figures over reference figures: geometric means, but for the slivers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Ratios {
    /// Hausdorff distance.
    pub hausdorff: Option<f64>,
    /// RMS distance.
    pub rms: Option<f64>,
    /// Mean angle between face normals.
    pub normals: Option<f64>,
    /// Mean angle between interpolated normals, where there are normals.
    pub shading: Option<f64>,
    /// Mean UV distance, where there are UVs.
    pub uv: Option<f64>,
    /// RMS distance in the assets' own poses, where there are poses.
    pub posed_rms: Option<f64>,
    /// Hausdorff distance in them.
    pub posed_hausdorff: Option<f64>,
    /// Mean share of triangles with an angle below 10°; no ratio.
    pub slivers: Option<f64>,
    /// Levels that were compared.
    pub levels: usize,
}

/// Ours or a mode of meshoptimizer relative to its plain `simplify`.
#[derive(Debug, Clone, Serialize)]
pub struct ModeSummary {
    /// The mode's name; `gltf-lod` for ours.
    pub mode: String,
    /// Processor time over that of plain chained calls.
    pub chain_time: Option<f64>,
    /// Time on the wall over that of plain chained calls.
    pub chain_wall: Option<f64>,
    /// Figures over those of plain calls on the source.
    #[serde(flatten)]
    pub ratios: Ratios,
}

/// Ours against the attribute modes (with and without `permissive` and `update`, from the source) that met our count.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct AgainstAttributes {
    /// Against the mode with the smallest RMS distance, chosen for each level.
    pub best_by_rms: Ratios,
    /// Against the best of all modes in each column: no mode has all of these at once.
    pub best_of_each: Ratios,
}

impl Summary {
    pub(super) fn of(meshes: &[MeshBench]) -> Self {
        let levels = || meshes.iter().flat_map(|mesh| &mesh.levels);
        let with_attributes = Mode { settings: Settings { attributes: true, ..Mode::PLAIN.settings }, chained: true };
        let plain = Ratios::of_levels(meshes, |level| Some(&level.ours));
        let time = |mode: Mode, pick: fn(&Times) -> f64| {
            geometric_mean(meshes.iter().filter_map(|mesh| time_ratio(&mesh.ours.times, mesh.times(mode)?, pick)))
        };
        Self {
            meshes: meshes.len(),
            levels: levels().count(),
            chain_time_vs_meshopt_chained: time(Mode::PLAIN.chained(), CPU),
            chain_wall_vs_meshopt_chained: time(Mode::PLAIN.chained(), WALL),
            chain_time_vs_meshopt_attributes_chained: time(with_attributes, CPU),
            chain_wall_vs_meshopt_attributes_chained: time(with_attributes, WALL),
            hausdorff_vs_meshopt: plain.hausdorff,
            rms_vs_meshopt: plain.rms,
            normals_vs_meshopt: plain.normals,
            slivers: mean(levels().map(|level| level.ours.slivers10)),
            slivers_meshopt: mean(levels().filter_map(|level| Some(level.reached(Mode::PLAIN)?.slivers10))),
            triangles_per_second: geometric_mean(meshes.iter().map(|mesh| mesh.ours.triangles_per_second)),
            peak_bytes_per_vertex: meshes
                .iter()
                .filter_map(|mesh| mesh.ours.peak_bytes_per_vertex)
                .max_by(f64::total_cmp),
            attributes: AgainstAttributes::of(meshes),
            modes: summarise_modes(meshes),
        }
    }
}

impl Summary {
    /// Whether anything was measured in poses.
    pub fn has_poses(&self) -> bool {
        self.modes.iter().any(|mode| mode.ratios.posed_rms.is_some())
    }
}

impl AgainstAttributes {
    fn of(meshes: &[MeshBench]) -> Option<Self> {
        let levels = || meshes.iter().flat_map(|mesh| &mesh.levels);
        levels().any(|level| level.attribute_modes().next().is_some()).then(|| {
            let ours = |reference: fn(&LevelRow) -> Option<Figures>| {
                let pairs: Vec<_> = levels().filter_map(|level| Some((level.ours, reference(level)?))).collect();
                Ratios::of(&pairs)
            };
            Self { best_by_rms: ours(find_best_by_rms), best_of_each: ours(find_best_of_each) }
        })
    }
}

impl Ratios {
    /// `pick`'s figures over those of plain `simplify`.
    fn of_levels<'a>(meshes: &'a [MeshBench], pick: impl Fn(&'a LevelRow) -> Option<&'a Figures>) -> Self {
        let levels = meshes.iter().flat_map(|mesh| &mesh.levels);
        let pair = |level: &'a LevelRow| Some((*pick(level)?, *level.reached(Mode::PLAIN)?));
        Self::of(&levels.filter_map(pair).collect::<Vec<_>>())
    }

    /// Each first over its second.
    fn of(pairs: &[(Figures, Figures)]) -> Self {
        let ratios = |nothing: f64, pick: fn(&Figures) -> Option<f64>| {
            let ratio = |(a, b): &(Figures, Figures)| Some(pick(a)?.max(nothing) / pick(b)?.max(nothing));
            geometric_mean(pairs.iter().filter_map(ratio))
        };
        Self {
            hausdorff: ratios(NO_DISTANCE_PERCENT, |f| Some(f.hausdorff_percent)),
            rms: ratios(NO_DISTANCE_PERCENT, |f| Some(f.rms_percent)),
            normals: ratios(NO_ANGLE_DEG, |f| Some(f.normal_deg)),
            shading: ratios(NO_ANGLE_DEG, |f| f.shading_deg),
            uv: ratios(NO_UV, |f| f.uv_mean),
            posed_rms: ratios(NO_DISTANCE_PERCENT, |f| Some(f.posed?.rms_percent)),
            posed_hausdorff: ratios(NO_DISTANCE_PERCENT, |f| Some(f.posed?.hausdorff_percent)),
            slivers: mean(pairs.iter().map(|(a, _)| a.slivers10)),
            levels: pairs.len(),
        }
    }
}

const CPU: fn(&Times) -> f64 = |times| times.cpu;
const WALL: fn(&Times) -> f64 = |times| times.wall;

fn time_ratio(ours: &Times, theirs: &Times, pick: fn(&Times) -> f64) -> Option<f64> {
    let (ours, theirs) = (pick(ours), pick(theirs));
    (ours > 0.0 && theirs > 0.0).then(|| ours / theirs)
}

/// Ours first, then every mode that any mesh has.
fn summarise_modes(meshes: &[MeshBench]) -> Vec<ModeSummary> {
    let summarise = |name: String, ratios: Ratios, times: &dyn Fn(&MeshBench) -> Option<Times>| {
        let time = |pick: fn(&Times) -> f64| {
            let ratio = |mesh: &MeshBench| time_ratio(&times(mesh)?, mesh.times(Mode::PLAIN.chained())?, pick);
            geometric_mean(meshes.iter().filter_map(ratio))
        };
        ModeSummary { mode: name, chain_time: time(CPU), chain_wall: time(WALL), ratios }
    };
    let ours = Ratios::of_levels(meshes, |level| Some(&level.ours));
    let mut modes = vec![summarise(env!("CARGO_PKG_NAME").to_owned(), ours, &|mesh| Some(mesh.ours.times))];
    for mode in Mode::all(meshes.iter().any(|mesh| mesh.has_attributes)) {
        let ratios = Ratios::of_levels(meshes, |level| level.reached(mode));
        modes.push(summarise(mode.name(), ratios, &|mesh| mesh.times(mode).copied()));
    }
    modes
}

fn find_best_by_rms(level: &LevelRow) -> Option<Figures> {
    let by_rms = |a: &&Rival, b: &&Rival| a.figures.rms_percent.total_cmp(&b.figures.rms_percent);
    level.attribute_modes().min_by(by_rms).map(|rival| rival.figures)
}

fn find_best_of_each(level: &LevelRow) -> Option<Figures> {
    let least = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| a.min(b)).or(a).or(b);
    level.attribute_modes().map(|rival| rival.figures).reduce(|a, b| Figures {
        triangles: a.triangles,
        hausdorff_percent: a.hausdorff_percent.min(b.hausdorff_percent),
        rms_percent: a.rms_percent.min(b.rms_percent),
        normal_deg: a.normal_deg.min(b.normal_deg),
        slivers10: a.slivers10.min(b.slivers10),
        shading_deg: least(a.shading_deg, b.shading_deg),
        uv_mean: least(a.uv_mean, b.uv_mean),
        gap_edges: a.gap_edges.min(b.gap_edges),
        flipped: a.flipped.min(b.flipped),
        posed: a.posed.zip(b.posed).map(|(a, b)| PosedFigures {
            poses: a.poses,
            hausdorff_percent: a.hausdorff_percent.min(b.hausdorff_percent),
            rms_percent: a.rms_percent.min(b.rms_percent),
        }),
    })
}

fn geometric_mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    mean(values.map(f64::ln)).map(f64::exp)
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests {
    use super::super::report::{OurTime, RivalTime};
    use super::*;

    fn figures(distance: f64, shading_deg: f64) -> Figures {
        Figures {
            triangles: 10,
            hausdorff_percent: 2.0 * distance,
            rms_percent: distance,
            normal_deg: distance,
            slivers10: distance / 100.0,
            shading_deg: Some(shading_deg),
            uv_mean: None,
            gap_edges: 0,
            flipped: 0,
            posed: None,
        }
    }

    fn mode(attributes: bool, update: bool, chained: bool) -> Mode {
        Mode { settings: Settings { attributes, update, ..Settings::default() }, chained }
    }

    /// A mesh of one level, with ours and every rival as far off as given.
    fn mesh(ours: f64, rivals: &[(Mode, f64, f64, bool)]) -> MeshBench {
        let times = |cpu| Times { cpu, cpu_median: cpu, wall: cpu / 2.0, wall_median: cpu, runs: 1 };
        let row = |&(mode, distance, shading, reached): &(Mode, f64, f64, bool)| Rival {
            mode,
            reached,
            figures: figures(distance, shading),
        };
        let level =
            LevelRow { level: 1, stop: "target", ours: figures(ours, 1.0), meshopt: rivals.iter().map(row).collect() };
        MeshBench {
            file: String::new(),
            mesh: 0,
            name: None,
            triangles: 100,
            vertices: 50,
            has_attributes: true,
            ours: OurTime::new(times(ours), 100, 50, Some(5000)),
            meshopt: rivals.iter().map(|&(mode, cpu, ..)| RivalTime { mode, times: times(cpu) }).collect(),
            levels: vec![level],
        }
    }

    fn is_near(found: Option<f64>, expected: f64) -> bool {
        found.is_some_and(|found| (found - expected).abs() < 1e-12)
    }

    #[test]
    fn meshes_count_alike_and_unequal_counts_not_at_all() {
        let plain =
            |distance, reached| [(Mode::PLAIN, distance, 1.0, reached), (Mode::PLAIN.chained(), 4.0, 1.0, true)];
        let meshes = [mesh(1.0, &plain(2.0, true)), mesh(4.0, &plain(2.0, true)), mesh(8.0, &plain(2.0, false))];
        let summary = Summary::of(&meshes);
        assert_eq!((summary.meshes, summary.levels, summary.modes[0].ratios.levels), (3, 3, 2));
        // 1/2 and 4/2.
        assert!(is_near(summary.rms_vs_meshopt, 1.0) && is_near(summary.hausdorff_vs_meshopt, 1.0), "{summary:?}");
        // 1/4, 4/4 and 8/4: times do not depend on the count.
        assert!(is_near(summary.chain_time_vs_meshopt_chained, 0.5_f64.cbrt()), "{summary:?}");
        assert_eq!(summary.chain_time_vs_meshopt_attributes_chained, None);
        assert!(is_near(summary.slivers, 0.13 / 3.0) && is_near(summary.slivers_meshopt, 0.02), "{summary:?}");
        assert_eq!(summary.peak_bytes_per_vertex, Some(100.0));
        assert!(summary.attributes.is_none());
    }

    #[test]
    fn the_better_attribute_mode_is_one_mode_or_the_best_of_all() {
        let rivals = [
            (Mode::PLAIN, 1.0, 1.0, true),
            (mode(true, false, false), 8.0, 2.0, true),
            (mode(true, true, false), 4.0, 5.0, true),
            (mode(true, true, true), 1.0, 0.1, true),
        ];
        let against = Summary::of(&[mesh(2.0, &rivals)]).attributes.unwrap();
        assert!(is_near(against.best_by_rms.rms, 0.5) && is_near(against.best_by_rms.shading, 0.2), "{against:?}");
        assert!(is_near(against.best_of_each.rms, 0.5) && is_near(against.best_of_each.shading, 0.5), "{against:?}");
        assert_eq!((against.best_by_rms.uv, against.best_by_rms.levels), (None, 1));
    }

    #[test]
    fn nothing_over_nothing_is_one() {
        let none = (figures(0.0, 0.0), figures(0.0, 0.0));
        assert!(is_near(Ratios::of(&[none]).rms, 1.0) && is_near(Ratios::of(&[none]).shading, 1.0));
        assert_eq!(Ratios::of(&[]), Ratios::default());
    }
}
