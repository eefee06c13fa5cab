//! `causal.mask`: soft samples of the edges of a graph.
//!
//! Ã(i,j) = σ((U(i,j) + ln u(i,j) − ln(1 − u(i,j))) / τ) for i ≠ j,   Ã(i,i) = 0
//!
//! Source: the binary case of Gumbel-softmax (Jang et al. 2017; Maddison et al. 2017) as used for graphs by Ng et al. 2022;
//! the logistic variable is the difference of two Gumbel variables. u = ½ gives the probabilities without noise.
//!
//! | symbol | argument  | shape  | range        |
//! |--------|-----------|--------|--------------|
//! | U      | `logits`  | (n, n) | finite       |
//! | u      | `uniform` | (n, n) | 0 < u < 1    |
//! | τ      | `tau`     | ()     | > 0          |
//! | Ã      | `mask`    | (n, n) | 0 ≤ Ã ≤ 1    |
//!
//! # Rounding
//! (U + (ln u − ln1p(−u))) / τ, each step rounded once; σ of [`elem`](crate::num::elem).
//!
//! # Kinks and domain
//! Smooth. The diagonal of U and u is ignored and gets no gradient; u gets none anywhere: it is noise.
//!
//! # Adjoint
//! Ū(i,j) += M̄(i,j)·(s(1 − s))/τ with s = Ã, where 1 − s is σ of the negated argument, so that it does not cancel
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::mask;
//! assert_eq!(mask::forward(&[9.0, 0.0, 0.0, 9.0], &[0.5; 4], 2, 0.2), [0.0, 0.5, 0.5, 0.0]);
//! ```

use crate::num::elem::f64::{ln, log1p, sigmoid};

/// Argument of σ.
fn argument(logit: f64, uniform: f64, tau: f64) -> f64 {
    (logit + (ln(uniform) - log1p(-uniform))) / tau
}

/// The mask Ã (n, n).
///
/// # Panics
/// When a buffer is not (n, n).
pub fn forward(logits: &[f64], uniform: &[f64], n: usize, tau: f64) -> Vec<f64> {
    assert!(logits.len() == n * n && uniform.len() == n * n, "arrays are (n, n)");
    let entry =
        |at: usize| if at / n == at % n { 0.0 } else { sigmoid(argument(logits[at], uniform[at], tau)) };
    (0..n * n).map(entry).collect()
}

/// Adds the gradient for the cotangent `mask_bar` (n, n) to `logits_bar`.
///
/// # Panics
/// When a buffer is not (n, n).
pub fn adjoint(
    logits: &[f64],
    uniform: &[f64],
    n: usize,
    tau: f64,
    mask_bar: &[f64],
    logits_bar: &mut [f64],
) {
    assert!(mask_bar.len() == n * n && logits_bar.len() == n * n, "arrays are (n, n)");
    for at in (0..n * n).filter(|at| at / n != at % n) {
        let x = argument(logits[at], uniform[at], tau);
        logits_bar[at] += mask_bar[at] * (sigmoid(x) * sigmoid(-x) / tau);
    }
}
