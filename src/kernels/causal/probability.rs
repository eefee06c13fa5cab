//! `causal.probability`: edge probabilities, without noise.
//!
//! p_ij = σ(U_ij/τ),   p_ii = 0
//!
//! See the chapter *Learned causes*.
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | U | `logits` | (n, n) | finite; the diagonal is not read |
//! | τ | `tau` | () | > 0 |
//! | p | `probabilities` | (n, n) | 0..1, zero diagonal |
//!
//! # Rounding
//! All values are f64; the quotient is rounded first, then σ of `num::elem` is applied.
//!
//! # Kinks and domain
//! There are no kinks.
//!
//! # Adjoint
//! Ū_ij += p̄_ij (p_ij (1 − p_ij)/τ) for i ≠ j; the diagonal gets no gradient. p is saved.
//!
//! Twin: `reference::causal::probability`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::probability::forward;
//! assert_eq!(forward(&[5.0, 0.0, 0.0, 5.0], 2, 0.2), [0.0, 0.5, 0.5, 0.0]);
//! ```

use crate::num::elem::f64::sigmoid;

/// Returns p (n, n).
///
/// # Panics
/// Panics if the logits are not (n, n).
pub fn forward(logits: &[f64], n: usize, tau: f64) -> Vec<f64> {
    assert_eq!(logits.len(), n * n, "logits are (n, n)");
    let p = |at: usize| if at / n == at % n { 0.0 } else { sigmoid(logits[at] / tau) };
    (0..n * n).map(p).collect()
}

/// Adds the gradient for the cotangent `p_bar` (n, n) of the probabilities `p` to `logits_bar` (n, n).
///
/// # Panics
/// Panics if an array is not (n, n).
pub fn adjoint(p: &[f64], n: usize, tau: f64, p_bar: &[f64], logits_bar: &mut [f64]) {
    assert!(p_bar.len() == p.len() && logits_bar.len() == p.len(), "arrays are (n, n)");
    for at in (0..n * n).filter(|at| at / n != at % n) {
        logits_bar[at] += p_bar[at] * (p[at] * (1.0 - p[at]) / tau);
    }
}
