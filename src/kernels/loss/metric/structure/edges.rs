//! Edges of a graph against those of the truth.
//!
//! With T the true and E the estimated edges, and E⁻ the estimated edges whose reverse is true and which are not themselves true:
//!
//! SHD = pairs joined in one graph alone + |E⁻|,   TPR = |E ∩ T| / |T|,   FDR = (|E⁻| + |F|) / |E|,   FPR = (|E⁻| + |F|) / (n(n−1)/2 − |T|),   nnz = |E|
//!
//! where F are the estimated edges between nodes that the truth does not join. (`count_accuracy` of NOTEARS; a denominator of 0 counts as 1
//! there and here.) Against a truth without edges only SHD and nnz mean something; the rates are absent.

use crate::math::digraph::Digraph;
use crate::num::order;

/// Counts and rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edges {
    /// Structural Hamming distance: edges to add, remove or turn, each 1.
    pub shd: usize,
    /// Number of estimated edges.
    pub nnz: usize,
    /// Rates, where the truth has edges.
    pub rates: Option<Rates>,
}

/// Fractions of edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// True edges that were found, in their direction.
    pub tpr: f64,
    /// Found edges that are reversed or false.
    pub fdr: f64,
    /// Reversed or false edges per pair that the truth does not join.
    pub fpr: f64,
}

/// Compares an estimate with the truth.
///
/// # Panics
/// When the graphs have different numbers of nodes.
pub fn compare(truth: &Digraph, estimate: &Digraph) -> Edges {
    let n = truth.n();
    assert_eq!(estimate.n(), n, "graphs over the same nodes");
    let found = estimate.edges();
    let right = found.iter().filter(|&&(i, j)| truth.has(i, j)).count();
    let reversed = found.iter().filter(|&&(i, j)| !truth.has(i, j) && truth.has(j, i)).count();
    let wrong = found.len() - right;
    let joined = |g: &Digraph, i: usize, j: usize| g.has(i, j) || g.has(j, i);
    let pairs = (0..n).flat_map(|i| (0..i).map(move |j| (i, j)));
    let alone = pairs.filter(|&(i, j)| joined(truth, i, j) != joined(estimate, i, j)).count();
    let edges = truth.count();
    let share = |part: usize, whole: usize| part as f64 / order::max(whole, 1) as f64;
    let rates = (edges > 0).then(|| Rates {
        tpr: share(right, edges),
        fdr: share(wrong, found.len()),
        fpr: share(wrong, (n * (n - 1) / 2).saturating_sub(edges)),
    });
    Edges { shd: alone + reversed, nnz: found.len(), rates }
}
