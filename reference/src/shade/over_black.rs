//! `shade.over_black`: a render over black instead of its background.
//!
//! x' = x − (1 − α) b
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x, α | `image`, `alpha` | (H, W, 3), (H, W) |
//! | b | `background` | (3) |
//! | x' | `over_black` | (H, W, 3) |

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `shade.over_black`.
    pub struct In<'a, S> {
        alpha: &'a Arr<S> = Port::var("H,W", "coverage of the render"),
        background: &'a Arr<S> = Port::fixed("3", "background colour to subtract"),
        image: &'a Arr<S> = Port::var("H,W,3", "render over the background"),
    }
}

/// `shade.over_black`
pub static SIGNATURE: Signature = Signature {
    name: "shade.over_black",
    summary: "a render over black instead of its background",
    inputs: In::<f64>::PORTS,
    outputs: ports![over_black: Port::var("H,W,3", "")],
    ..Signature::EMPTY
};

/// The twin of `shade.over_black`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let In { alpha, background, image } = *input;
    let over_black = out.array("over_black", &image.shape);
    for (pixel, a) in alpha.data.iter().enumerate() {
        for c in 0..3 {
            let behind = (S::one() - *a) * background.data[c];
            out.put(over_black, 3 * pixel + c, image.data[3 * pixel + c] - behind);
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
