//! What groups of pictures say that share one intervention.
//!
//! v_g = (1/M) Σ_m û'(g,m,i), or what is given,   i = i(g) the factor that group g set
//!
//! L_eq = mean of ‖û'(g,m,i) − v_g‖²/(k·max(s_i², 10⁻⁴)),   L_inv = mean over j ≠ i of ‖ε(g,m,j) − ε'(g,m,j)‖²/k
//!
//! L_spr = mean over factors of max(0, ¼ − V_i),   V_i = Σ ‖v_g − mean‖²/((G_i − 1)·k) over the G_i ≥ 2 groups of factor i
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | û', ε, ε' | `after`, `eps`, `eps_after` | (G, M, n, k) |
//! | i | `target` | (G) |
//! | s² | `variance` | (n) |
//! | v | `given`, optional | (G, k) |
//! | L_eq, L_inv, L_spr | `equal`, `invariant`, `spread` | () |
//! | v | `shared` | (G, k) |
//!
//! # Kinks and domain
//! No slope where V_i = ¼ or above. Factors with fewer than two groups are left out of L_spr; L_inv = 0 for n = 1.

use crate::array::{ANY, Named, Out, expect};
use crate::scalar::Scalar;

/// Least variance that L_eq divides by.
const VARIANCE_FLOOR: f64 = 1e-4;
/// Variance of the values below which L_spr sets in.
const SPREAD: f64 = 0.25;

/// The twin of `loss.groups`.
///
/// # Errors
/// When an input is missing, shaped otherwise or out of range.
pub fn forward<S: Scalar>(arrays: &Named<S>, out: &mut Out<S>) -> Result<(), String> {
    let after = expect(arrays, "after", &[ANY, ANY, ANY, ANY])?;
    let [g, m, n, k] = [0, 1, 2, 3].map(|axis| after.shape[axis]);
    let eps = expect(arrays, "eps", &[g, m, n, k])?;
    let eps_after = expect(arrays, "eps_after", &[g, m, n, k])?;
    if g * m * n * k == 0 {
        return Err(format!("input after: expected at least one number, got shape {:?}", after.shape));
    }
    let mut target = Vec::new();
    for i in &expect(arrays, "target", &[g])?.data {
        let i = i.value();
        if !(i >= 0.0 && i < n as f64 && i == i.trunc()) {
            return Err(format!("input target: expected factors from 0 to {}, got {i}", n - 1));
        }
        target.push(i as usize);
    }
    let variance: Vec<f64> = expect(arrays, "variance", &[n])?.data.iter().map(|s| s.value()).collect();
    if !variance.iter().all(|s| *s >= 0.0) {
        return Err(format!("input variance: expected numbers from 0 on, got {variance:?}"));
    }
    let given = if arrays.contains_key("given") { Some(expect(arrays, "given", &[g, k])?) } else { None };
    let at =
        |group: usize, member: usize, factor: usize, c: usize| ((group * m + member) * n + factor) * k + c;
    let mut shared = vec![S::zero(); g * k];
    let (mut equal, mut invariant) = (S::zero(), S::zero());
    for (group, &i) in target.iter().enumerate() {
        for c in 0..k {
            let mut sum = S::zero();
            for member in 0..m {
                sum = sum + after.data[at(group, member, i, c)];
            }
            shared[group * k + c] = given.map_or(sum / m as f64, |given| given.data[group * k + c]);
        }
        let scale = if variance[i] > VARIANCE_FLOOR { variance[i] } else { VARIANCE_FLOOR };
        for member in 0..m {
            for c in 0..k {
                let d = after.data[at(group, member, i, c)] - shared[group * k + c];
                equal = equal + d * d / scale;
                for j in (0..n).filter(|&j| j != i) {
                    let d = eps.data[at(group, member, j, c)] - eps_after.data[at(group, member, j, c)];
                    invariant = invariant + d * d;
                }
            }
        }
    }
    let (mut spread, mut factors) = (S::zero(), 0);
    for i in 0..n {
        let groups: Vec<usize> = (0..g).filter(|&group| target[group] == i).collect();
        if groups.len() < 2 {
            continue;
        }
        factors += 1;
        let mut squares = S::zero();
        for c in 0..k {
            let mut mean = S::zero();
            for group in &groups {
                mean = mean + shared[group * k + c];
            }
            mean = mean / groups.len() as f64;
            for group in &groups {
                let d = shared[group * k + c] - mean;
                squares = squares + d * d;
            }
        }
        let missing = -(squares / ((groups.len() - 1) * k) as f64) + SPREAD;
        if missing.value() > 0.0 {
            spread = spread + missing;
        }
    }
    let names = ["equal", "invariant", "spread"].map(|name| out.array(name, &[]));
    let slot = out.array("shared", &[g, k]);
    out.put(names[0], 0, equal / (g * m * k) as f64);
    out.put(names[1], 0, if n > 1 { invariant / (g * m * (n - 1) * k) as f64 } else { invariant });
    out.put(names[2], 0, if factors > 0 { spread / factors as f64 } else { spread });
    for (i, v) in shared.into_iter().enumerate() {
        out.put(slot, i, v);
    }
    out.flush();
    Ok(())
}
