//! Causes to factors and back, sample by sample.
//!
//! nonlinear: Z⁰ = ε, Zⱼᵗ⁺¹ = gⱼ(Ã(·,j)∘Zᵗ) − gⱼ(0) + εⱼ; linear: Zᵗ⁺¹ = WᵀZᵗ + ε, W = Ã∘Ω; abduct: εⱼ = uⱼ − the effect on j at u;
//! printed: the paper's eq. 2, then its eq. 3: Z = Σₜ (Wᵀ)ᵗ ε by the linear form, then gⱼ(Ã(·,j)∘Z) − gⱼ(0) + εⱼ once.
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
//! Left folds from 0; the bias is added last. The bias of the last layer cancels and is left out.

use crate::array::{ANY, Arr, Named, Out, expect};
use crate::scalar::Scalar;
use crate::settings::Settings;

/// Weights of the mechanism, and its sizes.
pub(super) struct Mechanism<'a, S> {
    mask: &'a Arr<S>,
    weight: Option<&'a Arr<S>>,
    layers: Vec<&'a Arr<S>>,
    slope: f64,
    n: usize,
    k: usize,
}

impl<'a, S: Scalar> Mechanism<'a, S> {
    /// The mechanism that the arrays hold, behind a mask.
    pub(super) fn behind(
        mask: &'a Arr<S>,
        arrays: &'a Named<S>,
        slope: f64,
        n: usize,
        k: usize,
    ) -> Result<Self, String> {
        let weight = arrays.contains_key("weight").then(|| expect(arrays, "weight", &[n, n])).transpose()?;
        if weight.is_some() && !arrays.contains_key("w0") {
            return Ok(Self { mask, weight, layers: Vec::new(), slope, n, k });
        }
        let h = expect(arrays, "b0", &[n, ANY])?.shape[1];
        let layers = vec![
            expect(arrays, "w0", &[n, h, n * k])?,
            expect(arrays, "b0", &[n, h])?,
            expect(arrays, "w1", &[n, h, h])?,
            expect(arrays, "b1", &[n, h])?,
            expect(arrays, "w2", &[n, k, h])?,
        ];
        Ok(Self { mask, weight, layers, slope, n, k })
    }

    /// Whether it is a number per edge and nothing else.
    pub(super) fn linear(&self) -> bool {
        self.layers.is_empty()
    }

    /// The number per edge of a mechanism that has networks too.
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

    /// What the parents of node j give it.
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
/// When an input is missing or shaped otherwise, or a setting is not what it should be.
pub fn forward<S: Scalar>(
    arrays: &Named<S>,
    settings: &Settings<'_>,
    out: &mut Out<S>,
) -> Result<(), String> {
    let eps = expect(arrays, "eps", &[ANY, ANY, ANY])?;
    let (batch, n, k) = (eps.shape[0], eps.shape[1], eps.shape[2]);
    let mode = settings.text("mode", "nonlinear")?;
    let mask = expect(arrays, "mask", &[n, n])?;
    let mechanism = Mechanism::behind(mask, arrays, settings.number("slope", 0.05)?, n, k)?;
    let sweeps = sweeps(settings, n, mechanism.linear())?;
    let z = out.array("z", &[batch, n, k]);
    for b in 0..batch {
        let given = &eps.data[b * n * k..(b + 1) * n * k];
        let effects =
            |by: &Mechanism<'_, S>, z: &[S]| -> Vec<S> { (0..n).flat_map(|j| by.effect(j, z)).collect() };
        let swept = |by: &Mechanism<'_, S>, z: &[S]| -> Vec<S> {
            effects(by, z).into_iter().zip(given).map(|(effect, e)| effect + *e).collect()
        };
        let mut state = given.to_vec();
        match mode.as_str() {
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

/// Number of passes.
pub(super) fn sweeps(settings: &Settings<'_>, n: usize, linear: bool) -> Result<usize, String> {
    let default = if linear { n.saturating_sub(1) } else { n };
    Ok(settings.number("sweeps", default as f64)? as usize)
}
