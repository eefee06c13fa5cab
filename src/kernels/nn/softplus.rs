//! `nn.softplus`: a smooth maximum of a number and 0.
//!
//! y = ln(1 + eˣ)        (Dugas et al. 2001)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | x | `x` | any | finite |
//! | y | `y` | as x | > 0 until it underflows |
//!
//! # Rounding
//! f64 (`num::elem::f64::softplus`), rounded once.
//!
//! # Kinks and domain
//! Smooth.
//!
//! # Adjoint
//! x̄ += ȳ/(1 + e⁻ˣ), in f64, rounded once before it is added. Nothing is saved.
//!
//! Twin: `reference::nn::softplus`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::softplus::forward;
//! let mut y = [0.0; 2];
//! forward(&[0.0, 100.0], &mut y);
//! assert_eq!(y, [std::f32::consts::LN_2, 100.0]);
//! ```

use crate::num::elem::f64 as elem;

/// Writes y.
///
/// # Panics
/// Panics if y does not have the size of x.
pub fn forward(x: &[f32], y: &mut [f32]) {
    assert_eq!(y.len(), x.len(), "y has the shape of x");
    y.iter_mut().zip(x).for_each(|(y, x)| *y = elem::softplus(f64::from(*x)) as f32);
}

/// Adds the gradient for the cotangent `y_bar` to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of x.
pub fn adjoint(x: &[f32], y_bar: &[f32], x_bar: &mut [f32]) {
    assert!(y_bar.len() == x.len() && x_bar.len() == x.len(), "cotangent and gradient have the shape of x");
    for (bar, (x, g)) in x_bar.iter_mut().zip(x.iter().zip(y_bar)) {
        *bar += (f64::from(*g) * elem::sigmoid(f64::from(*x))) as f32;
    }
}
