//! Mean squared difference over the kept values.
//!
//! value = Σ (x − y)² / (3·kept pixels)
//!
//! | argument | shape | range |
//! |---|---|---|
//! | `x`, `y` | (H, W, 3) | sRGB-encoded |
//! | `mask` | (H, W) | optional; 1: kept, 0: not |
//! | `value` | () | |
//!
//! # Rounding
//! A left fold over the kept entries in memory order, then one division.
//!
//! # Kinks and domain
//! Smooth. Nothing kept is refused.

use crate::array::{Named, Out};
use crate::loss::Pair;
use crate::scalar::Scalar;

/// The twin of `loss.mse`.
///
/// # Errors
/// When an input is missing or shaped otherwise, or nothing is kept.
pub fn forward<S: Scalar>(arrays: &Named<S>, out: &mut Out<S>) -> Result<(), String> {
    let pair = Pair::of(arrays)?;
    let value = out.array("value", &[]);
    for pixel in 0..pair.kept.len() {
        if pair.kept[pixel] {
            for i in 3 * pixel..3 * pixel + 3 {
                let (x, y) = (pair.x.data[i], pair.y.data[i]);
                out.add(value, 0, (x - y) * (x - y), pair.values);
            }
        }
        out.flush();
    }
    out.divide(value, 0, pair.values);
    Ok(())
}
