//! Conversion of soft edges to an acyclic graph. This is a discrete decision without an adjoint.

use crate::math::digraph::Digraph;

/// An edge that was deleted to break a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deleted {
    /// Start node of the edge.
    pub parent: usize,
    /// End node of the edge.
    pub child: usize,
    /// Strength of the edge: a probability, or the absolute value of a weight.
    pub strength: f64,
}

/// Returns an acyclic graph of the edges whose strength (n, n) has an absolute value above `threshold`. While
/// there is a cycle, the weakest edge that lies on a cycle is deleted; of equally weak edges, the first in
/// the order of (i, j). Also returns the deleted edges in the order of deletion. The diagonal is not read.
///
/// # Panics
/// Panics if `strength` is not (n, n).
pub fn repair(n: usize, strength: &[f64], threshold: f64) -> (Digraph, Vec<Deleted>) {
    let mut graph = Digraph::from_weights(strength, n, threshold);
    let mut deleted = Vec::new();
    while !graph.is_acyclic() {
        let on_cycle = graph.edges().into_iter().filter(|&(i, j)| graph.reaches(j, i));
        let weakest = on_cycle.fold(None, |best: Option<Deleted>, (parent, child)| {
            let edge = Deleted { parent, child, strength: strength[parent * n + child].abs() };
            match best {
                Some(best) if !(edge.strength < best.strength) => Some(best),
                _ => Some(edge),
            }
        });
        let edge = weakest.expect("a cycle has edges");
        graph.set(edge.parent, edge.child, false);
        deleted.push(edge);
    }
    (graph, deleted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weakest_edge_of_a_cycle_goes_first_and_ties_go_by_place() {
        let mut p = vec![0.0; 9];
        for (i, j, value) in [(0, 1, 0.6), (1, 2, 0.9), (2, 0, 0.8), (0, 2, 0.55)] {
            p[i * 3 + j] = value;
        }
        // both cycles go through 2 → 0; 0 → 2 is the weakest of them, then 0 → 1
        let (graph, deleted) = repair(3, &p, 0.5);
        let gone: Vec<_> = deleted.iter().map(|d| (d.parent, d.child)).collect();
        assert_eq!(gone, [(0, 2), (0, 1)], "weakest first");
        assert_eq!(graph.edges(), [(1, 2), (2, 0)], "the remaining edges");
        let (_, deleted) = repair(2, &[0.0, 0.75, 0.75, 0.0], 0.5);
        assert_eq!(
            (deleted[0].parent, deleted[0].child),
            (0, 1),
            "the first of equally weak edges is deleted"
        );
        let (graph, deleted) = repair(2, &[0.9, 0.5, 0.500_001, 0.9], 0.5);
        assert_eq!(graph.edges(), [(1, 0)], "½ is not probable, loops are not edges");
        assert!(deleted.is_empty(), "nothing to break");
        let (graph, _) = repair(2, &[0.0, -0.4, 0.35, 0.0], 0.3);
        assert_eq!(graph.edges(), [(0, 1)], "weights count by their absolute value");
    }
}
