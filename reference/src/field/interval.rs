//! `field.interval`: mean density over an interval in which the signed distance is linear.
//!
//! σ = ∫₀¹ D(s₀ + t(s₁ − s₀)) dt = (F(s₁) − F(s₀))/(s₁ − s₀) with the density D of `field.density` and its
//! antiderivative F(s) = −½e^(−s/β) for s ≥ 0, s/β − ½e^(s/β) for s < 0; D(s₀) where s₁ = s₀
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | s₀, s₁ | `sdf0`, `sdf1` | (N) |
//! | β | `beta` | () |
//! | σ | `sigma` | (N) |
//!
//! # Rounding
//! Differences of exponentials on one side of 0 are e^(−a)·(1 − e^(−d))/d, with the power series of the last
//! factor below d = 1/2.
//!
//! # Kinks and domain
//! Smooth of first order at s = 0 and at s₀ = s₁; 0 belongs to the outside. β is above 0.

use super::density::{BETA, scale};
use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `field.interval`.
    pub struct In<'a, S> {
        sdf0: &'a Arr<S> = Port::var("N", "at the start, negative inside"),
        sdf1: &'a Arr<S> = Port::var("N", "at the end"),
        beta: &'a Arr<S> = BETA,
    }
}

/// `field.interval`
pub static SIGNATURE: Signature = Signature {
    name: "field.interval",
    summary: "mean density over an interval with a linear signed distance",
    inputs: In::<f64>::PORTS,
    outputs: ports![sigma: Port::var("N", "per scene unit")],
    ..Signature::EMPTY
};

/// (1 − e^(−d))/d.
fn phi<S: Scalar>(d: S) -> S {
    if d.value().abs() >= 0.5 {
        return -(-d).expm1() / d;
    }
    // Σ (−d)ᵏ/(k+1)!
    let (mut term, mut sum) = (S::one(), S::one());
    for k in 1..20 {
        term = -(term * d) / f64::from(k + 1);
        sum = sum + term;
    }
    sum
}

/// Mean density between two distances.
pub fn interval<S: Scalar>(s0: S, s1: S, beta: S) -> S {
    interval_by(s0, s1, beta, |holds| holds)
}

/// Mean density between two distances; `choose` decides whether they descend, whether the smaller is outside, and if
/// not, whether the larger is inside.
pub(super) fn interval_by<S: Scalar>(s0: S, s1: S, beta: S, mut choose: impl FnMut(bool) -> bool) -> S {
    let (lo, hi) = if choose(s0.value() > s1.value()) { (s1, s0) } else { (s0, s1) };
    let (lo, hi) = (lo / beta, hi / beta);
    let d = hi - lo;
    let mean = if choose(lo.value() >= 0.0) {
        (-lo).exp() * phi(d) * 0.5
    } else if choose(hi.value() < 0.0) {
        -(hi.exp() * phi(d) * 0.5) + 1.0
    } else {
        // ∫ over the part inside, −lo − ½(1 − e^lo), and over that outside, ½(1 − e^−hi).
        let (inside, outside) = (-lo, hi);
        (inside * (-(phi(inside) * 0.5) + 1.0) + outside * phi(outside) * 0.5) / d
    };
    mean / beta
}

/// The twin of `field.interval`.
///
/// # Errors
/// When β is not above 0.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let beta = scale(input.beta)?;
    let sigma = out.array("sigma", &input.sdf0.shape);
    for (i, (s0, s1)) in input.sdf0.data.iter().zip(&input.sdf1.data).enumerate() {
        out.put(sigma, i, interval(*s0, *s1, beta));
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
