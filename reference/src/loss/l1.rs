//! `loss.l1`: mean absolute difference over the kept values.
//!
//! value = Σ |x − y| / (3·kept pixels)
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
//! The gradient is 0 where x = y. A mask that keeps no pixel is an error.

use crate::array::Out;
use crate::loss::{In, PAIR, Pair};
use crate::ports::Signature;
use crate::scalar::Scalar;
use crate::twins::Call;

/// `loss.l1`
pub static SIGNATURE: Signature = Signature { name: "loss.l1", summary: "mean |x − y|", ..PAIR };

/// The twin of `loss.l1`.
///
/// # Errors
/// When a mask entry is neither 0 nor 1, or no pixel is kept.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let pair = Pair::of(input)?;
    let value = out.array("value", &[]);
    for pixel in 0..pair.kept.len() {
        if pair.kept[pixel] {
            for i in 3 * pixel..3 * pixel + 3 {
                let (x, y) = (pair.x.data[i], pair.y.data[i]);
                out.add(value, 0, (x - y).abs(), pair.values);
            }
        }
        out.flush();
    }
    out.divide(value, 0, pair.values);
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or no pixel is kept.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
