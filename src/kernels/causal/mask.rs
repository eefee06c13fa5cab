//! `causal.mask`: soft samples of the edges of a graph.
//!
//! Ã(i,j) = L(i,j) σ((U(i,j) + ln u(i,j) − ln(1 − u(i,j))) / τ) for i ≠ j,   Ã(i,i) = 0
//!
//! Source: the binary case of Gumbel-softmax (Jang et al. 2017; Maddison et al. 2017) as used for graphs by Ng et al. 2022;
//! the logistic variable is the difference of two Gumbel variables. u = ½ gives the probabilities without noise. L limits the edges to
//! those allowed, for example to those along an order of the nodes; without it all are.
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
//! (U + (ln u − ln1p(−u))) / τ, each step rounded once; σ of [`elem`](crate::num::elem). The product with L is exact.
//!
//! # Kinks and domain
//! Smooth. The diagonal of U and u is ignored and gets no gradient; u gets none anywhere: it is noise. Nor
//! does L, which is a decision.
//!
//! # Adjoint
//! Ū(i,j) += (M̄(i,j) L(i,j))·(s(1 − s))/τ with s = σ(…), where 1 − s is σ of the negated argument, so that it does not cancel
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

/// Edges, noise and the edges allowed.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// (n, n) U
    pub logits: &'a [f64],
    /// (n, n) u
    pub uniform: &'a [f64],
    /// (n, n) L, 0 or 1; all edges where it is absent
    pub allowed: Option<&'a [f64]>,
    /// number of nodes
    pub n: usize,
    /// τ
    pub tau: f64,
}

impl In<'_> {
    fn check(&self) {
        let entries = self.n * self.n;
        let fits = self.allowed.is_none_or(|l| l.len() == entries);
        assert!(self.logits.len() == entries && self.uniform.len() == entries && fits, "arrays are (n, n)");
    }

    /// Entries off the diagonal.
    fn entries(&self) -> impl Iterator<Item = usize> + use<> {
        let n = self.n;
        (0..n * n).filter(move |at| at / n != at % n)
    }

    /// Argument of σ.
    fn argument(&self, at: usize) -> f64 {
        let uniform = self.uniform[at];
        (self.logits[at] + (ln(uniform) - log1p(-uniform))) / self.tau
    }

    /// x L(i,j).
    fn limited(&self, at: usize, x: f64) -> f64 {
        self.allowed.map_or(x, |allowed| x * allowed[at])
    }
}

/// The mask Ã (n, n).
///
/// # Panics
/// When an array is not (n, n).
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
/// When an array is not (n, n).
pub fn adjoint(x: &In<'_>, mask_bar: &[f64], logits_bar: &mut [f64]) {
    x.check();
    assert!(mask_bar.len() == x.n * x.n && logits_bar.len() == x.n * x.n, "arrays are (n, n)");
    for at in x.entries() {
        let y = x.argument(at);
        logits_bar[at] += x.limited(at, mask_bar[at]) * (sigmoid(y) * sigmoid(-y) / x.tau);
    }
}
