//! `causal.intervene`: the structure with one factor of every sample set to a value.
//!
//! Z = S(ε; do(i, v)):   Ã(·,i) := 0,   εᵢ := v,   then the sweeps of [`super::structure`]
//!
//! Source: Pearl 2009, §3.2: the equation of the factor is replaced, all others stay. Targets and values differ from
//! sample to sample; a sample may have none.
//!
//! | symbol | argument | shape  | range |
//! |--------|----------|--------|-------|
//! | i      | `target` | (B)    | 0 … n − 1, or −1 (here `None`) for no intervention |
//! | v      | `value`  | (B, k) | finite; not read without a target |
//!
//! All else as in `structure`.
//!
//! # Rounding
//! As in `structure`. The factor is v in every sweep, in bits. Factors that are no descendants of it have the bits of the sweeps
//! without intervention; what would be added from a column of zeros is exactly 0.
//!
//! # Kinks and domain
//! As in `structure`.
//!
//! # Adjoint
//! That of `structure` per sample without column i: v̄ += Σ over sweeps of Z̄ᵢ; the cause εᵢ, the edges into i and network i get
//! nothing from the sample.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::intervene::{In, forward};
//! use lastlight::causal::structure::{self, Mechanism};
//! // 0 → 1 with weight 2; factor 0 is set to 10, then factor 1
//! let mechanism = Mechanism::Linear { weight: &[0.0, 2.0, 0.0, 0.0] };
//! let mask = [0.0, 1.0, 0.0, 0.0];
//! let given = structure::In { eps: &[1.0, 0.5, 1.0, 0.5], mask: &mask, mechanism, batch: 2, n: 2, k: 1, sweeps: 1 };
//! let x = In { given, target: &[Some(0), Some(1)], value: &[10.0, 10.0] };
//! assert_eq!(forward(&x).0, [10.0, 20.5, 1.0, 10.0]);
//! ```

use super::structure::{self, Hold, Saved};

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// the structure and its causes
    pub given: structure::In<'a>,
    /// (B)
    pub target: &'a [Option<usize>],
    /// (B, k)
    pub value: &'a [f64],
}

/// Gradients, accumulated into.
#[derive(Clone, Debug, PartialEq)]
pub struct InBar {
    /// of the structure and its causes
    pub given: structure::InBar,
    /// (B, k)
    pub value: Vec<f64>,
}

impl InBar {
    /// Zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        Self { given: structure::InBar::zeros_like(&x.given), value: vec![0.0; x.value.len()] }
    }
}

impl<'a> In<'a> {
    fn hold(&self, sample: usize) -> Hold<'a> {
        let k = self.given.k;
        self.target[sample].map(|node| (node, &self.value[sample * k..(sample + 1) * k]))
    }

    fn check(&self) {
        let (batch, n, k) = (self.given.batch, self.given.n, self.given.k);
        assert!(self.target.len() == batch && self.value.len() == batch * k, "a target and a value each");
        assert!(self.target.iter().flatten().all(|node| *node < n), "targets are factors");
    }
}

/// Z (B, n, k), and what the adjoint needs.
///
/// # Panics
/// When a buffer does not have the size of its shape, or a target is not a factor.
pub fn forward(x: &In<'_>) -> (Vec<f64>, Saved) {
    x.check();
    structure::forward_held(&x.given, |sample| x.hold(sample))
}

/// Adds the gradients for the cotangent `z_bar` (B, n, k).
///
/// # Panics
/// As [`forward`].
pub fn adjoint(x: &In<'_>, saved: &Saved, z_bar: &[f64], bar: &mut InBar) {
    x.check();
    assert_eq!(bar.value.len(), x.value.len(), "the cotangent of value is (B, k)");
    structure::adjoint_held(&x.given, saved, z_bar, |sample| x.hold(sample), &mut bar.given, &mut bar.value);
}
