//! Learns a nonlinear structure with masks, after MCSL (Ng, Zhu, Fang, Li, Chen and Wang 2022): one small
//! network per node, whose inputs are multiplied by a column of a random mask.
//!
//! Ã_ij = σ((U_ij + l_ij)/τ),  l = ln u − ln(1 − u),   p_ij = σ(U_ij/τ),   i ≠ j
//!
//! loss = Σ_j ℓ(Q_j) + w_s Σ Ã_ij + λ h(p) + ½ ρ h(p)²,   Q_j = mean of (x_bj − f_j(Ã_·j ∘ x_b))² over samples b in which j was not set
//!
//! h = tr((I + p∘p)ⁿ) − n,   ℓ: [`Loss`]
//!
//! f_j: n → 16 → 16 → 16 → 16 → 1, leaky ReLU of slope 0.05. Networks and U are optimised by Adam. After
//! every outer round λ += ρh, and ρ grows tenfold unless h fell to a quarter; the fit ends when h ≤ the
//! tolerance, after two rounds at the earliest, or when ρ reaches its limit. Edges are those with p > ½, with
//! cycles removed.
//!
//! There are two deviations from the published code: u is drawn again in every step (there the noise never
//! changes), and the sparsity term is the sum of the entries (there the largest column sum). Its constants
//! (rates 3e-2, ρ from 1e-5 to 1e14, 1000 steps a round, U trained from the start) are not used either: with
//! them, both directions of an edge saturate before the penalty has an effect, and which one remains is
//! arbitrary. Here U is trained slowly, and only after the networks can predict under any mask. A step uses
//! `batch` samples drawn with replacement. Values are standardised first.
//!
//! # Rounding
//! Products with weights are left folds over inputs; gradients are left folds over the samples of a batch,
//! one node per task.

use super::Loss;
use super::samples::Samples;
use crate::causal::repair::repair;
use crate::causal::{acyclic, mask, probability};
use crate::math::digraph::Digraph;
use crate::num::rng::Rng;
use crate::num::{order, par};
use crate::{Error, Result};

/// Purpose numbers of random draws.
mod purpose {
    /// Weights of networks; item: node · 2³² + weight.
    pub(super) const NET: u16 = 0x0840;
    /// Logits at the start; item: edge.
    pub(super) const LOGIT: u16 = 0x0841;
    /// Noise of masks; item: edge, step: step.
    pub(super) const MASK: u16 = 0x0842;
    /// Samples of a batch; item: place, step: step.
    pub(super) const BATCH: u16 = 0x0843;
}

/// Constants of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The loss ℓ.
    pub loss: Loss,
    /// The temperature τ.
    pub temperature: f64,
    /// The sparsity weight w_s.
    pub sparsity: f64,
    /// Learning rates of Adam for networks and for U.
    pub rates: [f64; 2],
    /// Number of steps before U is trained, in which the networks learn to predict under any mask.
    pub frozen: usize,
    /// Number of samples per step.
    pub batch: usize,
    /// Maximum number of outer rounds.
    pub rounds: usize,
    /// Number of steps per round.
    pub steps: usize,
    /// Initial value and limit of ρ.
    pub rho: [f64; 2],
    /// Values of h up to this one count as 0.
    pub tolerance: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            loss: Loss::Likelihood,
            temperature: 0.2,
            sparsity: 2e-3,
            rates: [1e-2, 3e-3],
            frozen: 1000,
            batch: 128,
            rounds: 25,
            steps: 500,
            rho: [1e-3, 1e8],
            tolerance: 1e-10,
        }
    }
}

/// The result of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The probabilities p, with zero diagonal, shape (n, n).
    pub probabilities: Vec<f64>,
    /// The edges with p > ½, with cycles removed.
    pub graph: Digraph,
    /// Final value of h(p).
    pub h: f64,
    /// Number of outer rounds.
    pub rounds: usize,
}

/// Width of a hidden layer.
const H: usize = 16;
/// Number of hidden layers.
const LAYERS: usize = 4;
/// Slope of the leaky ReLU below 0.
const SLOPE: f64 = 0.05;
const BETAS: [f64; 2] = [0.9, 0.999];
const EPS: f64 = 1e-8;
/// Constant added to Q, in units of a standardised variance.
const FLOOR: f64 = 1e-4;

/// Largest |U|: the slope of p does not vanish, and the h of a cycle of one certain edge and one certainly
/// absent edge is far below any tolerance.
const LIMIT: f64 = 3.0;

/// Adam over a flat buffer.
struct Adam {
    m: Vec<f64>,
    v: Vec<f64>,
    powers: [f64; 2],
}

impl Adam {
    fn new(len: usize) -> Self {
        Self { m: vec![0.0; len], v: vec![0.0; len], powers: [1.0; 2] }
    }

    fn step(&mut self, x: &mut [f64], gradient: &[f64], rate: f64) {
        self.powers = [self.powers[0] * BETAS[0], self.powers[1] * BETAS[1]];
        for (i, g) in gradient.iter().enumerate() {
            self.m[i] = BETAS[0] * self.m[i] + (1.0 - BETAS[0]) * g;
            self.v[i] = BETAS[1] * self.v[i] + (1.0 - BETAS[1]) * (g * g);
            let (m, v) = (self.m[i] / (1.0 - self.powers[0]), self.v[i] / (1.0 - self.powers[1]));
            x[i] -= rate * m / (v.sqrt() + EPS);
        }
    }
}

/// One network: (n, H) weights and (H) biases, three times (H, H) and (H), (H) and 1; inputs are rows.
struct Net {
    n: usize,
    weights: Vec<f64>,
    adam: Adam,
}

type Row = [f64; H];

fn row(from: &[f64], at: usize) -> &Row {
    from[at..].first_chunk().expect("a layer has H columns")
}

fn row_mut(from: &mut [f64], at: usize) -> &mut Row {
    from[at..].first_chunk_mut().expect("a layer has H columns")
}

/// Start of hidden layer `l` and its number of inputs.
fn layer(n: usize, l: usize) -> (usize, usize) {
    if l == 0 { (0, n) } else { ((n + 1) * H + (l - 1) * (H + 1) * H, H) }
}

impl Net {
    fn new(n: usize, node: usize, rng: Rng) -> Self {
        let len = (n + 1) * H + (LAYERS - 1) * (H + 1) * H + H + 1;
        let mut weights: Vec<f64> = (0..len)
            .map(|at| 2.0 * rng.uniform_f64((node as u64) << 32 | at as u64, 0, purpose::NET, 0) - 1.0)
            .collect();
        // uniform within 1/√inputs
        for l in 0..LAYERS {
            let (start, inputs) = layer(n, l);
            let scale = 1.0 / (inputs as f64).sqrt();
            weights[start..start + (inputs + 1) * H].iter_mut().for_each(|w| *w *= scale);
        }
        weights[len - H - 1..].iter_mut().for_each(|w| *w *= 0.25); // 1/√H
        Self { n, weights, adam: Adam::new(len) }
    }

    /// Output for inputs x; stores the values before each activation.
    fn value(&self, x: &[f64], before: &mut [Row; LAYERS]) -> f64 {
        let mut input = [0.0; H];
        for l in 0..LAYERS {
            let (start, inputs) = layer(self.n, l);
            let mut sums = *row(&self.weights, start + inputs * H);
            let values = if l == 0 { x } else { &input[..] };
            for (i, v) in values.iter().enumerate() {
                for (sum, w) in sums.iter_mut().zip(row(&self.weights, start + i * H)) {
                    *sum += v * w;
                }
            }
            before[l] = sums;
            input = sums.map(|s| if s > 0.0 { s } else { SLOPE * s });
        }
        let last = self.weights.len() - H - 1;
        row(&self.weights, last).iter().zip(&input).fold(self.weights[last + H], |s, (w, v)| s + w * v)
    }

    /// Adds the gradients of weights and inputs for the cotangent `bar` of the output.
    fn pull_back(&self, x: &[f64], before: &[Row; LAYERS], bar: f64, to: &mut [f64], x_bar: &mut [f64]) {
        let active = |l: usize| before[l].map(|s| if s > 0.0 { s } else { SLOPE * s });
        let last = self.weights.len() - H - 1;
        let mut sums_bar = [0.0; H];
        let after = active(LAYERS - 1);
        for o in 0..H {
            to[last + o] += bar * after[o];
            sums_bar[o] = bar * self.weights[last + o];
        }
        to[last + H] += bar;
        for l in (0..LAYERS).rev() {
            for (bar, s) in sums_bar.iter_mut().zip(&before[l]) {
                *bar *= if *s > 0.0 { 1.0 } else { SLOPE };
            }
            let (start, inputs) = layer(self.n, l);
            for (to, bar) in row_mut(to, start + inputs * H).iter_mut().zip(&sums_bar) {
                *to += bar;
            }
            let hidden = if l > 0 { active(l - 1) } else { [0.0; H] };
            let values = if l == 0 { x } else { &hidden[..] };
            let mut input_bar = [0.0; H];
            for (i, v) in values.iter().enumerate() {
                for (to, bar) in row_mut(to, start + i * H).iter_mut().zip(&sums_bar) {
                    *to += v * bar;
                }
                let pulled =
                    row(&self.weights, start + i * H).iter().zip(&sums_bar).fold(0.0, |s, (w, b)| s + w * b);
                if l == 0 {
                    x_bar[i] += pulled;
                } else {
                    input_bar[i] = pulled;
                }
            }
            sums_bar = input_bar;
        }
    }
}

/// One step of a network over a batch; returns the gradient of the mask's column (n).
fn train_node(
    net: &mut Net,
    samples: &Samples,
    batch: &[usize],
    j: usize,
    mask: &[f64],
    settings: &Settings,
) -> Vec<f64> {
    let n = net.n;
    let mut gradient = vec![0.0; net.weights.len()];
    let (mut column, mut x, mut before) = (vec![0.0; n], vec![0.0; n], [[0.0; H]; LAYERS]);
    let (mut squares, mut seen) = (0.0, 0.0);
    for &s in batch.iter().filter(|&&s| samples.target(s) != Some(j)) {
        let values = samples.row(s);
        for (i, x) in x.iter_mut().enumerate() {
            *x = mask[i * n + j] * values[i];
        }
        let error = net.value(&x, &mut before) - values[j];
        let mut x_bar = vec![0.0; n];
        net.pull_back(&x, &before, error, &mut gradient, &mut x_bar);
        squares += error * error;
        seen += 1.0;
        for (i, c) in column.iter_mut().enumerate() {
            *c += x_bar[i] * values[i];
        }
    }
    if seen > 0.0 {
        let (_, slope) = settings.loss.of(squares / seen + FLOOR);
        let scale = 2.0 * slope / seen;
        gradient.iter_mut().chain(&mut column).for_each(|g| *g *= scale);
        net.adam.step(&mut net.weights, &gradient, settings.rates[0]);
    }
    column
}

/// Fits masks and networks to scalar factors.
///
/// # Errors
/// If factors have more than one dimension, or samples are too few, not finite or do not vary.
pub fn fit(samples: &Samples, settings: &Settings, seed: u64) -> Result<Fit> {
    let n = samples.n();
    if samples.k() != 1 || settings.batch == 0 {
        return Err(Error::input("structure by masks")
            .expected("factors of one dimension and a batch of at least one")
            .got(format!("{} dimensions, a batch of {}", samples.k(), settings.batch)));
    }
    let samples = samples.standardised()?;
    let (rng, tau) = (Rng::new(seed), settings.temperature);
    let mut logits: Vec<f64> =
        (0..n * n).map(|at| 1e-10 * (2.0 * rng.uniform_f64(at as u64, 0, purpose::LOGIT, 0) - 1.0)).collect();
    let mut nets: Vec<Net> = (0..n).map(|j| Net::new(n, j, rng)).collect();
    let mut adam = Adam::new(n * n);
    let (mut lambda, mut rho, mut earlier, mut rounds) = (0.0, settings.rho[0], f64::INFINITY, 0);
    while rounds < settings.rounds {
        for inner in 0..settings.steps {
            let step = (rounds * settings.steps + inner) as u32;
            let uniform: Vec<f64> =
                (0..n * n).map(|at| rng.uniform_f64(at as u64, step, purpose::MASK, 0)).collect();
            let drawn = mask::In { logits: &logits, uniform: &uniform, allowed: None, n, tau };
            let mask = mask::forward(&drawn);
            let batch: Vec<usize> = (0..settings.batch)
                .map(|b| rng.index(samples.count(), b as u64, step, purpose::BATCH, 0))
                .collect();
            let columns = par::map_each(nets.iter_mut().collect(), |j, net| {
                train_node(net, &samples, &batch, j, &mask, settings)
            });
            let p = probability::forward(&logits, n, tau);
            let (h, saved) = acyclic::forward(&p, n, 1.0);
            let mask_bar: Vec<f64> =
                (0..n * n).map(|at| columns[at % n][at / n] + settings.sparsity).collect();
            let (mut gradient, mut p_bar) = (vec![0.0; n * n], vec![0.0; n * n]);
            mask::adjoint(&drawn, &mask_bar, &mut gradient);
            acyclic::adjoint(&p, n, 1.0, &saved, lambda + rho * h, &mut p_bar);
            probability::adjoint(&p, n, tau, &p_bar, &mut gradient);
            if step as usize >= settings.frozen {
                adam.step(&mut logits, &gradient, settings.rates[1]);
                logits.iter_mut().for_each(|u| *u = order::clamp(*u, -LIMIT, LIMIT));
            }
        }
        rounds += 1;
        let (h, _) = acyclic::forward(&probability::forward(&logits, n, tau), n, 1.0);
        lambda += rho * h;
        if h > 0.25 * earlier {
            rho *= 10.0;
        }
        earlier = h;
        if (h <= settings.tolerance && rounds >= 2) || rho >= settings.rho[1] {
            break;
        }
    }
    let p = probability::forward(&logits, n, tau);
    let graph = repair(n, &p, 0.5).0;
    Ok(Fit { h: acyclic::forward(&p, n, 1.0).0, probabilities: p, graph, rounds })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_of_networks_are_those_of_differences() {
        let (n, rng) = (3, Rng::new(1));
        let mut net = Net::new(n, 0, rng);
        let x = [0.7, -0.4, 1.2];
        let mut before = [[0.0; H]; LAYERS];
        net.value(&x, &mut before);
        let (mut by_weight, mut by_x) = (vec![0.0; net.weights.len()], [0.0; 3]);
        net.pull_back(&x, &before, 1.0, &mut by_weight, &mut by_x);
        let h = 1e-6;
        for at in 0..net.weights.len() {
            let w = net.weights[at];
            let [up, down] = [h, -h].map(|h| {
                net.weights[at] = w + h;
                net.value(&x, &mut before)
            });
            net.weights[at] = w;
            let difference = (up - down) / (2.0 * h);
            assert!(
                (difference - by_weight[at]).abs() < 1e-8,
                "weight {at}: {difference}, {}",
                by_weight[at]
            );
        }
        for i in 0..3 {
            let [up, down] = [h, -h].map(|h| {
                let mut x = x;
                x[i] += h;
                net.value(&x, &mut before)
            });
            assert!(((up - down) / (2.0 * h) - by_x[i]).abs() < 1e-8, "input {i}");
        }
    }
}
