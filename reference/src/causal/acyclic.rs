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

use crate::array::{ANY, Arr, Named, Out, expect};
use crate::scalar::Scalar;

/// The twin of `causal.acyclic`.
///
/// # Errors
/// When an input is missing or shaped otherwise.
pub fn forward<S: Scalar>(arrays: &Named<S>, out: &mut Out<S>) -> Result<(), String> {
    let n = expect(arrays, "a", &[ANY, ANY])?.shape[0];
    let a = expect(arrays, "a", &[n, n])?;
    let alpha = expect(arrays, "alpha", &[])?.data[0].value();
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
    Ok(())
}
