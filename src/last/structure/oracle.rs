//! Exact search for the graph with the best score, by enumeration and by dynamic programming over sinks.
//!
//! [`enumerate`] scores every acyclic graph on up to five nodes (29 281 at five). [`by_sinks`] finds the same
//! optimum for up to eight nodes by dynamic programming over sets (Silander and Myllymäki 2006): the best
//! graph on a set of nodes has a sink j, whose parents are the best ones among the other nodes, and contains
//! the best graph on the other nodes.

use super::score::{MOST, Table};
use crate::math::digraph::{Digraph, Nodes, each_acyclic, nodes};
use crate::{Error, Result};

/// A graph and its score.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// The graph.
    pub graph: Digraph,
    /// The score S of the graph.
    pub score: f64,
}

/// The acyclic graph with the largest score, the first of equals in the order of [`each_acyclic`].
///
/// # Errors
/// If there are more than five nodes.
pub fn enumerate(table: &Table) -> Result<Best> {
    let n = table.n();
    if n > 5 {
        return Err(Error::input("enumeration of graphs")
            .expected("at most 5 factors")
            .got(n.to_string())
            .hint("by_sinks supports up to 8"));
    }
    let empty = Digraph::empty(n);
    let mut best = Best { score: table.score(&empty), graph: empty };
    each_acyclic(n, |graph| {
        let score = table.score(graph);
        if score > best.score {
            best = Best { graph: graph.clone(), score };
        }
    });
    Ok(best)
}

/// The acyclic graph with the largest score, for any number of nodes that a table supports.
pub fn by_sinks(table: &Table) -> Best {
    let n = table.n();
    assert!(n <= MOST, "a table must have at most {MOST} nodes");
    let sets = 1usize << n;
    // Best parents of j within every set.
    let best_parents: Vec<Vec<Nodes>> = (0..n)
        .map(|j| {
            let mut best: Vec<Nodes> = vec![0; sets];
            for set in 0..sets as Nodes {
                let mut chosen = if set >> j & 1 == 0 { set } else { 0 };
                for i in nodes(set).filter(|&i| i != j) {
                    let smaller = best[(set & !(1 << i)) as usize];
                    if table.local(j, smaller) >= table.local(j, chosen) {
                        chosen = smaller;
                    }
                }
                best[set as usize] = chosen;
            }
            best
        })
        .collect();
    let mut score = vec![f64::NEG_INFINITY; sets];
    let mut sink = vec![0; sets];
    score[0] = 0.0;
    for set in 1..sets as Nodes {
        for j in nodes(set) {
            let rest = set & !(1 << j);
            let with = score[rest as usize] + table.local(j, best_parents[j][rest as usize]);
            if with > score[set as usize] {
                (score[set as usize], sink[set as usize]) = (with, j);
            }
        }
    }
    let mut parents = vec![0; n];
    let mut set = (sets - 1) as Nodes;
    while set != 0 {
        let j = sink[set as usize];
        set &= !(1 << j);
        parents[j] = best_parents[j][set as usize];
    }
    let graph = Digraph::from_parents(parents);
    Best { score: table.score(&graph), graph }
}
