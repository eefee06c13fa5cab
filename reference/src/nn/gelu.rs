//! `nn.gelu`: the Gaussian error linear unit, x times the probability that a standard normal number is below x.
//!
//! y = x·Φ(x),   Φ(x) = ½ erfc(−x/√2)
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | any |
//! | y | `y` | as x |
//!
//! # Rounding
//! f64; erfc keeps the digits of small Φ.
//!
//! # Kinks and domain
//! Smooth.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.gelu`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("...", ""),
    }
}

/// `nn.gelu`
pub static SIGNATURE: Signature = Signature {
    name: "nn.gelu",
    summary: "x·Φ(x), with the distribution function Φ of the standard normal distribution",
    inputs: In::<f64>::PORTS,
    outputs: ports![y: Port::var("...", "")],
    ..Signature::EMPTY
};

/// x·Φ(x) of one number.
pub fn of<S: Scalar>(x: S) -> S {
    let v = x.value();
    let density = libm::exp(-0.5 * v * v) / (2.0 * std::f64::consts::PI).sqrt();
    x * x.chain(0.5 * libm::erfc(-v * std::f64::consts::FRAC_1_SQRT_2), density)
}

/// The twin of `nn.gelu`.
pub fn forward<S: Scalar>(x: &Arr<S>, out: &mut Out<'_, S>) {
    let y = out.array("y", &x.shape);
    for (i, &x) in x.data.iter().enumerate() {
        out.put(y, i, of(x));
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
