//! Structure learners on known factors: exact search, local search, and two continuous relaxations as
//! independent checks.
//!
//! ```text
//! samples under regimes ─ score: a table of every node under every set of parents ─┬─ oracle   the acyclic
//! graph with the best score
//!                                                                                 └─ search   local search over edges
//! samples ─┬─ dagma   linear, log-determinant, path following
//!          └─ mcsl    Gumbel-sigmoid masks, one small network per node, augmented Lagrangian
//! ```
//!
//! All computations use f64 and have no state: the same samples and seed give the same bits for any number of
//! threads.
//!
//! # Edges
//! i → j means that i is an argument of the mechanism of j. If scores are equal, enumeration and search take
//! the first in lexicographic order of (i, j).

pub mod dagma;
pub mod mcsl;
pub mod oracle;
pub mod samples;
pub mod score;
pub mod search;

use crate::num::elem::f64::ln;

/// The cost of the mean squared residual Q of a node in a relaxation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// ½ Q: assumes the same noise variance everywhere; the minimum depends on scales, and on standardised
    /// factors it is not the true graph.
    Squares,
    /// ½ ln Q: the likelihood with a separate variance for every node; invariant under scaling.
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
