//! Which latent block stands for which true factor.
//!
//! r(ẑ_i, u_j) = √(cᵀ (C + λI)⁻¹ c): the canonical correlation of the k dimensions of block i with the scalar u_j, C their correlations with each
//! other, c with u_j, λ = [`RIDGE`]. The matching is the injection of factors into blocks with the largest Σ_j r, found among all of them in
//! lexicographic order, the first of equals; MCC is the mean of r over the factors under it. A factor for which there is no block left counts
//! 0.
//!
//! # Rounding
//! Columns are standardised, products are left folds over the samples; a dimension without variance correlates with nothing.

use super::{Blocks, Factors, correlations, samples, standardised};
use crate::math::dense;
use crate::math::digraph::Digraph;
use crate::num::order;
use crate::{Error, Result};

/// λ
pub const RIDGE: f64 = 1e-3;
/// Most factors and most blocks.
pub const MOST: usize = 8;

/// The result of matching m factors with n blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct Matching {
    /// (m) block of each factor
    pub block: Vec<Option<usize>>,
    /// (n, m) r of every pair
    pub r: Vec<f64>,
    /// Mean r of the matched pairs, over m.
    pub mcc: f64,
}

/// r of every block with every factor, (n, m).
///
/// # Errors
/// Shapes that do not fit, fewer than two samples, numbers that are not finite.
pub fn canonical(z: &Blocks<'_>, u: &Factors<'_>) -> Result<Vec<f64>> {
    samples("matching", z, u)?;
    let (k, m) = (z.k, u.m);
    let factors = standardised(u.values, m);
    let mut out = Vec::with_capacity(z.n * m);
    for i in 0..z.n {
        let block = standardised(&z.block(i), k);
        let mut own = correlations(&block, k, &block, k);
        for d in 0..k {
            own[d * k + d] += RIDGE;
        }
        let l = dense::cholesky(&own, k).map_err(|e| e.of("matching"))?;
        let with = correlations(&block, k, &factors, m);
        for j in 0..m {
            let c: Vec<f64> = (0..k).map(|d| with[d * m + j]).collect();
            let half = dense::forward(&l, k, &c);
            out.push(half.iter().fold(0.0, |s, x| s + x * x).sqrt());
        }
    }
    Ok(out)
}

/// The best assignment for a table r (n, m).
///
/// # Errors
/// When there are more than [`MOST`] blocks or factors.
pub fn best(r: Vec<f64>, n: usize, m: usize) -> Result<Matching> {
    let size = order::max(n, m);
    if size > MOST || r.len() != n * m {
        return Err(Error::input("matching")
            .expected(format!("at most {MOST} blocks and factors"))
            .got(format!("{n} blocks, {m} factors")));
    }
    let score = |i: usize, j: usize| if i < n && j < m { r[i * m + j] } else { 0.0 };
    let mut chosen: Vec<usize> = (0..size).collect();
    let total = |places: &[usize]| (0..m).fold(0.0, |sum, j| sum + score(places[j], j));
    let (mut most, mut places) = (total(&chosen), chosen.clone());
    while next_permutation(&mut places) {
        let sum = total(&places);
        if sum > most {
            (most, chosen) = (sum, places.clone());
        }
    }
    let block = (0..m).map(|j| Some(chosen[j]).filter(|&i| i < n)).collect();
    Ok(Matching { block, r, mcc: most / m as f64 })
}

/// Matches blocks with factors.
///
/// # Errors
/// As [`canonical`] and [`best`].
pub fn matching(z: &Blocks<'_>, u: &Factors<'_>) -> Result<Matching> {
    best(canonical(z, u)?, z.n, u.m)
}

impl Matching {
    /// A graph over blocks as one over factors; edges of blocks that stand for no factor are gone.
    pub fn relabel(&self, over_blocks: &Digraph) -> Digraph {
        over_blocks.relabelled(&self.block)
    }
}

/// The lexicographically next order; false after the last.
fn next_permutation(x: &mut [usize]) -> bool {
    let Some(i) = (1..x.len()).rev().find(|&i| x[i - 1] < x[i]) else { return false };
    let j = (i..x.len()).rev().find(|&j| x[j] > x[i - 1]).unwrap_or(i);
    x.swap(i - 1, j);
    x[i..].reverse();
    true
}
