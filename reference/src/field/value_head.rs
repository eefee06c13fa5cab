//! `field.value_head`: values from 0 to 1 from features.
//!
//! value = 1/(1 + e⁻ᶻ),   z the network without bias with the weights `w0`, `w1`, `w2` and, if present, `w3`
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | f | `features` | (N, K) |
//! | W | `w0`, `w1`, `w2`, `w3` | (A, K), (B, A), (D, B), (E, D) |
//! | | `value` | (N, D) or (N, E) |
//!
//! # Rounding
//! Sums over inputs are left folds from 0.
//!
//! # Kinks and domain
//! max(0, z) has slope 0 at 0.

use super::network::network;
use super::products;
use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `field.value_head`.
    pub struct In<'a, S> {
        features: &'a Arr<S> = Port::var("N,K", "of field.fetch"),
        w0: &'a Arr<S> = Port::var("A,K", "first layer"),
        w1: &'a Arr<S> = Port::var("B,A", "second layer"),
        w2: &'a Arr<S> = Port::var("D,B", "third layer"),
        w3: Option<&'a Arr<S>> = Port::var("E,D", "fourth layer; absent: the third is the last"),
    }
}

/// `field.value_head`
pub static SIGNATURE: Signature = Signature {
    name: "field.value_head",
    summary: "values from 0 to 1 from features: colour, albedo, roughness, metallic",
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("N,O", "0 to 1")],
    ..Signature::EMPTY
};

/// The twin of `field.value_head`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let In { features, w0, w1, w2, w3 } = *input;
    let weights: Vec<&Arr<S>> = [w0, w1, w2].into_iter().chain(w3).collect();
    let [n, k] = [features.shape[0], features.shape[1]];
    let width = weights[weights.len() - 1].shape[0];
    let value = out.array("value", &[n, width]);
    for row in 0..n {
        for (c, z) in network(&weights, &features.data[row * k..(row + 1) * k]).into_iter().enumerate() {
            out.put(value, row * width + c, S::one() / ((-z).exp() + 1.0));
        }
        out.flush();
    }
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out);
    Ok(())
}

/// Number of products.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let In { features, w0, w1, w2, w3 } = In::of(call.arrays)?;
    Ok(products(features.shape[0], [w0, w1, w2].into_iter().chain(w3)))
}
