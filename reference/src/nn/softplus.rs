//! `nn.softplus`: a smooth maximum of a number and 0.
//!
//! y = ln(1 + eˣ), computed as max(x, 0) + ln(1 + e^(−|x|))
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | any |
//! | y | `y` | as x |

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.softplus`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("...", ""),
    }
}

/// `nn.softplus`
pub static SIGNATURE: Signature = Signature {
    name: "nn.softplus",
    summary: "ln(1 + eˣ)",
    inputs: In::<f64>::PORTS,
    outputs: ports![y: Port::var("...", "")],
    ..Signature::EMPTY
};

/// The twin of `nn.softplus`.
pub fn forward<S: Scalar>(x: &Arr<S>, out: &mut Out<'_, S>) {
    let y = out.array("y", &x.shape);
    for (i, &x) in x.data.iter().enumerate() {
        let soft = if x.value() > 0.0 { x + (-x).exp().log1p() } else { x.exp().log1p() };
        out.put(y, i, soft);
    }
    out.flush();
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When the input is missing.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(In::of(call.arrays)?.x, out);
    Ok(())
}
