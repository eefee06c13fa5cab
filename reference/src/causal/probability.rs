//! `causal.probability`: edge probabilities of a graph.
//!
//! p_ij = 1/(1 + e^(−U_ij/τ)) for i ≠ j, 0 for i = j.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | U | `logits` | (n, n) |
//! | τ | setting `tau` | () |
//! | p | `probabilities` | (n, n) |

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `causal.probability`.
    pub struct In<'a, S> {
        logits: &'a Arr<S> = Port::var("N,N", "of the edges i → j; the diagonal is ignored"),
    }
}

/// `causal.probability`
pub static SIGNATURE: Signature = Signature {
    name: "causal.probability",
    summary: "edge probabilities of a graph",
    inputs: In::<f64>::PORTS,
    outputs: ports![probabilities: Port::var("N,N", "zero diagonal")],
    settings: &[SettingSpec::number("tau", "0.2", "temperature")],
    ..Signature::EMPTY
};

/// The twin of `causal.probability`.
///
/// # Errors
/// When τ is not above 0.
pub fn forward<S: Scalar>(input: &In<'_, S>, tau: f64, out: &mut Out<'_, S>) -> Result<(), String> {
    let n = input.logits.shape[0];
    if !(tau > 0.0) {
        return Err(format!("setting tau: expected a number above 0, got {tau}"));
    }
    let probabilities = out.array("probabilities", &[n, n]);
    for at in (0..n * n).filter(|at| at / n != at % n) {
        let x = input.logits.data[at] / tau;
        let p = if x.value() >= 0.0 { S::one() / ((-x).exp() + 1.0) } else { x.exp() / (x.exp() + 1.0) };
        out.put(probabilities, at, p);
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or τ is not above 0.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.number("tau"), out)
}
