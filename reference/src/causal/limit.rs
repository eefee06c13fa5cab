//! `causal.limit`: clamps logarithms of variances.
//!
//! ℓ' = min(max(ℓ, −8), 4).
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | ℓ | `logvar` | any |
//! | ℓ' | `limited` | as ℓ |
//!
//! # Kinks and domain
//! The slope is 1 at the limits and between them, 0 outside.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `causal.limit`.
    pub struct In<'a, S> {
        logvar: &'a Arr<S> = Port::var("...", "ln of the variance"),
    }
}

/// `causal.limit`
pub static SIGNATURE: Signature = Signature {
    name: "causal.limit",
    summary: "clamps logarithms of variances to -8 … 4",
    inputs: In::<f64>::PORTS,
    outputs: ports![limited: Port::var("...", "")],
    ..Signature::EMPTY
};

/// The twin of `causal.limit`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let limited = out.array("limited", &input.logvar.shape);
    for (at, l) in input.logvar.data.iter().enumerate() {
        let x = match l.value() {
            x if x < -8.0 => S::from_f64(-8.0),
            x if x > 4.0 => S::from_f64(4.0),
            _ => *l,
        };
        out.put(limited, at, x);
    }
    out.flush();
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out);
    Ok(())
}
