//! `causal.intervene`: factors along a graph with one factor set to a value.
//!
//! Z = S(ε; do(i, v)) sample by sample: column i of Ã is zero, εᵢ is v, then the sweeps of `structure`.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | i | `target` | (B), −1 for none |
//! | v | `value` | (B, k) |
//!
//! All other symbols are those of `structure`.

use crate::array::{Arr, Out};
use crate::causal::structure::{self, B0, B1, B2, MASK, Mechanism, SLOPE, SWEEPS, W0, W1, W2, WEIGHT};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `causal.intervene`.
    pub struct In<'a, S> {
        eps: &'a Arr<S> = Port::var("B,N,K", "causes"),
        mask: &'a Arr<S> = MASK,
        weight: Option<&'a Arr<S>> = WEIGHT,
        w0: Option<&'a Arr<S>> = W0,
        b0: Option<&'a Arr<S>> = B0,
        w1: Option<&'a Arr<S>> = W1,
        b1: Option<&'a Arr<S>> = B1,
        w2: Option<&'a Arr<S>> = W2,
        b2: Option<&'a Arr<S>> = B2,
        target: &'a Arr<S> = Port::int("B", Dtype::I32, "the factor that is set, -1 for none"),
        value: &'a Arr<S> = Port::var("B,K", "the value it is set to"),
    }
}

/// `causal.intervene`
pub static SIGNATURE: Signature = Signature {
    name: "causal.intervene",
    summary: "factors along a graph with one of them set to a value",
    inputs: In::<f64>::PORTS,
    outputs: ports![z: Port::var("B,N,K", "factors")],
    settings: &[SLOPE, SWEEPS],
    ..Signature::EMPTY
};

/// Settings of `causal.intervene`.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Slope of the leaky ReLU at 0 and below.
    pub slope: f64,
    /// Passes over all nodes; `None`: one per factor, or one less with weights.
    pub sweeps: Option<usize>,
}

/// The twin of `causal.intervene`.
///
/// # Errors
/// When a layer of the networks is missing or does not match the factors, or a target is not a factor.
pub fn forward<S: Scalar>(input: &In<'_, S>, settings: Settings, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { eps, mask, weight, w0, b0, w1, b1, w2, b2, target, value } = *input;
    let (batch, n, k) = (eps.shape[0], eps.shape[1], eps.shape[2]);
    let z = out.array("z", &[batch, n, k]);
    for b in 0..batch {
        let node = target.data[b].value();
        if !(node >= -1.0 && node < n as f64) {
            return Err(format!("input target: expected -1 or a factor below {n}, got {node}"));
        }
        let mut cause = eps.data[b * n * k..(b + 1) * n * k].to_vec();
        let mut cut = mask.clone();
        if node >= 0.0 {
            let i = node as usize;
            cause[i * k..(i + 1) * k].copy_from_slice(&value.data[b * k..(b + 1) * k]);
            for parent in 0..n {
                cut.data[parent * n + i] = S::zero();
            }
        }
        let behind = structure::In { eps, mask: &cut, weight, w0, b0, w1, b1, w2, b2 };
        let mechanism = Mechanism::of(&behind, settings.slope)?;
        let mut state = cause.clone();
        for _ in 0..mechanism.sweeps(settings.sweeps) {
            let effects = (0..n).flat_map(|j| mechanism.effect(j, &state));
            state = effects.zip(&cause).map(|(effect, e)| effect + *e).collect();
        }
        for (at, x) in state.into_iter().enumerate() {
            out.put(z, b * n * k + at, x);
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or a target is not a factor.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let settings = Settings { slope: call.settings.number("slope"), sweeps: structure::sweeps(call) };
    forward(&In::of(call.arrays)?, settings, out)
}
