//! KL = (1/B) Σ_b Σ ½ (μ² + e^ℓ − 1 − ℓ).
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | μ | `mu` | (B, n, k) |
//! | ℓ | `logvar` | (B, n, k) |
//! | KL | `value` | () |

use crate::array::{ANY, Named, Out, expect};
use crate::scalar::Scalar;

/// The twin of `causal.posterior_kl`.
///
/// # Errors
/// When an input is missing or shaped otherwise, or the batch is empty.
pub fn forward<S: Scalar>(arrays: &Named<S>, out: &mut Out<S>) -> Result<(), String> {
    let mu = expect(arrays, "mu", &[ANY, ANY, ANY])?;
    let logvar = expect(arrays, "logvar", &mu.shape)?;
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
