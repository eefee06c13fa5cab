//! `causal.limit`: limits the logarithm of a variance to a fixed range.
//!
//! ℓ' = min(max(ℓ, −8), 4)
//!
//! LAST applies it to the log variance of its encoder.
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | ℓ | `logvar` | any | finite |
//! | ℓ' | `limited` | as ℓ | −8..4 |
//!
//! # Rounding
//! The result is exact.
//!
//! # Kinks and domain
//! The slope is 1 inside the limits and at the limits, and 0 outside.
//!
//! # Adjoint
//! ℓ̄ += ℓ̄' within the limits. The adjoint compares ℓ with the limits again.
//!
//! Twin: `reference::causal::limit`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::limit::forward;
//! assert_eq!(forward(&[-9.0, 0.5, 7.0]), [-8.0, 0.5, 4.0]);
//! ```

use super::posterior::{limited, within};

/// Returns ℓ'.
pub fn forward(logvar: &[f64]) -> Vec<f64> {
    logvar.iter().map(|l| limited(*l)).collect()
}

/// Adds the gradient for the cotangent `limited_bar` to `logvar_bar`.
///
/// # Panics
/// Panics if the arrays differ in length.
pub fn adjoint(logvar: &[f64], limited_bar: &[f64], logvar_bar: &mut [f64]) {
    assert!(
        limited_bar.len() == logvar.len() && logvar_bar.len() == logvar.len(),
        "all arrays have the same length"
    );
    for ((bar, g), l) in logvar_bar.iter_mut().zip(limited_bar).zip(logvar) {
        if within(*l) {
            *bar += g;
        }
    }
}
