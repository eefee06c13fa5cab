//! `causal.structure`: from independent causes to factors along a graph, and back.
//!
//! nonlinear   Z⁰ = ε;   Zⱼᵗ⁺¹ = gⱼ(Ã(·,j)∘Zᵗ) − gⱼ(0) + εⱼ,  t = 0 … sweeps − 1
//! linear      Z⁰ = ε;   Zᵗ⁺¹ = WᵀZᵗ + ε,  W = Ã∘Ω,          t = 0 … sweeps − 1   (Z = Σₜ (Wᵀ)ᵗ ε)
//! abduct      εⱼ = uⱼ − (gⱼ(Ã(·,j)∘u) − gⱼ(0)), or ε = u − Wᵀu
//!
//! Source: structural causal models with additive noise; the linear form is that of NOTEARS and DAG-GNN. gⱼ is a network of two
//! hidden layers with leaky ReLU, over the concatenation of all n factors, each scaled by its edge into j. It is centred,
//! so a node without parents is exactly its cause. On a graph without cycles n sweeps (n − 1 in linear mode) are exact at
//! every node, and abduction is their inverse.
//!
//! | symbol | argument  | shape     | remarks |
//! |--------|-----------|-----------|---------|
//! | ε, u   | `eps`     | (B, n, k) | what enters: causes; factors in mode abduct |
//! | Ã      | `mask`    | (n, n)    | `mask[i,j]` is the edge i → j; used as it is, diagonal included |
//! | Ω      | `weight`  | (n, n)    | the linear mechanism |
//! | g      | `w0` `b0` | (n, h, n·k), (n, h) | first layer of every node |
//! |        | `w1` `b1` | (n, h, h), (n, h)   | second layer |
//! |        | `w2` `b2` | (n, k, h), (n, k)   | last layer; `b2` cancels in gⱼ(x) − gⱼ(0) and is not used |
//! | Z, ε   | `z`       | (B, n, k) | what leaves: factors; causes in mode abduct |
//!
//! # Rounding
//! Every layer is a left fold from +0 over its inputs, the bias added last. gⱼ(0) runs through the same code, so that
//! gⱼ(x) − gⱼ(0) is exactly 0 at x = 0. WᵀZ is a left fold over i. The cause is added last.
//!
//! # Kinks and domain
//! Leaky ReLU has slope 1 above 0 and `slope` at 0 and below.
//!
//! # Adjoint
//! Reverse through the sweeps, samples in ascending order, nodes in ascending order; hidden layers are recomputed from the saved
//! sweeps. ε̄ collects the cotangent of every sweep. The cotangents at gⱼ(0) are summed over samples and sweeps and go
//! through the network once.
//!
//! # Example
//! ```
//! use lastlight::causal::structure::{In, Mechanism, forward};
//! // two factors of one number, 0 → 1 with weight 2
//! let mechanism = Mechanism::Linear { weight: &[0.0, 2.0, 0.0, 0.0] };
//! let x = In { eps: &[1.0, 0.5], mask: &[0.0, 1.0, 0.0, 0.0], mechanism, batch: 1, n: 2, k: 1, sweeps: 1 };
//! assert_eq!(forward(&x).0, [1.0, 2.5]);
//! ```

use super::mechanism::{At, Bank, Zero};
pub use super::mechanism::{Mechanism, MechanismBar, Networks};

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// (B, n, k)
    pub eps: &'a [f64],
    /// (n, n)
    pub mask: &'a [f64],
    /// how parents act
    pub mechanism: Mechanism<'a>,
    /// samples B
    pub batch: usize,
    /// factors n
    pub n: usize,
    /// numbers of a factor k
    pub k: usize,
    /// passes over all nodes; abduction takes none
    pub sweeps: usize,
}

/// A value that one factor of one sample is held at.
pub type Hold<'a> = Option<(usize, &'a [f64])>;

/// Gradients, accumulated into.
#[derive(Clone, Debug, PartialEq)]
pub struct InBar {
    /// (B, n, k)
    pub eps: Vec<f64>,
    /// (n, n)
    pub mask: Vec<f64>,
    /// of the mechanism
    pub mechanism: MechanismBar,
}

impl InBar {
    /// Zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        Self {
            eps: vec![0.0; x.eps.len()],
            mask: vec![0.0; x.mask.len()],
            mechanism: MechanismBar::zeros_like(&x.mechanism),
        }
    }
}

/// What the adjoint needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Saved {
    /// Z⁰ … Z before the last sweep, per sample: (B, sweeps, n, k)
    pub states: Vec<f64>,
    zero: Zero,
}

/// Z, and what the adjoint needs.
///
/// # Panics
/// When a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>) -> (Vec<f64>, Saved) {
    forward_held(x, |_| None)
}

/// [`forward`] with one factor of a sample held at a value: its cause is that value, and no edge enters it.
pub fn forward_held<'h>(x: &In<'_>, hold: impl Fn(usize) -> Hold<'h>) -> (Vec<f64>, Saved) {
    let bank = bank(x);
    let zero = bank.zero();
    let (n, k, d) = (x.n, x.k, x.n * x.k);
    let mut states = Vec::with_capacity(x.sweeps * x.eps.len());
    let mut z = Vec::with_capacity(x.eps.len());
    for b in 0..x.batch {
        let held = hold(b);
        let mut cause = x.eps[b * d..(b + 1) * d].to_vec();
        if let Some((node, value)) = held {
            cause[node * k..(node + 1) * k].copy_from_slice(value);
        }
        let mut state = cause.clone();
        for _ in 0..x.sweeps {
            let mut next = cause.clone();
            for j in (0..n).filter(|j| held.is_none_or(|(node, _)| node != *j)) {
                let effect = bank.effect(&zero, j, &state);
                for (next, effect) in next[j * k..].iter_mut().zip(&effect) {
                    *next = effect + *next;
                }
            }
            states.extend_from_slice(&state);
            state = next;
        }
        z.extend_from_slice(&state);
    }
    (z, Saved { states, zero })
}

/// Adds the gradients for the cotangent `z_bar` (B, n, k).
///
/// # Panics
/// When a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, saved: &Saved, z_bar: &[f64], bar: &mut InBar) {
    adjoint_held(x, saved, z_bar, |_| None, bar, &mut []);
}

/// [`adjoint`] of the held form: a held factor's cotangent goes to `value_bar` (B, k) and its cause gets none.
pub fn adjoint_held<'h>(
    x: &In<'_>,
    saved: &Saved,
    z_bar: &[f64],
    hold: impl Fn(usize) -> Hold<'h>,
    bar: &mut InBar,
    value_bar: &mut [f64],
) {
    let bank = bank(x);
    let (n, k, d) = (x.n, x.k, x.n * x.k);
    assert!(z_bar.len() == x.eps.len() && bar.eps.len() == x.eps.len(), "cotangents have the shape of eps");
    let mut zero_bar = vec![0.0; d];
    for b in 0..x.batch {
        let held = hold(b).map(|(node, _)| node);
        let mut state_bar = z_bar[b * d..(b + 1) * d].to_vec();
        let mut cause_bar = vec![0.0; d];
        for t in (0..x.sweeps).rev() {
            let state = &saved.states[(b * x.sweeps + t) * d..][..d];
            let mut before = vec![0.0; d];
            for j in 0..n {
                let c = &state_bar[j * k..(j + 1) * k];
                add(&mut cause_bar[j * k..], c);
                if held != Some(j) {
                    add(&mut zero_bar[j * k..], c);
                    bank.effect_adjoint(
                        At { node: j, z: state },
                        c,
                        &mut before,
                        &mut bar.mask,
                        &mut bar.mechanism,
                    );
                }
            }
            state_bar = before;
        }
        add(&mut cause_bar, &state_bar);
        if let Some(node) = held {
            add(&mut value_bar[b * k..], &cause_bar[node * k..(node + 1) * k]);
            cause_bar[node * k..(node + 1) * k].fill(0.0);
        }
        add(&mut bar.eps[b * d..], &cause_bar);
    }
    bank.zero_adjoint(&saved.zero, &zero_bar, &mut bar.mechanism);
}

/// The causes behind factors: `eps` holds u, the result ε.
///
/// # Panics
/// When a buffer does not have the size of its shape.
pub fn abduct(x: &In<'_>) -> Vec<f64> {
    let bank = bank(x);
    let zero = bank.zero();
    let d = x.n * x.k;
    let mut out = Vec::with_capacity(x.eps.len());
    for u in x.eps.chunks_exact(d) {
        for j in 0..x.n {
            let effect = bank.effect(&zero, j, u);
            out.extend(u[j * x.k..].iter().zip(&effect).map(|(u, effect)| u - effect));
        }
    }
    out
}

/// Adds the gradients of [`abduct`] for the cotangent `out_bar` (B, n, k).
///
/// # Panics
/// When a buffer does not have the size of its shape.
pub fn abduct_adjoint(x: &In<'_>, out_bar: &[f64], bar: &mut InBar) {
    let bank = bank(x);
    let (k, d) = (x.k, x.n * x.k);
    assert!(out_bar.len() == x.eps.len() && bar.eps.len() == x.eps.len(), "cotangents have the shape of eps");
    let mut zero_bar = vec![0.0; d];
    for b in 0..x.batch {
        let u = &x.eps[b * d..(b + 1) * d];
        let mut u_bar = out_bar[b * d..(b + 1) * d].to_vec();
        for j in 0..x.n {
            let c: Vec<f64> = out_bar[b * d + j * k..][..k].iter().map(|c| -c).collect();
            add(&mut zero_bar[j * k..], &c);
            bank.effect_adjoint(At { node: j, z: u }, &c, &mut u_bar, &mut bar.mask, &mut bar.mechanism);
        }
        add(&mut bar.eps[b * d..], &u_bar);
    }
    bank.zero_adjoint(&bank.zero(), &zero_bar, &mut bar.mechanism);
}

fn bank<'a>(x: &In<'a>) -> Bank<'a> {
    assert_eq!(x.eps.len(), x.batch * x.n * x.k, "eps is (B, n, k)");
    Bank::new(x.mask, x.mechanism, x.n, x.k)
}

fn add(into: &mut [f64], what: &[f64]) {
    into.iter_mut().zip(what).for_each(|(into, what)| *into += what);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::rng::Rng;

    const N: usize = 4;
    const K: usize = 2;
    const H: usize = 5;
    const D: usize = N * K;

    /// Numbers of one random graph without cycles, whose nodes stand in a random order.
    struct Draw {
        order: Vec<usize>,
        mask: Vec<f64>,
        weight: Vec<f64>,
        eps: Vec<f64>,
        layers: [Vec<f64>; 5],
    }

    fn draw(step: u32) -> Draw {
        let normals = |part: u32, len: usize| -> Vec<f64> {
            (0..len).map(|i| f64::from(Rng::new(7).normal_f32(i as u64, step, 0x7e57, part))).collect()
        };
        let mut order: Vec<usize> = (0..N).collect();
        let keys = normals(0, N);
        order.sort_by(|a, b| keys[*a].total_cmp(&keys[*b]));
        let edges = normals(1, N * N);
        let mut mask = vec![0.0; N * N];
        for (place, i) in order.iter().enumerate() {
            for j in &order[place + 1..] {
                let edge = edges[i * N + j];
                mask[i * N + j] = if edge > -0.3 { 1.0 } else { 0.0 };
            }
        }
        let layers = [(2, N * H * D), (3, N * H), (4, N * H * H), (5, N * H), (6, N * K * H)];
        let layers = layers.map(|(part, len)| normals(part, len).iter().map(|x| 0.5 * x).collect());
        Draw { order, mask, weight: normals(7, N * N), eps: normals(8, D), layers }
    }

    impl Draw {
        fn input(&self, linear: bool) -> In<'_> {
            let [w0, b0, w1, b1, w2] = &self.layers;
            let mechanism = if linear {
                Mechanism::Linear { weight: &self.weight }
            } else {
                Mechanism::Networks(Networks { w0, b0, w1, b1, w2, hidden: H, slope: 0.05 })
            };
            let sweeps = if linear { N - 1 } else { N };
            In { eps: &self.eps, mask: &self.mask, mechanism, batch: 1, n: N, k: K, sweeps }
        }
    }

    /// Solves (I − Wᵀ) z = ε by elimination with pivots.
    fn solved(w: &[f64], eps: &[f64]) -> Vec<f64> {
        let mut rows: Vec<Vec<f64>> = (0..N)
            .map(|r| {
                let left = (0..N).map(|c| f64::from(u8::from(r == c)) - w[c * N + r]);
                left.chain(eps[r * K..(r + 1) * K].iter().copied()).collect()
            })
            .collect();
        for c in 0..N {
            let best = (c..N).max_by(|a, b| rows[*a][c].abs().total_cmp(&rows[*b][c].abs()));
            rows.swap(c, best.expect("a row is left"));
            let pivot = rows[c].clone();
            for (r, row) in rows.iter_mut().enumerate().filter(|(r, _)| *r != c) {
                let factor = row[c] / pivot[c];
                assert!(factor.is_finite(), "row {r}: I − Wᵀ of a graph without cycles has an inverse");
                row.iter_mut().zip(&pivot).for_each(|(x, p)| *x -= factor * p);
            }
        }
        (0..N).flat_map(|r| (0..K).map(move |c| (r, c))).map(|(r, c)| rows[r][N + c] / rows[r][r]).collect()
    }

    #[test]
    fn truncated_sum_is_the_inverse_on_a_thousand_graphs() {
        let mut worst = 0.0;
        for step in 0..1000 {
            let d = draw(step);
            let w: Vec<f64> = d.mask.iter().zip(&d.weight).map(|(m, w)| m * w).collect();
            let exact = solved(&w, &d.eps);
            let z = forward(&d.input(true)).0;
            let scale = exact.iter().fold(1.0, |m: f64, x| if x.abs() > m { x.abs() } else { m });
            for (a, b) in z.iter().zip(&exact) {
                let error = (a - b).abs() / scale;
                worst = if error > worst { error } else { worst };
            }
        }
        assert!(worst < 1e-12, "largest difference {worst:e}");
    }

    #[test]
    fn sweeps_are_ancestral_evaluation_bit_for_bit() {
        for step in 0..200 {
            let d = draw(step);
            for linear in [true, false] {
                let x = d.input(linear);
                let bank = bank(&x);
                let zero = bank.zero();
                let mut z = vec![0.0; D];
                for j in &d.order {
                    let effect = bank.effect(&zero, *j, &z);
                    for c in 0..K {
                        z[j * K + c] = effect[c] + d.eps[j * K + c];
                    }
                }
                let swept = forward(&x).0;
                let bits = |z: &[f64]| z.iter().map(|z| z.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(&swept), bits(&z), "graph {step}, linear {linear}");
            }
        }
    }

    #[test]
    fn abduction_is_undone_by_sweeps() {
        for step in 0..200 {
            let d = draw(step);
            for linear in [true, false] {
                let x = d.input(linear);
                let causes = abduct(&x);
                let again = forward(&In { eps: &causes, ..x }).0;
                for (a, b) in again.iter().zip(&d.eps) {
                    assert!((a - b).abs() <= 1e-12, "graph {step}, linear {linear}: {a} for {b}");
                }
            }
        }
    }
}
