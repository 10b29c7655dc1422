//! Samples for the predictor of QFVP's w: models reduced with every w, the results measured.
//!
//! Geometry alone, as in the paper: attributes would decide about seams, not about w.

use super::{Observer, run_on_threads};
use crate::asset::{Asset, Limits};
use crate::discover::directory_of;
use crate::error::{Error, Kind, Result};
use crate::measure::{Ruler, Sampling};
use crate::mesh::Mesh;
use crate::predictor::{
    self, CLASSES, Reduction, Sample, Shape, TrainReport, Weights, judge_on_new_models, read_samples, write_samples,
};
use crate::random::Random;
use crate::shapes::{self, Model};
use crate::simplify::{Algorithm, FeatureWeight, Options, Schedule, Target, simplify};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Shares of triangles that may go: a progressive mesh's base has less than half; beyond 99 % a small mesh is gone.
const GONE: [f64; 2] = [0.5, 0.99];
/// Smaller meshes have no levels to learn from.
const LEAST_TRIANGLES: usize = 200;

/// What to train the predictor with.
#[derive(Debug, Clone)]
pub struct TrainOptions {
    /// `.glb` and `.gltf` files; each of their meshes is a model.
    pub meshes: Vec<PathBuf>,
    /// Number of made models besides.
    pub generated: usize,
    /// Random reductions of each model; the paper has 40.
    pub reductions: usize,
    /// What random numbers start from.
    pub seed: u64,
    /// Labelled samples to train with instead, as [`TrainOutcome::samples`] has them.
    pub samples: Option<String>,
    /// What the weights say of their origin: the command line.
    pub command: String,
    /// Bounds on what is read.
    pub limits: Limits,
    /// Threads; `None` takes one for each processor. The results are the same for any number.
    pub jobs: Option<usize>,
}

/// What training gives.
#[derive(Debug, Clone)]
pub struct TrainOutcome {
    /// The nets.
    pub weights: Weights,
    /// The labelled samples as CSV.
    pub samples: String,
    /// How good the nets are.
    pub report: TrainReport,
}

/// Labels samples, unless they are given, and trains both nets with them.
///
/// # Errors
/// Everything that keeps a file from being read; [`Kind::Preset`] if there is nothing to train with; [`Kind::Malformed`] for samples that are not
/// what [`TrainOutcome::samples`] is.
pub fn train_w(options: &TrainOptions, observer: &dyn Observer) -> Result<TrainOutcome> {
    run_on_threads(options.jobs, || {
        let samples = match &options.samples {
            Some(text) => text.clone(),
            None => write_samples(&label_models(options, observer)?),
        };
        // From the text, so that training with a file gives the same bits.
        let labelled = read_samples(&samples)?;
        if labelled.is_empty() {
            return Err(Error::new(Kind::Preset, "nothing to train with").help("give meshes, or --generated 12"));
        }
        let (weights, mut report) = predictor::train(&labelled, options.seed, &options.command);
        judge_on_new_models(&labelled, options.seed, &mut report);
        Ok(TrainOutcome { weights, samples, report })
    })?
}

fn label_models(options: &TrainOptions, observer: &dyn Observer) -> Result<Vec<Sample>> {
    let mut models: Vec<Model> = (0..options.generated).map(|number| shapes::make(number, options.seed)).collect();
    for file in &options.meshes {
        models.extend(read_models(file, &options.limits)?);
    }
    observer.found(models.len(), 0);
    let label = |(index, model): (usize, &Model)| {
        observer.asset_started(&model.name);
        let reductions = choose_reductions(model, options, index);
        let samples = label_model(model, &reductions, |_| true);
        observer.mesh_finished(model.mesh.triangles.len());
        samples
    };
    let labelled: Result<Vec<Vec<Sample>>> = models.par_iter().enumerate().map(label).collect();
    Ok(labelled?.concat())
}

/// The meshes of a file that are large enough, welded and without attributes.
pub(super) fn read_models(file: &Path, limits: &Limits) -> Result<Vec<Model>> {
    let asset = Asset::read(file, directory_of(file), limits)?;
    let stem = file.file_stem().unwrap_or_default().to_string_lossy().replace(',', "_");
    let mut models = Vec::new();
    for index in 0..asset.document.array("meshes").len() {
        let mesh = strip(asset.geometry(index, limits)?.mesh);
        if mesh.triangles.len() >= LEAST_TRIANGLES {
            let name = if index == 0 { stem.clone() } else { format!("{stem}-{index}") };
            models.push(Model { name, mesh });
        }
    }
    Ok(models)
}

/// The geometry alone: seams and material borders vanish with the attributes, as equal positions are welded.
fn strip(mesh: Mesh) -> Mesh {
    Mesh { positions: mesh.positions, triangles: mesh.triangles, ..Mesh::default() }
}

/// Random reductions from fine to coarse.
fn choose_reductions(model: &Model, options: &TrainOptions, index: usize) -> Vec<Reduction> {
    let mut random = Random(options.seed.wrapping_mul(1_000_003).wrapping_add(index as u64));
    let before = model.mesh.triangles.len();
    let after = |_| (before as f64 * (1.0 - random.between(GONE[0], GONE[1]))).round() as usize;
    let mut counts: Vec<usize> = (0..options.reductions).map(after).collect();
    counts.sort_unstable_by(|a, b| b.cmp(a));
    counts.into_iter().map(|after| Reduction { before, after }).collect()
}

/// Measures what each w leaves of a model at those `reductions` (fine to coarse) that are `wanted`.
fn label_model(model: &Model, reductions: &[Reduction], wanted: impl Fn(usize) -> bool + Sync) -> Result<Vec<Sample>> {
    let shape = Shape::of_mesh(&model.mesh);
    let ruler = Ruler::new(&model.mesh, Sampling::for_triangles(model.mesh.triangles.len()));
    let measure = |w: &f64| -> Result<Vec<f64>> {
        let options = Options {
            levels: reductions.iter().map(|r| Target::triangles(r.after)).collect(),
            algorithm: Algorithm::Qfvp,
            schedule: Schedule::Queue,
            qfvp_w: FeatureWeight::Fixed(*w),
            ..Options::default()
        };
        let levels = simplify(&model.mesh, &options)?.levels;
        let levels = levels.par_iter().enumerate().filter(|(index, _)| wanted(*index));
        Ok(levels.map(|(_, level)| 100.0 * ruler.measure(&level.mesh).hausdorff() / ruler.diagonal()).collect())
    };
    let errors: Vec<Vec<f64>> = CLASSES.par_iter().map(measure).collect::<Result<_>>()?;
    let chosen = reductions.iter().enumerate().filter(|(index, _)| wanted(*index));
    let sample = |(row, (_, &reduction)): (usize, (usize, &Reduction))| Sample {
        model: model.name.clone(),
        reduction,
        shape,
        errors: std::array::from_fn(|class| errors[class][row]),
    };
    Ok(chosen.enumerate().map(sample).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The whole labelling takes minutes; a few levels of one model, after all the collapses above them, show whether anything has changed.
    #[test]
    fn the_committed_samples_are_what_the_simplifier_gives() {
        let command = &predictor::builtin().command;
        let number = |flag: &str| command.split_once(flag)?.1.split_whitespace().next()?.parse().ok();
        let files: Vec<&str> = command.split_whitespace().filter(|word| word.starts_with("fixtures/")).collect();
        let options = TrainOptions {
            meshes: Vec::new(),
            generated: number("--generated").expect("made models"),
            reductions: number("--reductions").unwrap_or(40),
            seed: predictor::builtin().seed,
            samples: None,
            command: command.clone(),
            limits: Limits::default(),
            jobs: None,
        };
        let models: Vec<Model> = (0..options.generated).map(|number| shapes::make(number, options.seed)).collect();
        let index = (0..models.len()).min_by_key(|&i| models[i].mesh.triangles.len()).expect("models");
        let reductions = choose_reductions(&models[index], &options, index);
        let labelled = label_model(&models[index], &reductions, |i| i % 6 == 1).expect("valid");
        let committed = include_str!("../../config/qfvp-samples.csv");
        assert_eq!(labelled.len(), 4);
        // Each of the files has one mesh.
        assert_eq!(committed.lines().count(), 1 + (options.generated + files.len()) * options.reductions);
        for line in write_samples(&labelled).lines().skip(1) {
            assert!(committed.lines().any(|other| other == line), "{line}\nthe results have changed: {command}");
        }
    }
}
