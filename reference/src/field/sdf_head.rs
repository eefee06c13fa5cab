//! `field.sdf_head`: signed distance from features, bounded, and a sphere where the network is 0.
//!
//! s = 1.5·1.732·R·tanh(z) + (‖x‖ − 0.1 R),   z = W² max(0, W¹ max(0, W⁰ f))
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | f | `features` | (N, K) |
//! | x | `points` | (N, 3) |
//! | W⁰, W¹, W² | `w0`, `w1`, `w2` | (A, K), (B, A), (1, B) |
//! | R | setting `half_size` | () |
//! | s | `sdf` | (N) |
//!
//! # Rounding
//! Sums over inputs are left folds from 0.
//!
//! # Kinks and domain
//! max(0, z) has slope 0 at 0, ‖x‖ at x = 0.

use super::network::network;
use super::{HALF_SIZE, half_size, length, products};
use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `field.sdf_head`.
    pub struct In<'a, S> {
        features: &'a Arr<S> = Port::var("N,K", "of field.fetch"),
        points: &'a Arr<S> = Port::var("N,3", ""),
        w0: &'a Arr<S> = Port::var("A,K", "first layer"),
        w1: &'a Arr<S> = Port::var("B,A", "second layer"),
        w2: &'a Arr<S> = Port::var("1,B", "last layer"),
    }
}

/// `field.sdf_head`
pub static SIGNATURE: Signature = Signature {
    name: "field.sdf_head",
    summary: "signed distance from features: a bounded network plus a sphere",
    inputs: In::<f64>::PORTS,
    outputs: ports![sdf: Port::var("N", "negative inside")],
    settings: &[HALF_SIZE],
    ..Signature::EMPTY
};

/// Signed distance of a point with the network's output z.
pub fn distance<S: Scalar>(z: S, point: [S; 3], half_size: f64) -> S {
    z.tanh() * (1.5 * 1.732 * half_size) + (length(point) - 0.1 * half_size)
}

/// The twin of `field.sdf_head`.
pub fn forward<S: Scalar>(input: &In<'_, S>, half_size: f64, out: &mut Out<'_, S>) {
    let In { features, points, w0, w1, w2 } = *input;
    let [n, k] = [features.shape[0], features.shape[1]];
    let sdf = out.array("sdf", &[n]);
    for row in 0..n {
        let z = network(&[w0, w1, w2], &features.data[row * k..(row + 1) * k])[0];
        out.put(sdf, row, distance(z, points.row(row), half_size));
        out.flush();
    }
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or the half size is not above 0.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, half_size(&call.settings)?, out);
    Ok(())
}

/// Number of products.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let In { features, w0, w1, w2, .. } = In::of(call.arrays)?;
    Ok(products(features.shape[0], [w0, w1, w2].into_iter()))
}
