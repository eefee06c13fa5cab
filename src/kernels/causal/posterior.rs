//! `causal.posterior`: a sample of a diagonal Gaussian, differentiable in its parameters.
//!
//! s = μ + e^{ℓ/2} η,   ℓ limited to [−8, 4]
//!
//! Source: Kingma & Welling 2014, §2.4. η = 0 gives the mean.
//!
//! | symbol | argument | shape     | range |
//! |--------|----------|-----------|-------|
//! | μ      | `mu`     | (B, n, k) | finite |
//! | ℓ      | `logvar` | (B, n, k) | finite; ln of the variance |
//! | η      | `eta`    | (B, n, k) | finite; standard normal numbers |
//! | s      | `sample` | (B, n, k) | |
//!
//! # Rounding
//! exp(½ℓ), the product and the sum are rounded separately.
//!
//! # Kinks and domain
//! At the limits of ℓ, the gradient inside and on the limits is that of the smooth function, and outside it
//! is 0. η is noise and gets no gradient. The divergences and `independence` do not limit ℓ: callers that
//! pass the ℓ of this posterior apply [`limited`] first.
//!
//! # Adjoint
//! μ̄ += s̄,   ℓ̄ += s̄·½ e^{ℓ/2} η within the limits
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::posterior;
//! assert_eq!(posterior::forward(&[1.0], &[0.0], &[-0.5]), [0.5]);
//! ```

use crate::num::elem::f64::exp;

/// Limits of the logarithm of the variance.
pub const LOGVAR: [f64; 2] = [-8.0, 4.0];

/// Returns ℓ limited to its range.
pub fn limited(logvar: f64) -> f64 {
    let [low, high] = LOGVAR;
    if logvar < low {
        low
    } else if logvar > high {
        high
    } else {
        logvar
    }
}

/// Whether ℓ has a gradient through [`limited`].
pub fn within(logvar: f64) -> bool {
    let [low, high] = LOGVAR;
    (low..=high).contains(&logvar)
}

/// Returns the standard deviation.
fn deviation(logvar: f64) -> f64 {
    exp(0.5 * limited(logvar))
}

/// Returns the sample.
///
/// # Panics
/// Panics if the arrays differ in length.
pub fn forward(mu: &[f64], logvar: &[f64], eta: &[f64]) -> Vec<f64> {
    assert!(mu.len() == logvar.len() && mu.len() == eta.len(), "all arrays have the same length");
    (0..mu.len()).map(|i| mu[i] + deviation(logvar[i]) * eta[i]).collect()
}

/// Adds the gradients for the cotangent `sample_bar`.
///
/// # Panics
/// Panics if the arrays differ in length.
pub fn adjoint(logvar: &[f64], eta: &[f64], sample_bar: &[f64], mu_bar: &mut [f64], logvar_bar: &mut [f64]) {
    assert!(
        mu_bar.len() == sample_bar.len() && logvar_bar.len() == sample_bar.len(),
        "all arrays have the same length"
    );
    for (i, g) in sample_bar.iter().enumerate() {
        mu_bar[i] += g;
        if within(logvar[i]) {
            logvar_bar[i] += g * (0.5 * deviation(logvar[i]) * eta[i]);
        }
    }
}
