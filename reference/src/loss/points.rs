//! Distance of decoded points from their targets.
//!
//! ordered:  L = 1/(B·P) · Σ ( ‖Δxyz‖²/σ_x² + ‖Δrgb‖²/σ_c² )
//!
//! chamfer:  the mean over x of the smallest such square to y, plus the mean over y of the smallest to x
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x, y | `x`, `y` | (B, P, D), (B, Q, E), D = 3 or 6, E = D or 3 (no colour) |
//! | σ_x, σ_c | settings `sigma_x`, `sigma_c` | () |
//! | | plan `nearest_x`, `nearest_y` | (B, P), (B, Q) |
//! | L | `value` | () |
//!
//! # Kinks and domain
//! Of equally near neighbours the lowest index; the derivative is that on the plan.

use crate::array::{ANY, Arr, Named, Out, expect};
use crate::scalar::Scalar;
use crate::settings::Settings;

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

/// Rows of `to` nearest to the rows of `from`, or those of the plan.
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
    // Reverse mode: what was computed to decide leaves no trace.
    S::sweep();
    Ok(found)
}

/// The twin of `loss.points`.
///
/// # Errors
/// When an input, a setting or the plan is not what it should be.
pub fn forward<S: Scalar>(
    arrays: &Named<S>,
    settings: &Settings<'_>,
    plan: Option<&Named<f64>>,
    out: &mut Out<S>,
) -> Result<(), String> {
    let x = expect(arrays, "x", &[ANY, ANY, ANY])?;
    let [batch, p, d] = [0, 1, 2].map(|axis| x.shape[axis]);
    let y = expect(arrays, "y", &[batch, ANY, ANY])?;
    let [q, e] = [1, 2].map(|axis| y.shape[axis]);
    let sigmas = [settings.number("sigma_x", 0.05)?, settings.number("sigma_c", 0.2)?];
    if !sigmas.iter().all(|&sigma| sigma > 0.0) {
        return Err(format!("settings sigma_x, sigma_c: expected positive numbers, got {sigmas:?}"));
    }
    if !matches!([d, e], [3, 3] | [6, 3] | [6, 6]) || batch * p * q == 0 {
        return Err(format!(
            "inputs x, y: expected points of 3 or 6 numbers, targets of as many or of 3, got {:?}, {:?}",
            x.shape, y.shape
        ));
    }
    let value = out.array("value", &[]);
    let sum = |out: &mut Out<S>, i: usize, k: usize, n: usize| {
        let term = square(&x.data[i * d..][..d], &y.data[k * e..][..e], sigmas) / n as f64;
        out.add(value, 0, term, 1.0);
        out.flush();
    };
    match settings.text("mode", "ordered")?.as_str() {
        "ordered" if p == q => (0..batch * p).for_each(|i| sum(out, i, i, batch * p)),
        "ordered" => return Err(format!("input y: expected {p} points as in x, got {q}")),
        "chamfer" => {
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
        }
        other => return Err(format!("setting mode: expected ordered or chamfer, got {other}")),
    }
    Ok(())
}
