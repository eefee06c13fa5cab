//! Learns a linear structure with a log-determinant penalty and path following, after DAGMA (Bello, Aragam
//! and Ravikumar 2022).
//!
//! minimise μ (Σ_j ℓ(Q_j) + λ₁ Σ |W_ij|) + h(W),   Q_j = E_j[(x_j − Σ_i W_ij x_i)²],   h = −ln det(sI − W∘W) + n ln s,   ∂h/∂W = 2 W∘(sI − W∘W)⁻ᵀ
//!
//! over W with zero diagonal, inside the domain where (sI − W∘W)⁻¹ has no negative entry (spectral radius of
//! W∘W below s), where h ≥ 0 and h = 0 exactly on acyclic graphs. There are five rounds: μ = 1, 0.1, …, s =
//! 1, 0.9, 0.8, 0.7, 0.6, each starting from the result of the previous one, optimised by Adam (0.99, 0.999).
//! A step that leaves the domain is undone and the rate halved; a round whose starting point is outside uses
//! s + 0.1, and so on. E_j is the mean over the samples in which j was not set, each draw of noise counted
//! once.
//!
//! ℓ(Q) = ½ Q is the published loss. It assumes that all noise has the same variance and depends on scales:
//! on standardised factors its minimum is another graph. ℓ(Q) = ½ ln Q is the likelihood with a separate
//! variance for every node, and is invariant under scaling. Values are used without standardisation.
//!
//! # Rounding
//! Moments and products are left folds in index order.

use super::Loss;
use super::samples::Samples;
use crate::causal::repair::repair;
use crate::math::dense;
use crate::math::digraph::Digraph;
use crate::{Error, Result};

/// Constants of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The loss ℓ.
    pub loss: Loss,
    /// The sparsity weight λ₁.
    pub sparsity: f64,
    /// The constant s of each round.
    pub s: Vec<f64>,
    /// Ratio of μ in a round to that of the previous round; the first round has μ = 1.
    pub mu_factor: f64,
    /// Number of steps of every round except the last.
    pub warm_steps: usize,
    /// Number of steps of the last round.
    pub last_steps: usize,
    /// Learning rate of Adam.
    pub rate: f64,
    /// A round ends when the objective changes by less than this fraction over [`Settings::check_every`]
    /// steps.
    pub tolerance: f64,
    /// Number of steps between these checks.
    pub check_every: usize,
    /// Weights of smaller magnitude are not edges.
    pub threshold: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            loss: Loss::Likelihood,
            sparsity: 0.03,
            s: vec![1.0, 0.9, 0.8, 0.7, 0.6],
            mu_factor: 0.1,
            warm_steps: 30_000,
            last_steps: 60_000,
            rate: 3e-4,
            tolerance: 1e-6,
            check_every: 1000,
            threshold: 0.3,
        }
    }
}

/// The result of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The weights W of i → j, shape (n, n).
    pub weights: Vec<f64>,
    /// The edges above the threshold, with cycles removed.
    pub graph: Digraph,
    /// Value of h in the last round.
    pub h: f64,
    /// Total number of steps.
    pub steps: usize,
}

const BETAS: [f64; 2] = [0.99, 0.999];
const EPS: f64 = 1e-8;

/// Second moments around the means for the mechanism of `j`, shape (n, n).
fn moments(samples: &Samples, j: usize) -> Result<Vec<f64>> {
    let (n, weights) = (samples.n(), samples.weights(j));
    let mass = weights.iter().fold(0.0, |s, w| s + w);
    if !(mass > n as f64) {
        return Err(Error::input("linear structure")
            .at(format!("factor {j}"))
            .expected(format!("more than {n} draws in which it was not set"))
            .got(mass.to_string()));
    }
    let mean: Vec<f64> = (0..n)
        .map(|i| weights.iter().enumerate().fold(0.0, |s, (at, w)| s + w * samples.row(at)[i]) / mass)
        .collect();
    let mut sums = vec![0.0; n * n];
    for (at, w) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
        let row = samples.row(at);
        for a in 0..n {
            for b in 0..n {
                sums[a * n + b] += w * (row[a] - mean[a]) * (row[b] - mean[b]);
            }
        }
    }
    sums.iter_mut().for_each(|s| *s /= mass);
    Ok(sums)
}

/// Gradient (n, n) of the data term with respect to the weights, and its value.
fn data_term(covariances: &[Vec<f64>], w: &[f64], n: usize, loss: Loss) -> (Vec<f64>, f64) {
    let (mut gradient, mut value) = (vec![0.0; n * n], 0.0);
    for (j, c) in covariances.iter().enumerate() {
        let mut square = c[j * n + j];
        for i in 0..n {
            let with = (0..n).fold(0.0, |s, k| s + c[i * n + k] * w[k * n + j]);
            gradient[i * n + j] = with - c[i * n + j];
            square += w[i * n + j] * (with - 2.0 * c[i * n + j]);
        }
        let (cost, slope) = loss.of(square);
        value += cost;
        (0..n).for_each(|i| gradient[i * n + j] *= 2.0 * slope);
    }
    (gradient, value)
}

/// (sI − W∘W)⁻¹ and h, inside the domain. The gradient of h with respect to W is 2 (that matrix)ᵀ ∘ W.
fn barrier(w: &[f64], n: usize, s: f64) -> Option<(Vec<f64>, f64)> {
    let m: Vec<f64> =
        (0..n * n).map(|at| if at / n == at % n { s - w[at] * w[at] } else { -(w[at] * w[at]) }).collect();
    let (inverse, det) = dense::inverse(&m, n)?;
    if !(det > 0.0 && inverse.iter().all(|x| *x >= -1e-16)) {
        return None;
    }
    Some((inverse, n as f64 * libm::log(s) - libm::log(det)))
}

/// Fits a linear structure to scalar factors.
///
/// # Errors
/// If factors have more than one dimension, or samples are too few or not finite.
pub fn fit(samples: &Samples, settings: &Settings) -> Result<Fit> {
    let n = samples.n();
    if samples.k() != 1 {
        return Err(Error::input("linear structure")
            .expected("factors of one dimension")
            .got(samples.k().to_string()));
    }
    samples.standardised()?; // rejects values that are not finite or do not vary
    let covariances = (0..n).map(|j| moments(samples, j)).collect::<Result<Vec<_>>>()?;
    let mut w = vec![0.0; n * n];
    let (mut mu, mut steps, mut h) = (1.0, 0, 0.0);
    for (round, &first_s) in settings.s.iter().enumerate() {
        let most = if round + 1 == settings.s.len() { settings.last_steps } else { settings.warm_steps };
        let mut s = first_s;
        let mut inside = loop {
            match barrier(&w, n, s) {
                Some(found) => break found,
                None => s += 0.1,
            }
        };
        let (mut m, mut v) = (vec![0.0; n * n], vec![0.0; n * n]);
        let (mut powers, mut rate, mut last) = ([1.0, 1.0], settings.rate, None);
        for step in 1..=most {
            let (gradient, value) = data_term(&covariances, &w, n, settings.loss);
            if step % settings.check_every == 0 {
                let size = w.iter().fold(0.0, |s, w| s + w.abs());
                let objective = mu * (value + settings.sparsity * size) + inside.1;
                if last.is_some_and(|l: f64| (l - objective).abs() <= settings.tolerance * l.abs()) {
                    break;
                }
                last = Some(objective);
            }
            powers = [powers[0] * BETAS[0], powers[1] * BETAS[1]];
            let mut direction = vec![0.0; n * n];
            for at in (0..n * n).filter(|at| at / n != at % n) {
                let sign = f64::from(i8::from(w[at] > 0.0) - i8::from(w[at] < 0.0));
                let transposed = inside.0[at % n * n + at / n];
                let g = mu * (gradient[at] + settings.sparsity * sign) + 2.0 * w[at] * transposed;
                m[at] = BETAS[0] * m[at] + (1.0 - BETAS[0]) * g;
                v[at] = BETAS[1] * v[at] + (1.0 - BETAS[1]) * (g * g);
                direction[at] = m[at] / (1.0 - powers[0]) / ((v[at] / (1.0 - powers[1])).sqrt() + EPS);
            }
            steps += 1;
            let moved = loop {
                let next: Vec<f64> = w.iter().zip(&direction).map(|(w, d)| w - rate * d).collect();
                match barrier(&next, n, s) {
                    Some(found) => break Some((next, found)),
                    None if rate < 1e-16 => break None,
                    None => rate *= 0.5,
                }
            };
            match moved {
                Some((next, found)) => (w, inside) = (next, found),
                None => break, // at the border of the domain
            }
        }
        h = inside.1;
        mu *= settings.mu_factor;
    }
    let graph = repair(n, &w, settings.threshold).0;
    Ok(Fit { weights: w, graph, h, steps })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::rng::Rng;

    #[test]
    fn gradients_are_those_of_differences() {
        let (n, rng) = (3, Rng::new(4));
        let draw = |at: usize, purpose: u16| rng.uniform_f64(at as u64, 0, purpose, 0) - 0.5;
        let w: Vec<f64> = (0..n * n).map(|at| if at % 4 == 0 { 0.0 } else { draw(at, 1) }).collect();
        // Covariances A Aᵀ + I, one per node.
        let covariance = |j: u16| -> Vec<f64> {
            let a: Vec<f64> = (0..n * n).map(|at| draw(at, 2 + j)).collect();
            let of = |r: usize, c: usize| (0..n).fold(0.0, |s, k| s + a[r * n + k] * a[c * n + k]);
            (0..n * n).map(|at| of(at / n, at % n) + f64::from(u8::from(at / n == at % n))).collect()
        };
        let covariances: Vec<Vec<f64>> = (0..n as u16).map(covariance).collect();
        let h = 1e-6;
        let difference = |f: &dyn Fn(&[f64]) -> f64, at: usize| {
            let [up, down] = [h, -h].map(|h| {
                let mut w = w.clone();
                w[at] += h;
                f(&w)
            });
            (up - down) / (2.0 * h)
        };
        let (inverse, _) = barrier(&w, n, 1.0).expect("inside the domain");
        for at in (0..n * n).filter(|at| at / n != at % n) {
            for loss in [Loss::Squares, Loss::Likelihood] {
                let (gradient, _) = data_term(&covariances, &w, n, loss);
                let expected = difference(&|w| data_term(&covariances, w, n, loss).1, at);
                assert!((gradient[at] - expected).abs() < 1e-8, "{loss:?}, edge {at}");
            }
            let expected = difference(&|w| barrier(w, n, 1.0).expect("inside the domain").1, at);
            let gradient = 2.0 * w[at] * inverse[at % n * n + at / n];
            assert!((gradient - expected).abs() < 1e-8, "barrier, edge {at}");
        }
    }
}
