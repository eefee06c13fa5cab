//! `causal.independence`: mutual information of the factors of an aggregated Gaussian posterior.
//!
//! C = mean of (m−m̄)(m−m̄)ᵀ + (I−Wᵀ) diag(mean e^ℓ) (I−W),   Σ = share·C + carried + δI,
//! L = Σ_{i<j} aᵢⱼ ½ (ln|Σᵢᵢ| + ln|Σⱼⱼ| − ln|Σ₍ᵢⱼ₎|), or ½ (Σᵢ ln|Σᵢᵢ| − ln|Σ|)
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

use crate::array::{Arr, Out};
use crate::inputs::{inputs, required};
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `causal.independence`.
    pub struct In<'a, S> {
        mu: &'a Arr<S> = Port::var("B,N,K", "posterior means"),
        logvar: &'a Arr<S> = Port::var("B,N,K", "ln of the posterior variance"),
        mask: Option<&'a Arr<S>> =
            Port::var("N,N", "edges through which the noise of parents enters; diagonal ignored"),
        weight: Option<&'a Arr<S>> = Port::var("N,N", "their linear mechanism"),
        among: Option<&'a Arr<S>> =
            Port::fixed("N,N", "weights of the pairs, read above the diagonal; 1 if absent"),
        carried: Option<&'a Arr<S>> =
            Port::fixed("D,D", "weighted covariances of earlier batches, D = N·K"),
    }
}

/// `causal.independence`
pub static SIGNATURE: Signature = Signature {
    name: "causal.independence",
    summary: "mutual information of the factors of an aggregated Gaussian posterior",
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "nats, summed over pairs of factors")],
    intermediates: ports![
        covariance: Port::fixed("D,D", "of this batch alone, without ridge"),
        information: Port::fixed("N,N", "nats between two factors"),
    ],
    settings: &[
        SettingSpec::number("ridge", "1e-4", "added to the diagonal of the covariance"),
        SettingSpec::number("share", "1", "weight of this batch relative to the carried covariance"),
        SettingSpec::choice("form", &["pairs", "total"], "pairs", "sum over pairs, or total correlation"),
    ],
    ..Signature::EMPTY
};

/// Settings of `causal.independence`.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// δ, added to the diagonal of the covariance.
    pub ridge: f64,
    /// Weight of this batch beside those carried.
    pub share: f64,
    /// Total correlation instead of the sum over pairs.
    pub total: bool,
}

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
fn covariance<S: Scalar>(input: &In<'_, S>) -> Result<Vec<S>, String> {
    let In { mu, logvar, mask, weight, .. } = *input;
    let (batch, n, k) = (mu.shape[0], mu.shape[1], mu.shape[2]);
    let d = n * k;
    let mean = |f: &dyn Fn(usize) -> S| (0..batch).fold(S::zero(), |sum, b| sum + f(b * d)) / batch as f64;
    let centre: Vec<S> = (0..d).map(|p| mean(&|b| mu.data[b + p])).collect();
    let noise: Vec<S> = (0..d).map(|p| mean(&|b| logvar.data[b + p].exp())).collect();
    let mut entering = vec![S::zero(); n * n];
    for i in 0..n {
        entering[i * n + i] = S::one();
    }
    if mask.is_some() || weight.is_some() {
        let (mask, weight) = (required("mask", mask)?, required("weight", weight)?);
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
/// When the sizes do not fit, one of `mask` and `weight` is missing, or Σ is not positive definite.
pub fn forward<S: Scalar>(input: &In<'_, S>, settings: Settings, out: &mut Out<'_, S>) -> Result<(), String> {
    let (In { mu, among, carried, .. }, Settings { ridge, share, total }) = (*input, settings);
    let (batch, n, k) = (mu.shape[0], mu.shape[1], mu.shape[2]);
    if batch * n * k == 0 {
        return Err("input mu: expected at least one sample, factor and dimension".to_owned());
    }
    let d = n * k;
    if let Some(carried) = carried.filter(|carried| carried.shape[0] != d) {
        return Err(format!("input carried: expected {d} rows, got {}", carried.shape[0]));
    }
    let c = covariance(input)?;
    let mut sum: Vec<S> = c.iter().map(|c| *c * share).collect();
    if let Some(carried) = carried {
        sum = sum.iter().zip(&carried.data).map(|(s, c)| *s + c.value()).collect();
    }
    for p in 0..d {
        sum[p * d + p] = sum[p * d + p] + ridge;
    }
    let rows = |i: usize| (i * k..(i + 1) * k).collect::<Vec<_>>();
    let alone = (0..n).map(|i| log_det(&sum, d, &rows(i))).collect::<Result<Vec<S>, String>>()?;
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

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or Σ is not positive definite.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let settings = Settings {
        ridge: call.settings.number("ridge"),
        share: call.settings.number("share"),
        total: call.settings.word("form") == "total",
    };
    forward(&In::of(call.arrays)?, settings, out)
}
