//! The encoder E_φ: from an image (or a vector) to the posterior of its factors (q_φ in eq. 1 of the LAST
//! paper).
//!
//! Images (S, S, 3) in −½ … ½: convolutions 4×4 of stride 2, padded by 1, leaky ReLU 0.2 after each, down to
//! 4×4×64; a hidden layer of 256; a layer of 2·d: μ, then ℓ = ln σ². Vectors, which the tests of the
//! structure use instead of images: two hidden layers of 64.
//!
//! Weights are drawn He-uniform for the leaky ReLU, U(±√(6/((1 + 0.2²)·inputs))), biases are 0; the weights
//! of the last layer are scaled by 0.1 and the bias of ℓ is −2. There is no batch normalisation, because it
//! would couple the items of a batch: the gradient with respect to one image would depend on the others.

use super::purpose;
use crate::optim::initial::Initial;
use crate::tape::{Params, Tape, Var, nn};
use crate::{Error, Result};
use ndarray::{ArrayD, IxDyn};
use std::collections::BTreeMap;

/// Slope of the leaky ReLU at 0 and below.
pub const SLOPE: f32 = 0.2;
/// Width of the hidden layer behind the convolutions.
const HIDDEN: usize = 256;
/// Widths of the hidden layers for vectors.
const VECTOR_HIDDEN: [usize; 2] = [64, 64];
/// Scale of the weights of the last layer.
pub(super) const LAST: f32 = 0.1;
/// Initial value of ℓ.
const LOG_VARIANCE: f32 = -2.0;

/// Kind and size of the encoder input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// An image, shape (S, S, 3).
    Picture {
        /// Side S: 64, 128 or 256 pixels.
        side: usize,
    },
    /// A vector.
    Vector {
        /// Number of entries.
        size: usize,
    },
}

impl Input {
    /// Number of entries of an item.
    pub fn len(self) -> usize {
        match self {
            Self::Picture { side } => side * side * 3,
            Self::Vector { size } => size,
        }
    }

    /// Whether an item has no entries.
    pub fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Channels of the convolutions.
    ///
    /// # Errors
    /// If the side is not 64, 128 or 256.
    fn channels(self) -> Result<&'static [usize]> {
        match self {
            Self::Picture { side: 64 } => Ok(&[32, 32, 64, 64]),
            Self::Picture { side: 128 } => Ok(&[16, 32, 32, 64, 64]),
            Self::Picture { side: 256 } => Ok(&[16, 32, 32, 64, 64, 64]),
            Self::Picture { side } => Err(Error::input("image of the encoder")
                .expected("a side of 64, 128 or 256 pixels")
                .got(side.to_string())),
            Self::Vector { .. } => Ok(&[]),
        }
    }
}

/// Sizes of an encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoder {
    input: Input,
    channels: &'static [usize],
    /// Number d of latent values.
    latent: usize,
}

impl Encoder {
    /// Creates an encoder of `input` into d latent values.
    ///
    /// # Errors
    /// If there is no network for the side.
    pub fn new(input: Input, latent: usize) -> Result<Self> {
        Ok(Self { input, channels: input.channels()?, latent })
    }

    /// Kind and size of its input.
    pub fn input(&self) -> Input {
        self.input
    }

    /// Widths of the dense layers, inputs first.
    fn dense(&self) -> Vec<usize> {
        let mut widths = match self.input {
            Input::Picture { .. } => vec![16 * self.channels.last().copied().unwrap_or(3), HIDDEN],
            Input::Vector { size } => [&[size][..], &VECTOR_HIDDEN].concat(),
        };
        widths.push(2 * self.latent);
        widths
    }

    /// Names and shapes of all parameters.
    pub fn shapes(&self) -> Vec<(String, Vec<usize>)> {
        let mut all = Vec::new();
        let mut before = 3;
        for (i, &channels) in self.channels.iter().enumerate() {
            all.push((format!("encoder.conv{i}.weight"), vec![channels, 4, 4, before]));
            all.push((format!("encoder.conv{i}.bias"), vec![channels]));
            before = channels;
        }
        for (i, pair) in self.dense().windows(2).enumerate() {
            all.push((format!("encoder.dense{i}.weight"), vec![pair[1], pair[0]]));
            all.push((format!("encoder.dense{i}.bias"), vec![pair[1]]));
        }
        all
    }

    /// Names of weights and biases of the last layer, (2·d, inputs) and (2·d): rows of μ, then of ℓ.
    pub fn last(&self) -> [String; 2] {
        ["weight", "bias"].map(|part| format!("encoder.dense{}.{part}", self.dense().len() - 2))
    }

    /// Initial values of all parameters.
    pub fn draw(&self, seed: u64, params: &mut Params) {
        let last = self.dense().len() - 2;
        for (at, (name, shape)) in self.shapes().into_iter().enumerate() {
            let is_last = name.starts_with(&format!("encoder.dense{last}."));
            let mut array = first_values(seed, at as u32, &shape, SLOPE);
            if is_last && shape.len() == 2 {
                array.mapv_inplace(|w| LAST * w);
            } else if is_last {
                array.iter_mut().skip(self.latent).for_each(|b| *b = LOG_VARIANCE);
            }
            params.set(&name, array);
        }
    }

    /// Records the network on the tape: x (B, …) to (B, 2·d).
    ///
    /// # Panics
    /// If a parameter is missing.
    pub fn record(&self, tape: &mut Tape, vars: &BTreeMap<String, Var>, x: Var) -> Var {
        let var =
            |name: String| *vars.get(&name).unwrap_or_else(|| panic!("missing encoder parameter '{name}'"));
        let mut x = x;
        for i in 0..self.channels.len() {
            let [weight, bias] = ["weight", "bias"].map(|part| var(format!("encoder.conv{i}.{part}")));
            x = nn::conv(tape, [x, weight, bias], [2, 1], SLOPE);
        }
        let dense = self.dense();
        if !self.channels.is_empty() {
            let batch = tape.value(x).shape()[0];
            x = nn::reshape(tape, x, &[batch, dense[0]]);
        }
        for i in 0..dense.len() - 1 {
            let [weight, bias] = ["weight", "bias"].map(|part| var(format!("encoder.dense{i}.{part}")));
            x = nn::linear(tape, x, weight, bias, (i + 2 < dense.len()).then_some(SLOPE));
        }
        x
    }

    /// A batch in the form that the tape requires.
    ///
    /// # Panics
    /// If the number of values is not a multiple of the item size.
    pub fn batch(&self, values: Vec<f32>) -> ArrayD<f32> {
        let n = values.len() / self.input.len();
        let shape = match self.input {
            Input::Picture { side } => vec![n, side, side, 3],
            Input::Vector { size } => vec![n, size],
        };
        ArrayD::from_shape_vec(IxDyn(&shape), values).expect("whole items")
    }
}

/// He-uniform values for weights, 0 for biases and for weights without inputs; `at` is the number of the
/// array.
pub(super) fn first_values(seed: u64, at: u32, shape: &[usize], slope: f32) -> ArrayD<f32> {
    if shape.len() < 2 || shape.contains(&0) {
        return ArrayD::zeros(IxDyn(shape));
    }
    Initial::numbered(seed, purpose::INITIAL, at).he_uniform(shape, slope)
}
