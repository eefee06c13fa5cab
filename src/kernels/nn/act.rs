//! `nn.leaky_relu`: the leaky rectified linear unit, which multiplies negative values by a slope.
//!
//! y = x where x > 0,   y = s·x elsewhere        (Maas et al. 2013)
//!
//! | symbol | argument | shape | range |
//! |--------|----------|-------|-------|
//! | x      | `x`      | any   | finite |
//! | s      | `slope`  | ()    | finite, 0.2 by default |
//! | y      | `y`      | as x  |       |
//!
//! # Rounding
//! There is one product, rounded once; s is rounded to f32 beforehand.
//!
//! # Kinks and domain
//! At x = 0 (of either sign), y = s·0 and the slope is s, as in the lower branch. s = 1 gives the identity,
//! s = 0 the ReLU.
//!
//! # Adjoint
//! x̄ += ȳ where x > 0,   x̄ += s·ȳ elsewhere. The adjoint compares x with 0 again; nothing is saved.
//!
//! Twin: `reference::nn::act`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::act::leaky_relu;
//! let mut y = [0.0; 3];
//! leaky_relu(&[2.0, 0.0, -4.0], 0.25, &mut y);
//! assert_eq!(y, [2.0, 0.0, -1.0]);
//! ```

use crate::num::par;

/// Values per task; the number changes no bit.
const CHUNK: usize = 1 << 14;

/// Writes y.
///
/// # Panics
/// Panics if y does not have the size of x.
pub fn leaky_relu(x: &[f32], slope: f32, y: &mut [f32]) {
    assert_eq!(y.len(), x.len(), "y has the shape of x");
    par::chunks_mut(y, CHUNK, |i, y| {
        for (y, x) in y.iter_mut().zip(&x[i * CHUNK..]) {
            *y = if *x > 0.0 { *x } else { slope * *x };
        }
    });
}

/// Adds the gradient for the cotangent `y_bar` to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of x.
pub fn leaky_relu_adjoint(x: &[f32], slope: f32, y_bar: &[f32], x_bar: &mut [f32]) {
    assert_eq!(y_bar.len(), x.len(), "the cotangent has the shape of x");
    assert_eq!(x_bar.len(), x.len(), "the gradient has the shape of x");
    par::chunks_mut(x_bar, CHUNK, |i, x_bar| {
        let from = i * CHUNK;
        for (bar, (x, g)) in x_bar.iter_mut().zip(x[from..].iter().zip(&y_bar[from..])) {
            *bar += if *x > 0.0 { *g } else { slope * *g };
        }
    });
}

/// Converts the cotangent of `y` to that of x in place, given the result y: for a slope ≥ 0, y is positive
/// exactly where x is.
///
/// # Panics
/// Panics if the cotangent does not have the size of y.
pub fn leaky_relu_back(y: &[f32], slope: f32, bar: &mut [f32]) {
    assert_eq!(bar.len(), y.len(), "the cotangent has the shape of y");
    for (bar, y) in bar.iter_mut().zip(y) {
        *bar = if *y > 0.0 { *bar } else { slope * *bar };
    }
}
