//! From soft edges to a graph without cycles, and what a graph says of its nodes. No adjoints: decisions.
//!
//! `edges[i·n + j]` is the edge i → j; the diagonal is ignored, no node is its own parent.

/// A directed graph without loops.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Graph {
    n: usize,
    /// (n, n)
    edges: Vec<bool>,
}

/// An edge that was deleted to break a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deleted {
    /// from
    pub parent: usize,
    /// to
    pub child: usize,
    /// its probability
    pub probability: f64,
}

impl Graph {
    /// A graph of `n` nodes; entries on the diagonal are dropped.
    ///
    /// # Panics
    /// When `edges` is not (n, n).
    pub fn new(n: usize, edges: &[bool]) -> Self {
        assert_eq!(edges.len(), n * n, "edges are (n, n)");
        Self { n, edges: edges.iter().enumerate().map(|(at, edge)| *edge && at / n != at % n).collect() }
    }

    /// The graph of n nodes whose edges are the entries that are not 0.
    ///
    /// # Panics
    /// When `mask` is not (n, n).
    pub fn of_mask(n: usize, mask: &[f64]) -> Self {
        Self::new(n, &mask.iter().map(|m| *m != 0.0).collect::<Vec<_>>())
    }

    /// Number of nodes.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Number of edges.
    pub fn len(&self) -> usize {
        self.edges.iter().filter(|edge| **edge).count()
    }

    /// Whether there is no edge.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether i acts on j directly.
    pub fn has(&self, i: usize, j: usize) -> bool {
        self.edges[i * self.n + j]
    }

    /// Adds or deletes the edge i → j; a loop is never added.
    pub fn set(&mut self, i: usize, j: usize, edge: bool) {
        self.edges[i * self.n + j] = edge && i != j;
    }

    /// Edges (i, j) in order.
    pub fn edges(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.edges.iter().enumerate().filter(|(_, edge)| **edge).map(|(at, _)| (at / self.n, at % self.n))
    }

    /// As a mask of zeros and ones (n, n).
    pub fn mask(&self) -> Vec<f64> {
        self.edges.iter().map(|edge| f64::from(u8::from(*edge))).collect()
    }

    /// Nodes with an edge into j, in order.
    pub fn parents(&self, j: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.n).filter(move |i| self.has(*i, j))
    }

    /// Per node, whether a path of at least one edge leads there from i.
    pub fn descendants(&self, i: usize) -> Vec<bool> {
        let mut reached = vec![false; self.n];
        let mut open = vec![i];
        while let Some(node) = open.pop() {
            for j in (0..self.n).filter(|j| self.has(node, *j)) {
                if !reached[j] {
                    reached[j] = true;
                    open.push(j);
                }
            }
        }
        reached
    }

    /// Longest path into every node, in edges: 0 without parents, else 1 + the largest of the parents. `None` when there is a
    /// cycle.
    pub fn levels(&self) -> Option<Vec<usize>> {
        let mut level: Vec<Option<usize>> = vec![None; self.n];
        for _ in 0..self.n {
            let before = level.clone();
            for j in (0..self.n).filter(|j| before[*j].is_none()) {
                let mut deepest = Some(0);
                for i in self.parents(j) {
                    deepest = match (deepest, before[i]) {
                        (Some(deepest), Some(level)) => Some(Ord::max(deepest, level + 1)),
                        _ => None,
                    };
                }
                level[j] = deepest;
            }
        }
        level.into_iter().collect()
    }

    /// Nodes by level, then index; parents come before children. `None` when there is a cycle.
    pub fn order(&self) -> Option<Vec<usize>> {
        let levels = self.levels()?;
        let mut order: Vec<usize> = (0..self.n).collect();
        order.sort_by_key(|j| (levels[*j], *j));
        Some(order)
    }

    /// Whether no path leads back to its start.
    pub fn is_acyclic(&self) -> bool {
        self.levels().is_some()
    }
}

/// The graph of the probable edges, p > ½, without cycles: while there is one, the edge of smallest p that lies on a cycle is
/// deleted, of equal ones the first in order of (i, j). Also what was deleted, in order.
///
/// # Panics
/// When `probability` is not (n, n).
pub fn repair(n: usize, probability: &[f64]) -> (Graph, Vec<Deleted>) {
    let mut graph = Graph::new(n, &probability.iter().map(|p| *p > 0.5).collect::<Vec<_>>());
    let mut deleted = Vec::new();
    loop {
        let back: Vec<Vec<bool>> = (0..n).map(|j| graph.descendants(j)).collect();
        let on_cycle = graph.edges().filter(|(i, j)| back[*j][*i]);
        let weakest = on_cycle.fold(None, |best: Option<Deleted>, (parent, child)| {
            let candidate = Deleted { parent, child, probability: probability[parent * n + child] };
            match best {
                Some(best) if !(candidate.probability < best.probability) => Some(best),
                _ => Some(candidate),
            }
        });
        let Some(edge) = weakest else { return (graph, deleted) };
        graph.set(edge.parent, edge.child, false);
        deleted.push(edge);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::rng::Rng;

    fn graph(n: usize, edges: &[(usize, usize)]) -> Graph {
        let mut graph = Graph::new(n, &vec![false; n * n]);
        edges.iter().for_each(|(i, j)| graph.set(*i, *j, true));
        graph
    }

    #[test]
    fn levels_are_longest_paths() {
        let diamond = graph(5, &[(3, 0), (3, 1), (0, 2), (1, 2), (3, 2)]);
        assert_eq!(diamond.levels(), Some(vec![1, 1, 2, 0, 0]), "3 → {{0, 1}} → 2, and 4 alone");
        assert_eq!(diamond.order(), Some(vec![3, 4, 0, 1, 2]), "by level, then index");
        assert_eq!(diamond.descendants(0), [false, false, true, false, false], "0 → 2");
        assert_eq!(graph(3, &[(0, 1), (1, 2), (2, 0)]).levels(), None, "a ring");
        assert!(graph(1, &[(0, 0)]).is_acyclic(), "loops are not edges");
        assert_eq!(graph(0, &[]).levels(), Some(vec![]), "no nodes");
    }

    #[test]
    fn the_weakest_edge_of_a_cycle_goes_first_and_ties_go_by_place() {
        let mut p = vec![0.0; 9];
        for (i, j, value) in [(0, 1, 0.6), (1, 2, 0.9), (2, 0, 0.8), (0, 2, 0.55)] {
            p[i * 3 + j] = value;
        }
        // both cycles go through 2 → 0; 0 → 2 is the weakest of them, then 0 → 1
        let (graph, deleted) = repair(3, &p);
        let gone: Vec<_> = deleted.iter().map(|d| (d.parent, d.child)).collect();
        assert_eq!(gone, [(0, 2), (0, 1)], "weakest first");
        assert_eq!(graph.edges().collect::<Vec<_>>(), [(1, 2), (2, 0)], "what is left");
        let (_, deleted) = repair(2, &[0.0, 0.75, 0.75, 0.0]);
        assert_eq!((deleted[0].parent, deleted[0].child), (0, 1), "of equals the first");
        let (graph, deleted) = repair(2, &[0.9, 0.5, 0.500_001, 0.9]);
        assert_eq!(graph.edges().collect::<Vec<_>>(), [(1, 0)], "½ is not probable, loops are not edges");
        assert!(deleted.is_empty(), "nothing to break");
    }

    #[test]
    fn any_probabilities_become_a_graph_without_cycles() {
        for draw in 0..2000_u32 {
            let n = 2 + draw as usize % 7;
            let uniform = |i: usize| f64::from(Rng::new(5).uniform_f32(i as u64, draw, 0x7e57, 0));
            // coarse steps make ties
            let p: Vec<f64> = (0..n * n).map(|i| (8.0 * uniform(i)).floor() / 8.0 + 0.1).collect();
            let (graph, deleted) = repair(n, &p);
            assert!(graph.is_acyclic(), "draw {draw}: a cycle is left");
            let probable = Graph::new(n, &p.iter().map(|p| *p > 0.5).collect::<Vec<_>>());
            assert_eq!(graph.len() + deleted.len(), probable.len(), "draw {draw}: all edges accounted for");
            assert!(probable.is_acyclic() == deleted.is_empty(), "draw {draw}: deleted only if need be");
            let again = repair(n, &graph.mask());
            assert!(again.0 == graph && again.1.is_empty(), "draw {draw}: a graph without cycles stays");
        }
    }
}
