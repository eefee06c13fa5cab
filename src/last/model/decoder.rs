//! The decoder D_θ: from factors to what they show, at any coordinate of the template.
//!
//! The network is [`nn.decoder`](mod@crate::nn::decoder): equation, rounding and adjoint are there. Here γ(t) is the code of a coordinate t ([`code`],
//! F = 27), none (F = 0) for vectors; base and scale of points are (t, ½) and (½, ½, ½, 1, 1, 1) (`last.md` §4.4).
//!
//! The loss of §4.5 is part of the pass: L_b = (1/Q) Σ over q, c of w_c (R − target)² with w = 1/σ², a weight per item, and Q of the P coordinates.
//!
//! # Rounding
//! L_b is a left fold over (q, c) in f64.

use super::encoder::{LAST, first_values};
use crate::loss::points;
use crate::nn::decoder::{self, Item, SLOPE};
use crate::num::elem;
use crate::tape::Params;

/// Widths of the hidden layers.
pub const HIDDEN: [usize; 3] = [128, 128, 64];
/// Name of the weights that meet the factors, (128, d).
pub(super) const LATENT: &str = "decoder.latent.weight";
/// Octaves of the code.
const OCTAVES: usize = 4;
/// Numbers of the code of a coordinate.
pub const CODE: usize = 3 + 6 * OCTAVES;
/// First number of the arrays drawn for the decoder; those of the encoder come before.
const FIRST_ARRAY: u32 = 64;

/// γ(t) = (t, sin 2ᵐπt, cos 2ᵐπt for m = 0 … 3), t in −1 … 1; (N, 3) to (N, 27).
pub fn code(points: &[[f32; 3]]) -> Vec<f32> {
    let mut codes = Vec::with_capacity(points.len() * CODE);
    for t in points {
        codes.extend_from_slice(t);
        for m in 0..OCTAVES {
            let angles = t.map(|t| std::f64::consts::PI * f64::from(1u32 << m) * f64::from(t));
            codes.extend(angles.map(|a| elem::f64::sin(a) as f32));
            codes.extend(angles.map(|a| elem::f64::cos(a) as f32));
        }
    }
    codes
}

/// Sizes of a decoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decoder {
    /// F
    pub features: usize,
    /// d
    pub latent: usize,
    /// O
    pub outputs: usize,
}

/// Where an item is decoded, and what is to come out.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// (Q, F)
    pub codes: &'a [f32],
    /// (Q, O)
    pub base: &'a [f32],
    /// (Q, O)
    pub wanted: &'a [f32],
    /// factor of this item's loss
    pub weight: f32,
}

/// The loss of a batch and its gradients.
#[derive(Clone, Debug)]
pub struct Passed {
    /// (B) L_b, without weights
    pub losses: Vec<f64>,
    /// (B, d) gradient of Σ weight·L_b
    pub z_bar: Vec<f32>,
    /// the same by the parameters, in the order of [`Decoder::shapes`]
    pub grads: [Vec<f32>; 9],
}

fn slice<'a>(params: &'a Params, name: &str) -> &'a [f32] {
    let array = params.get(name).unwrap_or_else(|| panic!("the decoder has '{name}'"));
    array.as_slice().expect("parameters are contiguous and row-major")
}

impl Decoder {
    /// Names and shapes of all parameters.
    pub fn shapes(&self) -> Vec<(String, Vec<usize>)> {
        let [a, b, c] = HIDDEN;
        [
            ("point.weight", vec![a, self.features]),
            ("latent.weight", vec![a, self.latent]),
            ("dense0.bias", vec![a]),
            ("dense1.weight", vec![b, a]),
            ("dense1.bias", vec![b]),
            ("dense2.weight", vec![c, b]),
            ("dense2.bias", vec![c]),
            ("dense3.weight", vec![self.outputs, c]),
            ("dense3.bias", vec![self.outputs]),
        ]
        .map(|(name, shape)| (format!("decoder.{name}"), shape))
        .to_vec()
    }

    /// First values of all parameters, as the encoder's: the last layer's weights are scaled by 0.1 here too, so that the first loss is that of the
    /// template at rest. Without it the first gradients are a hundred times those that follow, and Adam's second moments (0.999) remember them for
    /// thousands of steps.
    pub fn draw(&self, seed: u64, params: &mut Params) {
        for (at, (name, shape)) in self.shapes().into_iter().enumerate() {
            let mut array = first_values(seed, FIRST_ARRAY + at as u32, &shape, SLOPE);
            if name == "decoder.dense3.weight" {
                array.mapv_inplace(|w| LAST * w);
            }
            params.set(&name, array);
        }
    }

    /// The parameters as [`decoder`] takes them.
    fn network<'a>(&self, params: &'a Params) -> decoder::Params<'a> {
        let get = |name: &str| slice(params, &format!("decoder.{name}"));
        decoder::Params {
            sizes: decoder::Sizes {
                features: self.features,
                latent: self.latent,
                hidden: HIDDEN,
                outputs: self.outputs,
            },
            point: get("point.weight"),
            latent: get("latent.weight"),
            weights: ["dense1.weight", "dense2.weight", "dense3.weight"].map(get),
            biases: ["dense0.bias", "dense1.bias", "dense2.bias", "dense3.bias"].map(get),
        }
    }

    /// y (B, Q, O) at the same Q coordinates for every item: `codes` (Q, F), `z` (B, d).
    ///
    /// # Panics
    /// When a buffer does not have the size of its shape.
    pub fn forward(&self, params: &Params, codes: &[f32], z: &[f32]) -> Vec<f32> {
        decoder::values(&self.network(params), codes, z)
    }

    /// Loss and gradients of a batch; `scale` (O), `precision` w (O).
    ///
    /// # Panics
    /// When a buffer does not have the size of its shape.
    pub fn pass(
        &self,
        params: &Params,
        z: &[f32],
        targets: &[Target<'_>],
        scale: &[f32],
        precision: &[f32],
    ) -> Passed {
        let items: Vec<Item<'_>> = targets.iter().map(|t| Item { codes: t.codes, base: t.base }).collect();
        let passed = decoder::adjoint(&self.network(params), z, &items, scale, &|b, decoded, bar| {
            let pair = points::Item { x: decoded, y: targets[b].wanted, precision };
            points::item_adjoint(&pair, targets[b].weight, bar);
            points::item(&pair)
        });
        Passed { losses: passed.values, z_bar: passed.z_bar, grads: passed.grads }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_batch_has_no_loss_and_no_gradient() {
        let decoder = Decoder { features: 5, latent: 6, outputs: 3 };
        let mut params = Params::default();
        decoder.draw(1, &mut params);
        let passed = decoder.pass(&params, &[], &[], &[1.0; 3], &[1.0; 3]);
        assert!(passed.losses.is_empty() && passed.z_bar.is_empty(), "nothing went in");
        assert_eq!(passed.grads.len(), decoder.shapes().len(), "every parameter has a gradient");
        assert!(passed.grads.iter().flatten().all(|g| *g == 0.0), "which is 0");
    }
}
