//! Training: labelled samples in, weights out, and how good they are at what they have not seen.

use super::{CLASSES, Net, Reduction, Shape, Weights, all_inputs};
use crate::error::{Error, Kind, Result};
use crate::random::Random;
use serde::Serialize;

/// The paper's.
const LEARNING_RATE: f64 = 0.1;
/// Hidden neurons: the paper's, and of the net that sees the shape.
const HIDDEN: [usize; 2] = [4, 6];
/// The paper's share of samples to train with; the rest tests.
const TRAINING_SHARE: f64 = 0.8;
/// Times that every sample is shown.
const EPOCHS: usize = 4000;

const HEADER: &str = "model,before,after,bend,bend_spread,deficit_spread,length_spread,euler,w0,w0.5,w1,w1.5,w2";

/// One reduction of one model, and the error that each w leaves.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Name of the model, without commas.
    pub model: String,
    /// What was asked for.
    pub reduction: Reduction,
    /// Of the model.
    pub shape: Shape,
    /// Measured Hausdorff distance for each of [`CLASSES`], in percent of the bounding box's diagonal.
    pub errors: [f64; 5],
}

impl Sample {
    /// Index of the best w: the first of equals.
    pub fn best(&self) -> usize {
        (1..CLASSES.len()).fold(0, |best, i| if self.errors[i] < self.errors[best] { i } else { best })
    }
}

/// Samples as CSV with a header, numbers rounded to what the file keeps.
pub fn write_samples(samples: &[Sample]) -> String {
    let line = |sample: &Sample| {
        let counts = [sample.reduction.before, sample.reduction.after].map(|n| n.to_string());
        let shape = sample.shape.to_array().map(|x| x.to_string());
        let errors = sample.errors.map(|e| format!("{e:.4e}"));
        let cells: Vec<&str> =
            std::iter::once(&sample.model).chain(&counts).chain(&shape).chain(&errors).map(String::as_str).collect();
        cells.join(",") + "\n"
    };
    format!("{HEADER}\n") + &samples.iter().map(line).collect::<String>()
}

/// Reads what [`write_samples`] has written.
///
/// # Errors
/// [`Kind::Malformed`] with the line.
pub fn read_samples(text: &str) -> Result<Vec<Sample>> {
    let mut lines = text.lines();
    let wrong =
        |line: usize, what: String| Error { place: Some(format!("line {line}")), ..Error::new(Kind::Malformed, what) };
    if lines.next() != Some(HEADER) {
        return Err(wrong(1, format!("expected the header {HEADER}")));
    }
    lines.enumerate().map(|(i, line)| read_sample(line).map_err(|what| wrong(i + 2, what))).collect()
}

fn read_sample(line: &str) -> Result<Sample, String> {
    let (model, numbers) = line.split_once(',').ok_or("expected 13 columns")?;
    let numbers: Vec<f64> = numbers
        .split(',')
        .map(|cell| cell.parse().ok().filter(|x: &f64| x.is_finite()).ok_or(format!("`{cell}` is no number")))
        .collect::<Result<_, _>>()?;
    let &[before, after, a, b, c, d, e, ref errors @ ..] = numbers.as_slice() else {
        return Err("expected 13 columns".to_owned());
    };
    Ok(Sample {
        model: model.to_owned(),
        reduction: Reduction { before: before as usize, after: after as usize },
        shape: Shape::from_array([a, b, c, d, e]),
        errors: errors.try_into().map_err(|_| "expected 13 columns")?,
    })
}

/// How good a way to choose w is, over some samples.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Judgement {
    /// Share of samples for which it names the best w.
    pub accuracy: f64,
    /// Geometric mean of the error that its w leaves over that of the best w: 1 is always the best.
    pub excess: f64,
}

/// What training came to. Every figure but `samples` and `models` is over samples that the nets have not been trained with.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrainReport {
    /// Labelled samples.
    pub samples: usize,
    /// Models that they come from.
    pub models: usize,
    /// How often each w is the best, over all samples.
    pub best: [usize; 5],
    /// The paper's net, on a random fifth of the samples.
    pub net: Judgement,
    /// The net that sees the shape, on the same.
    pub shape_net: Judgement,
    /// Each fixed w, on the same.
    pub fixed: [Judgement; 5],
    /// The paper's net on models that it has never seen: each is left out once.
    pub net_on_new_models: Judgement,
    /// The net that sees the shape, on the same.
    pub shape_net_on_new_models: Judgement,
    /// Each fixed w on all samples: what those two have to beat.
    pub fixed_on_all: [Judgement; 5],
}

/// Trains both nets with four fifths of `samples` and judges them by the rest; `command` is what the weights say of their origin.
pub fn train(samples: &[Sample], seed: u64, command: &str) -> (Weights, TrainReport) {
    let mut shuffled: Vec<&Sample> = samples.iter().collect();
    Random(seed).shuffle(&mut shuffled);
    let (training, tests) = shuffled.split_at((samples.len() as f64 * TRAINING_SHARE).round() as usize);
    let [net, shape_net] = [View::Reduction, View::Shape].map(|view| view.train(training, seed));
    let all: Vec<&Sample> = samples.iter().collect();
    let fixed = |samples: &[&Sample]| std::array::from_fn(|class| judge(samples, |_| class));
    let mut report = TrainReport {
        samples: samples.len(),
        models: 0,
        best: std::array::from_fn(|class| samples.iter().filter(|s| s.best() == class).count()),
        net: judge(tests, |sample| net.classify(&View::Reduction.inputs(sample))),
        shape_net: judge(tests, |sample| shape_net.classify(&View::Shape.inputs(sample))),
        fixed: fixed(tests),
        net_on_new_models: Judgement::default(),
        shape_net_on_new_models: Judgement::default(),
        fixed_on_all: fixed(&all),
    };
    let (accuracy, shape_accuracy) = (report.net.accuracy, report.shape_net.accuracy);
    report.models = models(samples).len();
    (Weights { command: command.to_owned(), seed, accuracy, shape_accuracy, net, shape_net }, report)
}

/// Fills in how the nets do on models that they have never seen: trains once more for each model.
pub fn judge_on_new_models(samples: &[Sample], seed: u64, report: &mut TrainReport) {
    let on_new = |view: View| {
        let mut choices = Vec::new();
        for model in models(samples) {
            let (tests, training): (Vec<&Sample>, Vec<&Sample>) = samples.iter().partition(|s| s.model == model);
            let net = view.train(&training, seed);
            choices.extend(tests.into_iter().map(|s| (s, net.classify(&view.inputs(s)))));
        }
        judge_choices(&choices)
    };
    (report.net_on_new_models, report.shape_net_on_new_models) =
        rayon::join(|| on_new(View::Reduction), || on_new(View::Shape));
}

/// The models' names in the order of their first samples.
fn models(samples: &[Sample]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for sample in samples {
        if !names.contains(&sample.model.as_str()) {
            names.push(&sample.model);
        }
    }
    names
}

/// What a net gets to see.
#[derive(Debug, Clone, Copy)]
enum View {
    Reduction,
    Shape,
}

impl View {
    fn inputs(self, sample: &Sample) -> Vec<f64> {
        match self {
            Self::Reduction => sample.reduction.inputs().to_vec(),
            Self::Shape => all_inputs(sample.reduction, sample.shape),
        }
    }

    fn train(self, samples: &[&Sample], seed: u64) -> Net {
        let mut random = Random(seed);
        let [few, more] = HIDDEN;
        let hidden = if matches!(self, Self::Reduction) { few } else { more };
        let inputs = self.inputs(&Sample {
            model: String::new(),
            reduction: Reduction { before: 1, after: 1 },
            shape: Shape::default(),
            errors: [0.0; 5],
        });
        let mut net = Net::random(inputs.len(), hidden, CLASSES.len(), &mut random);
        let mut cases: Vec<(Vec<f64>, [f64; 5])> = samples
            .iter()
            .map(|s| (self.inputs(s), std::array::from_fn(|class| f64::from(u8::from(class == s.best())))))
            .collect();
        for _ in 0..EPOCHS {
            random.shuffle(&mut cases);
            for (inputs, wanted) in &cases {
                let gradient = net.gradient(inputs, wanted);
                net.descend(&gradient, LEARNING_RATE);
            }
        }
        net
    }
}

fn judge(samples: &[&Sample], choose: impl Fn(&Sample) -> usize) -> Judgement {
    let choices: Vec<(&Sample, usize)> = samples.iter().map(|&s| (s, choose(s))).collect();
    judge_choices(&choices)
}

fn judge_choices(choices: &[(&Sample, usize)]) -> Judgement {
    // Without any error at all every w is as good as another.
    let floor = 1e-9;
    let excess = |(s, class): &(&Sample, usize)| libm::log(s.errors[*class].max(floor) / s.errors[s.best()].max(floor));
    let count = choices.len().max(1) as f64;
    Judgement {
        accuracy: choices.iter().filter(|(s, class)| *class == s.best()).count() as f64 / count,
        excess: libm::exp(choices.iter().map(excess).sum::<f64>() / count),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(model: &str, before: usize, after: usize, best: usize) -> Sample {
        let errors = std::array::from_fn(|class| if class == best { 0.5 } else { 1.0 });
        Sample { model: model.to_owned(), reduction: Reduction { before, after }, shape: Shape::default(), errors }
    }

    #[test]
    fn samples_are_read_back_and_broken_lines_named() {
        let shape = Shape { bend: 0.25, euler: -2.0, ..Shape::default() };
        let samples = [sample("a", 100, 20, 2), Sample { shape, ..sample("b-1", 5804, 581, 0) }];
        let text = write_samples(&samples);
        assert_eq!(read_samples(&text).unwrap(), samples);
        for (broken, place) in [
            (text.replace("w2", "w3"), "line 1"),
            (text.replace("b-1,5804", "b-1,x"), "line 3"),
            (text.replace("a,100,", "a,"), "line 2"),
            (text.replace("a,100,", "a,100,100,"), "line 2"),
            (text.replace("a,100,", "a,inf,"), "line 2"),
        ] {
            assert_eq!(read_samples(&broken).unwrap_err().place.as_deref(), Some(place), "{broken}");
        }
    }

    #[test]
    fn a_rule_that_counts_show_is_learned_and_models_left_out_are_judged() {
        let mut random = Random(5);
        let samples: Vec<Sample> = (0..200)
            .map(|i| {
                let gone = random.between(0.5, 0.99);
                sample(["a", "b"][i % 2], 4000, (4000.0 * (1.0 - gone)) as usize, if gone < 0.75 { 1 } else { 4 })
            })
            .collect();
        let (weights, mut report) = train(&samples, 1, "test");
        assert!(report.net.accuracy > 0.9 && weights.accuracy == report.net.accuracy, "{report:?}");
        assert!(report.net.excess < 1.1 && report.fixed[0].excess > 1.9);
        assert_eq!((report.samples, report.models, report.best[0]), (200, 2, 0));
        assert_eq!(weights.predict(Reduction { before: 4000, after: 1800 }), 0.5);
        assert_eq!(weights.predict(Reduction { before: 4000, after: 100 }), 2.0);
        judge_on_new_models(&samples, 1, &mut report);
        assert!(report.net_on_new_models.accuracy > 0.9, "{report:?}");
    }
}
