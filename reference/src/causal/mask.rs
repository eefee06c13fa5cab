//! Ã(i,j) = σ((U(i,j) + ln u(i,j) − ln(1 − u(i,j))) / τ) for i ≠ j, 0 for i = j.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | U | `logits` | (n, n) |
//! | u | `uniform` | (n, n), noise without gradient |
//! | Ã | `mask` | (n, n) |

use crate::array::{ANY, Named, Out, expect};
use crate::scalar::Scalar;
use crate::settings::Settings;

/// The twin of `causal.mask`.
///
/// # Errors
/// When an input is missing or shaped otherwise, or a number leaves its range.
pub fn forward<S: Scalar>(
    arrays: &Named<S>,
    settings: &Settings<'_>,
    out: &mut Out<S>,
) -> Result<(), String> {
    let n = expect(arrays, "logits", &[ANY, ANY])?.shape[0];
    let logits = expect(arrays, "logits", &[n, n])?;
    let uniform = expect(arrays, "uniform", &[n, n])?;
    let tau = settings.number("tau", 0.2)?;
    if !(tau > 0.0) {
        return Err(format!("setting tau: expected a number above 0, got {tau}"));
    }
    let mask = out.array("mask", &[n, n]);
    for i in 0..n {
        for j in (0..n).filter(|j| *j != i) {
            let u = uniform.data[i * n + j].value();
            if !(u > 0.0 && u < 1.0) {
                return Err(format!("input uniform: expected numbers between 0 and 1, got {u}"));
            }
            let x = (logits.data[i * n + j] + (libm::log(u) - libm::log1p(-u))) / tau;
            let y = if x.value() >= 0.0 { S::one() / ((-x).exp() + 1.0) } else { x.exp() / (x.exp() + 1.0) };
            out.put(mask, i * n + j, y);
        }
    }
    out.flush();
    Ok(())
}
