//! Evaluation of a learned structure against the true one, in f64.
//!
//! ```text
//! latent blocks, true factors ─ matching ──► the block of each factor, MCC
//! learned graph ─ relabelled ──► edges: SHD, TPR, FDR, FPR, nnz
//!                            └─► sid:   SID
//! blocks before and after ───── intervention: target accuracy, locality
//! blocks, factors ───────────── blocks: disentanglement, completeness, information gap
//! ```
//!
//! If true factors depend on each other, metrics that assume independence cannot reach 1 even for a perfect
//! model. To obtain the reachable value, evaluate the metric with the factors themselves as blocks, and
//! report it next to the model's value.

pub mod blocks;
pub mod edges;
pub mod intervention;
pub mod matching;
pub mod sid;

use crate::{Error, Result};

/// Latent blocks of N samples.
#[derive(Clone, Copy, Debug)]
pub struct Blocks<'a> {
    /// Shape (N, n, k).
    pub values: &'a [f64],
    /// Number of blocks, n.
    pub n: usize,
    /// Number of dimensions per block, k.
    pub k: usize,
}

/// True factors of N samples.
#[derive(Clone, Copy, Debug)]
pub struct Factors<'a> {
    /// Shape (N, m).
    pub values: &'a [f64],
    /// Number of factors, m.
    pub m: usize,
}

impl Blocks<'_> {
    /// Returns the number of samples, N.
    pub fn count(&self) -> usize {
        self.values.len().checked_div(self.n * self.k).unwrap_or(0)
    }

    /// Returns the number of dimensions of all blocks, n·k.
    pub fn dims(&self) -> usize {
        self.n * self.k
    }

    /// Returns the values (N, k) of block `i`.
    pub fn block(&self, i: usize) -> Vec<f64> {
        let (dims, k) = (self.dims(), self.k);
        self.values.chunks_exact(dims).flat_map(|row| &row[i * k..(i + 1) * k]).copied().collect()
    }
}

impl Factors<'_> {
    /// Returns the values (N) of factor `j`.
    pub fn factor(&self, j: usize) -> Vec<f64> {
        self.values.chunks_exact(self.m).map(|row| row[j]).collect()
    }
}

/// Checks both shapes and returns the number of samples.
fn samples(what: &str, z: &Blocks<'_>, u: &Factors<'_>) -> Result<usize> {
    let count = z.count();
    let fits = z.n > 0 && z.k > 0 && u.m > 0 && z.values.len() == count * z.dims();
    if !(fits && u.values.len() == count * u.m) {
        return Err(Error::input(what)
            .expected(format!("blocks (N, {}, {}) and factors (N, {}) with the same N", z.n, z.k, u.m))
            .got(format!("{} and {} values", z.values.len(), u.values.len())));
    }
    if count < 2 {
        return Err(Error::input(what).expected("at least two samples").got(count.to_string()));
    }
    if !z.values.iter().chain(u.values).all(|x| x.is_finite()) {
        return Err(Error::input(what)
            .expected("finite blocks and factors")
            .got("a number that is not finite"));
    }
    Ok(count)
}

/// Standardises the columns of rows of `width` values to mean 0 and variance 1 (1/N); a column without
/// variance becomes zeros.
///
/// # Rounding
/// Means and variances are left folds over the samples.
fn standardised(values: &[f64], width: usize) -> Vec<f64> {
    let count = (values.len() / width) as f64;
    let mut out = values.to_vec();
    for c in 0..width {
        let column = |values: &[f64]| values.iter().skip(c).step_by(width).copied().collect::<Vec<f64>>();
        let mean = column(values).iter().fold(0.0, |s, x| s + x) / count;
        let variance = column(values).iter().fold(0.0, |s, x| s + (x - mean) * (x - mean)) / count;
        // Rounding can leave a small variance in a constant column.
        let least = 1e-24 * (1.0 + mean * mean);
        let scale = if variance > least { 1.0 / variance.sqrt() } else { 0.0 };
        for x in out.iter_mut().skip(c).step_by(width) {
            *x = (*x - mean) * scale;
        }
    }
    out
}

/// Returns the mean products (a, b) of the columns of two standardised arrays with rows of `a` and `b`
/// values.
fn correlations(x: &[f64], a: usize, y: &[f64], b: usize) -> Vec<f64> {
    let mut sums = vec![0.0; a * b];
    for (x, y) in x.chunks_exact(a).zip(y.chunks_exact(b)) {
        for (i, x) in x.iter().enumerate() {
            for (sum, y) in sums[i * b..].iter_mut().zip(y) {
                *sum += x * y;
            }
        }
    }
    let count = (x.len() / a) as f64;
    sums.iter_mut().for_each(|s| *s /= count);
    sums
}
