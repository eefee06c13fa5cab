//! `loss.mse`: mean squared difference over the kept values.
//!
//! value = Σ (x − y)² / (C·kept pixels), or / (C·H·W) with `over=all`
//!
//! | argument | shape | range |
//! |---|---|---|
//! | `x`, `y` | (H, W, C) | any |
//! | `mask` | (H, W) | optional; 1: kept, 0: not |
//! | `value` | () | |
//!
//! # Rounding
//! A left fold over the kept entries in memory order, then one division.
//!
//! # Kinks and domain
//! Smooth. A mask that keeps no pixel is an error, except with `over=all`.

use super::{kept, mask_of};
use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `loss.mse`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("H,W,C", "usually the render; colours sRGB-encoded"),
        y: &'a Arr<S> = Port::var("H,W,C", "usually the input photo; colours sRGB-encoded"),
        mask: Option<&'a Arr<S>> = Port::fixed("H,W", "1 kept, 0 ignored; absent: all kept"),
    }
}

/// `loss.mse`
pub static SIGNATURE: Signature = Signature {
    name: "loss.mse",
    summary: "mean (x − y)²",
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "mean over the kept values, or over all")],
    settings: &[SettingSpec::choice("over", &["kept", "all"], "kept", "divisor: kept values, or all values")],
    ..Signature::EMPTY
};

/// The twin of `loss.mse`.
///
/// # Errors
/// When a mask entry is neither 0 nor 1, or no pixel is kept.
pub fn forward<S: Scalar>(input: &In<'_, S>, is_over_all: bool, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { x, y, mask } = *input;
    let (pixels, channels) = (x.shape[0] * x.shape[1], x.shape[2]);
    let (kept, count) =
        if is_over_all { (mask_of(mask, pixels)?, pixels as f64) } else { kept(mask, pixels)? };
    let values = channels as f64 * count;
    if values == 0.0 {
        return Err("input x: expected at least one value, got none".to_owned());
    }
    let value = out.array("value", &[]);
    for pixel in 0..pixels {
        if kept[pixel] {
            for i in channels * pixel..channels * (pixel + 1) {
                let (x, y) = (x.data[i], y.data[i]);
                out.add(value, 0, (x - y) * (x - y), values);
            }
        }
        out.flush();
    }
    out.divide(value, 0, values);
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or no pixel is kept.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.word("over") == "all", out)
}
