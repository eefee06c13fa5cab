//! Local search over acyclic graphs: the last step after a relaxation.
//!
//! Every single edge that can be added, removed or turned so that the graph stays acyclic is tried; the one with the largest gain of the score
//! is taken; again, until none gains. Changes are tried in the order of (i, j): for a pair with an edge remove, then turn, else add; the first
//! of equals is taken.

use super::oracle::Best;
use super::score::Table;
use crate::math::digraph::Digraph;

/// Climbs from `start`; gives the fixed point and the number of changes.
///
/// # Panics
/// When `start` has a cycle or other nodes than the table.
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
