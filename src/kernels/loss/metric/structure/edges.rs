//! Comparison of the edges of a graph with those of the true graph.
//!
//! T are the true edges, E the estimated edges, and E⁻ the estimated edges that are not true but whose
//! reverse is:
//!
//! SHD = pairs connected in only one of the graphs + |E⁻|,   TPR = |E ∩ T| / |T|,   FDR = (|E⁻| + |F|) / |E|,
//! FPR = (|E⁻| + |F|) / (n(n−1)/2 − |T|),   nnz = |E|
//!
//! where F are the estimated edges between nodes that the true graph does not connect. As in `count_accuracy`
//! of NOTEARS, a denominator of 0 is replaced by 1. If the true graph has no edges, only SHD and nnz are
//! meaningful, and the rates are absent.

use crate::math::digraph::Digraph;
use crate::num::order;

/// Counts and rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edges {
    /// Structural Hamming distance: the number of edges to add, remove or reverse.
    pub shd: usize,
    /// Number of estimated edges.
    pub nnz: usize,
    /// Rates, if the true graph has edges.
    pub rates: Option<Rates>,
}

/// Fractions of edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Fraction of the true edges that are found with their direction.
    pub tpr: f64,
    /// Fraction of the found edges that are reversed or false.
    pub fdr: f64,
    /// Number of reversed or false edges per pair that the true graph does not connect.
    pub fpr: f64,
}

/// Compares an estimated graph with the true graph.
///
/// # Panics
/// Panics if the graphs have different numbers of nodes.
pub fn compare(truth: &Digraph, estimate: &Digraph) -> Edges {
    let n = truth.n();
    assert_eq!(estimate.n(), n, "both graphs have the same nodes");
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
