//! `causal.limit`: the logarithm of a variance within its limits.
//!
//! ℓ' = min(max(ℓ, −8), 4)                                                                       (the log variance of LAST's encoder)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | ℓ | `logvar` | any | finite |
//! | ℓ' | `limited` | as ℓ | −8..4 |
//!
//! # Rounding
//! Exact.
//!
//! # Kinks and domain
//! Inside the limits and on them the slope is 1, outside it is 0.
//!
//! # Adjoint
//! ℓ̄ += ℓ̄' within the limits. The side is read from ℓ again.
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

/// ℓ'.
pub fn forward(logvar: &[f64]) -> Vec<f64> {
    logvar.iter().map(|l| limited(*l)).collect()
}

/// Adds the gradient for the cotangent `limited_bar` to `logvar_bar`.
///
/// # Panics
/// When the arrays differ in length.
pub fn adjoint(logvar: &[f64], limited_bar: &[f64], logvar_bar: &mut [f64]) {
    assert!(limited_bar.len() == logvar.len() && logvar_bar.len() == logvar.len(), "arrays of one shape");
    for ((bar, g), l) in logvar_bar.iter_mut().zip(limited_bar).zip(logvar) {
        if within(*l) {
            *bar += g;
        }
    }
}
