//! The networks and their evaluation on items.

use super::super::data::{Data, Item};
use super::super::decoder::Decoder;
use super::super::encoder::Encoder;
use super::super::settings::{Reading, Settings};
use super::super::structure::{Sizes, Structure};
use crate::Result;
use crate::causal::structure;
use crate::num::par;
use crate::tape::{Params, Tape};
use ndarray::{ArrayD, IxDyn};

/// The networks and their parameters.
#[derive(Clone, Debug)]
pub struct Model {
    /// The encoder E.
    pub encoder: Encoder,
    /// The decoder D.
    pub decoder: Decoder,
    /// Sizes of the structure (A, g).
    pub sizes: Sizes,
    /// All parameters.
    pub params: Params,
}

impl Model {
    /// Creates a model for `data` with initial values.
    ///
    /// # Errors
    /// If there is no encoder for the size of the images.
    pub fn new(settings: &Settings, data: &dyn Data) -> Result<Self> {
        let sizes = Sizes { factors: settings.factors, width: settings.width, kind: settings.kind };
        let frame = data.frame();
        let encoder = Encoder::new(data.input(), sizes.latent())?;
        let decoder = Decoder { features: frame.features, latent: sizes.latent(), outputs: frame.outputs };
        let mut params = Params::new();
        encoder.draw(settings.seed, &mut params);
        decoder.draw(settings.seed, &mut params);
        sizes.draw(settings.seed, &mut params);
        Ok(Self { encoder, decoder, sizes, params })
    }

    /// Means μ and log-variances ℓ of the posterior of some items, (B, d) each.
    pub fn encode(&self, data: &dyn Data, items: &[Item]) -> [Vec<f64>; 2] {
        let mut halves = [Vec::new(), Vec::new()];
        for part in items.chunks(256) {
            let mut tape = Tape::new();
            let x = tape.constant(self.encoder.batch(inputs(data, part)));
            let vars = self.params.of("encoder.").constants(&mut tape);
            let y = self.encoder.record(&mut tape, &vars, x);
            let [mu, ell] = split(&tape.value(y), self.sizes.latent());
            halves[0].extend(mu);
            halves[1].extend(ell);
        }
        halves
    }

    /// Factors u and noise ε (B, d) that correspond to means of the encoder, along the edges of `mask` (n,
    /// n).
    pub fn linked(&self, reading: Reading, mask: &[f64], mu: Vec<f64>) -> [Vec<f64>; 2] {
        let structure = Structure::new(self.sizes, &self.params);
        let x = structure::In {
            eps: &mu,
            mask,
            mechanism: structure.mechanism(),
            batch: mu.len() / self.sizes.latent(),
            n: self.sizes.factors,
            k: self.sizes.width,
            sweeps: structure.sweeps(),
        };
        match reading {
            Reading::Reference => {
                let eps = structure::abduct(&x);
                [mu, eps]
            }
            Reading::Literal => {
                let u = structure::forward(&x).0;
                [u, mu]
            }
        }
    }
}

/// Encoder inputs of the items.
pub(super) fn inputs(data: &dyn Data, items: &[Item]) -> Vec<f32> {
    let size = data.input().len();
    let mut x = vec![0.0; items.len() * size];
    par::chunks_mut(&mut x, size, |i, into| data.write_input(items[i], into));
    x
}

/// Splits (B, 2 d) into μ and ℓ.
pub(super) fn split(y: &ArrayD<f32>, d: usize) -> [Vec<f64>; 2] {
    let mut halves = [Vec::new(), Vec::new()];
    for (at, &y) in y.iter().enumerate() {
        halves[at / d % 2].push(f64::from(y));
    }
    halves
}

/// Joins gradients of μ and ℓ, (B, d) each, to (B, 2 d).
pub(super) fn joined([mu, ell]: [&[f64]; 2], d: usize) -> ArrayD<f32> {
    let both = (0..mu.len() * 2).map(|at| {
        let (row, column) = (at / (2 * d), at % (2 * d));
        let from = if column < d { mu } else { ell };
        from[row * d + column % d] as f32
    });
    ArrayD::from_shape_vec(IxDyn(&[mu.len() / d, 2 * d]), both.collect()).expect("(B, 2 d)")
}
