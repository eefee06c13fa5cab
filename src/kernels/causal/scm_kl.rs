//! `causal.scm_kl`: divergence of a posterior over factors from a structural causal model with standard
//! normal causes.
//!
//! sampled   KL = (1/B) Σ_b Σⱼ κⱼ ½ Σ_c (ε² − 1 − ℓ)
//! linear    KL = (1/B) Σ_b Σⱼ κⱼ ½ Σ_c ((μⱼ − Σᵢ Wᵢⱼ μᵢ)² + e^ℓⱼ + Σᵢ Wᵢⱼ² e^ℓᵢ − 1 − ℓⱼ),
//! W = Ã∘Ω without its diagonal
//!
//! Source: the change of variables ε = u − g(Ã∘u) of DAG-GNN (Yu et al. 2019), whose determinant is 1 on an
//! acyclic graph; on other graphs ln|det| is omitted. `sampled` uses the cause ε of one draw u = μ +
//! e^{ℓ/2}η: its expectation over η is the divergence. `linear` is that expectation in closed form. κ = 0
//! omits a factor whose mechanism was replaced by an intervention.
//!
//! | symbol | argument | shape     | range |
//! |--------|----------|-----------|-------|
//! | ε      | `eps`    | (B, n, k) | finite; causes as returned by abduction |
//! | μ      | `mu`     | (B, n, k) | finite; means of the factors |
//! | ℓ      | `logvar` | (B, n, k) | finite, at most 700; ln of the variance of the factors |
//! | κ      | `kept`   | (B, n)    | 0 or 1; absent = 1 |
//! | Ã, Ω   | `mask`, `weight` | (n, n) | edge i → j |
//! | KL     | `value`  | ()        | nats |
//!
//! # Rounding
//! Terms are ½·((ε² − 1) − ℓ), and ½·((r² + (expm1 ℓ − ℓ)) + s) with r = μⱼ − Σᵢ Wᵢⱼμᵢ and s = Σᵢ
//! (Wᵢⱼ·Wᵢⱼ)·e^ℓᵢ, left folds over i from +0. A left fold over all kept entries from +0 is followed by one
//! division.
//!
//! # Kinks and domain
//! The function is smooth. The operator list refuses an empty batch and an ℓ whose exponential overflows. The
//! sampled value may be negative.
//!
//! # Adjoint
//! With v = KL̄/B and sums over kept factors only:
//! sampled   ε̄ += vε,   ℓ̄ −= ½v
//! linear    μ̄ⱼ += vrⱼ,   μ̄ᵢ −= vWᵢⱼrⱼ,   ℓ̄ⱼ += ½v expm1 ℓⱼ,   ℓ̄ᵢ += ½vWᵢⱼ²e^ℓᵢ,
//! W̄ᵢⱼ += v Σ_c (Wᵢⱼe^ℓᵢ − μᵢrⱼ)
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::scm_kl::{Sampled, sampled};
//! let x = Sampled { eps: &[2.0, 3.0], logvar: &[0.0, -1.0], kept: Some(&[1.0, 0.0]), batch: 1, n: 2, k: 1 };
//! assert_eq!(sampled(&x), 1.5);
//! ```

use crate::num::elem::f64::{exp, expm1};

/// Inputs of the sampled form.
#[derive(Clone, Copy, Debug)]
pub struct Sampled<'a> {
    /// Shape (B, n, k).
    pub eps: &'a [f64],
    /// Shape (B, n, k).
    pub logvar: &'a [f64],
    /// Factors that count, shape (B, n), 0 or 1; all factors count if it is absent.
    pub kept: Option<&'a [f64]>,
    /// Number of samples B.
    pub batch: usize,
    /// Number of factors n.
    pub n: usize,
    /// Number of dimensions per factor, k.
    pub k: usize,
}

/// Gradients of the sampled form; the adjoint adds to them.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledBar {
    /// Shape (B, n, k).
    pub eps: Vec<f64>,
    /// Shape (B, n, k).
    pub logvar: Vec<f64>,
}

impl SampledBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &Sampled<'_>) -> Self {
        Self { eps: vec![0.0; x.eps.len()], logvar: vec![0.0; x.logvar.len()] }
    }
}

/// Inputs of the linear form.
#[derive(Clone, Copy, Debug)]
pub struct Linear<'a> {
    /// Shape (B, n, k).
    pub mu: &'a [f64],
    /// Shape (B, n, k).
    pub logvar: &'a [f64],
    /// Shape (n, n).
    pub mask: &'a [f64],
    /// Shape (n, n).
    pub weight: &'a [f64],
    /// Factors that count, shape (B, n), 0 or 1; all factors count if it is absent.
    pub kept: Option<&'a [f64]>,
    /// Number of samples B.
    pub batch: usize,
    /// Number of factors n.
    pub n: usize,
    /// Number of dimensions per factor, k.
    pub k: usize,
}

/// Gradients of the linear form; the adjoint adds to them.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearBar {
    /// Shape (B, n, k).
    pub mu: Vec<f64>,
    /// Shape (B, n, k).
    pub logvar: Vec<f64>,
    /// Shape (n, n).
    pub mask: Vec<f64>,
    /// Shape (n, n).
    pub weight: Vec<f64>,
}

impl LinearBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &Linear<'_>) -> Self {
        let zeros = |x: &[f64]| vec![0.0; x.len()];
        Self { mu: zeros(x.mu), logvar: zeros(x.logvar), mask: zeros(x.mask), weight: zeros(x.weight) }
    }
}

/// Whether factor `row` (counted over all samples in order) is kept.
fn counts(kept: Option<&[f64]>, row: usize) -> bool {
    kept.is_none_or(|kept| kept[row] != 0.0)
}

fn check(a: &[f64], b: &[f64], kept: Option<&[f64]>, [batch, n, k]: [usize; 3]) {
    assert!(a.len() == batch * n * k && b.len() == a.len(), "arrays are (B, n, k)");
    assert!(kept.is_none_or(|kept| kept.len() == batch * n), "kept is (B, n)");
}

/// Returns the KL divergence of the sampled form.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn sampled(x: &Sampled<'_>) -> f64 {
    check(x.eps, x.logvar, x.kept, [x.batch, x.n, x.k]);
    let all = x.eps.iter().zip(x.logvar).enumerate().filter(|(at, _)| counts(x.kept, at / x.k));
    all.fold(0.0, |sum, (_, (e, l))| sum + 0.5 * ((e * e - 1.0) - l)) / x.batch as f64
}

/// Adds the gradients of [`sampled`] for the cotangent `value_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn sampled_adjoint(x: &Sampled<'_>, value_bar: f64, bar: &mut SampledBar) {
    check(x.eps, x.logvar, x.kept, [x.batch, x.n, x.k]);
    check(&bar.eps, &bar.logvar, x.kept, [x.batch, x.n, x.k]);
    let share = value_bar / x.batch as f64;
    for at in (0..x.eps.len()).filter(|at| counts(x.kept, at / x.k)) {
        bar.eps[at] += share * x.eps[at];
        bar.logvar[at] -= 0.5 * share;
    }
}

/// Returns W(i,j) = Ã(i,j)·Ω(i,j), with 0 on the diagonal.
fn edges(x: &Linear<'_>) -> Vec<f64> {
    let n = x.n;
    assert!(x.mask.len() == n * n && x.weight.len() == n * n, "mask and weight are (n, n)");
    (0..n * n).map(|at| if at / n == at % n { 0.0 } else { x.mask[at] * x.weight[at] }).collect()
}

/// Returns r = μⱼ − Σᵢ Wᵢⱼ μᵢ of one entry: sample b, factor j, dimension c.
fn residual(x: &Linear<'_>, w: &[f64], [b, j, c]: [usize; 3]) -> f64 {
    let mu = &x.mu[b * x.n * x.k..];
    mu[j * x.k + c] - (0..x.n).fold(0.0, |sum, i| sum + w[i * x.n + j] * mu[i * x.k + c])
}

/// Returns the KL divergence of the linear form.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn linear(x: &Linear<'_>) -> f64 {
    check(x.mu, x.logvar, x.kept, [x.batch, x.n, x.k]);
    let (n, k, w) = (x.n, x.k, edges(x));
    let mut sum = 0.0;
    for row in (0..x.batch * n).filter(|row| counts(x.kept, *row)) {
        let (b, j) = (row / n, row % n);
        for c in 0..k {
            let r = residual(x, &w, [b, j, c]);
            let l = x.logvar[row * k + c];
            let carried = |i: usize| w[i * n + j] * w[i * n + j] * exp(x.logvar[(b * n + i) * k + c]);
            let s = (0..n).fold(0.0, |sum, i| sum + carried(i));
            sum += 0.5 * ((r * r + (expm1(l) - l)) + s);
        }
    }
    sum / x.batch as f64
}

/// Adds the gradients of [`linear`] for the cotangent `value_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn linear_adjoint(x: &Linear<'_>, value_bar: f64, bar: &mut LinearBar) {
    check(x.mu, x.logvar, x.kept, [x.batch, x.n, x.k]);
    check(&bar.mu, &bar.logvar, x.kept, [x.batch, x.n, x.k]);
    let (n, k, w) = (x.n, x.k, edges(x));
    assert!(bar.mask.len() == n * n && bar.weight.len() == n * n, "mask and weight are (n, n)");
    let share = value_bar / x.batch as f64;
    for row in (0..x.batch * n).filter(|row| counts(x.kept, *row)) {
        let (b, j) = (row / n, row % n);
        for c in 0..k {
            let r = residual(x, &w, [b, j, c]);
            bar.mu[row * k + c] += share * r;
            bar.logvar[row * k + c] += 0.5 * share * expm1(x.logvar[row * k + c]);
            for i in (0..n).filter(|i| *i != j) {
                let (edge, at) = (i * n + j, (b * n + i) * k + c);
                let (w, e) = (w[edge], exp(x.logvar[at]));
                bar.mu[at] -= share * w * r;
                bar.logvar[at] += 0.5 * share * w * w * e;
                let w_bar = share * (w * e - x.mu[at] * r);
                bar.mask[edge] += x.weight[edge] * w_bar;
                bar.weight[edge] += x.mask[edge] * w_bar;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::rng::Rng;

    fn normals(draw: u16, len: usize) -> Vec<f64> {
        (0..len).map(|i| f64::from(Rng::new(11).normal_f32(i as u64, 0, 0x7e57, draw))).collect()
    }

    /// ½ [‖(I−Wᵀ)μ‖² + Σᵢ Σ_c e^ℓ (1 + Σⱼ Wᵢⱼ²) − d − Σℓ] as it is printed, and the mean of the sampled form
    /// over draws.
    #[test]
    fn the_linear_form_is_the_printed_one_and_the_mean_of_the_sampled_one() {
        let (n, k, d) = (3, 2, 6);
        let (mu, logvar) = (normals(0, d), normals(1, d));
        let (mask, weight) = ([0.0, 0.7, 0.9, 0.0, 0.0, 0.4, 0.0, 0.0, 0.0], normals(2, n * n));
        let x = Linear { mu: &mu, logvar: &logvar, mask: &mask, weight: &weight, kept: None, batch: 1, n, k };
        let w = edges(&x);
        let mut printed = -(d as f64);
        for (j, c) in (0..d).map(|at| (at / k, at % k)) {
            let r = residual(&x, &w, [0, j, c]);
            let out = (0..n).fold(1.0, |sum, i| sum + w[j * n + i] * w[j * n + i]);
            printed += r * r + exp(logvar[j * k + c]) * out - logvar[j * k + c];
        }
        let closed = linear(&x);
        assert!((closed - 0.5 * printed).abs() < 1e-13, "{closed} for {}", 0.5 * printed);
        let draws = 20_000;
        let eta = normals(3, draws * d);
        let u: Vec<f64> = (0..draws * d).map(|at| mu[at % d] + exp(0.5 * logvar[at % d]) * eta[at]).collect();
        let parents = |at: usize| {
            let (b, j, c) = (at / d, at % d / k, at % k);
            (0..n).fold(0.0, |sum, i| sum + w[i * n + j] * u[b * d + i * k + c])
        };
        let eps: Vec<f64> = (0..draws * d).map(|at| u[at] - parents(at)).collect();
        let mean =
            sampled(&Sampled { eps: &eps, logvar: &logvar.repeat(draws), kept: None, batch: draws, n, k });
        assert!((mean / closed - 1.0).abs() < 0.02, "{mean} for {closed}");
    }
}
