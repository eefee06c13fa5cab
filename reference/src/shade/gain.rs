//! `shade.gain`: applies a per-frame gain per channel to the foreground of a render.
//!
//! x' = e^γ (x − (1 − α) b) + (1 − α) b
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x, α | `image`, `alpha` | (H, W, 3), (H, W) |
//! | γ | `gain` | (3) |
//! | b | `background` | (3) |
//! | x' | `lit` | (H, W, 3) |
//!
//! # Kinks and domain
//! No kinks. γ ≤ 88, so that e^γ is in the range of f32.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `shade.gain`.
    pub struct In<'a, S> {
        alpha: &'a Arr<S> = Port::var("H,W", "coverage of the render"),
        background: &'a Arr<S> = Port::fixed("3", "background colour, not affected by the gain"),
        gain: &'a Arr<S> = Port::var("3", "logarithm of the gain of a channel"),
        image: &'a Arr<S> = Port::var("H,W,3", "render over the background"),
    }
}

/// `shade.gain`
pub static SIGNATURE: Signature = Signature {
    name: "shade.gain",
    summary: "gain per channel on the foreground of a render",
    inputs: In::<f64>::PORTS,
    outputs: ports![lit: Port::var("H,W,3", "")],
    ..Signature::EMPTY
};

/// The twin of `shade.gain`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let In { alpha, background, gain, image } = *input;
    let lit = out.array("lit", &image.shape);
    for (pixel, a) in alpha.data.iter().enumerate() {
        for c in 0..3 {
            let behind = (S::one() - *a) * background.data[c];
            let above = image.data[3 * pixel + c] - behind;
            out.put(lit, 3 * pixel + c, gain.data[c].exp() * above + behind);
        }
        out.flush();
    }
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out);
    Ok(())
}
