//! One-to-one correspondence of blocks and factors: disentanglement, completeness, information gap.
//!
//! **Disentanglement, completeness** (the form of DCI, Eastwood and Williams 2018, with ridge regression
//! instead of boosted trees). The importance is I_ij = Σ over the dimensions of block i of |w|, where w are
//! the ridge weights of the standardised u_j on all standardised dimensions, (C + λI) w = c. With rows and
//! columns of I as distributions,
//!
//! D = Σ_i m_i (1 − H_m(I_i·)),   C = Σ_j m_j (1 − H_n(I_·j)),   m = fraction of the total mass in the row or
//! column,   H_b = entropy to base b.
//!
//! **Information gap** (the form of MIG, Chen et al. 2018): the mean over factors of (the largest − the
//! second largest I(ẑ_i; u_j)) / H(u_j), with the entropy of u_j in [`BINS`] equal bins from its minimum to
//! its maximum. The caller supplies the estimator of information: a function of the values (N, k) of a block,
//! k, and the values (N) of a factor, in nats. Estimates below 0 count as 0.

use super::{Blocks, Factors, correlations, samples, standardised};
use crate::math::dense;
use crate::num::{order, par};
use crate::{Error, Result};

/// Coefficient λ of the ridge regression.
pub const RIDGE: f64 = 1e-3;
/// Number of bins for the entropy of a factor.
pub const BINS: usize = 20;

/// Importance matrix and the metrics derived from it.
#[derive(Clone, Debug, PartialEq)]
pub struct Dci {
    /// Importance I, shape (n, m).
    pub importance: Vec<f64>,
    /// Degree to which each block depends on one factor only; `None` if there is one factor.
    pub disentanglement: Option<f64>,
    /// Degree to which each factor is represented by one block only; `None` if there is one block.
    pub completeness: Option<f64>,
}

/// Returns 1 − the entropy of an unnormalised distribution, to the base of its length.
fn concentration(values: &[f64]) -> f64 {
    let mass = values.iter().fold(0.0, |s, x| s + x);
    if mass == 0.0 {
        return 0.0;
    }
    let entropy = values.iter().filter(|x| **x > 0.0).fold(0.0, |h, x| {
        let p = x / mass;
        h - p * libm::log(p)
    });
    1.0 - entropy / libm::log(values.len() as f64)
}

/// Returns the mean concentration of the rows, weighted by their mass; 0 if the total mass is 0.
fn weighted(rows: &[Vec<f64>]) -> Option<f64> {
    if rows.iter().any(|row| row.len() < 2) {
        return None;
    }
    let mass = |row: &Vec<f64>| row.iter().fold(0.0, |s, x| s + x);
    let total = rows.iter().fold(0.0, |s, row| s + mass(row));
    let sum = rows.iter().fold(0.0, |s, row| s + mass(row) * concentration(row));
    Some(if total > 0.0 { sum / total } else { 0.0 })
}

/// Returns disentanglement and completeness.
///
/// # Errors
/// Returns an error if shapes do not match, if there are fewer than two samples, or if a number is not
/// finite.
pub fn dci(z: &Blocks<'_>, u: &Factors<'_>) -> Result<Dci> {
    samples("disentanglement", z, u)?;
    let (n, k, m, dims) = (z.n, z.k, u.m, z.dims());
    let (rows, factors) = (standardised(z.values, dims), standardised(u.values, m));
    let mut own = correlations(&rows, dims, &rows, dims);
    for d in 0..dims {
        own[d * dims + d] += RIDGE;
    }
    let l = dense::cholesky(&own, dims).map_err(|e| e.of("disentanglement"))?;
    let with = correlations(&rows, dims, &factors, m);
    let mut importance = vec![0.0; n * m];
    for j in 0..m {
        let c: Vec<f64> = (0..dims).map(|d| with[d * m + j]).collect();
        for (d, w) in dense::solve(&l, dims, &c).into_iter().enumerate() {
            importance[d / k * m + j] += w.abs();
        }
    }
    let by_block: Vec<Vec<f64>> = importance.chunks_exact(m).map(<[f64]>::to_vec).collect();
    let by_factor: Vec<Vec<f64>> = (0..m).map(|j| (0..n).map(|i| importance[i * m + j]).collect()).collect();
    Ok(Dci { disentanglement: weighted(&by_block), completeness: weighted(&by_factor), importance })
}

/// Returns the entropy in nats of values in [`BINS`] equal bins; 0 if all are equal.
pub fn binned_entropy(values: &[f64]) -> f64 {
    let low = values.iter().fold(f64::INFINITY, |m, &x| order::min(m, x));
    let high = values.iter().fold(f64::NEG_INFINITY, |m, &x| order::max(m, x));
    if !(high > low) {
        return 0.0;
    }
    let mut counts = [0.0; BINS];
    for x in values {
        let bin = ((x - low) / (high - low) * BINS as f64) as usize;
        counts[order::min(bin, BINS - 1)] += 1.0;
    }
    let total = values.len() as f64;
    counts.iter().filter(|c| **c > 0.0).fold(0.0, |h, c| h - c / total * libm::log(c / total))
}

/// Returns the information gap; with one block, its information over the entropy. Returns `None` if a factor
/// is constant.
///
/// # Errors
/// Returns an error if shapes do not match, if there are fewer than two samples, or if a number or an
/// estimate is not finite.
pub fn information_gap(
    z: &Blocks<'_>,
    u: &Factors<'_>,
    information: impl Fn(&[f64], usize, &[f64]) -> Result<f64> + Sync + Send,
) -> Result<Option<f64>> {
    samples("information gap", z, u)?;
    let (n, m) = (z.n, u.m);
    let table = par::map(n * m, |at| information(&z.block(at / m), z.k, &u.factor(at % m)));
    let table: Vec<f64> = table.into_iter().collect::<Result<_>>()?;
    if !table.iter().all(|x| x.is_finite()) {
        return Err(Error::input("information gap")
            .expected("finite estimates")
            .got("an estimate that is not finite"));
    }
    let mut sum = 0.0;
    for j in 0..m {
        let entropy = binned_entropy(&u.factor(j));
        if entropy == 0.0 {
            return Ok(None);
        }
        let (mut first, mut second) = (0.0, 0.0);
        for i in 0..n {
            let x = table[i * m + j];
            if x > first {
                (first, second) = (x, first);
            } else if x > second {
                second = x;
            }
        }
        sum += (first - second) / entropy;
    }
    Ok(Some(sum / m as f64))
}
