//! `causal.acyclic`: measures how far a weighted graph is from being acyclic.
//!
//! h = tr((I + αH)ⁿ) − n = Σₜ₌₁ⁿ (n over t) αᵗ tr Hᵗ, H = A∘A.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | A | `a` | (n, n) |
//! | α | `alpha` | () |
//! | h | `value` | () |
//!
//! # Rounding
//! Left folds; powers of H by repeated products; t ascending.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `causal.acyclic`.
    pub struct In<'a, S> {
        a: &'a Arr<S> = Port::var("N,N", "edges i → j"),
        alpha: &'a Arr<S> = Port::fixed("", "above 0; 1 for N up to 8"),
    }
}

/// `causal.acyclic`
pub static SIGNATURE: Signature = Signature {
    name: "causal.acyclic",
    summary: "how far a weighted graph is from having no cycle: tr((I + αA∘A)ⁿ) − n",
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "0 without cycles, positive otherwise")],
    ..Signature::EMPTY
};

/// The twin of `causal.acyclic`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let In { a, alpha } = *input;
    let (n, alpha) = (a.shape[0], alpha.data[0].value());
    let h: Arr<S> = a.map(|&a| a * a);
    let mut power = h.data.clone();
    let (mut value, mut factor) = (S::zero(), 1.0);
    for t in 1..=n {
        factor = factor * alpha * (n - t + 1) as f64 / t as f64;
        let mut trace = S::zero();
        for i in 0..n {
            trace = trace + power[i * n + i];
        }
        value = value + trace * factor;
        let mut next = vec![S::zero(); n * n];
        for i in 0..n {
            for j in 0..n {
                for l in 0..n {
                    next[i * n + j] = next[i * n + j] + power[i * n + l] * h.data[l * n + j];
                }
            }
        }
        power = next;
    }
    let slot = out.array("value", &[]);
    out.put(slot, 0, value);
    out.flush();
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out);
    Ok(())
}
