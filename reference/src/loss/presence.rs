//! `loss.presence`: mean opacity and mean standard deviation of Gaussians.
//!
//! L = w_o · mean σ(l) + w_s · mean e^s
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | l | `opacity_logits` | (N) |
//! | s | `scales_log` | (N, 3) |
//! | w_o, w_s | settings `opacity_weight`, `scale_weight` | () |
//! | L | `value` | () |
//!
//! # Kinks and domain
//! No kinks. s ≤ 88, so that e^s is in the range of f32.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `loss.presence`.
    pub struct In<'a, S> {
        opacity_logits: &'a Arr<S> = Port::var("N", "logits of the opacities"),
        scales_log: &'a Arr<S> = Port::var("N,3", "logarithms of the standard deviations"),
    }
}

/// `loss.presence`
pub static SIGNATURE: Signature = Signature {
    name: "loss.presence",
    summary: "mean opacity and mean standard deviation of Gaussians",
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "")],
    settings: &[
        SettingSpec::number("opacity_weight", "0.01", "weight of the mean opacity"),
        SettingSpec::number("scale_weight", "0.01", "weight of the mean standard deviation"),
    ],
    ..Signature::EMPTY
};

/// The twin of `loss.presence`.
pub fn forward<S: Scalar>(input: &In<'_, S>, weights: [f64; 2], out: &mut Out<'_, S>) {
    let In { opacity_logits, scales_log } = *input;
    let n = opacity_logits.data.len() as f64;
    let value = out.array("value", &[]);
    for l in &opacity_logits.data {
        out.add(value, 0, S::one() / ((-*l).exp() + 1.0) * weights[0] / n, 1.0);
        out.flush();
    }
    for s in &scales_log.data {
        out.add(value, 0, s.exp() * weights[1] / (3.0 * n), 1.0);
        out.flush();
    }
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let weights = ["opacity_weight", "scale_weight"].map(|key| call.settings.number(key));
    forward(&In::of(call.arrays)?, weights, out);
    Ok(())
}
