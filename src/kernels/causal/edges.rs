//! `causal.edges`: the cost of edge probabilities, and of their distance from earlier ones.
//!
//! L = Σ over i ≠ j of w p_ij + a (p_ij − q_ij)²                                        (LAST: sparsity, and the anchor of fine-tuning)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | p | `probabilities` | (n, n) | 0..1; the diagonal is not read |
//! | q | `before` | (n, n) | 0..1, a constant |
//! | w, a | `sparsity`, `anchor` | () | ≥ 0 |
//! | L | return | () | ≥ 0 |
//!
//! # Rounding
//! f64; a left fold over the entries from +0, both terms of an entry added first. The adjoint adds its two terms to p̄_ij one after the other.
//!
//! # Kinks and domain
//! None.
//!
//! # Adjoint
//! p̄_ij += L̄ (w + 2 a (p_ij − q_ij)) for i ≠ j. Nothing is saved.
//!
//! Twin: `reference::causal::edges`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::edges::{Weights, forward};
//! let w = Weights { sparsity: 1.0, anchor: 4.0 };
//! assert_eq!(forward(&w, &[0.0, 1.0, 0.0, 0.0], &[0.0, 0.5, 0.0, 0.0], 2), 2.0); // 1 + 4·½²
//! ```

/// Weights of the two terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// w
    pub sparsity: f64,
    /// a
    pub anchor: f64,
}

/// Entries that are no diagonal.
fn between(n: usize) -> impl Iterator<Item = usize> {
    (0..n * n).filter(move |at| at / n != at % n)
}

/// L.
///
/// # Panics
/// When an array is not (n, n).
pub fn forward(w: &Weights, probabilities: &[f64], before: &[f64], n: usize) -> f64 {
    between(n).fold(0.0, |sum, at| {
        let p = probabilities[at];
        let off = p - before[at];
        sum + (w.sparsity * p + w.anchor * (off * off))
    })
}

/// Adds the gradient for the cotangent `value_bar` to `probabilities_bar` (n, n).
///
/// # Panics
/// When an array is not (n, n).
pub fn adjoint(
    w: &Weights,
    probabilities: &[f64],
    before: &[f64],
    n: usize,
    value_bar: f64,
    probabilities_bar: &mut [f64],
) {
    for at in between(n) {
        probabilities_bar[at] += value_bar * w.sparsity;
        probabilities_bar[at] += value_bar * (2.0 * w.anchor * (probabilities[at] - before[at]));
    }
}
