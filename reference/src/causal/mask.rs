//! `causal.mask`: soft samples of the edges of a graph.
//!
//! Ã(i,j) = L(i,j) σ((U(i,j) + ln u(i,j) − ln(1 − u(i,j))) / τ) for i ≠ j, 0 for i = j; L = 1 without
//! `allowed`.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | U | `logits` | (n, n) |
//! | u | `uniform` | (n, n), noise without gradient |
//! | L | `allowed` | (n, n), 0 or 1, a decision without gradient |
//! | Ã | `mask` | (n, n) |

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `causal.mask`.
    pub struct In<'a, S> {
        logits: &'a Arr<S> = Port::var("N,N", "of the edges i → j; the diagonal is ignored"),
        uniform: &'a Arr<S> =
            Port::fixed("N,N", "noise between 0 and 1; 0.5 everywhere gives probabilities"),
        allowed: Option<&'a Arr<S>> = Port::fixed("N,N", "1 where an edge is allowed, else 0; absent: all are"),
    }
}

/// `causal.mask`
pub static SIGNATURE: Signature = Signature {
    name: "causal.mask",
    summary: "soft samples of the edges of a graph",
    inputs: In::<f64>::PORTS,
    outputs: ports![mask: Port::var("N,N", "soft edges, zero diagonal")],
    settings: &[SettingSpec::number("tau", "0.2", "temperature")],
    ..Signature::EMPTY
};

/// The twin of `causal.mask`.
///
/// # Errors
/// When a number is out of range.
pub fn forward<S: Scalar>(input: &In<'_, S>, tau: f64, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { logits, uniform, allowed } = *input;
    let n = logits.shape[0];
    if !(tau > 0.0) {
        return Err(format!("setting tau: expected a number above 0, got {tau}"));
    }
    let mask = out.array("mask", &[n, n]);
    for i in 0..n {
        for j in (0..n).filter(|j| *j != i) {
            let u = uniform.data[i * n + j].value();
            if !(u > 0.0 && u < 1.0) {
                return Err(format!("input uniform: expected numbers between 0 and 1, got {u}"));
            }
            let x = (logits.data[i * n + j] + (libm::log(u) - libm::log1p(-u))) / tau;
            let y = if x.value() >= 0.0 { S::one() / ((-x).exp() + 1.0) } else { x.exp() / (x.exp() + 1.0) };
            let edge = match allowed.map(|allowed| allowed.data[i * n + j].value()) {
                None | Some(1.0) => y,
                Some(0.0) => S::zero(),
                Some(other) => return Err(format!("input allowed: expected 0 or 1, got {other}")),
            };
            out.put(mask, i * n + j, edge);
        }
    }
    out.flush();
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or a number is out of range.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.number("tau"), out)
}
