//! `field.normal_head`: unit normals from features; radial where the network is 0.
//!
//! n = v/‖v‖,   v = z + x/‖x‖,   z the network without bias with the weights `w0` to `w3`
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | f | `features` | (N, K) |
//! | x | `points` | (N, 3) |
//! | W | `w0` to `w3` | (A, K), (B, A), (D, B), (3, D) |
//! | n | `normal` | (N, 3) |
//!
//! # Rounding
//! Sums over inputs are left folds from 0.
//!
//! # Kinks and domain
//! max(0, z) has slope 0 at 0; 0/0 is 0 with slope 0.

use super::network::network;
use super::{length, products};
use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `field.normal_head`.
    pub struct In<'a, S> {
        features: &'a Arr<S> = Port::var("N,K", "of field.fetch"),
        points: &'a Arr<S> = Port::var("N,3", ""),
        w0: &'a Arr<S> = Port::var("A,K", "first layer"),
        w1: &'a Arr<S> = Port::var("B,A", "second layer"),
        w2: &'a Arr<S> = Port::var("D,B", "third layer"),
        w3: &'a Arr<S> = Port::var("3,D", "last layer"),
    }
}

/// `field.normal_head`
pub static SIGNATURE: Signature = Signature {
    name: "field.normal_head",
    summary: "unit normals from features: a network plus the radial direction",
    inputs: In::<f64>::PORTS,
    outputs: ports![normal: Port::var("N,3", "unit, or 0")],
    ..Signature::EMPTY
};

/// v/‖v‖, 0 with slope 0 at 0.
pub fn unit<S: Scalar>(v: [S; 3]) -> [S; 3] {
    let length = length(v);
    if length.value() == 0.0 { [S::zero(); 3] } else { v.map(|x| x / length) }
}

/// The twin of `field.normal_head`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let In { features, points, w0, w1, w2, w3 } = *input;
    let [n, k] = [features.shape[0], features.shape[1]];
    let normal = out.array("normal", &[n, 3]);
    for row in 0..n {
        let z = network(&[w0, w1, w2, w3], &features.data[row * k..(row + 1) * k]);
        let radial = unit(points.row(row));
        out.put_row(normal, row, unit(std::array::from_fn(|i| z[i] + radial[i])));
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
    let In { features, w0, w1, w2, w3, .. } = In::of(call.arrays)?;
    Ok(products(features.shape[0], [w0, w1, w2, w3].into_iter()))
}
