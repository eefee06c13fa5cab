//! `shade.decode`: sRGB-encoded values to linear ones.
//!
//! x = y/12.92 where y ≤ 0.04045,   x = ((y + 0.055)/1.055)^2.4 elsewhere      (IEC 61966-2-1)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | y | `encoded` | any | ≥ 0 |
//! | x | `linear` | as y | ≥ 0 |
//!
//! # Rounding
//! f64, rounded once.
//!
//! # Kinks and domain
//! At 0.04045 the slope is 1/12.92 = 0.0774, that of the other side 0.0778.
//!
//! # Adjoint
//! ȳ += x̄·dx/dy with dx/dy = 1/12.92 or (2.4/1.055)·((y + 0.055)/1.055)^1.4, in f64, rounded once before it is added.
//!
//! Twin: `reference::shade::decode`. The inverse is [`super::encode`].
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::shade::decode::forward;
//! let mut x = [0.0; 2];
//! forward(&[0.0, 1.0], &mut x);
//! assert_eq!(x, [0.0, 1.0]);
//! ```

use crate::num::elem::f64 as elem;

/// Encoded value up to which the curve is a line.
const KNEE: f64 = 0.040_45;

fn decode(y: f64) -> f64 {
    if y <= KNEE { y / 12.92 } else { elem::pow((y + 0.055) / 1.055, 2.4) }
}

fn slope(y: f64) -> f64 {
    if y <= KNEE { 1.0 / 12.92 } else { 2.4 / 1.055 * elem::pow((y + 0.055) / 1.055, 1.4) }
}

/// Writes `linear`.
///
/// # Panics
/// Panics if it does not have the size of `encoded`.
pub fn forward(encoded: &[f32], linear: &mut [f32]) {
    assert_eq!(linear.len(), encoded.len(), "one linear value per encoded one");
    linear.iter_mut().zip(encoded).for_each(|(x, y)| *x = decode(f64::from(*y)) as f32);
}

/// Adds the gradient for the cotangent `linear_bar` to `encoded_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of `encoded`.
pub fn adjoint(encoded: &[f32], linear_bar: &[f32], encoded_bar: &mut [f32]) {
    assert!(
        linear_bar.len() == encoded.len() && encoded_bar.len() == encoded.len(),
        "buffers like the input"
    );
    for (bar, (y, g)) in encoded_bar.iter_mut().zip(encoded.iter().zip(linear_bar)) {
        *bar += (f64::from(*g) * slope(f64::from(*y))) as f32;
    }
}
