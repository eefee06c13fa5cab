//! `loss.latent`: distance between the factors of two images, and between the noise of their mechanisms.
//!
//! L = 1/(h d) Σ over i of ((u_i − u'_i)/s_i)² + ((ε_i − ε'_i)/t_i)²,   h = 2, or 1 without the second term
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | u, u', s | `factors`, `factors_real`, `factors_spread` | (D) |
//! | ε, ε', t | `noise`, `noise_real`, `noise_spread` | (D), optional, together |
//! | L | `value` | () |

use crate::array::{Arr, Out};
use crate::inputs::{inputs, required};
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `loss.latent`.
    pub struct In<'a, S> {
        factors: &'a Arr<S> = Port::var("D", "factors of the render"),
        factors_real: &'a Arr<S> = Port::fixed("D", "factors of the input image"),
        factors_spread: &'a Arr<S> = Port::fixed("D", "their standard deviations, above 0"),
        noise: Option<&'a Arr<S>> = Port::var("D", "noise of the render"),
        noise_real: Option<&'a Arr<S>> = Port::fixed("D", "noise of the input image"),
        noise_spread: Option<&'a Arr<S>> = Port::fixed("D", "its standard deviations, above 0"),
    }
}

/// `loss.latent`
pub static SIGNATURE: Signature = Signature {
    name: "loss.latent",
    summary: "distance between the factors of two images, and between their noise",
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "")],
    ..Signature::EMPTY
};

/// The twin of `loss.latent`.
///
/// # Errors
/// When only some of the inputs of the second term are present.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let mut halves = vec![[input.factors, input.factors_real, input.factors_spread]];
    if let Some(noise) = input.noise {
        let (real, spread) =
            (required("noise_real", input.noise_real)?, required("noise_spread", input.noise_spread)?);
        halves.push([noise, real, spread]);
    }
    let numbers = (halves.len() * input.factors.data.len()) as f64;
    let value = out.array("value", &[]);
    for [x, real, spread] in halves {
        for (i, x) in x.data.iter().enumerate() {
            let off = (*x - real.data[i]) / spread.data[i];
            out.add(value, 0, off * off, numbers);
            out.flush();
        }
    }
    out.divide(value, 0, numbers);
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
