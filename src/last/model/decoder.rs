//! The decoder D_θ: from factors to coloured points, at any coordinate of the template.
//!
//! The network is [`nn.decoder`](mod@crate::nn::decoder), whose documentation gives equation, rounding and
//! adjoint. Here γ(t) is the code of a coordinate t ([`code`], F = 27), or empty (F = 0) for vectors; base
//! and scale of points are (t, ½) and (½, ½, ½, 1, 1, 1). The paper does not specify the network.
//!
//! The pass includes the reconstruction loss (eq. 4 of the LAST paper, as a weighted mean): L_b = (1/Q) Σ
//! over q, c of w_c (R − target)² with w = 1/σ², a weight per item, and Q of the P coordinates.
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
/// Name of the weights applied to the factors, shape (128, d).
pub(super) const LATENT: &str = "decoder.latent.weight";
/// Number of octaves of the code.
const OCTAVES: usize = 4;
/// Number of entries of the code of a coordinate.
pub const CODE: usize = 3 + 6 * OCTAVES;
/// Number of the first array drawn for the decoder; those of the encoder have lower numbers.
const FIRST_ARRAY: u32 = 64;

/// The code γ(t) = (t, sin 2ᵐπt, cos 2ᵐπt for m = 0 … 3), t in −1 … 1; (N, 3) to (N, 27).
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
    /// Number F of entries of a code.
    pub features: usize,
    /// Number d of latent values.
    pub latent: usize,
    /// Number O of outputs.
    pub outputs: usize,
}

/// The coordinates at which an item is decoded, and the targets.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// Codes, shape (Q, F).
    pub codes: &'a [f32],
    /// Base of the outputs, shape (Q, O).
    pub base: &'a [f32],
    /// Targets, shape (Q, O).
    pub wanted: &'a [f32],
    /// Weight of the loss of this item.
    pub weight: f32,
}

/// The loss of a batch and its gradients.
#[derive(Clone, Debug)]
pub struct PassResult {
    /// Losses L_b, unweighted, shape (B).
    pub losses: Vec<f64>,
    /// Gradient of Σ weight·L_b with respect to z, shape (B, d).
    pub z_bar: Vec<f32>,
    /// Its gradients with respect to the parameters, in the order of [`Decoder::shapes`].
    pub grads: [Vec<f32>; 9],
}

fn slice<'a>(params: &'a Params, name: &str) -> &'a [f32] {
    let array = params.get(name).unwrap_or_else(|| panic!("missing decoder parameter '{name}'"));
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

    /// Initial values of all parameters, as for the encoder: here too, the weights of the last layer are
    /// scaled by 0.1, so that the initial loss is that of the template at rest. Without the scaling, the
    /// first gradients are a hundred times those that follow, and remain in Adam's second moments (decay
    /// 0.999) for thousands of steps.
    pub fn draw(&self, seed: u64, params: &mut Params) {
        for (at, (name, shape)) in self.shapes().into_iter().enumerate() {
            let mut array = first_values(seed, FIRST_ARRAY + at as u32, &shape, SLOPE);
            if name == "decoder.dense3.weight" {
                array.mapv_inplace(|w| LAST * w);
            }
            params.set(&name, array);
        }
    }

    /// The parameters in the form that [`decoder`] requires.
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

    /// Computes y (B, Q, O) at the same Q coordinates for every item: `codes` (Q, F), `z` (B, d).
    ///
    /// # Panics
    /// If a buffer does not have the size of its shape.
    pub fn forward(&self, params: &Params, codes: &[f32], z: &[f32]) -> Vec<f32> {
        decoder::values(&self.network(params), codes, z)
    }

    /// Loss and gradients of a batch; `scale` (O), `precision` w (O).
    ///
    /// # Panics
    /// If a buffer does not have the size of its shape.
    pub fn pass(
        &self,
        params: &Params,
        z: &[f32],
        targets: &[Target<'_>],
        scale: &[f32],
        precision: &[f32],
    ) -> PassResult {
        let items: Vec<Item<'_>> = targets.iter().map(|t| Item { codes: t.codes, base: t.base }).collect();
        let passed = decoder::adjoint(&self.network(params), z, &items, scale, &|b, decoded, bar| {
            let pair = points::Item { x: decoded, y: targets[b].wanted, precision };
            points::item_adjoint(&pair, targets[b].weight, bar);
            points::item(&pair)
        });
        PassResult { losses: passed.values, z_bar: passed.z_bar, grads: passed.grads }
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
        assert!(passed.losses.is_empty() && passed.z_bar.is_empty(), "an empty batch");
        assert_eq!(passed.grads.len(), decoder.shapes().len(), "every parameter has a gradient");
        assert!(passed.grads.iter().flatten().all(|g| *g == 0.0), "which is 0");
    }
}
