//! Structure of known factors: exact search, local search, and two continuous relaxations as independent checks.
//!
//! ```text
//! samples under regimes ─ score: a table of every node under every set of parents ─┬─ oracle   the best acyclic graph of all
//!                                                                                 └─ search   add, remove, turn to a fixed point
//! samples ─┬─ dagma   linear, log-determinant, path following
//!          └─ mcsl    masks of Gumbel-sigmoid, one small network per node, augmented Lagrangian
//! ```
//!
//! All in f64 and without state: the same samples and seed give the same bits for any number of threads.
//!
//! # Edges
//! i → j means: i is an argument of j's mechanism. Wherever scores are equal the first in lexicographic order of (i, j) is taken.

pub mod dagma;
pub mod mcsl;
pub mod oracle;
pub mod samples;
pub mod score;
pub mod search;

use crate::math::digraph::Digraph;
use crate::num::elem::f64::ln;

/// What the mean squared residual Q of a node costs a relaxation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// ½ Q: noise of one variance everywhere; the minimum depends on scales, and on standardised factors it is another graph than the true one
    Squares,
    /// ½ ln Q: the likelihood with a variance of its own for every node; knows no scale
    Likelihood,
}

impl Loss {
    /// Cost of Q > 0 and its derivative.
    pub fn of(self, q: f64) -> (f64, f64) {
        match self {
            Self::Squares => (0.5 * q, 0.5),
            Self::Likelihood => (0.5 * ln(q), 0.5 / q),
        }
    }
}

/// The edges with strength above `threshold`, without those that close cycles: while there is one, the weakest edge that lies on a cycle goes, the
/// first of equals.
///
/// # Panics
/// When there are not n² strengths.
pub fn without_cycles(strength: &[f64], n: usize, threshold: f64) -> Digraph {
    let mut graph = Digraph::from_weights(strength, n, threshold);
    while !graph.is_acyclic() {
        let closing = graph.edges().into_iter().filter(|&(i, j)| graph.reaches(j, i));
        let weakest = closing
            .reduce(|a, b| if strength[b.0 * n + b.1].abs() < strength[a.0 * n + a.1].abs() { b } else { a });
        let Some((i, j)) = weakest else { break };
        graph.set(i, j, false);
    }
    graph
}
