//! `shade.encode`: linear values to sRGB-encoded ones, limited to 0..1.
//!
//! u = clamp(x, 0, 1), y = 12.92·u where u ≤ 0.0031308, y = 1.055·u^(1/2.4) − 0.055 elsewhere
//!
//! | argument | shape |
//! |---|---|
//! | `linear` | any |
//! | `encoded` | as `linear` |
//!
//! # Kinks and domain
//! At 0 and 1 the slope is that of the inside; outside it is 0. At 0.0031308 the slope is that of the line.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `shade.encode`.
    pub struct In<'a, S> {
        linear: &'a Arr<S> = Port::var("...", ""),
    }
}

/// `shade.encode`
pub static SIGNATURE: Signature = Signature {
    name: "shade.encode",
    summary: "linear values to sRGB-encoded ones, limited to 0..1",
    inputs: In::<f64>::PORTS,
    outputs: ports![encoded: Port::var("...", "")],
    ..Signature::EMPTY
};

/// The twin of `shade.encode`.
pub fn forward<S: Scalar>(x: &Arr<S>, out: &mut Out<'_, S>) {
    let y = out.array("encoded", &x.shape);
    for (i, &x) in x.data.iter().enumerate() {
        let v = x.value();
        let u = if v < 0.0 {
            S::zero()
        } else if v > 1.0 {
            S::one()
        } else {
            x
        };
        let power = |u: S| u.pow(S::from_f64(1.0 / 2.4)) * 1.055 - 0.055;
        out.put(y, i, if u.value() <= 0.003_130_8 { u * 12.92 } else { power(u) });
    }
    out.flush();
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When the input is missing.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(In::of(call.arrays)?.linear, out);
    Ok(())
}
