//! `shade.decode`: sRGB-encoded values to linear ones.
//!
//! x = y/12.92 where y ≤ 0.04045, x = ((y + 0.055)/1.055)^2.4 elsewhere
//!
//! | argument | shape |
//! |---|---|
//! | `encoded` | any |
//! | `linear` | as `encoded` |
//!
//! # Kinks and domain
//! At 0.04045 the slope is that of the line.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `shade.decode`.
    pub struct In<'a, S> {
        encoded: &'a Arr<S> = Port::var("...", ""),
    }
}

/// `shade.decode`
pub static SIGNATURE: Signature = Signature {
    name: "shade.decode",
    summary: "sRGB-encoded values to linear ones",
    inputs: In::<f64>::PORTS,
    outputs: ports![linear: Port::var("...", "")],
    ..Signature::EMPTY
};

/// The twin of `shade.decode`.
pub fn forward<S: Scalar>(x: &Arr<S>, out: &mut Out<'_, S>) {
    let y = out.array("linear", &x.shape);
    for (i, &x) in x.data.iter().enumerate() {
        let power = |y: S| ((y + 0.055) / 1.055).pow(S::from_f64(2.4));
        out.put(y, i, if x.value() <= 0.040_45 { x / 12.92 } else { power(x) });
    }
    out.flush();
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When the input is missing.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(In::of(call.arrays)?.encoded, out);
    Ok(())
}
