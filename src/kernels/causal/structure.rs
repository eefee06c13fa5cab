//! `causal.structure`: the map from independent causes to factors along a graph, and its inverse.
//!
//! nonlinear   Z⁰ = ε;   Zⱼᵗ⁺¹ = gⱼ(Ã(·,j)∘Zᵗ) − gⱼ(0) + εⱼ,  t = 0 … sweeps − 1
//! linear      Z⁰ = ε;   Zᵗ⁺¹ = WᵀZᵗ + ε,  W = Ã∘Ω,          t = 0 … sweeps − 1   (Z = Σₜ (Wᵀ)ᵗ ε)
//! printed     linear for t = 0 … sweeps − 2, nonlinear for the last sweep: with n sweeps, eq. 2 of LAST
//! followed by one application of eq. 3
//! abduct      εⱼ = uⱼ − (gⱼ(Ã(·,j)∘u) − gⱼ(0)), or ε = u − Wᵀu
//!
//! Source: LAST, eqs. 2 and 3; structural causal models with additive noise. The linear form is that of
//! NOTEARS and DAG-GNN. gⱼ is a network with two hidden layers and leaky ReLU over the concatenation of all n
//! factors, each scaled by its edge into j. The network is centred, so a node without parents equals its
//! cause exactly. On an acyclic graph n sweeps (n − 1 in linear mode) are exact at every node, and abduction
//! is their inverse.
//!
//! | symbol | argument  | shape     | remarks |
//! |--------|-----------|-----------|---------|
//! | ε, u   | `eps`     | (B, n, k) | input: causes; factors in mode abduct |
//! | Ã      | `mask`    | (n, n)    | `mask[i,j]` is the edge i → j; all entries are used, including the diagonal |
//! | Ω      | `weight`  | (n, n)    | the linear mechanism |
//! | g      | `w0` `b0` | (n, h, n·k), (n, h) | first layer of every node |
//! |        | `w1` `b1` | (n, h, h), (n, h)   | second layer |
//! |        | `w2` `b2` | (n, k, h), (n, k)   | last layer; `b2` cancels in gⱼ(x) − gⱼ(0) and is not used |
//! | Z, ε   | `z`       | (B, n, k) | output: factors; causes in mode abduct |
//!
//! # Rounding
//! Every layer is a left fold from +0 over its inputs, and the bias is added last. gⱼ(0) is computed by the
//! same code, so that gⱼ(x) − gⱼ(0) is exactly 0 at x = 0. WᵀZ is a left fold over i. The cause is added
//! last.
//!
//! # Kinks and domain
//! Leaky ReLU has the slope 1 above 0 and `slope` at 0 and below.
//!
//! # Adjoint
//! Samples are processed in ascending order; within a sample the sweeps are traversed in reverse, nodes in
//! ascending order; hidden layers are recomputed from the saved sweeps. ε̄ accumulates the cotangent of every
//! sweep. The cotangents at gⱼ(0) are summed over the sweeps of a sample and pass through the network once
//! per sample. Consecutive parts of a batch that add to the same gradients therefore give the bits of the
//! complete batch.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::structure::{In, Mechanism, forward};
//! // two one-dimensional factors, 0 → 1 with weight 2
//! let mechanism = Mechanism::Linear { weight: &[0.0, 2.0, 0.0, 0.0] };
//! let x = In { eps: &[1.0, 0.5], mask: &[0.0, 1.0, 0.0, 0.0], mechanism, batch: 1, n: 2, k: 1, sweeps: 1 };
//! assert_eq!(forward(&x).0, [1.0, 2.5]);
//! ```

use super::mechanism::{At, Bank, Zero, add};
pub use super::mechanism::{Mechanism, MechanismBar, Networks};

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (B, n, k).
    pub eps: &'a [f64],
    /// Shape (n, n).
    pub mask: &'a [f64],
    /// Mechanism by which parents act.
    pub mechanism: Mechanism<'a>,
    /// Number of samples B.
    pub batch: usize,
    /// Number of factors n.
    pub n: usize,
    /// Number of dimensions per factor, k.
    pub k: usize,
    /// Number of passes over all nodes; abduction does not use it.
    pub sweeps: usize,
}

/// A factor of one sample, and the value at which it is held.
pub(super) type Hold<'a> = Option<(usize, &'a [f64])>;

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, PartialEq)]
pub struct InBar {
    /// Shape (B, n, k).
    pub eps: Vec<f64>,
    /// Shape (n, n).
    pub mask: Vec<f64>,
    /// Gradients of the mechanism.
    pub mechanism: MechanismBar,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        Self {
            eps: vec![0.0; x.eps.len()],
            mask: vec![0.0; x.mask.len()],
            mechanism: MechanismBar::zeros_like(&x.mechanism),
        }
    }
}

/// Intermediate values that the adjoint needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Saved {
    /// States from Z⁰ to the Z before the last sweep, per sample, shape (B, sweeps, n, k).
    pub states: Vec<f64>,
    zero: Zero,
}

/// Returns Z and the intermediate values that the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>) -> (Vec<f64>, Saved) {
    forward_held(x, |_| None)
}

/// Like [`forward`], with one factor of a sample held at a value: its cause is that value, and it has no
/// incoming edges.
pub fn forward_held<'h>(x: &In<'_>, hold: impl Fn(usize) -> Hold<'h>) -> (Vec<f64>, Saved) {
    let bank = bank(x);
    let (zero, mut work) = (bank.zero(), bank.work());
    let (n, k, d) = (x.n, x.k, x.n * x.k);
    let mut states = Vec::with_capacity(x.sweeps * x.eps.len());
    let mut z = Vec::with_capacity(x.eps.len());
    let (mut cause, mut state, mut next) = (vec![0.0; d], vec![0.0; d], vec![0.0; d]);
    for (b, eps) in x.eps.chunks_exact(d).enumerate() {
        let held = hold(b);
        cause.copy_from_slice(eps);
        if let Some((node, value)) = held {
            cause[node * k..(node + 1) * k].copy_from_slice(value);
        }
        state.copy_from_slice(&cause);
        for t in 0..x.sweeps {
            next.copy_from_slice(&cause);
            for node in (0..n).filter(|j| held.is_none_or(|(node, _)| node != *j)) {
                let (next, cause) = (&mut next[node * k..(node + 1) * k], &cause[node * k..]);
                bank.effect(&zero, At { node, is_last: t + 1 == x.sweeps, z: &state }, &mut work, next);
                add(next, cause);
            }
            states.extend_from_slice(&state);
            std::mem::swap(&mut state, &mut next);
        }
        z.extend_from_slice(&state);
    }
    (z, Saved { states, zero })
}

/// Adds the gradients for the cotangent `z_bar` (B, n, k).
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, saved: &Saved, z_bar: &[f64], bar: &mut InBar) {
    adjoint_held(x, saved, z_bar, |_| None, bar, &mut []);
}

/// Like [`adjoint`], for the held form: the cotangent of a held factor is added to `value_bar` (B, k), and
/// its cause gets none.
pub fn adjoint_held<'h>(
    x: &In<'_>,
    saved: &Saved,
    z_bar: &[f64],
    hold: impl Fn(usize) -> Hold<'h>,
    bar: &mut InBar,
    value_bar: &mut [f64],
) {
    let bank = bank(x);
    let mut work = bank.work();
    let (n, k, d) = (x.n, x.k, x.n * x.k);
    assert!(z_bar.len() == x.eps.len() && bar.eps.len() == x.eps.len(), "cotangents have the shape of eps");
    let zeros = || vec![0.0; d];
    let (mut state_bar, mut before, mut cause_bar, mut zero_bar) = (zeros(), zeros(), zeros(), zeros());
    for b in 0..x.batch {
        let held = hold(b).map(|(node, _)| node);
        state_bar.copy_from_slice(&z_bar[b * d..(b + 1) * d]);
        cause_bar.fill(0.0);
        zero_bar.fill(0.0);
        for t in (0..x.sweeps).rev() {
            let z = &saved.states[(b * x.sweeps + t) * d..][..d];
            let is_last = t + 1 == x.sweeps;
            before.fill(0.0);
            for node in 0..n {
                let c = &state_bar[node * k..(node + 1) * k];
                add(&mut cause_bar[node * k..], c);
                if held != Some(node) {
                    if x.mechanism.is_centred(is_last) {
                        add(&mut zero_bar[node * k..], c);
                    }
                    let at = At { node, is_last, z };
                    bank.effect_adjoint(at, c, &mut work, &mut before, &mut bar.mask, &mut bar.mechanism);
                }
            }
            std::mem::swap(&mut state_bar, &mut before);
        }
        add(&mut cause_bar, &state_bar);
        if let Some(node) = held {
            add(&mut value_bar[b * k..], &cause_bar[node * k..(node + 1) * k]);
            cause_bar[node * k..(node + 1) * k].fill(0.0);
        }
        add(&mut bar.eps[b * d..], &cause_bar);
        bank.zero_adjoint(&saved.zero, &zero_bar, &mut work, &mut bar.mechanism);
    }
}

/// Returns the contributions of the parents at `state` (B, n, k) to every node (B, n, k), as in the last
/// sweep.
fn effects(x: &In<'_>, state: &[f64]) -> Vec<f64> {
    let bank = bank(x);
    let (zero, mut work) = (bank.zero(), bank.work());
    assert_eq!(state.len(), x.eps.len(), "factors have the shape of eps");
    let mut out = vec![0.0; state.len()];
    for (out, z) in out.chunks_exact_mut(x.n * x.k).zip(state.chunks_exact(x.n * x.k)) {
        for (node, out) in out.chunks_exact_mut(x.k).enumerate() {
            bank.effect(&zero, At { node, is_last: true, z }, &mut work, out);
        }
    }
    out
}

/// Adds the gradients of [`effects`] for the cotangent `c` (B, n, k).
fn effects_adjoint(x: &In<'_>, state: &[f64], c: &[f64], state_bar: &mut [f64], bar: &mut InBar) {
    let bank = bank(x);
    let (zero, mut work) = (bank.zero(), bank.work());
    let d = x.n * x.k;
    assert!(c.len() == x.eps.len() && state.len() == x.eps.len(), "cotangents have the shape of eps");
    let samples = state.chunks_exact(d).zip(c.chunks_exact(d)).zip(state_bar.chunks_exact_mut(d));
    for ((z, c), z_bar) in samples {
        for (node, c) in c.chunks_exact(x.k).enumerate() {
            let at = At { node, is_last: true, z };
            bank.effect_adjoint(at, c, &mut work, z_bar, &mut bar.mask, &mut bar.mechanism);
        }
        bank.zero_adjoint(&zero, c, &mut work, &mut bar.mechanism);
    }
}

/// Returns the causes of given factors: `eps` contains u, the result is ε. `sweeps` is not used.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn abduct(x: &In<'_>) -> Vec<f64> {
    effects(x, x.eps).into_iter().zip(x.eps).map(|(effect, u)| u - effect).collect()
}

/// Adds the gradients of [`abduct`] for the cotangent `out_bar` (B, n, k); `bar.eps` is the gradient of u.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn abduct_adjoint(x: &In<'_>, out_bar: &[f64], bar: &mut InBar) {
    let mut u_bar = out_bar.to_vec();
    let c: Vec<f64> = out_bar.iter().map(|c| -c).collect();
    effects_adjoint(x, x.eps, &c, &mut u_bar, bar);
    add(&mut bar.eps, &u_bar);
}

/// Applies the mechanism once to given factors S, as the last sweep does: Zⱼ = gⱼ(Ã(·,j)∘S) − gⱼ(0) + εⱼ, or
/// WᵀS + ε. Applied node by node in causal order, it is ancestral evaluation. `sweeps` is not used.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn apply(x: &In<'_>, state: &[f64]) -> Vec<f64> {
    effects(x, state).into_iter().zip(x.eps).map(|(effect, e)| effect + e).collect()
}

fn bank<'a>(x: &In<'a>) -> Bank<'a> {
    assert_eq!(x.eps.len(), x.batch * x.n * x.k, "eps is (B, n, k)");
    Bank::new(x.mask, x.mechanism, x.n, x.k)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::rng::Rng;

    const N: usize = 3;
    const K: usize = 2;
    const H: usize = 5;
    const D: usize = N * K;
    const BATCH: usize = 4;

    fn normals(draw: u16, len: usize) -> Vec<f64> {
        (0..len).map(|i| 0.6 * f64::from(Rng::new(7).normal_f32(i as u64, 0, 0x7e57, draw))).collect()
    }

    #[test]
    fn consecutive_parts_of_a_batch_give_the_bits_of_the_whole() {
        let (eps, mask, z_bar) = (normals(0, BATCH * D), normals(1, N * N), normals(2, BATCH * D));
        let lengths = [N * H * D, N * H, N * H * H, N * H, N * K * H];
        let [w0, b0, w1, b1, w2]: [Vec<f64>; 5] = std::array::from_fn(|i| normals(3 + i as u16, lengths[i]));
        let networks = Networks { w0: &w0, b0: &b0, w1: &w1, b1: &b1, w2: &w2, hidden: H, slope: 0.05 };
        let mechanism = Mechanism::Networks(networks);
        let part = |from: usize, to: usize| In {
            eps: &eps[from * D..to * D],
            mask: &mask,
            mechanism,
            batch: to - from,
            n: N,
            k: K,
            sweeps: N,
        };
        type Gradient = fn(&In<'_>, &[f64], &mut InBar);
        let forms: [(&str, Gradient); 2] = [
            ("sweeps", |x, z_bar, bar| adjoint(x, &forward(x).1, z_bar, bar)),
            ("back", |x, z_bar, bar| abduct_adjoint(x, z_bar, bar)),
        ];
        for (name, gradient) in forms {
            let mut whole = InBar::zeros_like(&part(0, BATCH));
            gradient(&part(0, BATCH), &z_bar, &mut whole);
            for cut in 1..BATCH {
                let (mut first, mut second) =
                    (InBar::zeros_like(&part(0, cut)), InBar::zeros_like(&part(cut, BATCH)));
                gradient(&part(0, cut), &z_bar[..cut * D], &mut first);
                (second.mask, second.mechanism) = (first.mask, first.mechanism);
                gradient(&part(cut, BATCH), &z_bar[cut * D..], &mut second);
                assert!(second.mask == whole.mask, "{name}, cut at {cut}: mask");
                assert!(second.mechanism == whole.mechanism, "{name}, cut at {cut}: networks");
                assert_eq!([first.eps, second.eps].concat(), whole.eps, "{name}, cut at {cut}: causes");
            }
        }
    }

    #[test]
    fn one_application_and_the_kink() {
        // one factor with an edge to itself: g(x) − g(0) = act(act(x) + 1) − 1
        let networks =
            Networks { w0: &[1.0], b0: &[0.0], w1: &[1.0], b1: &[1.0], w2: &[1.0], hidden: 1, slope: 0.25 };
        let mechanism = Mechanism::Networks(networks);
        let x = In { eps: &[], mask: &[1.0], mechanism, batch: 1, n: 1, k: 1, sweeps: 0 };
        for (state, effect, slope) in [(2.0, 2.0, 1.0), (-2.0, -0.5, 0.25), (0.0, 0.0, 0.25)] {
            let x = In { eps: &[state], ..x };
            assert_eq!(abduct(&x), [state - effect], "{state} − g({state})");
            let mut bar = InBar::zeros_like(&x);
            abduct_adjoint(&x, &[1.0], &mut bar);
            assert_eq!(bar.eps[0], 1.0 - slope, "slope at {state}");
        }
        let weight = [0.0, 2.0, 0.0, 0.0];
        let linear = In {
            mechanism: Mechanism::Linear { weight: &weight },
            eps: &[10.0, 5.0],
            mask: &[1.0; 4],
            n: 2,
            sweeps: 1,
            ..x
        };
        assert_eq!(forward(&linear).0, [10.0, 25.0], "0 → 1 with weight 2");
        assert_eq!(abduct(&In { eps: &[10.0, 25.0], ..linear }), [10.0, 5.0], "and back");
        // Weights in every sweep but the last, where networks that are the identity add up what enters.
        let (one, none) = ([1.0, 0.0, 0.0, 1.0], [0.0; 4]);
        let networks = Networks {
            w0: &[1.0, 0.0, 1.0, 0.0],
            b0: &none[..2],
            w1: &[1.0; 2],
            b1: &none[..2],
            w2: &[1.0; 2],
            hidden: 1,
            slope: 1.0,
        };
        let mechanism = Mechanism::Printed { weight: &weight, networks };
        let printed = |sweeps| forward(&In { mechanism, mask: &[0.0, 1.0, 0.0, 0.0], sweeps, ..linear }).0;
        assert_eq!(printed(1), [10.0, 15.0], "the networks alone: the mask lets 10 into 1");
        assert_eq!(printed(2), [10.0, 15.0], "eq. 2 makes (10, 25), eq. 3 reads the 10");
        let back = In { mechanism, mask: &one, ..linear };
        assert_eq!(abduct(&back), [0.0, 5.0], "back through the networks alone");
    }
}
