//! Local search over acyclic graphs, used as the last step after a relaxation.
//!
//! Every edge that can be added, removed or reversed without creating a cycle is tried, and the change with
//! the largest gain of the score is applied; this repeats until no change gains. Changes are tried in the
//! order of (i, j): for a pair with an edge remove, then reverse, otherwise add; the first of equals is
//! taken.

use super::oracle::Best;
use super::score::Table;
use crate::math::digraph::Digraph;

/// Climbs from `start`; returns the fixed point and the number of changes.
///
/// # Panics
/// If `start` has a cycle or another number of nodes than the table.
pub fn climb(table: &Table, start: &Digraph) -> (Best, usize) {
    assert!(start.n() == table.n() && start.is_acyclic(), "an acyclic graph over the nodes of the table");
    let n = table.n();
    let mut best = Best { graph: start.clone(), score: table.score(start) };
    let mut changes = 0;
    loop {
        let mut next: Option<Best> = None;
        let mut consider = |graph: Digraph| {
            let score = table.score(&graph);
            if score > next.as_ref().map_or(best.score, |b| b.score) && graph.is_acyclic() {
                next = Some(Best { graph, score });
            }
        };
        for (i, j) in (0..n * n).map(|at| (at / n, at % n)).filter(|(i, j)| i != j) {
            let mut changed = best.graph.clone();
            if best.graph.has(i, j) {
                changed.set(i, j, false);
                consider(changed.clone());
                changed.set(j, i, true);
                consider(changed);
            } else if !best.graph.has(j, i) {
                changed.set(i, j, true);
                consider(changed);
            }
        }
        match next {
            Some(better) => best = better,
            None => return (best, changes),
        }
        changes += 1;
    }
}
