//! Structural intervention distance (Peters and Bühlmann 2015): the number of intervention effects that a
//! graph predicts wrongly.
//!
//! SID is the number of ordered pairs (i, j), i ≠ j, for which the distribution of j under do(i) is wrong if
//! it is computed by adjusting for the parents P of i in the estimate. The pair is right if and only if
//!
//! * j ∈ P and j is not a descendant of i in the true graph (the estimate predicts no effect), or
//! * j ∉ P, P contains neither a node on a directed path i ⇝ j (except i) nor a descendant of one, and P
//!   d-separates i from j in the true graph after removal of the first edge of every directed path i ⇝ j.
//!
//! SID is between 0 and n(n−1). It is 0 exactly if the estimate contains the true graph. It is not symmetric:
//! in general SID(G, H) ≠ SID(H, G).

use crate::math::digraph::{Digraph, nodes};

/// Whether adjusting for the parents of `i` in the estimate gives the effect of do(i) on `j`.
///
/// # Panics
/// Panics if i = j, or if the graphs have different numbers of nodes.
pub fn is_right(truth: &Digraph, estimate: &Digraph, i: usize, j: usize) -> bool {
    assert!(i != j && truth.n() == estimate.n(), "i and j differ, and both graphs have the same nodes");
    let given = estimate.parents(i);
    if given >> j & 1 == 1 {
        return !truth.reaches(i, j);
    }
    let first_steps = nodes(truth.children(i)).filter(|&c| c == j || truth.reaches(c, j));
    // Nodes on directed paths i ⇝ j other than i: descendants of i that are j or lead to it.
    let on_paths = nodes(truth.descendants(i)).filter(|&w| w == j || truth.reaches(w, j));
    let forbidden = on_paths.fold(0, |set, w| set | 1 << w | truth.descendants(w));
    if given & forbidden != 0 {
        return false;
    }
    let mut cut = truth.clone();
    for c in first_steps {
        cut.set(i, c, false);
    }
    cut.separated(i, j, given)
}

/// Returns the distance of an estimate from the true graph.
///
/// # Panics
/// Panics if the graphs have different numbers of nodes.
pub fn distance(truth: &Digraph, estimate: &Digraph) -> usize {
    let n = truth.n();
    let pairs = (0..n * n).map(|at| (at / n, at % n)).filter(|(i, j)| i != j);
    pairs.filter(|&(i, j)| !is_right(truth, estimate, i, j)).count()
}
