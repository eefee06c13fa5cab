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

use crate::array::{ANY, Named, Out, expect};
use crate::scalar::Scalar;
use crate::settings::Settings;

/// The twin of `causal.scm_kl`.
///
/// # Errors
/// When an input is missing or shaped otherwise, or the batch is empty.
pub fn forward<S: Scalar>(
    arrays: &Named<S>,
    settings: &Settings<'_>,
    out: &mut Out<S>,
) -> Result<(), String> {
    let linear = settings.text("mode", "sampled")? == "linear";
    let x = expect(arrays, if linear { "mu" } else { "eps" }, &[ANY, ANY, ANY])?;
    let logvar = expect(arrays, "logvar", &x.shape)?;
    let (batch, n, k) = (x.shape[0], x.shape[1], x.shape[2]);
    if batch == 0 {
        return Err("input logvar: expected at least one sample".to_owned());
    }
    let kept = if arrays.contains_key("kept") { Some(expect(arrays, "kept", &[batch, n])?) } else { None };
    let mut w = vec![S::zero(); n * n];
    if linear {
        let (mask, weight) = (expect(arrays, "mask", &[n, n])?, expect(arrays, "weight", &[n, n])?);
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
