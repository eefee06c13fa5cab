//! `causal.scm_kl`: divergence of a posterior over factors from a structural causal model.
//!
//! sampled: (1/B) Σ_b Σⱼ κⱼ ½ Σ_c (ε² − 1 − ℓ); linear: its expectation, with rⱼ = μⱼ − Σᵢ Wᵢⱼ μᵢ:
//! (1/B) Σ_b Σⱼ κⱼ ½ Σ_c (rⱼ² + e^ℓⱼ + Σᵢ Wᵢⱼ² e^ℓᵢ − 1 − ℓⱼ).
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | ε or μ | `eps` or `mu` | (B, n, k) |
//! | ℓ | `logvar` | (B, n, k) |
//! | κ | `kept` | (B, n), 0 or 1, fixed; absent = 1 |
//! | W = Ã∘Ω, zero diagonal | `mask`, `weight` | (n, n) |
//! | KL | `value` | () |
//!
//! # Rounding
//! Left folds.

use crate::array::{Arr, Out};
use crate::causal::posterior::LOGVAR;
use crate::inputs::{inputs, required};
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `causal.scm_kl`.
    pub struct In<'a, S> {
        eps: Option<&'a Arr<S>> = Port::var("B,N,K", "mode sampled: causes of a sample, by abduction"),
        mu: Option<&'a Arr<S>> = Port::var("B,N,K", "mode linear: means of the factors"),
        logvar: &'a Arr<S> = LOGVAR,
        mask: Option<&'a Arr<S>> =
            Port::var("N,N", "mode linear: edges i → j, the diagonal is ignored"),
        weight: Option<&'a Arr<S>> = Port::var("N,N", "mode linear: a number per edge"),
        kept: Option<&'a Arr<S>> =
            Port::fixed("B,N", "0 omits a factor whose mechanism was replaced"),
    }
}

/// `causal.scm_kl`
pub static SIGNATURE: Signature = Signature {
    name: "causal.scm_kl",
    summary: "divergence of a posterior over factors from a structural causal model",
    inputs: In::<f64>::PORTS,
    outputs: ports![
        value: Port::var("", "nats; sum over kept factors and dimensions, mean over the batch"),
    ],
    settings: &[SettingSpec::choice(
        "mode",
        &["sampled", "linear"],
        "sampled",
        "one sample, or the closed form for a linear mechanism",
    )],
    ..Signature::EMPTY
};

/// The twin of `causal.scm_kl`.
///
/// # Errors
/// When an input of the mode is missing, or the batch is empty.
pub fn forward<S: Scalar>(input: &In<'_, S>, linear: bool, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { eps, mu, logvar, mask, weight, kept } = *input;
    let [batch, n, k] = [0, 1, 2].map(|axis| logvar.shape[axis]);
    if batch == 0 {
        return Err("input logvar: expected at least one sample".to_owned());
    }
    let x = if linear { required("mu", mu)? } else { required("eps", eps)? };
    let mut w = vec![S::zero(); n * n];
    if linear {
        let (mask, weight) = (required("mask", mask)?, required("weight", weight)?);
        for at in (0..n * n).filter(|at| at / n != at % n) {
            w[at] = mask.data[at] * weight.data[at];
        }
    }
    let mut sum = S::zero();
    for b in 0..batch {
        for j in (0..n).filter(|j| kept.is_none_or(|kept| kept.data[b * n + j].value() != 0.0)) {
            for c in 0..k {
                let at = |i: usize| (b * n + i) * k + c;
                let (mut cause, mut spread) = (x.data[at(j)], S::zero());
                if linear {
                    spread = logvar.data[at(j)].exp();
                    for i in 0..n {
                        let w = w[i * n + j];
                        cause = cause - w * x.data[at(i)];
                        spread = spread + w * w * logvar.data[at(i)].exp();
                    }
                }
                sum = sum + (cause * cause + spread - 1.0 - logvar.data[at(j)]) * 0.5;
            }
        }
    }
    let value = out.array("value", &[]);
    out.put(value, 0, sum / batch as f64);
    out.flush();
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or the batch is empty.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.word("mode") == "linear", out)
}
