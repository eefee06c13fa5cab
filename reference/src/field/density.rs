//! `field.density`: density of a volume from a signed distance.
//!
//! σ = Ψ(−s)/β,   Ψ the distribution function of a Laplace variable with mean 0 and scale β
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | s | `sdf` | (N) |
//! | β | `beta` | () |
//! | σ | `sigma` | (N) |
//!
//! # Rounding
//! One exponential of −|s|/β.
//!
//! # Kinks and domain
//! Smooth of first order at s = 0, where the formula of s < 0 is taken. β is above 0.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, Space, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

/// The port of the scale.
pub(super) const BETA: Port = Port::var("", "scale, above 0, scene units").moved(Space::Log);

inputs! {
    /// Inputs of `field.density`.
    pub struct In<'a, S> {
        sdf: &'a Arr<S> = Port::var("N", "negative inside"),
        beta: &'a Arr<S> = BETA,
    }
}

/// `field.density`
pub static SIGNATURE: Signature = Signature {
    name: "field.density",
    summary: "density from a signed distance (VolSDF)",
    inputs: In::<f64>::PORTS,
    outputs: ports![sigma: Port::var("N", "per scene unit")],
    ..Signature::EMPTY
};

/// The scale.
///
/// # Errors
/// When it is not above 0.
pub(super) fn scale<S: Scalar>(beta: &Arr<S>) -> Result<S, String> {
    let beta = beta.data[0];
    if beta.value() > 0.0 {
        return Ok(beta);
    }
    Err(format!("input beta: expected a number above 0, got {}", beta.value()))
}

/// Density at one distance.
pub fn density<S: Scalar>(s: S, beta: S) -> S {
    density_by(s, beta, |is_outside| is_outside)
}

/// Density at one distance; `choose` decides whether it is outside.
pub(super) fn density_by<S: Scalar>(s: S, beta: S, mut choose: impl FnMut(bool) -> bool) -> S {
    let psi = if choose(s.value() > 0.0) { (-s / beta).exp() * 0.5 } else { -((s / beta).exp() * 0.5) + 1.0 };
    psi / beta
}

/// The twin of `field.density`.
///
/// # Errors
/// When β is not above 0.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let beta = scale(input.beta)?;
    let sigma = out.array("sigma", &input.sdf.shape);
    for (i, s) in input.sdf.data.iter().enumerate() {
        out.put(sigma, i, density(*s, beta));
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or β is not above 0.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
