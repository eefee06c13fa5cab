//! Losses: two pictures, a mask, one number.
//!
//! Each reads its arguments through [`Pair`], walks the pixels in order and adds to one entry of the output; called by
//! [`crate::twins`].

pub mod groups;
pub mod l1;
pub mod lpips;
pub mod mse;
pub mod points;
pub mod ssim;

use crate::array::{ANY, Arr, Named, expect};
use crate::scalar::Scalar;

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
    /// Reads `x`, `y` and the optional `mask`.
    ///
    /// # Errors
    /// When an input is missing or shaped otherwise, a mask entry is neither 0 nor 1, or nothing is kept.
    pub fn of(arrays: &'a Named<S>) -> Result<Self, String> {
        let x = expect(arrays, "x", &[ANY, ANY, 3])?;
        let (h, w) = (x.shape[0], x.shape[1]);
        let y = expect(arrays, "y", &[h, w, 3])?;
        let mut kept = vec![true; h * w];
        if arrays.contains_key("mask") {
            for (kept, m) in kept.iter_mut().zip(&expect(arrays, "mask", &[h, w])?.data) {
                *kept = match m.value() {
                    0.0 => false,
                    1.0 => true,
                    other => return Err(format!("input mask: expected 0 or 1, got {other}")),
                };
            }
        }
        let pixels = kept.iter().filter(|&&kept| kept).count();
        if pixels == 0 {
            return Err("input mask: expected at least one kept pixel, got none".to_owned());
        }
        Ok(Self { x, y, size_px: [h, w], kept, values: 3.0 * pixels as f64 })
    }
}
