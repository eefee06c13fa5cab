//! `loss.points`: distance of decoded points from their targets.
//!
//! ordered:  L = 1/(B·P) · Σ ( ‖Δxyz‖²/σ_x² + ‖Δrgb‖²/σ_c² )
//!
//! chamfer:  the mean over x of the smallest such term over y, plus the mean over y of the smallest over x
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x, y | `x`, `y` | (B, P, D), (B, Q, E), D = 3 or 6, E = D or 3 (no colour) |
//! | σ_x, σ_c | settings `sigma_x`, `sigma_c` | () |
//! | | plan `nearest_x`, `nearest_y` | (B, P), (B, Q) |
//! | L | `value` | () |
//!
//! # Kinks and domain
//! Of equally near neighbours the one with the lowest index is taken; derivatives hold the plan fixed.

use crate::array::{Arr, Named, Out};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `loss.points`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("B,P,D", "decoded points: xyz, or xyz and rgb"),
        y: &'a Arr<S> = Port::var(
            "B,Q,E",
            "targets: xyz if colours are unknown, else as x; Q = P in mode ordered",
        ),
    }
}

/// `loss.points`
pub static SIGNATURE: Signature = Signature {
    name: "loss.points",
    summary: "mean weighted squared distance of points, by index or to the nearest",
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "mean over the points, of both directions for chamfer")],
    plan: ports![
        nearest_x: Port::int("B,P", Dtype::I32, "chamfer: row of y nearest to each row of x").or_absent(),
        nearest_y: Port::int("B,Q", Dtype::I32, "chamfer: row of x nearest to each row of y").or_absent(),
    ],
    settings: &[
        SettingSpec::choice(
            "mode",
            &["ordered", "chamfer"],
            "ordered",
            "by index, or to the nearest neighbour in both directions",
        ),
        SettingSpec::number("sigma_x", "0.05", "distance with loss 1"),
        SettingSpec::number("sigma_c", "0.2", "colour difference with loss 1"),
    ],
    ..Signature::EMPTY
};

/// Settings of `loss.points`.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Whether points are matched to their nearest neighbours in both directions instead of by index.
    pub chamfer: bool,
    /// σ_x, σ_c.
    pub sigmas: [f64; 2],
}

impl Settings {
    fn of<S>(call: &Call<'_, S>) -> Self {
        let sigmas = ["sigma_x", "sigma_c"].map(|key| call.settings.number(key));
        Self { chamfer: call.settings.word("mode") == "chamfer", sigmas }
    }
}

fn square<S: Scalar>(u: &[S], v: &[S], sigmas: [f64; 2]) -> S {
    let mut total = S::zero();
    for (part, sigma) in sigmas.iter().enumerate().take(v.len().min(u.len()) / 3) {
        let mut sum = S::zero();
        for c in 3 * part..3 * part + 3 {
            let d = u[c] - v[c];
            sum = sum + d * d;
        }
        total = total + sum / (sigma * sigma);
    }
    total
}

/// For each row of `from` its nearest row of `to`, or the one given by the plan.
fn nearest<S: Scalar>(
    name: &str,
    [from, to]: [&Arr<S>; 2],
    sigmas: [f64; 2],
    plan: Option<&Named<f64>>,
) -> Result<Arr<f64>, String> {
    let [batch, n, d] = [0, 1, 2].map(|axis| from.shape[axis]);
    let [m, e] = [1, 2].map(|axis| to.shape[axis]);
    if let Some(given) = plan.and_then(|plan| plan.get(name)) {
        let inside = |&k: &f64| k >= 0.0 && k < m as f64 && k == k.trunc();
        if given.shape != [batch, n] || !given.data.iter().all(inside) {
            return Err(format!("plan {name}: expected [{batch}, {n}] rows below {m}"));
        }
        return Ok(given.clone());
    }
    let mut found = Arr::filled(&[batch, n], 0.0);
    for row in 0..batch * n {
        let mut least = f64::INFINITY;
        for k in 0..m {
            let other = (row / n * m + k) * e;
            let far = square(&from.data[row * d..][..d], &to.data[other..][..e], sigmas).value();
            if far < least {
                (least, found.data[row]) = (far, k as f64);
            }
        }
    }
    // In reverse mode, drop the nodes recorded while searching.
    S::sweep();
    Ok(found)
}

/// The twin of `loss.points`.
///
/// # Errors
/// When the points or a setting are invalid, or the plan does not match.
pub fn forward<S: Scalar>(
    input: &In<'_, S>,
    settings: Settings,
    plan: Option<&Named<f64>>,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    let (In { x, y }, Settings { chamfer, sigmas }) = (*input, settings);
    let [batch, p, d] = [0, 1, 2].map(|axis| x.shape[axis]);
    let [q, e] = [1, 2].map(|axis| y.shape[axis]);
    if !sigmas.iter().all(|&sigma| sigma > 0.0) {
        return Err(format!("settings sigma_x, sigma_c: expected positive numbers, got {sigmas:?}"));
    }
    if !matches!([d, e], [3, 3] | [6, 3] | [6, 6]) || batch * p * q == 0 {
        return Err(format!(
            "inputs x, y: expected shapes (B, P, 3 or 6) and (B, Q, 3 or as x), not empty, got {:?}, {:?}",
            x.shape, y.shape
        ));
    }
    let value = out.array("value", &[]);
    let sum = |out: &mut Out<S>, i: usize, k: usize, n: usize| {
        let term = square(&x.data[i * d..][..d], &y.data[k * e..][..e], sigmas) / n as f64;
        out.add(value, 0, term, 1.0);
        out.flush();
    };
    if chamfer {
        let f = nearest("nearest_x", [x, y], sigmas, plan)?;
        let g = nearest("nearest_y", [y, x], sigmas, plan)?;
        for (i, &k) in f.data.iter().enumerate() {
            sum(out, i, i / p * q + k as usize, batch * p);
        }
        for (k, &i) in g.data.iter().enumerate() {
            sum(out, k / q * p + i as usize, k, batch * q);
        }
        out.plan.insert("nearest_x".to_owned(), f);
        out.plan.insert("nearest_y".to_owned(), g);
    } else if p == q {
        (0..batch * p).for_each(|i| sum(out, i, i, batch * p));
    } else {
        return Err(format!("input y: expected {p} points as in x, got {q}"));
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input, a setting or the plan is invalid.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, Settings::of(call), call.plan, out)
}

/// Number of pairs of points compared.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let In { x, y } = In::of(call.arrays)?;
    let [b, p, q] = [x.shape[0], x.shape[1], y.shape[1]].map(|size| size as u64);
    Ok(if Settings::of(call).chamfer { 2 * b * p * q } else { b * p })
}
