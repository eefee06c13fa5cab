//! Losses between two images with a mask, and losses of points, factors and Gaussians.
//!
//! `l1` and `ssim` have the same inputs [`In`], `mse` the same with any number of channels; they read the
//! mask through [`Pair`], visit the pixels in order and add to one entry of the output. Every file also binds
//! its function to named arrays for [`crate::twins`].

pub mod albedo;
pub mod eikonal;
pub mod groups;
pub mod l1;
pub mod latent;
pub mod lpips;
pub mod mse;
pub mod points;
pub mod presence;
pub mod prior;
pub mod ssim;
pub mod variation;

use crate::array::Arr;
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;

inputs! {
    /// Inputs of the losses between two images.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("H,W,3", "usually the render, sRGB-encoded"),
        y: &'a Arr<S> = Port::var("H,W,3", "usually the input photo, sRGB-encoded"),
        mask: Option<&'a Arr<S>> = Port::fixed("H,W", "1 kept, 0 ignored; absent: all kept"),
    }
}

/// The common part of the signatures of losses between two images.
const PAIR: Signature = Signature {
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "mean over the kept values")],
    ..Signature::EMPTY
};

/// Two images of the same size, and a mask of the pixels to keep.
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
    /// When a mask entry is neither 0 nor 1, or no pixel is kept.
    pub fn of(input: &In<'a, S>) -> Result<Self, String> {
        let In { x, y, mask } = *input;
        let (h, w) = (x.shape[0], x.shape[1]);
        let (kept, pixels) = kept(mask, h * w)?;
        Ok(Self { x, y, size_px: [h, w], kept, values: 3.0 * pixels })
    }
}

/// The kept pixels.
fn mask_of<S: Scalar>(mask: Option<&Arr<S>>, pixels: usize) -> Result<Vec<bool>, String> {
    let mut kept = vec![true; pixels];
    for (kept, m) in kept.iter_mut().zip(mask.into_iter().flat_map(|mask| &mask.data)) {
        *kept = match m.value() {
            0.0 => false,
            1.0 => true,
            other => return Err(format!("input mask: expected 0 or 1, got {other}")),
        };
    }
    Ok(kept)
}

/// The kept pixels and their number.
fn kept<S: Scalar>(mask: Option<&Arr<S>>, pixels: usize) -> Result<(Vec<bool>, f64), String> {
    let kept = mask_of(mask, pixels)?;
    let count = kept.iter().filter(|&&kept| kept).count();
    if count == 0 {
        return Err("input mask: expected at least one kept pixel, got none".to_owned());
    }
    Ok((kept, count as f64))
}
