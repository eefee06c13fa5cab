//! `loss.eikonal`: deviation of gradients from unit length.
//!
//! value = Σ (‖g‖² − 1)² / N
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | g | `gradient` | (N, 3) |
//! | | `value` | () |
//!
//! # Rounding
//! A left fold over the rows, then one division.
//!
//! # Kinks and domain
//! Smooth. At least one row.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `loss.eikonal`.
    pub struct In<'a, S> {
        gradient: &'a Arr<S> = Port::var("N,3", "of a signed distance"),
    }
}

/// `loss.eikonal`
pub static SIGNATURE: Signature = Signature {
    name: "loss.eikonal",
    summary: "mean (‖g‖² − 1)²",
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "mean over the rows")],
    ..Signature::EMPTY
};

/// The twin of `loss.eikonal`.
///
/// # Errors
/// When there is no row.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let n = input.gradient.shape[0];
    if n == 0 {
        return Err("input gradient: expected at least one row, got none".to_owned());
    }
    let value = out.array("value", &[]);
    for row in 0..n {
        let [x, y, z] = input.gradient.row(row);
        let excess = x * x + y * y + z * z - 1.0;
        out.add(value, 0, excess * excess, n as f64);
        out.flush();
    }
    out.divide(value, 0, n as f64);
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or there is no row.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
