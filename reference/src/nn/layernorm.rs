//! `nn.layernorm`: rows with mean 0 and variance 1, then a gain and a bias per column.
//!
//! y = (x − μ)/√(v + ε)·γ + b,   μ and v: mean of the row, mean of its squared distances from μ
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | (M, K) |
//! | γ | `gain` | (K) |
//! | b | `bias` | (K) |
//! | ε | setting `eps` | () |
//! | y | `y` | (M, K) |
//!
//! # Rounding
//! Two passes, left folds.
//!
//! # Kinks and domain
//! Smooth for ε > 0.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.layernorm`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("M,K", "rows"),
        gain: &'a Arr<S> = Port::var("K", "factor of every column"),
        bias: &'a Arr<S> = Port::var("K", "added last"),
    }
}

/// `nn.layernorm`
pub static SIGNATURE: Signature = Signature {
    name: "nn.layernorm",
    summary: "rows shifted and scaled to mean 0 and variance 1, then scaled and shifted per column",
    inputs: In::<f64>::PORTS,
    outputs: ports![y: Port::var("M,K", "")],
    settings: &[SettingSpec::number("eps", "1e-6", "added to the variance, above 0")],
    ..Signature::EMPTY
};

/// A row with mean 0 and variance v/(v + ε).
pub fn normalized<S: Scalar>(row: &[S], eps: f64) -> Vec<S> {
    let n = row.len() as f64;
    let mean = row.iter().fold(S::zero(), |sum, x| sum + *x) / n;
    let apart: Vec<S> = row.iter().map(|x| *x - mean).collect();
    let variance = apart.iter().fold(S::zero(), |sum, d| sum + *d * *d) / n;
    let spread = (variance + eps).sqrt();
    apart.into_iter().map(|d| d / spread).collect()
}

/// The twin of `nn.layernorm`.
pub fn forward<S: Scalar>(input: &In<'_, S>, eps: f64, out: &mut Out<'_, S>) {
    let In { x, gain, bias } = *input;
    let k = gain.data.len();
    let y = out.array("y", &x.shape);
    for (i, row) in x.data.chunks_exact(k).enumerate() {
        for (j, n) in normalized(row, eps).into_iter().enumerate() {
            out.put(y, i * k + j, n * gain.data[j] + bias.data[j]);
        }
        out.flush();
    }
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.number("eps"), out);
    Ok(())
}
