//! Small fully connected networks of the avatar: [`mod@crate::nn::mlp`] with named parameters and their
//! optimiser.
//!
//! The last layer is initialised close to 0, so that a new network has no visible effect.

use crate::Result;
use crate::nn::mlp;
use crate::num::array::Arrays;
use crate::optim::adam::Rule;
use crate::optim::initial::Initial;
use crate::optim::optimiser::{ArrayNames, Optimiser};
use crate::tape::{Grads, Params};
use ndarray::{ArrayD, IxDyn};

/// Largest magnitude of the initial entries of the last layer.
const LAST: f64 = 1e-5;

/// Sizes and initialisation of a network.
#[derive(Clone, Copy, Debug)]
pub struct Sizes<'a> {
    /// Prefix of the names of its parameters, `NAME.L.weight` (N, K) and `NAME.L.bias` (N).
    pub name: &'a str,
    /// Widths from input to output.
    pub widths: &'a [usize],
    /// The layer that takes the input again.
    pub skip: Option<usize>,
    /// Purpose number of the draws of the initial values.
    pub purpose: u16,
}

/// A network and its optimiser.
#[derive(Clone, Debug)]
pub struct Mlp {
    /// Names of weight and bias of each layer.
    layers: Vec<[String; 2]>,
    /// The layer that takes the input again.
    skip: Option<usize>,
    params: Params,
    optimiser: Optimiser,
}

/// Values saved for the adjoint: the number of input rows and what the network saved.
#[derive(Clone, Debug, Default)]
pub struct Saved {
    x: Vec<f32>,
    rows: usize,
    saved: mlp::Saved,
}

fn flat(array: &ArrayD<f32>) -> &[f32] {
    array.as_slice().expect("parameters are contiguous")
}

impl Mlp {
    /// Creates a network with weights uniform in ±1/√K, those of the last layer in ±1e-5; biases are 0.
    ///
    /// # Errors
    /// See [`Optimiser::new`].
    pub fn new(sizes: Sizes<'_>, seed: u64) -> Result<Self> {
        let Sizes { name, widths, skip, purpose } = sizes;
        let (mut params, mut layers, last) = (Params::new(), Vec::new(), widths.len() - 2);
        for l in 0..=last {
            let (n, k) = (widths[l + 1], widths[l] + if skip == Some(l) { widths[0] } else { 0 });
            let most = if l == last { LAST } else { 1.0 / (k as f64).sqrt() };
            let names = ["weight", "bias"].map(|part| format!("{name}.{l}.{part}"));
            params.set(&names[0], Initial::numbered(seed, purpose, l as u32).uniform_f64(&[n, k], most));
            params.set(&names[1], ArrayD::zeros(IxDyn(&[n])));
            layers.push(names);
        }
        Ok(Self { layers, skip, optimiser: Optimiser::new(Rule::SPLAT, &params)?, params })
    }

    fn get(&self, name: &str) -> &[f32] {
        flat(self.params.get(name).expect("every layer has its parameters"))
    }

    fn network(&self) -> Vec<mlp::Layer<'_>> {
        let layer =
            |[weight, bias]: &[String; 2]| mlp::Layer { weight: self.get(weight), bias: self.get(bias) };
        self.layers.iter().map(layer).collect()
    }

    /// Evaluates the network on `rows` rows of inputs.
    pub fn forward(&self, x: Vec<f32>, rows: usize) -> (Vec<f32>, Saved) {
        let (y, saved) = mlp::forward(&mlp::In { x: &x, layers: &self.network(), m: rows, skip: self.skip });
        (y, Saved { x, rows, saved })
    }

    /// Performs one step of the optimiser with the gradient that `y_bar` implies; no gradient is propagated
    /// to the input.
    ///
    /// # Errors
    /// If a result is not finite.
    pub fn step(&mut self, saved: &Saved, y_bar: &[f32], rate: f64) -> Result<()> {
        let layers = self.network();
        let x = mlp::In { x: &saved.x, layers: &layers, m: saved.rows, skip: self.skip };
        let mut bar = mlp::InBar::of_layers(&x);
        mlp::adjoint(&x, &saved.saved, y_bar, &mut bar);
        let mut grads = Grads::default();
        for (names, bars) in self.layers.iter().zip(bar.layers) {
            for (name, bar) in names.iter().zip(bars) {
                let shape = self.params.get(name).expect("every layer has its parameters").raw_dim();
                let bar = ArrayD::from_shape_vec(shape, bar).expect("the shape of the parameter");
                grads.0.insert(name.clone(), bar);
            }
        }
        self.optimiser.step(&mut self.params, &grads, |_| Some(rate))
    }

    /// The parameters in order, for a digest.
    pub fn values(&self) -> impl Iterator<Item = (&[f32], [usize; 2])> {
        self.layers.iter().flatten().map(|name| {
            let values = self.params.get(name).expect("every layer has its parameters");
            (flat(values), [values.shape()[0], values.shape().get(1).copied().unwrap_or(1)])
        })
    }

    /// Stores the parameters, and with `state` the optimiser.
    pub fn save(&self, state: bool, out: &mut Arrays) {
        ArrayNames::Beside.save(&self.params, out);
        if state {
            self.optimiser.save(ArrayNames::Beside, out);
        }
    }

    /// Whether the arrays contain the parameters of this network.
    pub fn is_in(&self, arrays: &Arrays) -> bool {
        self.layers.first().is_some_and(|[weight, _]| arrays.get(weight).is_some())
    }

    /// Restores what [`Self::save`] stored.
    ///
    /// # Errors
    /// Missing arrays, other shapes, values that are not finite.
    pub fn load(&mut self, state: bool, from: &Arrays) -> Result<()> {
        ArrayNames::Beside.load(&mut self.params, from)?;
        if state { self.optimiser.load(ArrayNames::Beside, from) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_lower_what_they_should() {
        let sizes = Sizes { name: "net", widths: &[3, 16, 16, 16, 2], skip: Some(2), purpose: 0x0903 };
        let mut net = Mlp::new(sizes, 3).expect("widths above 0");
        let x: Vec<f32> = (0..30).map(|i| ((i * 7) % 13) as f32 / 13.0 - 0.5).collect();
        let want: Vec<f32> = x.chunks(3).flat_map(|r| [r[0] * r[1] - r[2], 0.5 * r[0]]).collect();
        let (first, _) = net.forward(x.clone(), 10);
        assert!(first.iter().all(|v| v.abs() < 1e-4), "a new network has no visible effect");
        let error = |y: &[f32]| y.iter().zip(&want).fold(0.0, |s, (a, b)| s + (a - b) * (a - b));
        for _ in 0..400 {
            let (y, saved) = net.forward(x.clone(), 10);
            let bar: Vec<f32> = y.iter().zip(&want).map(|(a, b)| 2.0 * (a - b)).collect();
            net.step(&saved, &bar, 5e-3).expect("finite");
        }
        let (y, _) = net.forward(x.clone(), 10);
        assert!(error(&y) < 1e-2 * error(&first), "{} of {}", error(&y), error(&first));
    }
}
