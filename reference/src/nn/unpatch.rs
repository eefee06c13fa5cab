//! `nn.unpatch`: every token as a square of texels, a transposed convolution without overlap.
//!
//! y(n, rh+i, rw+j, c) = β(c) + Σ over d of tokens(n,h,w,d)·W(d,i,j,c)
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | tokens | `tokens` | (N, H, W, D) |
//! | W | `weight` | (D, R, R, C) |
//! | β | `bias` | (C) |
//! | y | `y` | (N, R·H, R·W, C) |
//!
//! r = R.
//!
//! # Rounding
//! A left fold over d from 0; then the bias.
//!
//! # Kinks and domain
//! Linear in each input. No axis is empty but N.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.unpatch`.
    pub struct In<'a, S> {
        tokens: &'a Arr<S> = Port::var("N,H,W,D", "grids of tokens"),
        weight: &'a Arr<S> = Port::var("D,R,R,C", "one square of texels per column"),
        bias: &'a Arr<S> = Port::var("C", "added last"),
    }
}

/// `nn.unpatch`
pub static SIGNATURE: Signature = Signature {
    name: "nn.unpatch",
    summary: "every token as a square of texels: a transposed convolution without overlap",
    inputs: In::<f64>::PORTS,
    outputs: ports![y: Port::var("N,H',W',C", "planes or panoramas")],
    ..Signature::EMPTY
};

/// The twin of `nn.unpatch`.
///
/// # Errors
/// When an axis other than N is empty.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { tokens, weight, bias } = *input;
    let [grids, height, width, d] = [0, 1, 2, 3].map(|axis| tokens.shape[axis]);
    let [side, channels] = [1, 3].map(|axis| weight.shape[axis]);
    if [height, width, d, side, channels].contains(&0) {
        return Err("input tokens: an axis is empty".to_owned());
    }
    let y = out.array("y", &[grids, side * height, side * width, channels]);
    for texel in 0..grids * side * height * side * width {
        let (n, row, column) = (
            texel / (side * height * side * width),
            texel / (side * width) % (side * height),
            texel % (side * width),
        );
        let token = (n * height + row / side) * width + column / side;
        for c in 0..channels {
            let mut sum = S::zero();
            for k in 0..d {
                let w = weight.data[((k * side + row % side) * side + column % side) * channels + c];
                sum = sum + tokens.data[token * d + k] * w;
            }
            out.put(y, texel * channels + c, sum + bias.data[c]);
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}

/// Number of products.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let In { tokens, weight, .. } = In::of(call.arrays)?;
    let grids_and_places = tokens.shape[0] * tokens.shape[1] * tokens.shape[2];
    Ok((grids_and_places * weight.data.len()) as u64)
}
