//! C = mean of (m−m̄)(m−m̄)ᵀ + (I−Wᵀ) diag(mean e^ℓ) (I−W), Σ = share·C + carried + δI, L = Σ_{i<j} aᵢⱼ ½ (ln|Σᵢᵢ| + ln|Σⱼⱼ| − ln|Σ₍ᵢⱼ₎|),
//! or ½ (Σᵢ ln|Σᵢᵢ| − ln|Σ|).
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | m, ℓ | `mu`, `logvar` | (B, n, k) |
//! | W = Ã∘Ω, zero diagonal | `mask`, `weight` | (n, n), both or none |
//! | a | `among` | (n, n), fixed |
//! | | `carried` | (n·k, n·k), fixed |
//! | L | `value` | () |
//!
//! # Rounding
//! Left folds; determinants by elimination without pivoting.

use crate::array::{ANY, Arr, Named, Out, expect};
use crate::scalar::Scalar;
use crate::settings::Settings;

/// ln det of the rows and columns `at` of a (d, d) matrix.
fn log_det<S: Scalar>(matrix: &[S], d: usize, at: &[usize]) -> Result<S, String> {
    let size = at.len();
    let mut a: Vec<S> = (0..size * size).map(|x| matrix[at[x / size] * d + at[x % size]]).collect();
    let mut sum = S::zero();
    for c in 0..size {
        let pivot = a[c * size + c];
        if !(pivot.value() > 0.0) {
            return Err(format!("row {}: the covariance is not positive definite", at[c]));
        }
        sum = sum + pivot.ln();
        for r in c + 1..size {
            let factor = a[r * size + c] / pivot;
            for x in c..size {
                a[r * size + x] = a[r * size + x] - factor * a[c * size + x];
            }
        }
    }
    Ok(sum)
}

/// C (d, d).
fn covariance<S: Scalar>(arrays: &Named<S>, mu: &Arr<S>, logvar: &Arr<S>) -> Result<Vec<S>, String> {
    let (batch, n, k) = (mu.shape[0], mu.shape[1], mu.shape[2]);
    let d = n * k;
    let mean = |f: &dyn Fn(usize) -> S| (0..batch).fold(S::zero(), |sum, b| sum + f(b * d)) / batch as f64;
    let centre: Vec<S> = (0..d).map(|p| mean(&|b| mu.data[b + p])).collect();
    let noise: Vec<S> = (0..d).map(|p| mean(&|b| logvar.data[b + p].exp())).collect();
    let mut entering = vec![S::zero(); n * n];
    for i in 0..n {
        entering[i * n + i] = S::one();
    }
    if arrays.contains_key("mask") || arrays.contains_key("weight") {
        let (mask, weight) = (expect(arrays, "mask", &[n, n])?, expect(arrays, "weight", &[n, n])?);
        for (i, j) in (0..n * n).map(|at| (at / n, at % n)).filter(|(i, j)| i != j) {
            entering[j * n + i] = -(mask.data[i * n + j] * weight.data[i * n + j]);
        }
    }
    let mut c = vec![S::zero(); d * d];
    for p in 0..d {
        for q in 0..d {
            c[p * d + q] = mean(&|b| (mu.data[b + p] - centre[p]) * (mu.data[b + q] - centre[q]));
            if p % k == q % k {
                for i in 0..n {
                    let both = entering[p / k * n + i] * entering[q / k * n + i];
                    c[p * d + q] = c[p * d + q] + both * noise[i * k + p % k];
                }
            }
        }
    }
    Ok(c)
}

/// The twin of `causal.independence`.
///
/// # Errors
/// When an input is missing or shaped otherwise, a setting is not what it should be, or Σ is not positive definite.
pub fn forward<S: Scalar>(
    arrays: &Named<S>,
    settings: &Settings<'_>,
    out: &mut Out<S>,
) -> Result<(), String> {
    let mu = expect(arrays, "mu", &[ANY, ANY, ANY])?;
    let logvar = expect(arrays, "logvar", &mu.shape)?;
    let (batch, n, k) = (mu.shape[0], mu.shape[1], mu.shape[2]);
    if batch * n * k == 0 {
        return Err("input mu: expected at least one sample, factor and number".to_owned());
    }
    let d = n * k;
    let (ridge, share) = (settings.number("ridge", 1e-4)?, settings.number("share", 1.0)?);
    let c = covariance(arrays, mu, logvar)?;
    let mut sum: Vec<S> = c.iter().map(|c| *c * share).collect();
    if arrays.contains_key("carried") {
        let carried = expect(arrays, "carried", &[d, d])?;
        sum = sum.iter().zip(&carried.data).map(|(s, c)| *s + c.value()).collect();
    }
    for p in 0..d {
        sum[p * d + p] = sum[p * d + p] + ridge;
    }
    let among = if arrays.contains_key("among") { Some(expect(arrays, "among", &[n, n])?) } else { None };
    let rows = |i: usize| (i * k..(i + 1) * k).collect::<Vec<_>>();
    let alone = (0..n).map(|i| log_det(&sum, d, &rows(i))).collect::<Result<Vec<S>, String>>()?;
    let total = settings.text("form", "pairs")? == "total";
    let mut value = S::zero();
    let mut information = vec![0.0; n * n];
    for i in 0..n {
        for j in i + 1..n {
            let nats = (alone[i] + alone[j] - log_det(&sum, d, &[rows(i), rows(j)].concat())?) * 0.5;
            information[i * n + j] = nats.value();
            information[j * n + i] = nats.value();
            if !total {
                value = value + nats * among.map_or(1.0, |among| among.data[i * n + j].value());
            }
        }
    }
    if total {
        let all = log_det(&sum, d, &(0..d).collect::<Vec<_>>())?;
        value = (alone.iter().fold(S::zero(), |sum, x| sum + *x) - all) * 0.5;
    }
    let slot = out.array("value", &[]);
    out.put(slot, 0, value);
    let slot = out.array("covariance", &[d, d]);
    c.iter().enumerate().for_each(|(at, c)| out.put(slot, at, S::from_f64(c.value())));
    let slot = out.array("information", &[n, n]);
    information.iter().enumerate().for_each(|(at, x)| out.put(slot, at, S::from_f64(*x)));
    out.flush();
    Ok(())
}
