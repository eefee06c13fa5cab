//! `loss.mse`: mean squared difference of two images with any number of channels.
//!
//! value = Σ (x − y)² / n over the kept values, with n = C·(kept pixels); with `over=all` n = C·H·W, the mean of
//! the masked difference
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `x` | (H, W, C) | colours sRGB-encoded; one channel for coverage |
//! | y | `y` | (H, W, C) | the same |
//! | – | `mask` | (H, W) | 0 or 1 |
//! | value | return | () | ≥ 0 |
//!
//! # Rounding
//! d = x − y in f32; d² is exact in f64 and summed in f64 (rows of 16 logical lanes, tree over rows:
//! [`super`]); one division in f64; the result is rounded once to f32.
//!
//! # Kinks and domain
//! The function is smooth. Pixels that the mask excludes get no gradient. It is an error if no pixel is kept, except with
//! `over=all`, where the value is then 0.
//!
//! # Adjoint
//! x̄ += d·(2v̄/n),  ȳ −= the same; 2v̄/n in f64, rounded once; d is recomputed.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::mse::{In, forward};
//! let (value, _) = forward(&In { x: &[0.5, 0.25, 1.0], y: &[0.25, 0.5, 1.0], mask: None, height: 1, width: 1 })?;
//! assert_eq!(value, (0.125f64 / 3.0) as f32);
//! # Ok::<(), lastlight::Error>(())
//! ```

pub use super::In;
use super::{add_rows, assert_like, finite, image_sum};
use crate::Result;

/// Intermediate values that the adjoint needs.
#[derive(Clone, Copy, Debug)]
pub struct Saved {
    /// Divisor n.
    pub count: usize,
}

/// Divisor of the sum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Over {
    /// The number of kept values.
    #[default]
    Kept,
    /// The number of all values.
    All,
}

/// Returns the value and the intermediate values that the adjoint needs.
///
/// # Errors
/// Returns an error for wrong sizes, a mask value other than 0 and 1, a mask that keeps no pixel, or images
/// that are not finite.
pub fn forward(x: &In<'_>) -> Result<(f32, Saved)> {
    forward_over(x, Over::Kept)
}

/// Like [`forward`], with a choice of the divisor.
///
/// # Errors
/// As [`forward`]; with [`Over::All`] a mask may keep no pixel.
pub fn forward_over(x: &In<'_>, over: Over) -> Result<(f32, Saved)> {
    let count = match over {
        Over::Kept => x.channels() * x.check_channels("loss.mse", x.channels())?,
        Over::All => {
            x.count_kept("loss.mse", x.channels())?;
            Ord::max(x.x.len(), 1)
        }
    };
    let square = |a: f32, b: f32| {
        let d = f64::from(a - b);
        d * d
    };
    let total = finite("loss.mse", image_sum(x, square))?;
    Ok(((total / count as f64) as f32, Saved { count }))
}

/// Adds the gradients; `y_bar` is `None` if not requested.
pub fn adjoint(x: &In<'_>, saved: &Saved, value_bar: f32, x_bar: &mut [f32], y_bar: Option<&mut [f32]>) {
    let scale = (2.0 * f64::from(value_bar) / saved.count as f64) as f32;
    assert_like(x_bar, x.x);
    add_rows(x, x_bar, |a, b| (a - b) * scale);
    if let Some(y_bar) = y_bar {
        assert_like(y_bar, x.y);
        add_rows(x, y_bar, |a, b| (b - a) * scale);
    }
}
