//! `loss.groups`: losses of groups of image pairs that share one intervention.
//!
//! v_g = (1/M) Σ_m û'(g,m,i), or the given code,   i = i(g) is the factor set in group g
//!
//! L_eq = mean of ‖û'(g,m,i) − v_g‖²/(k·max(s_i², 10⁻⁴)),
//! L_inv = mean over j ≠ i of ‖ε(g,m,j) − ε'(g,m,j)‖²/k
//!
//! L_spr = mean over factors of max(0, ¼ − V_i),
//! V_i = Σ ‖v_g − mean‖²/((G_i − 1)·k) over the G_i ≥ 2 groups of factor i
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
//! The slope is 0 where V_i ≥ ¼. Factors with fewer than two groups are excluded from L_spr; L_inv = 0 for n
//! = 1.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `loss.groups`.
    pub struct In<'a, S> {
        after: &'a Arr<S> = Port::var("G,M,N,K", "factors after the intervention, posterior means"),
        eps: &'a Arr<S> = Port::var("G,M,N,K", "causes before"),
        eps_after: &'a Arr<S> = Port::var("G,M,N,K", "causes after"),
        target: &'a Arr<S> = Port::int("G", Dtype::I32, "factor set in the group, 0 to N − 1"),
        variance: &'a Arr<S> =
            Port::fixed("N", "running variance of each factor, 0 or more; at least 1e-4 is used"),
        given: Option<&'a Arr<S>> =
            Port::var("G,K", "codes of the values; absent: means over the members"),
    }
}

/// `loss.groups`
pub static SIGNATURE: Signature = Signature {
    name: "loss.groups",
    summary: "losses of groups that share one intervention: equal codes, no other cause changed, no collapse",
    inputs: In::<f64>::PORTS,
    outputs: ports![
        equal: Port::var(
            "",
            "mean square of the distance from the group's value, in units of the variance",
        ),
        invariant: Port::var("", "mean square of the change of all other causes"),
        spread: Port::var("", "mean over the factors of max(0, 1/4 − variance of the values)"),
        shared: Port::var("G,K", "the value of each group"),
    ],
    ..Signature::EMPTY
};

/// Least variance that L_eq divides by.
const VARIANCE_FLOOR: f64 = 1e-4;
/// Variance of the values below which L_spr is positive.
const SPREAD: f64 = 0.25;

/// The twin of `loss.groups`.
///
/// # Errors
/// When an array is empty, or an entry is out of range.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { after, eps, eps_after, given, .. } = *input;
    let [g, m, n, k] = [0, 1, 2, 3].map(|axis| after.shape[axis]);
    if g * m * n * k == 0 {
        return Err(format!("input after: expected at least one number, got shape {:?}", after.shape));
    }
    let mut target = Vec::new();
    for i in &input.target.data {
        let i = i.value();
        if !(i >= 0.0 && i < n as f64 && i == i.trunc()) {
            return Err(format!("input target: expected factors from 0 to {}, got {i}", n - 1));
        }
        target.push(i as usize);
    }
    let variance: Vec<f64> = input.variance.data.iter().map(|s| s.value()).collect();
    if !variance.iter().all(|s| *s >= 0.0) {
        return Err(format!("input variance: expected numbers from 0 on, got {variance:?}"));
    }
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

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing, has the wrong shape or is out of range.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
