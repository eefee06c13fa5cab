//! Matching of latent blocks with true factors.
//!
//! r(ẑ_i, u_j) = √(cᵀ (C + λI)⁻¹ c) is the canonical correlation of the k dimensions of block i with the
//! scalar u_j, where C are their mutual correlations, c those with u_j, and λ = [`RIDGE`]. The matching is
//! the injection of factors into blocks with the largest Σ_j r, found by exhaustive search in lexicographic
//! order; of equal ones the first is taken. MCC is the mean of r over the matched factors. A factor without a
//! block counts 0.
//!
//! # Rounding
//! Columns are standardised, and products are left folds over the samples; a dimension without variance has
//! correlation 0 with all others.

use super::{Blocks, Factors, correlations, samples, standardised};
use crate::math::dense;
use crate::math::digraph::Digraph;
use crate::num::order;
use crate::{Error, Result};

/// Ridge λ that is added to the correlation matrix.
pub const RIDGE: f64 = 1e-3;
/// Largest number of factors and of blocks.
pub const MOST: usize = 8;

/// Result of matching m factors with n blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct Matching {
    /// Block of each factor, shape (m).
    pub block: Vec<Option<usize>>,
    /// Correlation r of every pair, shape (n, m).
    pub r: Vec<f64>,
    /// Sum of r over the matched pairs, divided by m.
    pub mcc: f64,
}

/// Returns r of every block with every factor, shape (n, m).
///
/// # Errors
/// Returns an error if shapes do not match, if there are fewer than two samples, or if a number is not
/// finite.
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

/// Returns the best assignment for a table r (n, m).
///
/// # Errors
/// Returns an error if there are more than [`MOST`] blocks or factors.
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
/// Returns an error under the conditions of [`canonical`] and [`best`].
pub fn matching(z: &Blocks<'_>, u: &Factors<'_>) -> Result<Matching> {
    best(canonical(z, u)?, z.n, u.m)
}

impl Matching {
    /// Converts a graph over blocks to one over factors; edges of unmatched blocks are dropped.
    pub fn relabel(&self, over_blocks: &Digraph) -> Digraph {
        over_blocks.relabelled(&self.block)
    }
}

/// Advances to the lexicographically next permutation; returns false after the last.
fn next_permutation(x: &mut [usize]) -> bool {
    let Some(i) = (1..x.len()).rev().find(|&i| x[i - 1] < x[i]) else { return false };
    let j = (i..x.len()).rev().find(|&j| x[j] > x[i - 1]).unwrap_or(i);
    x.swap(i - 1, j);
    x[i..].reverse();
    true
}
