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
//! i → j means: i is an argument of j's mechanism. Where scores are equal, enumeration and search take the first in
//! lexicographic order of (i, j).

pub mod dagma;
pub mod mcsl;
pub mod oracle;
pub mod samples;
pub mod score;
pub mod search;

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
