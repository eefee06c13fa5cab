//! `nn.linear`: y = λ(x·Wᵀ + b), λ a leaky ReLU of slope s; s = 1 is the identity.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | (M, K) |
//! | W | `weight` | (N, K) |
//! | b | `bias` | (N) |
//! | s | setting `slope` | () |
//! | y | `y` | (M, N) |
//!
//! # Rounding
//! One chain per entry from 0, k ascending; then the bias, then λ.
//!
//! # Kinks and domain
//! At 0 the slope of λ is s.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.linear`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("M,K", "rows"),
        weight: &'a Arr<S> = Port::var("N,K", "one row per output"),
        bias: &'a Arr<S> = Port::var("N", "added last"),
    }
}

/// `nn.linear`
pub static SIGNATURE: Signature = Signature {
    name: "nn.linear",
    summary: "affine map of every row, y = x·Wᵀ + b, followed by a leaky ReLU",
    inputs: In::<f64>::PORTS,
    outputs: ports![y: Port::var("M,N", "")],
    settings: &[SettingSpec::number(
        "slope",
        "1",
        "slope of the leaky ReLU that follows, not negative; 1 for none",
    )],
    ..Signature::EMPTY
};

/// The twin of `nn.linear`.
pub fn forward<S: Scalar>(input: &In<'_, S>, slope: f64, out: &mut Out<'_, S>) {
    let In { x, weight, bias } = *input;
    let [m, k, n] = [x.shape[0], x.shape[1], weight.shape[0]];
    let y = out.array("y", &[m, n]);
    for row in 0..m {
        for column in 0..n {
            let mut sum = S::zero();
            for i in 0..k {
                sum = sum + x.data[row * k + i] * weight.data[column * k + i];
            }
            let z = sum + bias.data[column];
            out.put(y, row * n + column, if z.value() > 0.0 { z } else { z * slope });
        }
        out.flush();
    }
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.number("slope"), out);
    Ok(())
}

/// Number of products.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let In { x, weight, .. } = In::of(call.arrays)?;
    Ok((x.shape[0] * weight.data.len()) as u64)
}
