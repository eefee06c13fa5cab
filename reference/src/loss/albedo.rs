//! `loss.albedo`: mean squared difference of albedo, after a common scale of the linear values.
//!
//! adjusted = clamp(s·p^2.2 + (1 − O), 10⁻⁴, 1)^(1/2.2),   value = Σ (adjusted − truth)² / 3N
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | p | `prediction` | (N, 3) or (H, W, 3), composited over black |
//! | | `truth` | the same, over white, no gradient |
//! | O | `opacity` | (N) or (H, W) |
//! | s | `scale` | (), no gradient |
//! | | `value` | () |
//! | | `adjusted` | as `prediction` |
//!
//! # Rounding
//! A left fold over the values, then one division.
//!
//! # Kinks and domain
//! Slope 0 where the linear value is below 10⁻⁴ or above 1, the slope of the power at both ends. p ≥ 0, s > 0.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `loss.albedo`.
    pub struct In<'a, S> {
        prediction: &'a Arr<S> = Port::var("N,3|H,W,3", "sRGB-encoded, composited over black"),
        truth: &'a Arr<S> = Port::fixed("N,3|H,W,3", "sRGB-encoded, over white"),
        opacity: &'a Arr<S> = Port::var("N|H,W", "predicted, 0 to 1"),
        scale: &'a Arr<S> = Port::fixed("", "factor of linear values, one per object"),
    }
}

/// `loss.albedo`
pub static SIGNATURE: Signature = Signature {
    name: "loss.albedo",
    summary: "mean squared difference of albedo after a scale, and the adjusted prediction",
    inputs: In::<f64>::PORTS,
    outputs: ports![
        value: Port::var("", "mean over the values"),
        adjusted: Port::var("N,3|H,W,3", "scaled prediction over white"),
    ],
    ..Signature::EMPTY
};

/// The twin of `loss.albedo`.
///
/// # Errors
/// When there is no value, a prediction is negative, or the scale is not above 0.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { prediction, truth, opacity, scale } = *input;
    let (count, scale) = (prediction.data.len() as f64, scale.data[0].value());
    if opacity.data.len() * 3 != prediction.data.len() {
        return Err("input opacity: expected one value per pixel".to_owned());
    }
    if prediction.data.is_empty() || prediction.data.iter().any(|p| p.value() < 0.0) || !(scale > 0.0) {
        return Err("input prediction: expected values of 0 or more and a scale above 0".to_owned());
    }
    let (value, adjusted) = (out.array("value", &[]), out.array("adjusted", &prediction.shape));
    let exponent = |x: f64| S::from_f64(x);
    for (i, p) in prediction.data.iter().enumerate() {
        let linear = p.pow(exponent(2.2)) * scale + (S::one() - opacity.data[i / 3]);
        let limited = if linear.value() < 1e-4 {
            S::from_f64(1e-4)
        } else if linear.value() > 1.0 {
            S::one()
        } else {
            linear
        };
        let ours = limited.pow(exponent(1.0 / 2.2));
        let d = ours - truth.data[i].value();
        out.add(value, 0, d * d, count);
        out.put(adjusted, i, ours);
        out.flush();
    }
    out.divide(value, 0, count);
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
