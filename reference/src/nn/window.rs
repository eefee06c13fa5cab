//! `nn.window`: resamples a square of an image to S×S pixels by area averaging.
//!
//! A pixel of the window is the mean of the image over its cell, a square of side a/S; image pixels are
//! squares of constant colour, and everything outside the image is black.
//!
//! y(r, c) = (S/a)² Σ over pixels of |cell (r, c) ∩ pixel| · x(pixel)
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `image` | (H, W, 3) |
//! | l, t | `corner` | (2), left and top of the square, pixels |
//! | a | `length` | () |
//! | S | setting `side` | () |
//! | y | `window` | (S, S, 3) |
//!
//! # Kinks and domain
//! Linear in the image.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.window`.
    pub struct In<'a, S> {
        image: &'a Arr<S> = Port::var("H,W,3", "image"),
        corner: &'a Arr<S> = Port::fixed("2", "left and top of the square, pixels"),
        length: &'a Arr<S> = Port::fixed("", "side of the square, pixels"),
    }
}

/// `nn.window`
pub static SIGNATURE: Signature = Signature {
    name: "nn.window",
    summary: "a square of an image, resampled by area averaging",
    inputs: In::<f64>::PORTS,
    outputs: ports![window: Port::var("S,S,3", "")],
    settings: &[SettingSpec::number("side", "4", "pixels of a side of the window, 1 or more")],
    ..Signature::EMPTY
};

/// Length of the part that two intervals share.
fn shared(a: [f64; 2], b: [f64; 2]) -> f64 {
    let low = if a[0] > b[0] { a[0] } else { b[0] };
    let high = if a[1] < b[1] { a[1] } else { b[1] };
    if high > low { high - low } else { 0.0 }
}

/// The twin of `nn.window`.
///
/// # Errors
/// When the square has no length.
pub fn forward<S: Scalar>(input: &In<'_, S>, side: usize, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { image, corner, length } = *input;
    let [height, width] = [image.shape[0], image.shape[1]];
    let ([left, top], length) = (corner.row::<2>(0).map(S::value), length.data[0].value());
    if !(length > 0.0) {
        return Err(format!("input length: expected a number above 0, got {length}"));
    }
    let cell = length / side as f64;
    let part = |start: f64, at: usize, pixel: usize| {
        let from = start + at as f64 * cell;
        shared([from, from + cell], [pixel as f64, pixel as f64 + 1.0]) / cell
    };
    let window = out.array("window", &[side, side, 3]);
    for r in 0..side {
        for c in 0..side {
            for k in 0..3 {
                let mut sum = S::zero();
                for (row, column) in (0..height * width).map(|i| (i / width, i % width)) {
                    let weight = part(top, r, row) * part(left, c, column);
                    if weight > 0.0 {
                        sum = sum + image.data[(row * width + column) * 3 + k] * weight;
                    }
                }
                out.put(window, (r * side + c) * 3 + k, sum);
            }
            out.flush();
        }
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or the square has no length.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.whole("side", 1.0)?, out)
}

/// Number of pairs of a pixel and a cell.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let side = call.settings.whole("side", 1.0)?;
    Ok((In::of(call.arrays)?.image.data.len() * side * side) as u64)
}
