//! Structural intervention distance (Peters and Bühlmann 2015): how many effects of interventions a graph gets wrong.
//!
//! SID = number of ordered pairs (i, j), i ≠ j, for which the distribution of j under do(i) is wrong when it is computed by adjusting for the
//! parents P of i in the estimate. The pair is right if and only if
//!
//! * j ∈ P and j is no descendant of i in the truth (the estimate says: no effect), or
//! * j ∉ P, and P holds no node that lies on a directed path i ⇝ j (i itself apart) nor a descendant of one, and P d-separates i from j in the
//!   truth after the first edge of every directed path i ⇝ j was removed.
//!
//! From 0 to n(n−1). It is 0 exactly when the estimate contains the truth. It is no distance: SID(G, H) ≠ SID(H, G) in general.

use crate::math::digraph::{Digraph, nodes};

/// Whether adjusting for the parents of `i` in the estimate gives the effect of do(i) on `j`.
///
/// # Panics
/// When i = j or the graphs have different numbers of nodes.
pub fn is_right(truth: &Digraph, estimate: &Digraph, i: usize, j: usize) -> bool {
    assert!(i != j && truth.n() == estimate.n(), "two nodes of graphs over the same nodes");
    let given = estimate.parents(i);
    if given >> j & 1 == 1 {
        return !truth.reaches(i, j);
    }
    let first_steps = nodes(truth.children(i)).filter(|&c| c == j || truth.reaches(c, j));
    // nodes on directed paths i ⇝ j other than i: descendants of i that are j or lead to it
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

/// The distance of an estimate from the truth.
///
/// # Panics
/// When the graphs have different numbers of nodes.
pub fn distance(truth: &Digraph, estimate: &Digraph) -> usize {
    let n = truth.n();
    let pairs = (0..n * n).map(|at| (at / n, at % n)).filter(|(i, j)| i != j);
    pairs.filter(|&(i, j)| !is_right(truth, estimate, i, j)).count()
}
