//! The Gaussian score of a graph under known interventions.
//!
//! S(A) = Σ_j S_j(parents of j),   S_j(P) = −½ W_j (k ln 2π + ln det Σ_j + k) − ½ ln W_j · (k (1 + |P| k f) + ½ k (k+1))
//!
//! | symbol | meaning |
//! |---|---|
//! | Σ_j | (k, k) residual covariance of block j regressed on 1 and f features of every dimension of the blocks in P, by weighted least squares |
//! | W_j | Σ of the weights of the samples: the number of draws of j's noise ([`Samples::weights`]) |
//! | f | 1: x; 2: x, x²; 10: x, x², x³ and (x − κ)³ beyond each of the knots κ = −1.5, −1, …, 1.5; of standardised values |
//!
//! Omitting node j where it was set gives the interventional likelihood: with an intervention on every node
//! it identifies the graph, not only its equivalence class. The features must be able to represent the
//! mechanism, because the unexplained part of a mechanism appears as an additional effect of indirect causes.
//! Splines represent any smooth mechanism.
//!
//! # Rounding
//! Moments are left folds over the samples; triangles follow [`dense`]; S is a left fold over the nodes.

use super::samples::Samples;
use crate::math::dense;
use crate::math::digraph::{Digraph, Nodes, nodes};
use crate::num::{order, par};
use crate::{Error, Result};

/// Maximum number of nodes of a table.
pub const MOST: usize = 8;

/// Constant added to the diagonals of correlations and of residual covariances, in units of a standardised
/// variance, so that the score of a node that its parents determine is finite.
const FLOOR: f64 = 1e-9;

/// Knots of the splines.
const KNOTS: [f64; 7] = [-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5];

/// Basis functions of a mechanism.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Features {
    /// x.
    Linear,
    /// x, x².
    Quadratic,
    /// A cubic spline with knots at −1.5, −1, …, 1.5.
    Spline,
}

impl Features {
    /// Number of features per dimension.
    pub fn count(self) -> usize {
        match self {
            Self::Linear => 1,
            Self::Quadratic => 2,
            Self::Spline => 3 + KNOTS.len(),
        }
    }
}

/// S_j(P) of every node and every set of parents.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    n: usize,
    /// Values, shape (n, 2ⁿ); −∞ for sets that contain the node itself.
    local: Vec<f64>,
}

/// 1, then the features of every dimension of every block: (n, k, f).
fn features(row: &[f64], how: Features, into: &mut Vec<f64>) {
    into.clear();
    into.push(1.0);
    for &x in row {
        let beyond = |knot: f64| {
            let d = order::max(x - knot, 0.0);
            (d * d) * d
        };
        into.extend_from_slice(&[x, x * x, (x * x) * x][..order::min(how.count(), 3)]);
        if how == Features::Spline {
            into.extend(KNOTS.map(beyond));
        }
    }
}

/// Weighted moments Σ w φ φᵀ, (F, F).
fn moments(samples: &Samples, weights: &[f64], how: Features) -> Vec<f64> {
    let size = 1 + samples.n() * samples.k() * how.count();
    let (mut sums, mut phi) = (vec![0.0; size * size], Vec::with_capacity(size));
    for (s, &w) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
        features(samples.row(s), how, &mut phi);
        for (a, row) in sums.chunks_exact_mut(size).enumerate() {
            let scaled = w * phi[a];
            for (sum, b) in row.iter_mut().zip(&phi) {
                *sum += scaled * b;
            }
        }
    }
    sums
}

/// Number of draws in which a node is not set that scoring it takes: more than this.
pub fn too_few(n: usize, k: usize, how: Features) -> usize {
    // A constant, the features of all other nodes, and the variances of its own dimensions.
    1 + (n - 1) * k * how.count() + k
}

impl Table {
    /// Scores all sets of parents of all nodes; samples are standardised first.
    ///
    /// # Errors
    /// If there are more than [`MOST`] nodes, or a node has too few samples in which it is not set, or values
    /// are not finite or do not vary.
    pub fn new(samples: &Samples, how: Features) -> Result<Self> {
        let (n, k) = (samples.n(), samples.k());
        if n == 0 || n > MOST {
            return Err(Error::input("structure score")
                .expected(format!("1 to {MOST} factors"))
                .got(n.to_string()));
        }
        let samples = samples.standardised()?;
        let rows = par::map(n, |j| {
            let weights = samples.weights(j);
            let mass = weights.iter().fold(0.0, |s, w| s + w);
            let few = too_few(n, k, how);
            if !(mass > few as f64) {
                return Err(Error::input("structure score")
                    .at(format!("factor {j}"))
                    .expected(format!("more than {few} draws in which it was not set"))
                    .got(mass.to_string()));
            }
            let moments = moments(&samples, &weights, how);
            let score = |set: Nodes| local(&moments, j, set, [n, k, how.count()], mass);
            Ok((0..1u32 << n).map(score).collect::<Vec<f64>>())
        });
        Ok(Self { n, local: rows.into_iter().collect::<Result<Vec<_>>>()?.concat() })
    }

    /// Number of nodes.
    pub fn n(&self) -> usize {
        self.n
    }

    /// S_j of a set of parents.
    pub fn local(&self, j: usize, parents: Nodes) -> f64 {
        self.local[(j << self.n) + parents as usize]
    }

    /// S of a graph.
    pub fn score(&self, graph: &Digraph) -> f64 {
        assert_eq!(graph.n(), self.n, "a graph over the nodes of the table");
        (0..self.n).fold(0.0, |sum, j| sum + self.local(j, graph.parents(j)))
    }
}

fn local(moments: &[f64], j: usize, set: Nodes, [n, k, f]: [usize; 3], mass: f64) -> f64 {
    if set >> j & 1 == 1 {
        return f64::NEG_INFINITY;
    }
    let size = 1 + n * k * f;
    let at = |a: usize, b: usize| moments[a * size + b] / mass;
    let regressors: Vec<usize> =
        [0].into_iter().chain(nodes(set).flat_map(|i| (0..k * f).map(move |c| 1 + i * k * f + c))).collect();
    // The first feature of a dimension is its value.
    let own: Vec<usize> = (0..k).map(|d| 1 + (j * k + d) * f).collect();
    let p = regressors.len();
    let normal: Vec<f64> = (0..p * p)
        .map(|c| at(regressors[c / p], regressors[c % p]) + if c / p == c % p { FLOOR } else { 0.0 })
        .collect();
    let Ok(l) = dense::cholesky(&normal, p) else { return f64::NEG_INFINITY };
    let halves: Vec<Vec<f64>> = own
        .iter()
        .map(|&t| dense::forward(&l, p, &regressors.iter().map(|&r| at(r, t)).collect::<Vec<f64>>()))
        .collect();
    let residual: Vec<f64> = (0..k * k)
        .map(|c| {
            let (a, b) = (c / k, c % k);
            let explained = halves[a].iter().zip(&halves[b]).fold(0.0, |s, (x, y)| s + x * y);
            at(own[a], own[b]) - explained + if a == b { FLOOR } else { 0.0 }
        })
        .collect();
    let Ok(triangle) = dense::cholesky(&residual, k) else { return f64::NEG_INFINITY };
    let dims = k as f64;
    let fit = dims * libm::log(std::f64::consts::TAU) + dense::log_det(&triangle, k) + dims;
    let parameters = dims * p as f64 + 0.5 * dims * (dims + 1.0);
    -0.5 * mass * fit - 0.5 * libm::log(mass) * parameters
}
