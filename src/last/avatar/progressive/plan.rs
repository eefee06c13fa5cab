//! The order in which factors are updated, and the key Gaussians of each factor.

use super::super::ranking;
use super::settings::Order;
use crate::math::digraph::{Digraph, Nodes, nodes};
use crate::num::rng::Rng;
use crate::{Error, Result};

/// Purpose numbers of the draws.
const PURPOSE_ORDER: u16 = 0x0905;
const PURPOSE_KEYS: u16 = 0x0906;
/// A Gaussian with a smaller score is key to no factor.
const LEAST_SCORE: f64 = 1e-6;

/// Factors by level, and their parents.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Factors of each level, in ascending order.
    pub levels: Vec<Vec<usize>>,
    /// Parents of each factor as a bit mask, shape (n).
    pub parents: Vec<Nodes>,
}

impl Plan {
    /// Computes the levels of a graph in the given order.
    ///
    /// # Errors
    /// If the graph has a cycle.
    pub fn new(graph: &Digraph, order: Order, seed: u64) -> Result<Self> {
        let n = graph.n();
        let graph = match order {
            Order::Topological => graph.clone(),
            Order::Reverse => Digraph::from_fn(n, |i, j| graph.has(j, i)),
            Order::Random => {
                let to = Rng::new(seed).permutation(n, 0, PURPOSE_ORDER);
                Digraph::from_fn(n, |i, j| graph.has(to[i], to[j]))
            }
            Order::None => Digraph::empty(n),
        };
        let Some(sequence) = graph.order() else {
            return Err(Error::input("causal graph")
                .expected("no cycle")
                .got(format!("edges {:?}", graph.edges())));
        };
        let mut level = vec![0; n];
        for j in sequence {
            level[j] = nodes(graph.parents(j)).map(|i| level[i] + 1).fold(0, Ord::max);
        }
        let depth = level.iter().fold(0, |m, &l| Ord::max(m, l));
        Ok(Self {
            levels: (0..=depth).map(|l| (0..n).filter(|&j| level[j] == l).collect()).collect(),
            parents: (0..n).map(|j| graph.parents(j)).collect(),
        })
    }
}

/// Bit mask of the factors to which each Gaussian is key, from scores (n, G): the ⌈q G⌉ largest scores of
/// each factor, ties to the lower row, without scores below 1e-6.
pub fn keys(scores: &[Vec<f64>], share: f64) -> Vec<u32> {
    let rows = scores.first().map_or(0, Vec::len);
    let count = size(rows, share);
    let mut members = vec![0; rows];
    for (i, score) in scores.iter().enumerate() {
        for g in ranking::ranked(score).into_iter().take(count).filter(|&g| score[g] >= LEAST_SCORE) {
            members[g] |= 1 << i;
        }
    }
    members
}

/// The number ⌈q G⌉.
fn size(rows: usize, share: f64) -> usize {
    Ord::min(rows, libm::ceil(share * rows as f64) as usize)
}

/// The same number of key Gaussians for each of n factors, drawn at random.
pub fn random_keys(n: usize, rows: usize, share: f64, seed: u64, iteration: usize) -> Vec<u32> {
    let (rng, step) = (Rng::new(seed), u32::try_from(iteration).expect("validated"));
    let mut members = vec![0; rows];
    for i in 0..n {
        let draw = |g: usize| rng.block(g as u64, step, PURPOSE_KEYS, i as u16);
        let mut order: Vec<([u32; 2], usize)> = (0..rows).map(|g| ([draw(g)[1], draw(g)[0]], g)).collect();
        order.sort_unstable();
        for (_, g) in order.into_iter().take(size(rows, share)) {
            members[g] |= 1 << i;
        }
    }
    members
}

/// Mask (G) with 1 for the rows in the blocks of a level; level 0 also contains Gaussians that are key to no
/// factor.
pub fn block(members: &[u32], factors: &[usize], level: usize) -> Vec<u8> {
    let bits = factors.iter().fold(0u32, |b, i| b | 1 << i);
    members.iter().map(|&m| u8::from(m & bits != 0 || (level == 0 && m == 0))).collect()
}
