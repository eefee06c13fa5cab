//! `causal.posterior_kl`: divergence of diagonal Gaussians from the standard normal prior.
//!
//! KL = (1/B) Σ_b Σ ½ (μ² + e^ℓ − 1 − ℓ).
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | μ | `mu` | (B, n, k) |
//! | ℓ | `logvar` | (B, n, k) |
//! | KL | `value` | () |

use crate::array::{Arr, Out};
use crate::causal::posterior::{LOGVAR, MU};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `causal.posterior_kl`.
    pub struct In<'a, S> {
        mu: &'a Arr<S> = MU,
        logvar: &'a Arr<S> = LOGVAR,
    }
}

/// `causal.posterior_kl`
pub static SIGNATURE: Signature = Signature {
    name: "causal.posterior_kl",
    summary: "divergence of diagonal Gaussians from the standard normal prior",
    inputs: In::<f64>::PORTS,
    outputs: ports![
        value: Port::var("", "nats; sum over factors and dimensions, mean over the batch"),
    ],
    ..Signature::EMPTY
};

/// The twin of `causal.posterior_kl`.
///
/// # Errors
/// When the batch is empty.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { mu, logvar } = *input;
    if mu.shape[0] == 0 {
        return Err("input mu: expected at least one sample".to_owned());
    }
    let mut sum = S::zero();
    for (m, l) in mu.data.iter().zip(&logvar.data) {
        sum = sum + (*m * *m + l.exp() - 1.0 - *l) * 0.5;
    }
    let value = out.array("value", &[]);
    out.put(value, 0, sum / mu.shape[0] as f64);
    out.flush();
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or the batch is empty.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
