//! `causal.mask`: soft samples of the edges of a graph.
//!
//! Ã(i,j) = L(i,j) σ((U(i,j) + ln u(i,j) − ln(1 − u(i,j))) / τ) for i ≠ j,   Ã(i,i) = 0
//!
//! Source: the binary case of Gumbel-softmax (Jang et al. 2017; Maddison et al. 2017) as used for graphs by
//! Ng et al. 2022; the logistic variable is the difference of two Gumbel variables. u = ½ gives the
//! probabilities without noise. L restricts the graph to the allowed edges, for example to those along an
//! order of the nodes; if it is absent, all edges are allowed.
//!
//! | symbol | argument  | shape  | range        |
//! |--------|-----------|--------|--------------|
//! | U      | `logits`  | (n, n) | finite       |
//! | u      | `uniform` | (n, n) | 0 < u < 1    |
//! | L      | `allowed` | (n, n) | 0 or 1       |
//! | τ      | `tau`     | ()     | > 0          |
//! | Ã      | `mask`    | (n, n) | 0 ≤ Ã ≤ 1    |
//!
//! # Rounding
//! (U + (ln u − ln1p(−u))) / τ, each step rounded once; σ is that of [`elem`](crate::num::elem). The product
//! with L is exact.
//!
//! # Kinks and domain
//! The function is smooth. The diagonals of U and u are ignored and get no gradient. u is noise and L a
//! decision, so neither gets a gradient.
//!
//! # Adjoint
//! Ū(i,j) += (M̄(i,j) L(i,j))·(s(1 − s))/τ with s = σ(…), where 1 − s is σ of the negated argument, so that
//! it does not cancel
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::mask;
//! let all = mask::In { logits: &[9.0, 0.0, 0.0, 9.0], uniform: &[0.5; 4], allowed: None, n: 2, tau: 0.2 };
//! assert_eq!(mask::forward(&all), [0.0, 0.5, 0.5, 0.0]);
//! let upper = mask::In { allowed: Some(&[0.0, 1.0, 0.0, 0.0]), ..all };
//! assert_eq!(mask::forward(&upper), [0.0, 0.5, 0.0, 0.0]);
//! ```

use crate::num::elem::f64::{ln, log1p, sigmoid};

/// Edge logits, noise and allowed edges.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// U, shape (n, n).
    pub logits: &'a [f64],
    /// u, shape (n, n).
    pub uniform: &'a [f64],
    /// Allowed edges L, shape (n, n), 0 or 1; all edges are allowed if it is absent.
    pub allowed: Option<&'a [f64]>,
    /// Number of nodes, n.
    pub n: usize,
    /// Temperature τ.
    pub tau: f64,
}

impl In<'_> {
    fn check(&self) {
        let entries = self.n * self.n;
        let fits = self.allowed.is_none_or(|l| l.len() == entries);
        assert!(self.logits.len() == entries && self.uniform.len() == entries && fits, "arrays are (n, n)");
    }

    /// Iterates over the entries off the diagonal.
    fn entries(&self) -> impl Iterator<Item = usize> + use<> {
        let n = self.n;
        (0..n * n).filter(move |at| at / n != at % n)
    }

    /// Returns the argument of σ.
    fn argument(&self, at: usize) -> f64 {
        let uniform = self.uniform[at];
        (self.logits[at] + (ln(uniform) - log1p(-uniform))) / self.tau
    }

    /// Returns x L(i,j).
    fn limited(&self, at: usize, x: f64) -> f64 {
        self.allowed.map_or(x, |allowed| x * allowed[at])
    }
}

/// Returns the mask Ã (n, n).
///
/// # Panics
/// Panics if an array is not (n, n).
pub fn forward(x: &In<'_>) -> Vec<f64> {
    x.check();
    let mut mask = vec![0.0; x.n * x.n];
    for at in x.entries() {
        mask[at] = x.limited(at, sigmoid(x.argument(at)));
    }
    mask
}

/// Adds the gradient for the cotangent `mask_bar` (n, n) to `logits_bar`.
///
/// # Panics
/// Panics if an array is not (n, n).
pub fn adjoint(x: &In<'_>, mask_bar: &[f64], logits_bar: &mut [f64]) {
    x.check();
    assert!(mask_bar.len() == x.n * x.n && logits_bar.len() == x.n * x.n, "arrays are (n, n)");
    for at in x.entries() {
        let y = x.argument(at);
        logits_bar[at] += x.limited(at, mask_bar[at]) * (sigmoid(y) * sigmoid(-y) / x.tau);
    }
}
