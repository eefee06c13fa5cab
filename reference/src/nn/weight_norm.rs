//! `nn.weight_norm`: rows of a matrix from their directions and lengths.
//!
//! W(o,·) = g(o)·v(o,·)/‖v(o,·)‖
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | v | `v` | (N, K) |
//! | g | `g` | (N) |
//! | W | `weight` | (N, K) |
//!
//! # Rounding
//! ‖v‖² is a left fold.
//!
//! # Kinks and domain
//! No row of v is zero.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.weight_norm`.
    pub struct In<'a, S> {
        v: &'a Arr<S> = Port::var("N,K", "directions of the rows, of any length"),
        g: &'a Arr<S> = Port::var("N", "lengths of the rows"),
    }
}

/// `nn.weight_norm`
pub static SIGNATURE: Signature = Signature {
    name: "nn.weight_norm",
    summary: "a matrix as directions and lengths of its rows",
    inputs: In::<f64>::PORTS,
    outputs: ports![weight: Port::var("N,K", "")],
    ..Signature::EMPTY
};

/// The twin of `nn.weight_norm`.
///
/// # Errors
/// When a row of v is zero.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { v, g } = *input;
    let [n, k] = [v.shape[0], v.shape[1]];
    let weight = out.array("weight", &v.shape);
    for i in 0..n {
        let row = &v.data[i * k..(i + 1) * k];
        let length = row.iter().fold(S::zero(), |sum, x| sum + *x * *x).sqrt();
        if length.value() == 0.0 {
            return Err(format!("input v: row {i} is zero"));
        }
        for (j, x) in row.iter().enumerate() {
            out.put(weight, i * k + j, g.data[i] * *x / length);
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
