//! `causal.posterior`: a sample of a diagonal Gaussian.
//!
//! s = μ + e^{ℓ/2} η, ℓ limited to [−8, 4], gradient 0 outside.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | μ | `mu` | (B, n, k) |
//! | ℓ | `logvar` | (B, n, k) |
//! | η | `eta` | (B, n, k), noise without gradient |
//! | s | `sample` | (B, n, k) |

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

pub(super) const MU: Port = Port::var("B,N,K", "mean");
pub(super) const LOGVAR: Port = Port::var("B,N,K", "ln of the variance");

inputs! {
    /// Inputs of `causal.posterior`.
    pub struct In<'a, S> {
        mu: &'a Arr<S> = MU,
        logvar: &'a Arr<S> = LOGVAR,
        eta: &'a Arr<S> = Port::fixed("B,N,K", "standard normal numbers; 0 gives the mean"),
    }
}

/// `causal.posterior`
pub static SIGNATURE: Signature = Signature {
    name: "causal.posterior",
    summary: "a sample of a diagonal Gaussian, differentiable in mean and variance",
    inputs: In::<f64>::PORTS,
    outputs: ports![sample: Port::var("B,N,K", "")],
    ..Signature::EMPTY
};

/// The twin of `causal.posterior`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let In { mu, logvar, eta } = *input;
    let sample = out.array("sample", &mu.shape);
    for i in 0..mu.data.len() {
        let l = logvar.data[i];
        let limited = match l.value() {
            low if low < -8.0 => S::from_f64(-8.0),
            high if high > 4.0 => S::from_f64(4.0),
            _ => l,
        };
        out.put(sample, i, mu.data[i] + (limited * 0.5).exp() * eta.data[i].value());
        out.flush();
    }
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out);
    Ok(())
}
