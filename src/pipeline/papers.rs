//! The papers' tables, made again: their models where they are at hand, ours in their units, times as ratios on this machine.
//!
//! A model that is missing is replaced by a made one of as many triangles: it fills the row and says so, but counts for no claim.

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
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What to compare.
#[derive(Debug, Clone)]
pub struct PapersOptions {
    /// Directory with `cow.glb`, `stanford-bunny.glb` and others; made models stand in for all that is missing.
    pub models: Option<PathBuf>,
    /// Runs of which the fastest counts.
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
const LEAST_TIMED: Duration = Duration::from_millis(200);
/// Most reductions that are timed together.
const MOST_REPEATS: u128 = 20;
/// Share that goes in the comparison of times, as in QFVP's tables on average.
const SPEED_SHARE: f64 = 0.9;

/// Makes the papers' tables.
///
/// # Errors
/// Everything that keeps a model's file from being read; a file that is not there is no error.
pub fn papers(options: &PapersOptions, clock: Clock<'_>, observer: &dyn Observer) -> Result<PapersReport> {
    // One thread: the papers have one.
    run_on_threads(Some(1), || Comparison { options, clock, observer }.make_report())?
}

struct Comparison<'a> {
    options: &'a PapersOptions,
    clock: Clock<'a>,
    observer: &'a dyn Observer,
}

/// A model, ready to be reduced and measured.
struct Model {
    subject: Subject,
    mesh: Mesh,
    ruler: Ruler,
    /// Length of the papers' unit, in object units: coordinates from −1 to 1.
    unit: f64,
}

impl Model {
    /// Whether the model has more triangles than that: a file of the right name may hold anything.
    fn has_more(&self) -> impl Fn(&usize) -> bool + use<> {
        let triangles = self.mesh.triangles.len();
        move |count| *count < triangles
    }
}

/// What one reduction came to.
struct Run {
    /// Hausdorff distance in the papers' unit.
    error: f64,
    seconds: f64,
}

impl Comparison<'_> {
    fn make_report(&self) -> Result<PapersReport> {
        let mut report = PapersReport { published: QFVP_PUBLISHED.to_vec(), ..PapersReport::default() };
        for known in [&COW, &BUNNY].into_iter().chain(&OTHERS) {
            if known.triangles > self.options.most_triangles {
                report.left_out.push(known.name);
                continue;
            }
            let Some(model) = self.open(known)? else { continue };
            self.observer.asset_started(known.name);
            self.add_model(known, &model, &mut report)?;
            self.observer.mesh_finished(model.mesh.triangles.len());
        }
        report.check_claims();
        Ok(report)
    }

    fn add_model(&self, known: &Known, model: &Model, report: &mut PapersReport) -> Result<()> {
        if known.name == COW.name {
            for count in ESQEM_COUNTS.into_iter().filter(model.has_more()) {
                report.esqem.push(self.compare_curvature(model, count)?);
            }
        }
        let of_model = QFVP_TABLE.iter().filter(|(table, ..)| table.name == known.name);
        for (_, count, published) in of_model.filter(|row| model.has_more()(&row.1)) {
            report.qfvp.push(self.compare_exponents(model, *count, Some(*published))?);
        }
        if OTHERS.iter().any(|other| other.name == known.name) {
            let share = |gone: f64| (model.mesh.triangles.len() as f64 * (1.0 - gone)).round() as usize;
            for gone in [0.8, 0.9] {
                report.qfvp.push(self.compare_exponents(model, share(gone), None)?);
            }
        }
        let of_model = FMS_COUNTS.iter().filter(|(table, _)| table.name == known.name);
        for (_, count) in of_model.filter(|row| model.has_more()(&row.1)) {
            report.fms.push(self.compare_reductions(model, *count)?);
        }
        report.picks.extend(report.qfvp.iter().filter(|row| row.subject == model.subject).map(|row| pick(model, row)));
        report.speeds.push(self.compare_speeds(model)?);
        report.updates.push(self.compare_updates(model)?);
        Ok(())
    }

    /// The model's file, or a made model for one that the papers have; `None` for another one that is missing.
    fn open(&self, known: &Known) -> Result<Option<Model>> {
        let found = match &self.options.models {
            Some(directory) => find_model(directory, known.file, &self.options.limits)?,
            None => None,
        };
        let in_papers = [COW.name, BUNNY.name].contains(&known.name);
        let (mesh, stands_in) = match found {
            Some(mesh) => (mesh, false),
            None if in_papers => (shapes::make_stand_in(known.triangles), true),
            None => return Ok(None),
        };
        let (low, high) = mesh.bounds();
        let ruler = Ruler::new(&mesh, Sampling::default());
        let unit = f64::from((high - low).max_element()) / 2.0;
        let subject = Subject { model: known.name, triangles: mesh.triangles.len(), stands_in };
        Ok(Some(Model { subject, mesh, ruler, unit }))
    }

    fn compare_curvature(&self, model: &Model, count: usize) -> Result<CurvatureRow> {
        let esqem = Algorithm::Esqem(Mode::Paper);
        let [qem, esqem] = [self.run(model, count, Algorithm::Qem)?, self.run(model, count, esqem)?];
        Ok(CurvatureRow { subject: model.subject, triangles: count, qem: qem.error, esqem: esqem.error })
    }

    fn compare_exponents(&self, model: &Model, count: usize, published: Option<[f64; 5]>) -> Result<QfvpRow> {
        let error_of = |w: f64| -> Result<f64> {
            let with_w = |options: &mut Options| options.qfvp_w = FeatureWeight::Fixed(w);
            Ok(self.run_with(model, count, Algorithm::Qfvp, 1, with_w)?.error)
        };
        let mut errors = [0.0; 5];
        for (error, w) in errors.iter_mut().zip(CLASSES) {
            *error = error_of(w)?;
        }
        let beyond = error_of(BEYOND[0])?.min(error_of(BEYOND[1])?);
        Ok(QfvpRow { subject: model.subject, triangles: count, errors, beyond, published })
    }

    fn compare_reductions(&self, model: &Model, count: usize) -> Result<ReductionRow> {
        let [qem, fms] = [self.run(model, count, Algorithm::Qem)?, self.run(model, count, Algorithm::Fms)?];
        Ok(ReductionRow {
            subject: model.subject,
            triangles: count,
            errors: [qem.error, fms.error],
            seconds: [qem.seconds, fms.seconds],
        })
    }

    fn compare_speeds(&self, model: &Model) -> Result<SpeedRow> {
        let count = (model.mesh.triangles.len() as f64 * (1.0 - SPEED_SHARE)).round() as usize;
        let mut row = SpeedRow { subject: model.subject, triangles: count, ..SpeedRow::default() };
        let algorithms = [Algorithm::Qem, Algorithm::Melax, Algorithm::Qfvp, Algorithm::Fms];
        for (i, algorithm) in algorithms.into_iter().enumerate() {
            let run = self.run(model, count, algorithm)?;
            (row.seconds[i], row.errors[i]) = (run.seconds, run.error);
        }
        Ok(row)
    }

    fn compare_updates(&self, model: &Model) -> Result<UpdateRow> {
        let count = (model.mesh.triangles.len() as f64 * (1.0 - SPEED_SHARE)).round() as usize;
        let run = |update| {
            let with = |options: &mut Options| {
                options.qfvp_normals = update;
                // Any w but 0 lets the normals count.
                options.qfvp_w = FeatureWeight::Fixed(0.5);
            };
            self.run_with(model, count, Algorithm::Qfvp, self.options.runs, with)
        };
        let [anew, linear] = [run(NormalUpdate::Recompute)?, run(NormalUpdate::Linear)?];
        Ok(UpdateRow {
            subject: model.subject,
            triangles: count,
            seconds: [anew.seconds, linear.seconds],
            errors: [anew.error, linear.error],
        })
    }

    fn run(&self, model: &Model, count: usize, algorithm: Algorithm) -> Result<Run> {
        self.run_with(model, count, algorithm, self.options.runs, |_| {})
    }

    /// Every algorithm in its paper's order, QEM too: one collapse at a time.
    fn run_with(
        &self,
        model: &Model,
        count: usize,
        algorithm: Algorithm,
        runs: usize,
        change: impl Fn(&mut Options),
    ) -> Result<Run> {
        let schedule = match algorithm {
            Algorithm::Qem => Schedule::Queue,
            other => other.natural_schedule(),
        };
        let mut options = Options { levels: vec![Target::triangles(count)], algorithm, schedule, ..Options::default() };
        change(&mut options);
        let mut batch = 1;
        let mut fastest = Duration::MAX;
        let mut level = None;
        for _ in 0..runs.max(1) {
            let start = (self.clock)();
            for _ in 0..batch {
                level = simplify(&model.mesh, &options)?.levels.into_iter().next();
            }
            let took = (self.clock)().saturating_sub(start) / batch;
            fastest = fastest.min(took);
            batch = (LEAST_TIMED.as_nanos() / took.as_nanos().max(1)).clamp(1, MOST_REPEATS) as u32;
        }
        let mesh = level.map(|level| level.mesh).unwrap_or_default();
        Ok(Run { error: model.ruler.measure(&mesh).hausdorff() / model.unit, seconds: fastest.as_secs_f64() })
    }
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

/// What the nets pick for a row of measured errors.
fn pick(model: &Model, row: &QfvpRow) -> PickRow {
    let reduction = Reduction { before: row.subject.triangles, after: row.triangles };
    let error_of = |w: f64| CLASSES.iter().position(|class| *class == w).map_or(f64::NAN, |class| row.errors[class]);
    let with_error = |w: f64| (w, error_of(w));
    let best = CLASSES.into_iter().min_by(|a, b| error_of(*a).total_cmp(&error_of(*b))).unwrap_or_default();
    PickRow {
        subject: row.subject,
        triangles: row.triangles,
        best: with_error(best),
        net: with_error(builtin().predict(reduction)),
        shape_net: with_error(builtin().predict_by_shape(reduction, Shape::of_mesh(&model.mesh))),
    }
}
