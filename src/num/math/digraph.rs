//! Directed graphs on a few nodes, stored as bit sets: topological order, descendants, d-separation, and
//! enumeration of all acyclic graphs.
//!
//! `has(i, j)` is true for the edge i → j; the parents of node j are stored as a bit set. A graph has at most
//! [`MOST`] nodes. Wherever several nodes qualify, the lowest index comes first.
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::math::digraph::Digraph;
//! let chain = Digraph::new(3, &[(0, 1), (1, 2)]);
//! assert!(chain.is_acyclic() && chain.reaches(0, 2));
//! assert!(chain.separated(0, 2, 1 << 1) && !chain.separated(0, 2, 0));
//! ```

/// Largest number of nodes of a graph.
pub const MOST: usize = 32;

/// A set of nodes: bit i represents node i.
pub type Nodes = u32;

/// Iterates over the nodes of a set in increasing order.
pub fn nodes(set: Nodes) -> impl Iterator<Item = usize> + Clone {
    (0..MOST).filter(move |i| set >> i & 1 == 1)
}

/// A directed graph without self-loops; cycles are possible.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Digraph {
    /// Parents of each node, shape (n).
    parents: Vec<Nodes>,
}

impl Digraph {
    /// Returns the graph without edges.
    ///
    /// # Panics
    /// Panics if there are more than [`MOST`] nodes.
    pub fn empty(n: usize) -> Self {
        assert!(n <= MOST, "a graph has at most {MOST} nodes, got {n}");
        Self { parents: vec![0; n] }
    }

    /// Returns the graph with these edges (i, j), meaning i → j.
    ///
    /// # Panics
    /// Panics if an edge is a self-loop or refers to a node that does not exist.
    pub fn new(n: usize, edges: &[(usize, usize)]) -> Self {
        let mut graph = Self::empty(n);
        for &(i, j) in edges {
            graph.set(i, j, true);
        }
        graph
    }

    /// Returns the graph of the pairs (i, j), i ≠ j, for which `edge` returns true.
    pub fn from_fn(n: usize, mut edge: impl FnMut(usize, usize) -> bool) -> Self {
        let mut graph = Self::empty(n);
        for i in 0..n {
            for j in (0..n).filter(|&j| j != i) {
                graph.set(i, j, edge(i, j));
            }
        }
        graph
    }

    /// Returns the graph whose edges are the entries of a matrix (n, n) with an absolute value above
    /// `threshold`; the diagonal is not read.
    pub fn from_weights(weights: &[f64], n: usize, threshold: f64) -> Self {
        assert_eq!(weights.len(), n * n, "the matrix is square, (n, n)");
        Self::from_fn(n, |i, j| weights[i * n + j].abs() > threshold)
    }

    /// Returns the graph with these sets of parents.
    ///
    /// # Panics
    /// Panics if a set contains its own node or a node that does not exist.
    pub fn from_parents(parents: Vec<Nodes>) -> Self {
        let n = parents.len();
        assert!(n <= MOST, "a graph has at most {MOST} nodes, got {n}");
        let fits = |(j, set): (usize, &Nodes)| u64::from(*set) >> n == 0 && set >> j & 1 == 0;
        assert!(parents.iter().enumerate().all(fits), "the parents of a node are other nodes of the graph");
        Self { parents }
    }

    /// Number of nodes.
    pub fn n(&self) -> usize {
        self.parents.len()
    }

    /// Whether the edge i → j exists.
    pub fn has(&self, i: usize, j: usize) -> bool {
        self.parents[j] >> i & 1 == 1
    }

    /// Adds the edge i → j if `there` is true, and removes it otherwise.
    ///
    /// # Panics
    /// Panics if the edge is a self-loop or refers to a node that does not exist.
    pub fn set(&mut self, i: usize, j: usize, there: bool) {
        assert!(
            i != j && i < self.n() && j < self.n(),
            "edge {i} -> {j} is not valid in a graph of {} nodes",
            self.n()
        );
        if there {
            self.parents[j] |= 1 << i;
        } else {
            self.parents[j] &= !(1 << i);
        }
    }

    /// Nodes with an edge to `j`.
    pub fn parents(&self, j: usize) -> Nodes {
        self.parents[j]
    }

    /// Nodes with an edge from `i`.
    pub fn children(&self, i: usize) -> Nodes {
        (0..self.n()).filter(|&j| self.has(i, j)).fold(0, |set, j| set | 1 << j)
    }

    /// Returns the edges, sorted by start node, then by end node.
    pub fn edges(&self) -> Vec<(usize, usize)> {
        let n = self.n();
        (0..n * n).map(|at| (at / n, at % n)).filter(|&(i, j)| self.has(i, j)).collect()
    }

    /// Number of edges.
    pub fn count(&self) -> usize {
        self.parents.iter().fold(0, |sum, set| sum + set.count_ones() as usize)
    }

    /// Returns the adjacency matrix (n, n) with 1 at (i, j) for i → j and 0 elsewhere.
    pub fn adjacency(&self) -> Vec<f64> {
        let n = self.n();
        (0..n * n).map(|at| f64::from(u8::from(self.has(at / n, at % n)))).collect()
    }

    /// Returns the nodes in topological order, the lowest available index first, or `None` if there is a
    /// cycle.
    pub fn order(&self) -> Option<Vec<usize>> {
        let (mut done, mut order) = (0, Vec::with_capacity(self.n()));
        while order.len() < self.n() {
            let next = (0..self.n()).find(|&j| done >> j & 1 == 0 && self.parents[j] & !done == 0)?;
            done |= 1 << next;
            order.push(next);
        }
        Some(order)
    }

    /// Returns the length in edges of the longest path into every node: 0 without parents, otherwise 1 + the
    /// maximum over the parents. Returns `None` if there is a cycle.
    pub fn levels(&self) -> Option<Vec<usize>> {
        let mut levels = vec![0; self.n()];
        for j in self.order()? {
            levels[j] = nodes(self.parents[j]).map(|i| levels[i] + 1).fold(0, Ord::max);
        }
        Some(levels)
    }

    /// Whether the graph has no cycle.
    pub fn is_acyclic(&self) -> bool {
        self.order().is_some()
    }

    /// Returns the nodes that a path of at least one edge reaches from `i`.
    pub fn descendants(&self, i: usize) -> Nodes {
        self.closed(self.children(i), |graph, set| nodes(set).fold(0, |all, j| all | graph.children(j)))
    }

    /// Returns the nodes of a set together with all their ancestors.
    pub fn ancestral(&self, set: Nodes) -> Nodes {
        self.closed(set, |graph, set| nodes(set).fold(0, |all, j| all | graph.parents[j]))
    }

    fn closed(&self, mut set: Nodes, step: impl Fn(&Self, Nodes) -> Nodes) -> Nodes {
        loop {
            let more = set | step(self, set);
            if more == set {
                return set;
            }
            set = more;
        }
    }

    /// Whether a path of at least one edge leads from `i` to `j`.
    pub fn reaches(&self, i: usize, j: usize) -> bool {
        self.descendants(i) >> j & 1 == 1
    }

    /// Whether `given`, which must not contain i or j, d-separates i from j: in the moral graph of the
    /// ancestors of i, j and `given`, no path from i to j avoids `given` (Lauritzen et al. 1990).
    pub fn separated(&self, i: usize, j: usize, given: Nodes) -> bool {
        let kept = self.ancestral(1 << i | 1 << j | given);
        let neighbours = |a: usize| {
            let own = self.parents[a] | self.children(a);
            // Parents of a common child are connected in the moral graph.
            let married = nodes(self.children(a) & kept).fold(0, |all, child| all | self.parents[child]);
            (own | married) & kept & !given
        };
        let mut reached: Nodes = 1 << i;
        loop {
            let more = nodes(reached).fold(reached, |all, a| all | neighbours(a));
            if more == reached {
                return reached >> j & 1 == 0;
            }
            reached = more;
        }
    }

    /// Returns the graph on `keep.len()` nodes that has the edge a → b if this graph has `keep[a]` →
    /// `keep[b]`; a node whose entry is `None` has no edges.
    pub fn relabelled(&self, keep: &[Option<usize>]) -> Self {
        Self::from_fn(keep.len(), |a, b| match (keep[a], keep[b]) {
            (Some(i), Some(j)) => i != j && self.has(i, j),
            _ => false,
        })
    }
}

impl std::fmt::Display for Digraph {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let edges: Vec<String> = self.edges().iter().map(|(i, j)| format!("{i}→{j}")).collect();
        f.write_str(&if edges.is_empty() { "no edges".to_owned() } else { edges.join(" ") })
    }
}

/// Calls `visit` with every acyclic graph on `n` nodes; there are 1, 3, 25, 543 and 29 281 for n = 1 … 5. The
/// graphs are enumerated by their sets of parents in increasing order; those of node 0 vary slowest.
///
/// # Panics
/// Panics if n is not in 1..=5.
pub fn each_acyclic(n: usize, mut visit: impl FnMut(&Digraph)) {
    assert!((1..=5).contains(&n), "graphs of 1 to 5 nodes can be enumerated, got {n}");
    fn choose(graph: &mut Digraph, j: usize, visit: &mut impl FnMut(&Digraph)) {
        let n = graph.n();
        if j == n {
            visit(graph);
            return;
        }
        for set in (0..1u32 << n).filter(|set| set >> j & 1 == 0) {
            // A new cycle would have to contain j.
            graph.parents[j] = set;
            if graph.descendants(j) >> j & 1 == 0 {
                choose(graph, j + 1, visit);
            }
        }
        graph.parents[j] = 0;
    }
    choose(&mut Digraph::empty(n), 0, &mut visit);
}

/// Returns all acyclic graphs on `n` ≤ 5 nodes, in the order of [`each_acyclic`].
pub fn all_acyclic(n: usize) -> Vec<Digraph> {
    let mut all = Vec::new();
    each_acyclic(n, |graph| all.push(graph.clone()));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_as_many_acyclic_graphs_as_there_should_be() {
        for (n, count) in [(1, 1), (2, 3), (3, 25), (4, 543), (5, 29_281)] {
            let all = all_acyclic(n);
            assert_eq!(all.len(), count, "{n} nodes");
            assert!(all.iter().all(Digraph::is_acyclic), "{n} nodes: no cycles");
            let distinct: std::collections::BTreeSet<_> = all.iter().collect();
            assert_eq!(distinct.len(), count, "{n} nodes: each once");
        }
    }

    /// Whether a simple path from `at` to `j` is open: colliders have a descendant in `given`, others are
    /// outside.
    fn open(g: &Digraph, path: &mut Vec<usize>, j: usize, given: Nodes) -> bool {
        let at = *path.last().expect("a path has a start");
        if at == j {
            return (1..path.len() - 1).all(|k| {
                let (a, b, c) = (path[k - 1], path[k], path[k + 1]);
                if g.has(a, b) && g.has(c, b) {
                    (g.descendants(b) | 1 << b) & given != 0
                } else {
                    given >> b & 1 == 0
                }
            });
        }
        for next in 0..g.n() {
            if (g.has(at, next) || g.has(next, at)) && !path.contains(&next) {
                path.push(next);
                let found = open(g, path, j, given);
                path.pop();
                if found {
                    return true;
                }
            }
        }
        false
    }

    #[test]
    fn separation_agrees_with_the_blocking_of_every_path() {
        let mut questions = 0;
        for g in all_acyclic(4) {
            for (i, j) in (0..16).map(|at| (at / 4, at % 4)).filter(|(i, j)| i != j) {
                for given in (0..16).filter(|given| given & (1 << i | 1 << j) == 0) {
                    let want = !open(&g, &mut vec![i], j, given);
                    assert_eq!(g.separated(i, j, given), want, "{g}: {i}, {j} given {given:b}");
                    questions += 1;
                }
            }
        }
        assert_eq!(questions, 543 * 12 * 4, "every pair and every set");
    }
}
