//! `loss.l1`: mean absolute difference of two images.
//!
//! value = Σ |x − y| / n over the n = 3·(kept pixels) values        (3DGS, § 5.1, the term L₁)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `x` | (H, W, 3) | sRGB-encoded |
//! | y | `y` | (H, W, 3) | sRGB-encoded |
//! | – | `mask` | (H, W) | 0 or 1 |
//! | value | return | () | ≥ 0 |
//!
//! # Rounding
//! x − y in f32; its absolute value is summed in f64 (rows of 16 logical lanes, tree over rows: [`super`]);
//! one division in f64; rounded once to f32.
//!
//! # Kinks and domain
//! At x = y the gradient is 0. Pixels that the mask excludes get no gradient. It is an error if no pixel is
//! kept.
//!
//! # Adjoint
//! x̄ += sign(x − y)·v̄/n,  ȳ −= the same; v̄/n in f64, rounded once. Only the sign is recomputed.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::l1::{In, forward};
//! let (value, _) = forward(&In { x: &[0.5, 0.25, 1.0], y: &[0.25, 0.5, 1.0], mask: None, height: 1, width: 1 })?;
//! assert_eq!(value, 0.5 / 3.0);
//! # Ok::<(), lastlight::Error>(())
//! ```

pub use super::In;
use super::{CHANNELS, add_rows, assert_like, finite, image_sum};
use crate::Result;

/// Intermediate values that the adjoint needs.
#[derive(Clone, Copy, Debug)]
pub struct Saved {
    /// Number n of kept values.
    pub count: usize,
}

/// Returns the value and the intermediate values that the adjoint needs.
///
/// # Errors
/// Returns an error for wrong sizes, a mask value other than 0 and 1, a mask that keeps no pixel, or images
/// that are not finite.
pub fn forward(x: &In<'_>) -> Result<(f32, Saved)> {
    let count = CHANNELS * x.check("loss.l1")?;
    let total = finite("loss.l1", image_sum(x, |a, b| f64::from((a - b).abs())))?;
    Ok(((total / count as f64) as f32, Saved { count }))
}

/// Adds the gradients; `y_bar` is `None` if not requested.
pub fn adjoint(x: &In<'_>, saved: &Saved, value_bar: f32, x_bar: &mut [f32], y_bar: Option<&mut [f32]>) {
    let scale = (f64::from(value_bar) / saved.count as f64) as f32;
    let sign = |a: f32, b: f32| f32::from(i8::from(a > b) - i8::from(a < b)) * scale; // branch-free for vectorisation
    assert_like(x_bar, x.x);
    add_rows(x, x_bar, sign);
    if let Some(y_bar) = y_bar {
        assert_like(y_bar, x.y);
        add_rows(x, y_bar, |a, b| sign(b, a));
    }
}
