//! `nn.leaky_relu`: the leaky ReLU, an activation function.
//!
//! y = x where x > 0, s·x elsewhere
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | any |
//! | s | setting `slope` | () |
//! | y | `y` | as x |
//!
//! # Kinks and domain
//! At x = 0 the slope is s.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.leaky_relu`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("...", ""),
    }
}

/// `nn.leaky_relu`
pub static SIGNATURE: Signature = Signature {
    name: "nn.leaky_relu",
    summary: "x where it is positive, slope·x elsewhere",
    inputs: In::<f64>::PORTS,
    outputs: ports![y: Port::var("...", "")],
    settings: &[SettingSpec::number("slope", "0.2", "factor of values that are not positive")],
    ..Signature::EMPTY
};

/// The twin of `nn.leaky_relu`.
pub fn leaky_relu<S: Scalar>(x: &Arr<S>, slope: f64, out: &mut Out<'_, S>) {
    let y = out.array("y", &x.shape);
    for (i, &x) in x.data.iter().enumerate() {
        out.put(y, i, if x.value() > 0.0 { x } else { x * slope });
    }
    out.flush();
}

/// [`leaky_relu`] on named arrays.
///
/// # Errors
/// When the input is missing.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    leaky_relu(In::of(call.arrays)?.x, call.settings.number("slope"), out);
    Ok(())
}
