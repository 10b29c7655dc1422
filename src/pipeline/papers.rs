//! The papers' tables, made again: their models where they are at hand, ours in their units, times as ratios on this machine.
//!
//! A model that is missing is replaced by a made one of as many triangles: it fills the row and says so, but counts for no claim. Errors come
//! first, on all threads: one run of each way serves all counts. Then times, of one reduction after the other on one thread, in turn.

use super::train::read_models;
use super::{Observer, run_on_threads};
use crate::asset::Limits;
use crate::error::Result;
use crate::measure::{Ruler, Sampling};
use crate::mesh::Mesh;
use crate::predictor::{CLASSES, Reduction, Shape, builtin};
use crate::report::papers::{
    CurvatureRow, PapersReport, PickRow, PublishedQfvp, QfvpRow, ReductionRow, SpeedRow, Subject, UpdateRow,
};
use crate::shapes;
use crate::simplify::{Algorithm, FeatureWeight, Mode, NormalUpdate, Options, Schedule, Target, simplify};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What to compare.
#[derive(Debug, Clone)]
pub struct PapersOptions {
    /// Directory with `cow.glb`, `stanford-bunny.glb` and others; made models stand in for all that is missing.
    pub models: Option<PathBuf>,
    /// Rounds of timing, of which the fastest counts.
    pub runs: usize,
    /// Leaves out models above this many triangles: a quick look.
    pub most_triangles: usize,
    /// Bounds on what is read.
    pub limits: Limits,
}

/// A clock: the library reads none itself. CPU time of the process is best, as others on the machine hardly disturb it.
pub type Clock<'a> = &'a (dyn Fn() -> Duration + Sync);

/// A model of the papers: the file's name, its triangles there, where we measure it.
struct Known {
    name: &'static str,
    file: &'static str,
    triangles: usize,
}

const COW: Known = Known { name: "cow", file: "cow.glb", triangles: 5804 };
const BUNNY: Known = Known { name: "bunny", file: "stanford-bunny.glb", triangles: 69451 };
/// Not in the papers: more models for times and for w.
const OTHERS: [Known; 3] = [
    Known { name: "spot", file: "spot.glb", triangles: 5856 },
    Known { name: "fandisk", file: "fandisk.glb", triangles: 12946 },
    Known { name: "rocker arm", file: "rocker-arm.glb", triangles: 20088 },
];

/// ESQEM's counts for the cow (its table 1).
const ESQEM_COUNTS: [usize; 4] = [2436, 1554, 1000, 424];
/// QFVP, table 1: model, triangles, Hausdorff distance for each w.
const QFVP_TABLE: [(&Known, usize, [f64; 5]); 4] = [
    (&COW, 1161, [0.024733, 0.028809, 0.020492, 0.036881, 0.051415]),
    (&COW, 581, [0.048358, 0.032823, 0.055442, 0.112377, 0.064680]),
    (&BUNNY, 13891, [0.004618, 0.005632, 0.008788, 0.009180, 0.009821]),
    (&BUNNY, 6946, [0.006265, 0.008224, 0.009154, 0.010427, 0.009315]),
];
/// QFVP, tables 2, 4 and 5. None of these models is at hand.
const QFVP_PUBLISHED: [PublishedQfvp; 4] = [
    PublishedQfvp::new("cat", 671, 87, [0.195, 0.431, 0.210], [0.028994, 0.039878, 0.024457]),
    PublishedQfvp::new("car", 10474, 716, [3.782, 9.155, 4.020], [0.039553, 0.211860, 0.030573]),
    PublishedQfvp::new("apple", 1704, 144, [0.588, 1.603, 0.630], [0.005037, 0.005143, 0.004262]),
    PublishedQfvp::new("dragon", 871_414, 2252, [362.872, 797.356, 392.816], [0.003579, 0.011230, 0.002699]),
];
/// FMS, §4: model and triangles.
const FMS_COUNTS: [(&Known, usize); 2] = [(&COW, 2804), (&BUNNY, 9589)];
/// Exponents beyond those that the paper looks at.
const BEYOND: [f64; 2] = [2.5, 3.0];
/// What is timed takes at least about this long.
const LEAST_TIMED: Duration = Duration::from_millis(50);
/// Most reductions that are timed together.
const MOST_REPEATS: u128 = 20;

/// Makes the papers' tables.
///
/// # Errors
/// Everything that keeps a model's file from being read; a file that is not there is no error.
pub fn papers(options: &PapersOptions, clock: Clock<'_>, observer: &dyn Observer) -> Result<PapersReport> {
    let mut report = PapersReport { published: QFVP_PUBLISHED.to_vec(), ..PapersReport::default() };
    let known: Vec<&Known> = [&COW, &BUNNY].into_iter().chain(&OTHERS).collect();
    let (known, too_large): (Vec<_>, Vec<_>) = known.into_iter().partition(|k| k.triangles <= options.most_triangles);
    report.left_out = too_large.iter().map(|k| k.name).collect();
    let models = known.into_iter().map(|known| Model::open(known, options)).collect::<Result<Vec<_>>>()?;
    let mut models: Vec<Model> = models.into_iter().flatten().collect();
    // Everything is done in two turns, of a weight each that goes by triangles.
    let weight = |model: &Model| model.mesh.triangles.len() as u64;
    observer.found(2 * models.len(), 2 * models.iter().map(weight).sum::<u64>());
    run_on_threads(None, || {
        models.iter_mut().try_for_each(|model| {
            observer.asset_started(model.known.name);
            model.measure()?;
            observer.asset_benched(&format!("{}: errors", model.known.name), weight(model));
            Ok(())
        })
    })??;
    // One thread: the papers have one.
    run_on_threads(Some(1), || {
        models.iter().try_for_each(|model| {
            observer.asset_started(model.known.name);
            model.fill_in(&mut report, options.runs, clock)?;
            observer.asset_benched(&format!("{}: times", model.known.name), weight(model));
            Ok(())
        })
    })??;
    report.check_claims();
    Ok(report)
}

/// A way to reduce: every algorithm in its paper's order, QEM too, one collapse at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    Qem,
    Esqem,
    /// ESQEM without its second half.
    EsqemUnsplit,
    Melax,
    Qfvp(f64),
    /// QFVP with normals recomputed, at [`FOLLOWED`].
    QfvpRecomputed,
    Fms,
}

/// The w at which normals are compared: any but 0 lets them count.
const FOLLOWED: f64 = 0.5;

impl Way {
    fn options(self, counts: &[usize]) -> Options {
        let algorithm = match self {
            Self::Qem => Algorithm::Qem,
            Self::Esqem | Self::EsqemUnsplit => Algorithm::Esqem(Mode::Paper),
            Self::Melax => Algorithm::Melax,
            Self::Qfvp(_) | Self::QfvpRecomputed => Algorithm::Qfvp,
            Self::Fms => Algorithm::Fms,
        };
        let schedule = if self == Self::Qem { Schedule::Queue } else { algorithm.natural_schedule() };
        let levels = counts.iter().map(|&count| Target::triangles(count)).collect();
        let mut options = Options { levels, algorithm, schedule, ..Options::default() };
        match self {
            Self::EsqemUnsplit => options.split_factor = None,
            Self::Qfvp(w) => options.qfvp_w = FeatureWeight::Fixed(w),
            Self::QfvpRecomputed => {
                options.qfvp_w = FeatureWeight::Fixed(FOLLOWED);
                options.qfvp_normals = NormalUpdate::Recompute;
            }
            Self::Qem | Self::Esqem | Self::Melax | Self::Fms => {}
        }
        options
    }
}

/// A model, ready to be reduced and measured.
struct Model {
    known: &'static Known,
    subject: Subject,
    mesh: Mesh,
    /// Length of the papers' unit, in object units: coordinates from −1 to 1.
    unit: f64,
    found: Vec<Found>,
}

/// What one way came to at one count; distances in the papers' unit.
#[derive(Debug, Clone, Copy)]
struct Found {
    way: Way,
    triangles: usize,
    /// Hausdorff distance of the surfaces.
    error: f64,
    /// Hausdorff distance of the vertices alone.
    between_vertices: f64,
}

impl Model {
    /// The model's file, or a made model for one that the papers have; `None` for another one that is missing.
    fn open(known: &'static Known, options: &PapersOptions) -> Result<Option<Self>> {
        let found = match &options.models {
            Some(directory) => find_model(directory, known.file, &options.limits)?,
            None => None,
        };
        let in_papers = [COW.name, BUNNY.name].contains(&known.name);
        let (mesh, stands_in) = match found {
            Some(mesh) => (mesh, false),
            None if in_papers => (shapes::make_stand_in(known.triangles), true),
            None => return Ok(None),
        };
        let (low, high) = mesh.bounds();
        let unit = f64::from((high - low).max_element()) / 2.0;
        let subject = Subject { model: known.name, triangles: mesh.triangles.len(), stands_in };
        Ok(Some(Self { known, subject, mesh, unit, found: Vec::new() }))
    }

    fn is(&self, known: &Known) -> bool {
        self.known.name == known.name
    }

    /// Those of `counts` that the model can be reduced to: a file of the right name may hold anything.
    fn below(&self, counts: impl IntoIterator<Item = usize>) -> Vec<usize> {
        counts.into_iter().filter(|count| *count < self.mesh.triangles.len()).collect()
    }

    /// Where times are compared: nine tenths gone, as in QFVP's tables on average.
    fn tenth(&self) -> usize {
        self.mesh.triangles.len().div_ceil(10)
    }

    fn esqem_counts(&self) -> Vec<usize> {
        if self.is(&COW) { self.below(ESQEM_COUNTS) } else { Vec::new() }
    }

    fn fms_counts(&self) -> Vec<usize> {
        self.below(FMS_COUNTS.into_iter().filter(|(known, _)| self.is(known)).map(|row| row.1))
    }

    /// QFVP's counts with what is printed for them; of other models the same shares.
    fn qfvp_counts(&self) -> Vec<(usize, Option<[f64; 5]>)> {
        let printed = QFVP_TABLE.into_iter().filter(|(known, ..)| self.is(known));
        let printed: Vec<_> = printed.map(|(_, count, errors)| (count, Some(errors))).collect();
        let rows = if printed.is_empty() {
            vec![(self.mesh.triangles.len().div_ceil(5), None), (self.tenth(), None)]
        } else {
            printed
        };
        rows.into_iter().filter(|row| row.0 < self.mesh.triangles.len()).collect()
    }

    /// Reduces the model in every way to all counts, and measures.
    fn measure(&mut self) -> Result<()> {
        let mut counts = [self.esqem_counts(), self.fms_counts(), self.below([self.tenth()])].concat();
        counts.extend(self.qfvp_counts().iter().map(|row| row.0));
        counts.sort_unstable_by(|a, b| b.cmp(a));
        counts.dedup();
        let mut ways = vec![Way::Qem, Way::Melax, Way::Fms, Way::QfvpRecomputed];
        ways.extend(CLASSES.into_iter().chain(BEYOND).map(Way::Qfvp));
        if self.is(&COW) {
            ways.extend([Way::Esqem, Way::EsqemUnsplit]);
        }
        let ruler = Ruler::new(&self.mesh, Sampling::for_triangles(self.mesh.triangles.len()));
        let measure = |way: Way| -> Result<Vec<Found>> {
            let levels = simplify(&self.mesh, &way.options(&counts))?.levels;
            let levels = levels.par_iter().zip(&counts).map(|(level, &triangles)| Found {
                way,
                triangles,
                error: ruler.measure(&level.mesh).hausdorff() / self.unit,
                between_vertices: if self.is(&COW) {
                    measure_vertices(&self.mesh, &level.mesh) / self.unit
                } else {
                    f64::NAN
                },
            });
            Ok(levels.collect())
        };
        self.found = ways.into_par_iter().map(measure).collect::<Result<Vec<_>>>()?.concat();
        Ok(())
    }

    fn find(&self, way: Way, triangles: usize) -> Option<&Found> {
        self.found.iter().find(|found| found.way == way && found.triangles == triangles)
    }

    fn error(&self, way: Way, triangles: usize) -> f64 {
        self.find(way, triangles).map_or(f64::NAN, |found| found.error)
    }

    /// Adds the model's rows; times are taken now.
    fn fill_in(&self, report: &mut PapersReport, runs: usize, clock: Clock<'_>) -> Result<()> {
        report.esqem.extend(self.esqem_counts().into_iter().map(|count| self.compare_curvature(count)));
        let exponents: Vec<QfvpRow> =
            self.qfvp_counts().into_iter().map(|(count, published)| self.compare_exponents(count, published)).collect();
        report.picks.extend(exponents.iter().map(|row| self.pick(row)));
        report.qfvp.extend(exponents);
        for count in self.fms_counts() {
            let ways = [Way::Qem, Way::Fms];
            report.fms.push(ReductionRow {
                subject: self.subject,
                triangles: count,
                errors: ways.map(|way| self.error(way, count)),
                seconds: self.time(count, ways, runs, clock)?,
            });
        }
        let count = self.tenth();
        let w = builtin().predict(Reduction { before: self.mesh.triangles.len(), after: count });
        let ways = [Way::Qem, Way::Melax, Way::Qfvp(w), Way::Fms, Way::QfvpRecomputed, Way::Qfvp(FOLLOWED)];
        let [qem, melax, qfvp, fms, recomputed, followed] = self.time(count, ways, runs, clock)?;
        let [ways @ .., _, _] = ways;
        report.speeds.push(SpeedRow {
            subject: self.subject,
            triangles: count,
            errors: ways.map(|way| self.error(way, count)),
            seconds: [qem, melax, qfvp, fms],
        });
        report.updates.push(UpdateRow {
            subject: self.subject,
            triangles: count,
            seconds: [recomputed, followed],
            errors: [Way::QfvpRecomputed, Way::Qfvp(FOLLOWED)].map(|way| self.error(way, count)),
        });
        Ok(())
    }

    fn compare_curvature(&self, triangles: usize) -> CurvatureRow {
        let between_vertices = |way| self.find(way, triangles).map_or(f64::NAN, |found| found.between_vertices);
        CurvatureRow {
            subject: self.subject,
            triangles,
            qem: self.error(Way::Qem, triangles),
            esqem: self.error(Way::Esqem, triangles),
            unsplit: self.error(Way::EsqemUnsplit, triangles),
            between_vertices: [Way::Qem, Way::Esqem].map(between_vertices),
        }
    }

    fn compare_exponents(&self, triangles: usize, published: Option<[f64; 5]>) -> QfvpRow {
        let error = |w: f64| self.error(Way::Qfvp(w), triangles);
        let beyond = BEYOND.map(error).into_iter().fold(f64::INFINITY, f64::min);
        QfvpRow { subject: self.subject, triangles, errors: CLASSES.map(error), beyond, published }
    }

    /// What the nets pick for a row of measured errors.
    fn pick(&self, row: &QfvpRow) -> PickRow {
        let reduction = Reduction { before: row.subject.triangles, after: row.triangles };
        let with_error = |w: f64| (w, self.error(Way::Qfvp(w), row.triangles));
        let best = CLASSES.map(with_error).into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
        PickRow {
            subject: row.subject,
            triangles: row.triangles,
            best,
            net: with_error(builtin().predict(reduction)),
            shape_net: with_error(builtin().predict_by_shape(reduction, Shape::of_mesh(&self.mesh))),
        }
    }

    /// Seconds that reducing takes in each way: the least of several rounds, in each of which every way has its turn.
    fn time<const N: usize>(&self, count: usize, ways: [Way; N], runs: usize, clock: Clock<'_>) -> Result<[f64; N]> {
        let options = ways.map(|way| way.options(&[count]));
        let mut fastest = [Duration::MAX; N];
        for round in 0..=runs.max(1) {
            for (options, fastest) in options.iter().zip(&mut fastest) {
                // The first round tells how many together take long enough.
                let batch = (LEAST_TIMED.as_nanos() / fastest.as_nanos().max(1)).clamp(1, MOST_REPEATS) as u32;
                let start = clock();
                for _ in 0..batch {
                    simplify(&self.mesh, options)?;
                }
                let took = clock().saturating_sub(start) / batch;
                *fastest = if round == 0 { took } else { took.min(*fastest) };
            }
        }
        Ok(fastest.map(|time| time.as_secs_f64()))
    }
}

/// Two-sided Hausdorff distance of the vertices of two meshes, object units.
fn measure_vertices(a: &Mesh, b: &Mesh) -> f64 {
    let farthest = |from: &Mesh, to: &Mesh| {
        let nearest = |p: &[f32; 3]| {
            let square = |q: &[f32; 3]| (0..3).map(|i| f64::from(p[i]) - f64::from(q[i])).map(|d| d * d).sum::<f64>();
            to.positions.iter().map(square).fold(f64::INFINITY, f64::min)
        };
        from.positions.iter().map(nearest).fold(0.0, f64::max)
    };
    farthest(a, b).max(farthest(b, a)).sqrt()
}

/// The largest mesh of a file, geometry alone; the welded variant if the directory has one. `None` if there is no such file.
fn find_model(directory: &Path, file: &str, limits: &Limits) -> Result<Option<Mesh>> {
    let Some(path) = [directory.join("positions").join(file), directory.join(file)].into_iter().find(|p| p.is_file())
    else {
        return Ok(None);
    };
    let models = read_models(&path, limits)?;
    Ok(models.into_iter().map(|model| model.mesh).max_by_key(|mesh| mesh.triangles.len()))
}
