//! A net of two layers with sigmoids, and back-propagation. The same numbers on every machine: sums in a fixed order, `exp` in software.

use crate::random::Random;
use serde::{Deserialize, Serialize};

/// Inputs → hidden neurons → outputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Net {
    /// For each hidden neuron the weights of the inputs, then its bias.
    pub hidden: Vec<Vec<f64>>,
    /// For each output the weights of the hidden neurons, then its bias.
    pub output: Vec<Vec<f64>>,
}

impl Net {
    /// Small random weights.
    pub(crate) fn random(inputs: usize, hidden: usize, outputs: usize, random: &mut Random) -> Self {
        let mut layer = |neurons: usize, inputs: usize| {
            (0..neurons).map(|_| (0..=inputs).map(|_| random.between(-0.5, 0.5)).collect()).collect()
        };
        Self { hidden: layer(hidden, inputs), output: layer(outputs, hidden) }
    }

    /// The outputs, each in (0, 1).
    pub fn outputs(&self, inputs: &[f64]) -> Vec<f64> {
        fire(&self.output, &fire(&self.hidden, inputs))
    }

    /// The index of the largest output; the first of equals.
    pub fn classify(&self, inputs: &[f64]) -> usize {
        let outputs = self.outputs(inputs);
        (0..outputs.len()).reduce(|best, i| if outputs[i] > outputs[best] { i } else { best }).unwrap_or(0)
    }

    /// Whether every row has the length that `inputs` inputs and `outputs` outputs ask for.
    pub(crate) fn fits(&self, inputs: usize, outputs: usize) -> bool {
        let rows = |layer: &[Vec<f64>], width: usize| layer.iter().all(|row| row.len() == width + 1);
        self.output.len() == outputs && rows(&self.hidden, inputs) && rows(&self.output, self.hidden.len())
    }

    /// The derivative of half the squared error, ½ Σ (y − t)², by every weight.
    pub(crate) fn gradient(&self, inputs: &[f64], wanted: &[f64]) -> Self {
        let hidden = fire(&self.hidden, inputs);
        let outputs = fire(&self.output, &hidden);
        let slope = |y: f64| y * (1.0 - y);
        let blame: Vec<f64> = outputs.iter().zip(wanted).map(|(y, t)| (y - t) * slope(*y)).collect();
        let passed_back = |j: usize| blame.iter().zip(&self.output).map(|(d, row)| d * row[j]).sum::<f64>();
        let hidden_blame: Vec<f64> = (0..hidden.len()).map(|j| passed_back(j) * slope(hidden[j])).collect();
        Self { hidden: spread(&hidden_blame, inputs), output: spread(&blame, &hidden) }
    }

    /// Goes `rate` against the gradient.
    pub(crate) fn descend(&mut self, gradient: &Self, rate: f64) {
        let layers = [(&mut self.hidden, &gradient.hidden), (&mut self.output, &gradient.output)];
        for (rows, slopes) in layers {
            for (weight, slope) in rows.iter_mut().flatten().zip(slopes.iter().flatten()) {
                *weight -= rate * slope;
            }
        }
    }
}

fn fire(layer: &[Vec<f64>], inputs: &[f64]) -> Vec<f64> {
    // A bias is the weight of an input that is always 1.
    let sum = |row: &Vec<f64>| row.iter().zip(inputs.iter().chain(&[1.0])).map(|(w, x)| w * x).sum::<f64>();
    layer.iter().map(|row| 1.0 / (1.0 + libm::exp(-sum(row)))).collect()
}

fn spread(blame: &[f64], inputs: &[f64]) -> Vec<Vec<f64>> {
    blame.iter().map(|d| inputs.iter().chain(&[1.0]).map(|x| d * x).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(net: &Net, inputs: &[f64], wanted: &[f64]) -> f64 {
        net.outputs(inputs).iter().zip(wanted).map(|(y, t)| 0.5 * (y - t) * (y - t)).sum()
    }

    #[test]
    fn outputs_are_sigmoids_of_weighted_sums() {
        let net = Net { hidden: vec![vec![2.0, -1.0, 0.5]], output: vec![vec![3.0, -2.0], vec![0.0, 0.0]] };
        let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
        let outputs = net.outputs(&[1.0, 2.0]);
        assert!((outputs[0] - sigmoid(3.0 * sigmoid(0.5) - 2.0)).abs() < 1e-15);
        assert_eq!(outputs[1], 0.5);
        assert!(net.fits(2, 2) && !net.fits(3, 2) && !net.fits(2, 1));
    }

    #[test]
    fn the_gradient_is_what_finite_differences_say() {
        let net = Net::random(3, 4, 5, &mut Random(7));
        let (inputs, wanted) = ([0.3, -1.2, 0.9], [0.0, 1.0, 0.0, 0.0, 0.0]);
        let gradient = net.gradient(&inputs, &wanted);
        let weights = |net: &Net| net.hidden.iter().chain(&net.output).flatten().copied().collect::<Vec<f64>>();
        let slopes = weights(&gradient);
        assert_eq!(slopes.len(), 4 * 4 + 5 * 5);
        for (i, slope) in slopes.iter().enumerate() {
            let nudged = |by: f64| {
                let mut net = net.clone();
                if let Some(w) = net.hidden.iter_mut().chain(&mut net.output).flatten().nth(i) {
                    *w += by;
                }
                error(&net, &inputs, &wanted)
            };
            let difference = (nudged(1e-5) - nudged(-1e-5)) / 2e-5;
            assert!((slope - difference).abs() < 1e-9, "weight {i}: {slope} against {difference}");
        }
    }

    #[test]
    fn descent_learns_what_one_neuron_could_not() {
        let mut net = Net::random(2, 4, 2, &mut Random(3));
        let cases = [([0.0, 0.0], 0), ([1.0, 0.0], 1), ([0.0, 1.0], 1), ([1.0, 1.0], 0)];
        for _ in 0..5000 {
            for (inputs, class) in cases {
                let wanted = [0, 1].map(|c| f64::from(u8::from(c == class)));
                let gradient = net.gradient(&inputs, &wanted);
                net.descend(&gradient, 0.5);
            }
        }
        assert!(cases.iter().all(|(inputs, class)| net.classify(inputs) == *class));
    }
}
