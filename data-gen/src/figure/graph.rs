//! Causal graphs between the factors.
//!
//! `A[i][j]` means i → j: the parents of j are in column j.

use super::purpose;
use reference::num::rng::{Key, uniform_f64};

/// A directed acyclic graph over n nodes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Graph {
    /// Adjacency matrix, shape (n, n): true if the node of the row acts on that of the column.
    pub adjacency: Vec<Vec<bool>>,
    /// The nodes in topological order; among several available nodes, the lowest index comes first.
    pub order: Vec<usize>,
}

/// Edges of the named graphs over P = 0, W = 2, O = 1, L = 3.
const NAMED: &[(&str, &[(usize, usize)])] = {
    const P: usize = 0;
    const O: usize = 1;
    const W: usize = 2;
    const L: usize = 3;
    &[
        ("FORK", &[(P, W), (P, O)]),
        ("CHAIN", &[(P, W), (W, O), (O, L)]),
        ("COLLIDER", &[(P, W), (O, W)]),
        ("DIAMOND", &[(P, W), (P, O), (W, L), (O, L)]),
        ("FULL", &[(P, W), (P, O), (P, L), (W, O), (W, L), (O, L)]),
        ("EMPTY", &[]),
    ]
};

impl Graph {
    /// Creates a graph from its edges.
    ///
    /// # Errors
    /// If an edge refers to a node that does not exist, is a loop, or closes a cycle.
    pub fn new(n: usize, edges: &[(usize, usize)]) -> Result<Self, String> {
        let mut adjacency = vec![vec![false; n]; n];
        for &(i, j) in edges {
            if i >= n || j >= n || i == j {
                return Err(format!("edge {i} -> {j}: expected two different nodes below {n}"));
            }
            adjacency[i][j] = true;
        }
        let mut order: Vec<usize> = Vec::with_capacity(n);
        while order.len() < n {
            let free =
                |j: &usize| !order.contains(j) && (0..n).all(|i| !adjacency[i][*j] || order.contains(&i));
            match (0..n).find(free) {
                Some(j) => order.push(j),
                None => return Err("expected a graph without cycles".to_owned()),
            }
        }
        Ok(Self { adjacency, order })
    }

    /// The graph with the given name over n factors: `FORK`, `CHAIN`, `COLLIDER`, `DIAMOND`, `FULL`, `EMPTY`
    /// (in which factors after the first four have no edges), or `ER-m`: m different edges drawn at random by
    /// the seed along a random order of the nodes.
    ///
    /// # Errors
    /// If there is no such name, n is not 4 to 8 (2 to 8 for `ER-m` and `EMPTY`), or there cannot be m edges.
    pub fn named(name: &str, n: usize, seed: u64) -> Result<Self, String> {
        if let Some(m) = name.strip_prefix("ER-") {
            let most = n * n.saturating_sub(1) / 2;
            let m: usize =
                m.parse().map_err(|_| format!("graph {name}: expected ER- and a number of edges"))?;
            if !(2..=super::MAX_FACTORS).contains(&n) || m > most {
                return Err(format!(
                    "graph {name}: expected 2 to 8 factors and at most {most} edges for {n}"
                ));
            }
            return Self::random(n, m, seed);
        }
        let Some((_, edges)) = NAMED.iter().find(|(known, _)| *known == name) else {
            return Err(format!(
                "graph {name}: expected FORK, CHAIN, COLLIDER, DIAMOND, FULL, EMPTY or ER-m"
            ));
        };
        let least = if edges.is_empty() { 2 } else { 4 };
        if !(least..=super::MAX_FACTORS).contains(&n) {
            return Err(format!("graph {name}: expected {least} to 8 factors, got {n}"));
        }
        Self::new(n, edges)
    }

    fn random(n: usize, m: usize, seed: u64) -> Result<Self, String> {
        let draw =
            |purpose: u16, i: usize| uniform_f64(Key { seed, item: i as u64, step: 0, purpose, draw: 0 });
        let rank = |purpose: u16, count: usize| {
            let mut places: Vec<usize> = (0..count).collect();
            places.sort_by(|&a, &b| draw(purpose, a).total_cmp(&draw(purpose, b)).then(a.cmp(&b)));
            places
        };
        let order = rank(purpose::GRAPH_ORDER, n);
        let pairs: Vec<(usize, usize)> =
            (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).map(|(i, j)| (order[i], order[j])).collect();
        let chosen: Vec<(usize, usize)> =
            rank(purpose::GRAPH_EDGE, pairs.len()).into_iter().take(m).map(|k| pairs[k]).collect();
        Self::new(n, &chosen)
    }

    /// Number of nodes.
    pub fn n(&self) -> usize {
        self.adjacency.len()
    }

    /// Nodes with an edge to `j`, in index order.
    pub fn parents(&self, j: usize) -> Vec<usize> {
        (0..self.n()).filter(|&i| self.adjacency[i][j]).collect()
    }

    /// Whether each node can be reached from `i` on a directed path of at least one edge.
    pub fn descendants(&self, i: usize) -> Vec<bool> {
        let mut reached = vec![false; self.n()];
        for &j in &self.order {
            reached[j] = self.parents(j).into_iter().any(|p| p == i || reached[p]);
        }
        reached
    }
}
