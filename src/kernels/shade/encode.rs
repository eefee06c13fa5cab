//! `shade.encode`: linear values to sRGB-encoded ones, limited to 0..1.
//!
//! u = clamp(x, 0, 1),   y = 12.92·u where u ≤ 0.0031308,   y = 1.055·u^(1/2.4) − 0.055 elsewhere      (IEC 61966-2-1)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | x | `linear` | any | finite |
//! | y | `encoded` | as x | 0..1 |
//!
//! # Rounding
//! f64, rounded once.
//!
//! # Kinks and domain
//! At 0 and 1 the slope is that of the inside; outside it is 0. At 0.0031308 the slope is 12.92, that of the other side
//! 12.70.
//!
//! # Adjoint
//! x̄ += ȳ·dy/dx with dy/dx = 12.92 or (1.055/2.4)·x^(1/2.4 − 1), in f64, rounded once before it is added.
//!
//! Twin: `reference::shade::encode`. The inverse is [`super::decode`].
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::shade::encode::forward;
//! let mut y = [0.0; 3];
//! forward(&[-1.0, 1.0, 7.0], &mut y);
//! assert_eq!(y, [0.0, 1.0, 1.0]);
//! ```

use crate::num::elem::f64 as elem;
use crate::num::order;

/// Linear value up to which the curve is a line.
const KNEE: f64 = 0.003_130_8;

fn encode(x: f64) -> f64 {
    let u = order::clamp(x, 0.0, 1.0);
    if u <= KNEE { 12.92 * u } else { 1.055 * elem::pow(u, 1.0 / 2.4) - 0.055 }
}

fn slope(x: f64) -> f64 {
    if !(0.0..=1.0).contains(&x) {
        0.0
    } else if x <= KNEE {
        12.92
    } else {
        1.055 / 2.4 * elem::pow(x, 1.0 / 2.4 - 1.0)
    }
}

/// Writes `encoded`.
///
/// # Panics
/// Panics if it does not have the size of `linear`.
pub fn forward(linear: &[f32], encoded: &mut [f32]) {
    assert_eq!(encoded.len(), linear.len(), "one encoded value per linear one");
    encoded.iter_mut().zip(linear).for_each(|(y, x)| *y = encode(f64::from(*x)) as f32);
}

/// Adds the gradient for the cotangent `encoded_bar` to `linear_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of `linear`.
pub fn adjoint(linear: &[f32], encoded_bar: &[f32], linear_bar: &mut [f32]) {
    assert!(encoded_bar.len() == linear.len() && linear_bar.len() == linear.len(), "buffers like the input");
    for (bar, (x, g)) in linear_bar.iter_mut().zip(linear.iter().zip(encoded_bar)) {
        *bar += (f64::from(*g) * slope(f64::from(*x))) as f32;
    }
}
