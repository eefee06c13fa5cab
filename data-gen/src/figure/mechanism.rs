//! The structural causal model: factors as functions of their parents and of independent noise.
//!
//! u_j = Σ_i a_ij f(u_i) + s_j e_j
//!
//! The magnitude |a_ij| is uniform in [0.5, 0.9] with a random sign, f is the identity or tanh(1.5 x), e is
//! standard normal or uniform in ±√3.
//! If the model is standardised, s_j is chosen so that Var(u_j) = 1: s_j² = 1 − V_j with V_j = Var(Σ_i a_ij
//! f(u_i)), computed exactly for a linear f, otherwise from 10⁶ fixed draws. If V_j would exceed
//! [`MOST_EXPLAINED`], all incoming a_ij are scaled by one factor so that V_j equals this limit, and every
//! factor retains noise of its own. Without standardisation, s_j = 1 and a_ij remains as drawn.
//!
//! # Rounding
//! Sums over parents are left folds in index order from +0, then the noise is added.

use super::graph::Graph;
use super::purpose;
use reference::num::rng::{Key, normal_f64, uniform_f64};
use reference::scalar::Scalar;

/// Largest fraction of a factor's variance that its parents explain; a noise of standard deviation 0.05
/// remains.
pub const MOST_EXPLAINED: f64 = 1.0 - 0.05 * 0.05;

/// Number of draws for the variances of nonlinear mechanisms.
pub const DRAWS: usize = 1_000_000;

/// Seed of those draws, the same for every data set.
const DRAWS_SEED: u64 = 0x5eed;

/// Form of the equations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mechanism {
    /// f = identity, e ~ N(0, 1)
    Lin,
    /// f = tanh(1.5 x), e ~ N(0, 1)
    Nl,
    /// f = identity, e ~ U(−√3, √3)
    Ng,
    /// f = tanh(1.5 x), e ~ U(−√3, √3)
    NlNg,
}

impl Mechanism {
    /// The mechanism with the given name: `LIN`, `NL`, `NG` or `NL-NG`.
    ///
    /// # Errors
    /// If there is no such name.
    pub fn parse(name: &str) -> Result<Self, String> {
        match name {
            "LIN" => Ok(Self::Lin),
            "NL" => Ok(Self::Nl),
            "NG" => Ok(Self::Ng),
            "NL-NG" => Ok(Self::NlNg),
            other => Err(format!("mechanism {other}: expected LIN, NL, NG or NL-NG")),
        }
    }

    /// The name of the mechanism.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lin => "LIN",
            Self::Nl => "NL",
            Self::Ng => "NG",
            Self::NlNg => "NL-NG",
        }
    }

    /// The function f(x).
    pub fn f(self, x: f64) -> f64 {
        match self {
            Self::Lin | Self::Ng => x,
            Self::Nl | Self::NlNg => Scalar::tanh(1.5 * x),
        }
    }

    /// The noise with the given key: mean 0, variance 1.
    pub fn noise(self, key: Key) -> f64 {
        match self {
            Self::Lin | Self::Nl => normal_f64(key),
            Self::Ng | Self::NlNg => 3.0_f64.sqrt() * (2.0 * uniform_f64(key) - 1.0),
        }
    }
}

/// A graph with its coefficients.
#[derive(Clone, Debug, PartialEq)]
pub struct Scm {
    /// The graph of direct effects.
    pub graph: Graph,
    /// Form of the equations.
    pub mechanism: Mechanism,
    /// Coefficients a_ij, 0 without an edge, shape (n, n).
    pub a: Vec<Vec<f64>>,
    /// Noise scales s_j, shape (n).
    pub s: Vec<f64>,
    /// Whether s and a were chosen for unit variances.
    pub standardised: bool,
}

impl Scm {
    /// Draws the coefficients.
    pub fn new(graph: Graph, mechanism: Mechanism, standardised: bool, seed: u64) -> Self {
        Self::with_draws(graph, mechanism, standardised, seed, DRAWS)
    }

    /// As [`Scm::new`], with variances of nonlinear mechanisms computed only from the first `draws` of the
    /// fixed draws: their relative error is about √(2/draws). Used for statistics over many models.
    pub fn with_draws(
        graph: Graph,
        mechanism: Mechanism,
        standardised: bool,
        seed: u64,
        draws: usize,
    ) -> Self {
        let n = graph.n();
        let draw = |i: usize, j: usize, draw: u16| {
            uniform_f64(Key { seed, item: (i * n + j) as u64, step: 0, purpose: purpose::COEFFICIENT, draw })
        };
        let coefficient = |i: usize, j: usize| {
            if !graph.adjacency[i][j] {
                return 0.0;
            }
            let size = 0.5 + 0.4 * draw(i, j, 0);
            if draw(i, j, 1) < 0.5 { -size } else { size }
        };
        let a = (0..n).map(|i| (0..n).map(|j| coefficient(i, j)).collect()).collect();
        let mut scm = Self { graph, mechanism, a, s: vec![1.0; n], standardised };
        if standardised {
            match mechanism {
                Mechanism::Lin | Mechanism::Ng => scm.standardise_exactly(),
                Mechanism::Nl | Mechanism::NlNg => scm.standardise_by_draws(draws),
            }
        }
        scm
    }

    /// Takes the variance V_j of the parents' sum, scales the coefficients if necessary, and sets s_j;
    /// returns the factor by which a_·j was multiplied.
    fn settle(&mut self, j: usize, explained: f64) -> f64 {
        let shrink = if explained > MOST_EXPLAINED { (MOST_EXPLAINED / explained).sqrt() } else { 1.0 };
        for row in &mut self.a {
            row[j] *= shrink;
        }
        let kept = if explained > MOST_EXPLAINED { MOST_EXPLAINED } else { explained };
        self.s[j] = (1.0 - kept).sqrt();
        shrink
    }

    /// Linear f: with the covariance C of the nodes before j, V_j = Σ a_pj a_qj C_pq and C_ij = Σ_p a_pj
    /// C_ip.
    fn standardise_exactly(&mut self) {
        let n = self.graph.n();
        let mut c = vec![vec![0.0; n]; n];
        for j in self.graph.order.clone() {
            let parents = self.graph.parents(j);
            let explained = parents.iter().fold(0.0, |sum, &p| {
                sum + self.a[p][j] * parents.iter().fold(0.0, |inner, &q| inner + self.a[q][j] * c[p][q])
            });
            self.settle(j, explained);
            for i in 0..n {
                let with = parents.iter().fold(0.0, |sum, &p| sum + self.a[p][j] * c[i][p]);
                c[i][j] = with;
                c[j][i] = with;
            }
            c[j][j] = 1.0;
        }
    }

    fn standardise_by_draws(&mut self, draws: usize) {
        let n = self.graph.n();
        // Values f(u_i) of the nodes that have children, shape (n, draws).
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); n];
        for j in self.graph.order.clone() {
            let parents = self.graph.parents(j);
            let has_children = self.graph.adjacency[j].iter().any(|&edge| edge);
            if parents.is_empty() && !has_children {
                continue;
            }
            let mut sums: Vec<f64> = (0..draws)
                .map(|k| parents.iter().fold(0.0, |sum, &p| sum + self.a[p][j] * values[p][k]))
                .collect();
            let explained = if parents.is_empty() { 0.0 } else { variance(&sums) };
            let shrink = self.settle(j, explained);
            if has_children {
                for (k, sum) in sums.iter_mut().enumerate() {
                    let key = Key {
                        seed: DRAWS_SEED,
                        item: k as u64,
                        step: 0,
                        purpose: purpose::DRAWS,
                        draw: j as u16,
                    };
                    *sum = self.mechanism.f(shrink * *sum + self.s[j] * self.mechanism.noise(key));
                }
                values[j] = sums;
            }
        }
    }

    /// The factors for given noise; `fixed` sets one of them to a value, which then does not depend on its
    /// parents and its noise.
    pub fn factors(&self, e: &[f64], fixed: Option<(usize, f64)>) -> Vec<f64> {
        let n = self.graph.n();
        assert!(e.len() == n, "{} noises for {n} factors", e.len());
        let mut u = vec![0.0; n];
        for &j in &self.graph.order {
            u[j] = match fixed {
                Some((i, v)) if i == j => v,
                _ => {
                    let parents = self.graph.parents(j);
                    let cause =
                        parents.iter().fold(0.0, |sum, &p| sum + self.a[p][j] * self.mechanism.f(u[p]));
                    cause + self.s[j] * e[j]
                }
            };
        }
        u
    }
}

/// Variance with divisor N, by a left fold around the mean.
pub fn variance(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let mean = x.iter().fold(0.0, |sum, x| sum + x) / n;
    x.iter().fold(0.0, |sum, x| sum + (x - mean) * (x - mean)) / n
}
