//! Z = S(ε; do(i, v)) sample by sample: column i of Ã is zero, εᵢ is v, then the sweeps of `structure`.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | i | `target` | (B), −1 for none |
//! | v | `value` | (B, k) |
//!
//! All else as in `structure`.

use crate::array::{ANY, Arr, Named, Out, expect};
use crate::causal::structure::{Mechanism, sweeps};
use crate::scalar::Scalar;
use crate::settings::Settings;

/// The twin of `causal.intervene`.
///
/// # Errors
/// When an input is missing or shaped otherwise, a setting is not what it should be, or a target is not a factor.
pub fn forward<S: Scalar>(
    arrays: &Named<S>,
    settings: &Settings<'_>,
    out: &mut Out<S>,
) -> Result<(), String> {
    let eps = expect(arrays, "eps", &[ANY, ANY, ANY])?;
    let (batch, n, k) = (eps.shape[0], eps.shape[1], eps.shape[2]);
    let target = expect(arrays, "target", &[batch])?;
    let value = expect(arrays, "value", &[batch, k])?;
    let slope = settings.number("slope", 0.05)?;
    let z = out.array("z", &[batch, n, k]);
    for b in 0..batch {
        let node = target.data[b].value();
        if !(node >= -1.0 && node < n as f64) {
            return Err(format!("input target: expected -1 or a factor below {n}, got {node}"));
        }
        let mut cause = eps.data[b * n * k..(b + 1) * n * k].to_vec();
        let mut cut: Arr<S> = expect(arrays, "mask", &[n, n])?.clone();
        if node >= 0.0 {
            let i = node as usize;
            cause[i * k..(i + 1) * k].copy_from_slice(&value.data[b * k..(b + 1) * k]);
            for parent in 0..n {
                cut.data[parent * n + i] = S::zero();
            }
        }
        let mechanism = Mechanism::behind(&cut, arrays, slope, n, k)?;
        let mut state = cause.clone();
        for _ in 0..sweeps(settings, n, mechanism.linear())? {
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
