//! `field.composite`: values along rays, composited over a background.
//!
//! αᵢ = 1 − e^(−σᵢδᵢ),   wᵢ = αᵢ Π_{j<i} (1 − αⱼ),   O = Σ wᵢ,   value = Σ wᵢvᵢ + (1 − O)·background
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | σ, δ | `sigma`, `delta` | (N, S) |
//! | v | `values` | (N, S, C) |
//! | | `background` | (C) |
//! | | `value` | (N, C) |
//! | O, w | `opacity`, `weights` | (N), (N, S) |
//!
//! # Rounding
//! The product of 1 − α is e to the minus sum of σδ.
//!
//! # Kinks and domain
//! Smooth. All samples count.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `field.composite`.
    pub struct In<'a, S> {
        sigma: &'a Arr<S> = Port::var("N,S", "density, per scene unit"),
        delta: &'a Arr<S> = Port::var("N,S", "length of the interval, scene units"),
        values: &'a Arr<S> = Port::var("N,S,C", "value of every sample"),
        background: &'a Arr<S> = Port::var("C", "behind the last sample"),
    }
}

/// `field.composite`
pub static SIGNATURE: Signature = Signature {
    name: "field.composite",
    summary: "values along rays, weighted by visibility, over a background",
    inputs: In::<f64>::PORTS,
    outputs: ports![
        value: Port::var("N,C", ""),
        opacity: Port::var("N", "0 to 1"),
        weights: Port::fixed("N,S", "of every sample"),
    ],
    ..Signature::EMPTY
};

/// The twin of `field.composite`.
///
/// # Errors
/// When there is no sample.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { sigma, delta, values, background } = *input;
    let [n, s, channels] = [values.shape[0], values.shape[1], values.shape[2]];
    if s == 0 {
        return Err("input sigma: expected at least one sample per ray, got none".to_owned());
    }
    let (value, opacity) = (out.array("value", &[n, channels]), out.array("opacity", &[n]));
    let weights = out.array("weights", &[n, s]);
    for ray in 0..n {
        let (mut depth, mut total) = (S::zero(), S::zero());
        let mut sums = vec![S::zero(); channels];
        for i in ray * s..(ray + 1) * s {
            let tau = sigma.data[i] * delta.data[i];
            let weight = (-depth).exp() * -(-tau).expm1();
            depth = depth + tau;
            total = total + weight;
            for (c, sum) in sums.iter_mut().enumerate() {
                *sum = *sum + weight * values.data[i * channels + c];
            }
            out.put(weights, i, weight);
        }
        for (c, sum) in sums.into_iter().enumerate() {
            out.put(value, ray * channels + c, sum + (S::one() - total) * background.data[c]);
        }
        out.put(opacity, ray, total);
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or there is no sample.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
