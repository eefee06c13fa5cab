//! `causal.structure`: maps causes to factors and back, sample by sample.
//!
//! nonlinear: Z⁰ = ε, Zⱼᵗ⁺¹ = gⱼ(Ã(·,j)∘Zᵗ) − gⱼ(0) + εⱼ; linear: Zᵗ⁺¹ = WᵀZᵗ + ε, W = Ã∘Ω; abduct: εⱼ = uⱼ −
//! the effect on j at u; printed: the paper's eq. 2, then its eq. 3: Z = Σₜ (Wᵀ)ᵗ ε by the linear form, then
//! gⱼ(Ã(·,j)∘Z) − gⱼ(0) + εⱼ once.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | ε, u | `eps` | (B, n, k) |
//! | Ã | `mask` | (n, n) |
//! | Ω | `weight` | (n, n) |
//! | g | `w0`, `b0`, `w1`, `b1`, `w2` | (n, h, n·k), (n, h), (n, h, h), (n, h), (n, k, h) |
//! | Z, ε | `z` | (B, n, k) |
//!
//! # Rounding
//! Left folds from 0; the bias is added last. The bias of the last layer cancels and is omitted.

use crate::array::{Arr, Out};
use crate::inputs::{inputs, required};
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

pub(super) const MASK: Port = Port::var("N,N", "edges i → j");
pub(super) const WEIGHT: Port = Port::var("N,N", "linear mechanism: a number per edge");
pub(super) const W0: Port = Port::var("N,H,D", "networks: first layer over D = N·K inputs");
pub(super) const B0: Port = Port::var("N,H", "");
pub(super) const W1: Port = Port::var("N,H,H", "second layer");
pub(super) const B1: Port = Port::var("N,H", "");
pub(super) const W2: Port = Port::var("N,K,H", "last layer");
pub(super) const B2: Port = Port::fixed("N,K", "cancels: every network is centred; accepted and not used");

pub(super) const SLOPE: SettingSpec =
    SettingSpec::number("slope", "0.05", "of the leaky ReLU at 0 and below");
pub(super) const SWEEPS: SettingSpec =
    SettingSpec::number("sweeps", "N, with weights N − 1", "passes over all nodes");

inputs! {
    /// Inputs of `causal.structure`.
    pub struct In<'a, S> {
        eps: &'a Arr<S> = Port::var("B,N,K", "causes; in mode abduct the factors"),
        mask: &'a Arr<S> = MASK,
        weight: Option<&'a Arr<S>> = WEIGHT,
        w0: Option<&'a Arr<S>> = W0,
        b0: Option<&'a Arr<S>> = B0,
        w1: Option<&'a Arr<S>> = W1,
        b1: Option<&'a Arr<S>> = B1,
        w2: Option<&'a Arr<S>> = W2,
        b2: Option<&'a Arr<S>> = B2,
    }
}

/// `causal.structure`
pub static SIGNATURE: Signature = Signature {
    name: "causal.structure",
    summary: "maps independent causes to factors along a graph, and back",
    inputs: In::<f64>::PORTS,
    outputs: ports![z: Port::var("B,N,K", "factors; in mode abduct the causes")],
    settings: &[
        SettingSpec::choice(
            "mode",
            &["nonlinear", "linear", "printed", "abduct"],
            "nonlinear",
            "networks; weights; weights, then networks in the last sweep; inverse of the given mechanism",
        ),
        SLOPE,
        SWEEPS,
    ],
    ..Signature::EMPTY
};

/// Settings of `causal.structure`.
#[derive(Clone, Copy, Debug)]
pub struct Settings<'a> {
    /// `nonlinear`, `linear`, `printed` or `abduct`.
    pub mode: &'a str,
    /// Slope of the leaky ReLU at 0 and below.
    pub slope: f64,
    /// Passes over all nodes; `None`: one per factor, or one less with weights.
    pub sweeps: Option<usize>,
}

/// The mechanism and its sizes.
pub(super) struct Mechanism<'a, S> {
    mask: &'a Arr<S>,
    weight: Option<&'a Arr<S>>,
    layers: Vec<&'a Arr<S>>,
    slope: f64,
    n: usize,
    k: usize,
}

impl<'a, S: Scalar> Mechanism<'a, S> {
    /// The mechanism of the inputs.
    pub(super) fn of(input: &In<'a, S>, slope: f64) -> Result<Self, String> {
        let In { eps, mask, weight, .. } = *input;
        let (n, k) = (eps.shape[1], eps.shape[2]);
        if weight.is_some() && input.w0.is_none() {
            return Ok(Self { mask, weight, layers: Vec::new(), slope, n, k });
        }
        let w0 = required("w0", input.w0)?;
        if w0.shape[2] != n * k {
            return Err(format!("input w0: expected {} numbers per row, got {}", n * k, w0.shape[2]));
        }
        let layers = vec![
            w0,
            required("b0", input.b0)?,
            required("w1", input.w1)?,
            required("b1", input.b1)?,
            required("w2", input.w2)?,
        ];
        Ok(Self { mask, weight, layers, slope, n, k })
    }

    /// Whether the mechanism consists of one number per edge.
    pub(super) fn linear(&self) -> bool {
        self.layers.is_empty()
    }

    /// Number of passes: as set, else one per factor, or one less if the mechanism is linear.
    pub(super) fn sweeps(&self, given: Option<usize>) -> usize {
        given.unwrap_or(if self.linear() { self.n.saturating_sub(1) } else { self.n })
    }

    /// The number per edge of a mechanism that also has networks.
    fn eq2(&self) -> Self {
        Self { layers: Vec::new(), ..*self }
    }

    /// gⱼ without the bias of its last layer.
    fn network(&self, j: usize, x: &[S]) -> Vec<S> {
        let product = |w: &Arr<S>, x: &[S]| -> Vec<S> {
            let (rows, columns) = (w.shape[1], w.shape[2]);
            let entry = |r: usize| {
                (0..columns).fold(S::zero(), |sum, c| sum + w.data[(j * rows + r) * columns + c] * x[c])
            };
            (0..rows).map(entry).collect()
        };
        let activated = |x: Vec<S>, b: &Arr<S>| -> Vec<S> {
            let biased = x.iter().enumerate().map(|(r, x)| *x + b.data[j * b.shape[1] + r]);
            biased.map(|x| if x.value() > 0.0 { x } else { x * self.slope }).collect()
        };
        let first = activated(product(self.layers[0], x), self.layers[1]);
        let second = activated(product(self.layers[2], &first), self.layers[3]);
        product(self.layers[4], &second)
    }

    /// The effect of its parents on node j.
    pub(super) fn effect(&self, j: usize, z: &[S]) -> Vec<S> {
        let (n, k) = (self.n, self.k);
        if let Some(weight) = self.weight.filter(|_| self.linear()) {
            let term = |i: usize, c: usize| self.mask.data[i * n + j] * weight.data[i * n + j] * z[i * k + c];
            return (0..k).map(|c| (0..n).fold(S::zero(), |sum, i| sum + term(i, c))).collect();
        }
        let x: Vec<S> = (0..n * k).map(|at| self.mask.data[at / k * n + j] * z[at]).collect();
        let at_zero = self.network(j, &vec![S::zero(); n * k]);
        self.network(j, &x).into_iter().zip(at_zero).map(|(y, at_zero)| y - at_zero).collect()
    }
}

/// The twin of `causal.structure`.
///
/// # Errors
/// When a layer of the networks is missing or does not match the factors.
pub fn forward<S: Scalar>(
    input: &In<'_, S>,
    settings: Settings<'_>,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    let eps = input.eps;
    let (batch, n, k) = (eps.shape[0], eps.shape[1], eps.shape[2]);
    let mechanism = Mechanism::of(input, settings.slope)?;
    let sweeps = mechanism.sweeps(settings.sweeps);
    let z = out.array("z", &[batch, n, k]);
    for b in 0..batch {
        let given = &eps.data[b * n * k..(b + 1) * n * k];
        let effects =
            |by: &Mechanism<'_, S>, z: &[S]| -> Vec<S> { (0..n).flat_map(|j| by.effect(j, z)).collect() };
        let swept = |by: &Mechanism<'_, S>, z: &[S]| -> Vec<S> {
            effects(by, z).into_iter().zip(given).map(|(effect, e)| effect + *e).collect()
        };
        let mut state = given.to_vec();
        match settings.mode {
            "abduct" => {
                let all = effects(&mechanism, given);
                state = given.iter().zip(all).map(|(u, effect)| *u - effect).collect();
            }
            "printed" => {
                let eq2 = mechanism.eq2();
                for _ in 1..sweeps {
                    state = swept(&eq2, &state);
                }
                if sweeps > 0 {
                    state = swept(&mechanism, &state);
                }
            }
            _ => (0..sweeps).for_each(|_| state = swept(&mechanism, &state)),
        }
        for (at, x) in state.into_iter().enumerate() {
            out.put(z, b * n * k + at, x);
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let settings = Settings {
        mode: call.settings.word("mode"),
        slope: call.settings.number("slope"),
        sweeps: sweeps(call),
    };
    forward(&In::of(call.arrays)?, settings, out)
}

/// Number of passes, if it is set.
pub(super) fn sweeps<S>(call: &Call<'_, S>) -> Option<usize> {
    call.settings.given_number("sweeps").map(|sweeps| sweeps as usize)
}
