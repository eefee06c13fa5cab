//! The structural causal model: how factors arise from their parents and from noise of their own.
//!
//! u_j = Σ_i a_ij f(u_i) + s_j e_j
//!
//! |a_ij| is uniform in [0.5, 0.9] with a random sign, f the identity or tanh(1.5 x), e standard normal or uniform in ±√3.
//! Standardised, s_j is such that Var(u_j) = 1: s_j² = 1 − V_j with V_j = Var(Σ_i a_ij f(u_i)), exact for a linear f, from
//! 10⁶ fixed draws otherwise. Where V_j would pass [`MOST_EXPLAINED`], the incoming a_ij are shrunk by one factor so that it is
//! met: an own cause remains in every factor. Without standardisation s_j = 1 and a_ij stays as drawn.
//!
//! # Rounding
//! Sums over parents are left folds in index order from +0, then the noise is added.

use super::graph::Graph;
use super::purpose;
use reference::num::rng::{Key, normal_f64, uniform_f64};
use reference::scalar::Scalar;

/// Largest share of a factor's variance that its parents explain; a noise of standard deviation 0.05 remains.
pub const MOST_EXPLAINED: f64 = 1.0 - 0.05 * 0.05;

/// Draws behind the variances of nonlinear mechanisms.
pub const DRAWS: usize = 1_000_000;

/// The seed of those draws, the same for every data set.
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
    /// The mechanism of that name: `LIN`, `NL`, `NG` or `NL-NG`.
    ///
    /// # Errors
    /// When there is none.
    pub fn parse(name: &str) -> Result<Self, String> {
        match name {
            "LIN" => Ok(Self::Lin),
            "NL" => Ok(Self::Nl),
            "NG" => Ok(Self::Ng),
            "NL-NG" => Ok(Self::NlNg),
            other => Err(format!("mechanism {other}: expected LIN, NL, NG or NL-NG")),
        }
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lin => "LIN",
            Self::Nl => "NL",
            Self::Ng => "NG",
            Self::NlNg => "NL-NG",
        }
    }

    /// f(x).
    pub fn f(self, x: f64) -> f64 {
        match self {
            Self::Lin | Self::Ng => x,
            Self::Nl | Self::NlNg => Scalar::tanh(1.5 * x),
        }
    }

    /// The noise of a key: mean 0, variance 1.
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
    /// Who acts on whom.
    pub graph: Graph,
    /// Form of the equations.
    pub mechanism: Mechanism,
    /// (n, n) a_ij, 0 where there is no edge
    pub a: Vec<Vec<f64>>,
    /// (n) s_j
    pub s: Vec<f64>,
    /// Whether s and a were chosen for unit variances.
    pub standardised: bool,
}

impl Scm {
    /// Draws the coefficients.
    pub fn new(graph: Graph, mechanism: Mechanism, standardised: bool, seed: u64) -> Self {
        Self::with_draws(graph, mechanism, standardised, seed, DRAWS)
    }

    /// [`Scm::new`] with variances of nonlinear mechanisms from the first `draws` of the fixed draws only: their relative error is about
    /// √(2/draws). For statistics over many models.
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

    /// Takes V_j of the parents' sum, shrinks if it must, and sets s_j; gives the factor that a_·j was multiplied by.
    fn settle(&mut self, j: usize, explained: f64) -> f64 {
        let shrink = if explained > MOST_EXPLAINED { (MOST_EXPLAINED / explained).sqrt() } else { 1.0 };
        for row in &mut self.a {
            row[j] *= shrink;
        }
        let kept = if explained > MOST_EXPLAINED { MOST_EXPLAINED } else { explained };
        self.s[j] = (1.0 - kept).sqrt();
        shrink
    }

    /// Linear f: with the covariance C of the nodes before j, V_j = Σ a_pj a_qj C_pq and C_ij = Σ_p a_pj C_ip.
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
        // (n, draws) f(u_i) of the nodes that have children
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

    /// The factors of given noise; `fixed` holds one of them at a value: its parents and its noise no longer matter.
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

/// Variance with 1/N, by a left fold around the mean.
pub fn variance(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let mean = x.iter().fold(0.0, |sum, x| sum + x) / n;
    x.iter().fold(0.0, |sum, x| sum + (x - mean) * (x - mean)) / n
}
