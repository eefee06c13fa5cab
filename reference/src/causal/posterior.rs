//! s = μ + e^{ℓ/2} η, ℓ limited to [−8, 4], gradient 0 outside.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | μ | `mu` | (B, n, k) |
//! | ℓ | `logvar` | (B, n, k) |
//! | η | `eta` | (B, n, k), noise without gradient |
//! | s | `sample` | (B, n, k) |

use crate::array::{ANY, Named, Out, expect};
use crate::scalar::Scalar;

/// The twin of `causal.posterior`.
///
/// # Errors
/// When an input is missing or shaped otherwise.
pub fn forward<S: Scalar>(arrays: &Named<S>, out: &mut Out<S>) -> Result<(), String> {
    let mu = expect(arrays, "mu", &[ANY, ANY, ANY])?;
    let logvar = expect(arrays, "logvar", &mu.shape)?;
    let eta = expect(arrays, "eta", &mu.shape)?;
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
    Ok(())
}
