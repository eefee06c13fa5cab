//! Losses: two pictures, a mask, one number.
//!
//! `l1` and `ssim` have the same inputs [`In`], `mse` those of any number of channels; they read the mask through [`Pair`], walk the pixels in order and add to
//! one entry of the output. Every file binds its function to named arrays for [`crate::twins`].

pub mod groups;
pub mod l1;
pub mod latent;
pub mod lpips;
pub mod mse;
pub mod points;
pub mod presence;
pub mod prior;
pub mod ssim;

use crate::array::Arr;
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;

inputs! {
    /// Inputs of the losses between two images.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("H,W,3", "usually the render, sRGB-encoded"),
        y: &'a Arr<S> = Port::var("H,W,3", "usually the photograph, sRGB-encoded"),
        mask: Option<&'a Arr<S>> = Port::fixed("H,W", "0 left out, 1 kept; absent: all kept"),
    }
}

/// What the losses between two images have in common.
const PAIR: Signature = Signature {
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "mean over the kept values")],
    ..Signature::EMPTY
};

/// Two pictures of one size and which of their pixels are kept.
pub struct Pair<'a, S> {
    /// (H, W, 3)
    pub x: &'a Arr<S>,
    /// (H, W, 3)
    pub y: &'a Arr<S>,
    /// H and W.
    pub size_px: [usize; 2],
    /// (H, W)
    pub kept: Vec<bool>,
    /// Number of kept values, 3 per kept pixel.
    pub values: f64,
}

impl<'a, S: Scalar> Pair<'a, S> {
    /// Reads the mask.
    ///
    /// # Errors
    /// When a mask entry is neither 0 nor 1, or nothing is kept.
    pub fn of(input: &In<'a, S>) -> Result<Self, String> {
        let In { x, y, mask } = *input;
        let (h, w) = (x.shape[0], x.shape[1]);
        let (kept, pixels) = kept(mask, h * w)?;
        Ok(Self { x, y, size_px: [h, w], kept, values: 3.0 * pixels })
    }
}

/// Which pixels are kept, and how many.
fn kept<S: Scalar>(mask: Option<&Arr<S>>, pixels: usize) -> Result<(Vec<bool>, f64), String> {
    let mut kept = vec![true; pixels];
    for (kept, m) in kept.iter_mut().zip(mask.into_iter().flat_map(|mask| &mask.data)) {
        *kept = match m.value() {
            0.0 => false,
            1.0 => true,
            other => return Err(format!("input mask: expected 0 or 1, got {other}")),
        };
    }
    let count = kept.iter().filter(|&&kept| kept).count();
    if count == 0 {
        return Err("input mask: expected at least one kept pixel, got none".to_owned());
    }
    Ok((kept, count as f64))
}
