//! `nn.gelu`: the Gaussian error linear unit, in its form with the error function.
//!
//! y = x·Φ(x),   Φ(x) = ½(1 + erf(x/√2))        (Hendrycks and Gimpel 2016)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | x | `x` | any | finite |
//! | y | `y` | as x | ≥ −0.17 |
//!
//! # Rounding
//! f64 ([`elem::gelu`]), rounded once. Φ is not computed as ½(1 + erf), which loses all digits below −5, but from
//! e^(−x²/2) times a polynomial.
//!
//! # Kinks and domain
//! Smooth. The result is −0 below −14.5.
//!
//! # Adjoint
//! x̄ += ȳ·(Φ(x) + x·φ(x)),   φ(x) = e^(−x²/2)/√(2π); the factor is [`elem::gelu_slope`], rounded once, then the product is
//! rounded. Nothing is saved.
//!
//! Twin: `reference::nn::gelu`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::gelu::forward;
//! let mut y = [0.0; 3];
//! forward(&[0.0, 20.0, 1.0], &mut y);
//! assert_eq!(y, [0.0, 20.0, 0.841_344_77]); // Φ(1)
//! ```

use crate::num::{elem, par};

/// Values per task; the number changes no bit.
const CHUNK: usize = 1 << 13;

/// Writes y.
///
/// # Panics
/// Panics if y does not have the size of x.
pub fn forward(x: &[f32], y: &mut [f32]) {
    assert_eq!(y.len(), x.len(), "y has the shape of x");
    par::chunks_mut(y, CHUNK, |i, y| elem::gelu_slice(&x[i * CHUNK..][..y.len()], y));
}

/// Adds the gradient for the cotangent `y_bar` to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of x.
pub fn adjoint(x: &[f32], y_bar: &[f32], x_bar: &mut [f32]) {
    assert!(y_bar.len() == x.len() && x_bar.len() == x.len(), "cotangent and gradient have the shape of x");
    par::chunks_mut(x_bar, CHUNK, |i, x_bar| {
        let mut slopes = vec![0.0; x_bar.len()];
        let at = i * CHUNK;
        elem::gelu_slope_slice(&x[at..][..x_bar.len()], &mut slopes);
        for ((bar, slope), g) in x_bar.iter_mut().zip(&slopes).zip(&y_bar[at..]) {
            *bar += g * slope;
        }
    });
}
