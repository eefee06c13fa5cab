//! `causal.posterior_kl`: divergence of diagonal Gaussian posteriors from the standard normal prior.
//!
//! KL = (1/B) Σ_b Σ ½ (μ² + e^ℓ − 1 − ℓ), where the inner sum is over all factors and their dimensions
//!
//! Source: LAST, eq. 1; Kingma & Welling 2014, appendix B.
//!
//! | symbol | argument | shape     | range |
//! |--------|----------|-----------|-------|
//! | μ      | `mu`     | (B, n, k) | finite |
//! | ℓ      | `logvar` | (B, n, k) | finite, at most 700; ln of the variance |
//! | KL     | `value`  | ()        | nats, ≥ 0 |
//!
//! # Rounding
//! Terms are ½·(μ² + (expm1(ℓ) − ℓ)), which avoids cancellation near ℓ = 0. A left fold over all entries from
//! +0 is followed by one division.
//!
//! # Kinks and domain
//! The function is smooth. The operator list refuses an empty batch and an ℓ whose exponential overflows.
//!
//! # Adjoint
//! μ̄ += v̄/B·μ,   ℓ̄ += v̄/B·½ expm1(ℓ)
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::posterior_kl;
//! assert_eq!(posterior_kl::forward(&[1.0, 0.0], &[0.0, 0.0], 2), 0.25);
//! ```

use crate::num::elem::f64::expm1;

/// Returns the KL divergence of a batch.
///
/// # Panics
/// Panics if the arrays differ in length.
pub fn forward(mu: &[f64], logvar: &[f64], batch: usize) -> f64 {
    assert_eq!(mu.len(), logvar.len(), "one variance per mean");
    let term = |(m, l): (&f64, &f64)| 0.5 * (m * m + (expm1(*l) - l));
    mu.iter().zip(logvar).map(term).fold(0.0, |sum, term| sum + term) / batch as f64
}

/// Adds the gradients for the cotangent `value_bar`.
///
/// # Panics
/// Panics if the arrays differ in length.
pub fn adjoint(
    mu: &[f64],
    logvar: &[f64],
    batch: usize,
    value_bar: f64,
    mu_bar: &mut [f64],
    logvar_bar: &mut [f64],
) {
    assert!(
        mu_bar.len() == mu.len() && logvar_bar.len() == logvar.len(),
        "the gradients have the shapes of the inputs"
    );
    let share = value_bar / batch as f64;
    mu_bar.iter_mut().zip(mu).for_each(|(bar, m)| *bar += share * m);
    logvar_bar.iter_mut().zip(logvar).for_each(|(bar, l)| *bar += share * (0.5 * expm1(*l)));
}
