//! `nn.mlp`: a fully connected network, affine maps with max(0, ·) between them.
//!
//! yˡ = max(0, Wˡ yˡ⁻¹ + bˡ) for every layer but the last, which has no max; y⁰ = x; the layer `skip` has the
//! argument (yˡ⁻¹, x) instead of yˡ⁻¹
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | (M, K) |
//! | | `widths` | (L + 1): K, then the outputs of every layer |
//! | W | `weights` | (Σ Nˡ Kˡ), layer by layer, row-major (Nˡ, Kˡ) |
//! | b | `biases` | (Σ Nˡ) |
//! | | setting `skip` | () |
//! | y | `y` | (M, Nᴸ) |
//!
//! # Rounding
//! One chain per entry from 0, inputs ascending; the bias is added last.
//!
//! # Kinks and domain
//! max(0, z) has slope 0 at 0. At least one layer and one row; `skip` is a layer after the first, or 0.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.mlp`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("M,K", "rows"),
        widths: &'a Arr<S> = Port::int("L1", Dtype::I32, "inputs, then the outputs of every layer"),
        weights: &'a Arr<S> = Port::var("W", "weights (N, K) of every layer, one after the other"),
        biases: &'a Arr<S> = Port::var("B", "biases (N) of every layer, one after the other"),
    }
}

/// `nn.mlp`
pub static SIGNATURE: Signature = Signature {
    name: "nn.mlp",
    summary: "a fully connected network with max(0, x) between its layers",
    inputs: In::<f64>::PORTS,
    outputs: ports![y: Port::var("M,N", "")],
    settings: &[SettingSpec::number(
        "skip",
        "0",
        "index of the layer that also takes the input x; 0 for none",
    )],
    ..Signature::EMPTY
};

/// The twin of `nn.mlp`.
///
/// # Errors
/// When the widths do not match the arrays.
pub fn forward<S: Scalar>(input: &In<'_, S>, skip: usize, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { x, widths, weights, biases } = *input;
    let widths: Vec<usize> = widths.data.iter().map(|w| w.value() as usize).collect();
    let [m, k] = [x.shape[0], x.shape[1]];
    let last = widths.len() - 1;
    let inputs = |layer: usize| widths[layer] + if layer > 0 && layer == skip { k } else { 0 };
    let needed = (0..last).fold([0, 0], |[w, b], l| [w + inputs(l) * widths[l + 1], b + widths[l + 1]]);
    if widths[0] != k || needed != [weights.data.len(), biases.data.len()] {
        return Err(format!("input widths: {widths:?} do not match the arrays"));
    }
    let y = out.array("y", &[m, widths[last]]);
    for row in 0..m {
        let own = &x.data[row * k..(row + 1) * k];
        let mut values = own.to_vec();
        let (mut weight, mut bias) = (weights.data.iter(), biases.data.iter());
        for layer in 0..last {
            if layer > 0 && layer == skip {
                values.extend_from_slice(own);
            }
            let mut next = Vec::new();
            for _ in 0..widths[layer + 1] {
                let mut sum = S::zero();
                for value in &values {
                    sum = sum + *value * *weight.next().ok_or("input weights: too few")?;
                }
                sum = sum + *bias.next().ok_or("input biases: too few")?;
                next.push(if layer + 1 < last && sum.value() <= 0.0 { S::zero() } else { sum });
            }
            values = next;
        }
        for (column, value) in values.into_iter().enumerate() {
            out.put(y, row * widths[last] + column, value);
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or the widths do not match.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.whole("skip", 0.0)?, out)
}

/// Number of products.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let In { x, weights, .. } = In::of(call.arrays)?;
    Ok((x.shape[0] * weights.data.len()) as u64)
}
