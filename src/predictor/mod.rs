//! Predicts QFVP's exponent w from what is asked for: the paper's 3-4-5 net, and one that looks at the shape as well.
//!
//! The weights in `config/qfvp-weights.json` are compiled in; the file names the command that makes it. Training and prediction give the same
//! bits on every machine.

mod net;
mod shape;
mod train;

pub use net::Net;
pub use shape::Shape;
pub use train::{Judgement, Sample, TrainReport, judge_on_new_models, read_samples, train, write_samples};

use crate::error::{Error, Kind, Result};
use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

/// The values of w that a net chooses from.
pub const CLASSES: [f64; 5] = [0.0, 0.5, 1.0, 1.5, 2.0];

/// A reduction asked for, in triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reduction {
    /// Of the source.
    pub before: usize,
    /// Of the coarsest level.
    pub after: usize,
}

impl Reduction {
    /// The paper's input: both counts and the share that goes. Counts by their magnitude, so that no neuron starts out saturated.
    fn inputs(self) -> [f64; 3] {
        let magnitude = |count: usize| libm::log10(count.max(1) as f64) / 6.0;
        let gone = 1.0 - self.after as f64 / self.before.max(1) as f64;
        [magnitude(self.before), magnitude(self.after), 2.0 * gone - 1.0]
    }
}

/// What the second net sees: the reduction, then the shape.
fn all_inputs(reduction: Reduction, shape: Shape) -> Vec<f64> {
    reduction.inputs().into_iter().chain(shape.inputs()).collect()
}

/// The trained nets, as a file has them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// The command that makes this file, bit for bit.
    pub command: String,
    /// What the training's random numbers start from.
    pub seed: u64,
    /// Share of the test samples for which the net names the best of the five values.
    pub accuracy: f64,
    /// The same for the net that sees the shape.
    pub shape_accuracy: f64,
    /// The paper's net: 3 inputs, 4 hidden neurons, 5 classes.
    pub net: Net,
    /// The net that sees the shape: 8 inputs.
    pub shape_net: Net,
}

impl Weights {
    /// Reads a weights file.
    ///
    /// # Errors
    /// [`Kind::Malformed`] where it is not JSON of this form, or a net has the wrong size.
    pub fn parse(text: &str) -> Result<Self> {
        let weights: Self =
            serde_json::from_str(text).map_err(|error| Error::new(Kind::Malformed, error.to_string()))?;
        let inputs = all_inputs(Reduction { before: 1, after: 1 }, Shape::default()).len();
        if weights.net.fits(3, CLASSES.len()) && weights.shape_net.fits(inputs, CLASSES.len()) {
            Ok(weights)
        } else {
            Err(Error::new(Kind::Malformed, "a net has not the size that its inputs and classes ask for"))
        }
    }

    /// The file's text.
    pub fn to_text(&self) -> String {
        // Strings, numbers and lists: nothing that JSON cannot express.
        let value = serde_json::to_value(self).unwrap_or_default();
        format!("{value:#}\n")
    }

    /// The w that the paper's net names.
    pub fn predict(&self, reduction: Reduction) -> f64 {
        CLASSES[self.net.classify(&reduction.inputs())]
    }

    /// The w that the net names which sees the shape as well.
    pub fn predict_by_shape(&self, reduction: Reduction, shape: Shape) -> f64 {
        CLASSES[self.shape_net.classify(&all_inputs(reduction, shape))]
    }
}

/// The weights that are compiled in.
pub fn builtin() -> &'static Weights {
    static WEIGHTS: OnceLock<Weights> = OnceLock::new();
    WEIGHTS.get_or_init(|| {
        Weights::parse(include_str!("../../config/qfvp-weights.json"))
            .unwrap_or_else(|error| panic!("the embedded weights are broken: {error}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_back_and_broken_ones_refused() {
        let weights = builtin();
        assert_eq!(Weights::parse(&weights.to_text()).as_ref().ok(), Some(weights));
        let mut broken = weights.clone();
        broken.net.hidden[2].pop();
        assert_eq!(Weights::parse(&broken.to_text()).unwrap_err().kind, Kind::Malformed);
        assert_eq!(Weights::parse("{}").unwrap_err().kind, Kind::Malformed);
    }

    #[test]
    fn the_committed_weights_come_from_the_committed_samples() {
        let samples = read_samples(include_str!("../../config/qfvp-samples.csv")).unwrap();
        let (trained, _) = train(&samples, builtin().seed, &builtin().command);
        assert_eq!(trained.to_text(), include_str!("../../config/qfvp-weights.json"), "run its `command` again");
    }

    #[test]
    fn predictions_are_classes() {
        for (before, after) in [(0, 0), (1, 1), (5804, 581), (871_414, 2252), (usize::MAX, 3)] {
            let reduction = Reduction { before, after };
            assert!(CLASSES.contains(&builtin().predict(reduction)));
            assert!(CLASSES.contains(&builtin().predict_by_shape(reduction, Shape::default())));
        }
    }
}
