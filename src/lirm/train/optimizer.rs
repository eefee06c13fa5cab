//! What updates the weights: AdamW for all arrays, or Muon for the matrices of the blocks and AdamW for the
//! others.
//!
//! ```text
//! gradients, clipped ──► matrices of blocks and of fuse ──► optim.muon   ┐ with [`Kind::Muon`]
//!                  └───► all others ─────────────────────► optim.adamw  ┘ decay: arrays of rank 2 and more
//! ```
//!
//! Queries, keys and values are three matrices for Muon. Tokens, places, the layers to texels and the heads
//! stay with AdamW, as vectors do: they are first and last layers (Jordan et al. 2024). Muon's step has a
//! root mean square of [`MATRICES`]`.rms` times the rate.
//!
//! AdamW moves a weight by at most about the rate per step, however wide its layer is, so a narrow layer
//! changes its outputs less than a wide one. The heads of stage 2 ([`LATER`]) begin with outputs of ½ or with
//! those of another head, and have a rate of their own, a multiple of that of all others
//! ([`Settings::head_rate`](super::Settings::head_rate)). A rate in proportion to 1/width (Yang et al. 2021)
//! would be 8 times that of blocks with a width of 256 in heads with one of 32.

use crate::lirm::model::params::{decays, matrices};
use crate::num::array::Arrays;
use crate::optim::adam::{Counters, Decay, Rule};
use crate::optim::muon::{self, Muon};
use crate::optim::optimiser::{ArrayNames, Optimiser};
use crate::tape::{Grads, Params};
use crate::{Error, Result};
use std::collections::BTreeMap;

/// AdamW of the paper's code.
const RULE: Rule = Rule {
    beta1: 0.9,
    beta2: 0.95,
    eps: 1e-8,
    weight_decay: 0.05,
    decay: Decay::Decoupled,
    counters: Counters::Global,
};
/// Settings of Muon; r = 0.5 had the lower loss at steps 125 to 149 of the two values tried in stage 1a (0.5,
/// 2.5).
pub const MATRICES: muon::Rule = muon::Rule { momentum: 0.95, weight_decay: 0.05, rms: 0.5 };

/// Beginnings of the names of the heads that stage 2 adds.
pub const LATER: [&str; 3] = ["heads/albedo/", "heads/material/", "heads/rho/"];

/// Which optimiser updates the matrices of the blocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// AdamW, as published.
    #[default]
    AdamW,
    /// Muon.
    Muon,
}

impl Kind {
    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::AdamW => "adamw",
            Self::Muon => "muon",
        }
    }

    /// Returns the one of that name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::AdamW, Self::Muon].into_iter().find(|kind| kind.name() == name)
    }
}

/// The states of all arrays.
#[derive(Clone, Debug)]
pub(super) struct States {
    /// Of arrays that decay, and of the others.
    adam: [Optimiser; 2],
    muon: BTreeMap<String, Muon>,
    /// Rate of the heads of stage 2, in units of that of the others.
    head_rate: f64,
}

impl States {
    pub(super) fn new(kind: Kind, head_rate: f64, params: &Params) -> Result<Self> {
        let mut muon = BTreeMap::new();
        if kind == Kind::Muon {
            for (name, array) in params.iter() {
                if let Some(shape) = matrices(name, array) {
                    muon.insert(name.to_owned(), Muon::new(MATRICES, shape)?);
                }
            }
        }
        let of = |rule: Rule, decaying: bool| {
            let chosen =
                |name: &str| !muon.contains_key(name) && params.get(name).is_some_and(decays) == decaying;
            Optimiser::of(rule, params, chosen)
        };
        let adam = [of(RULE, true)?, of(Rule { weight_decay: 0.0, ..RULE }, false)?];
        Ok(Self { adam, muon, head_rate })
    }

    /// One step of all arrays.
    pub(super) fn step(&mut self, params: &mut Params, grads: &Grads, rate: f64) -> Result<()> {
        let own = |name: &str| {
            let is_later = LATER.iter().any(|head| name.starts_with(head));
            Some(if is_later { self.head_rate * rate } else { rate })
        };
        for optimiser in &mut self.adam {
            optimiser.step(params, grads, own)?;
        }
        for (name, muon) in &mut self.muon {
            let param = params.get_mut(name).expect("every state has its parameter");
            let param = param.as_slice_mut().expect("parameters are contiguous");
            let grad = grads.get(name).expect("every parameter has a gradient");
            muon.step(param, grad.as_slice().expect("gradients are contiguous"), rate)
                .map_err(|e: Error| e.within(format!("optimiser of {name}")))?;
        }
        Ok(())
    }

    pub(super) fn save(&self, out: &mut Arrays) {
        self.adam.iter().for_each(|o| o.save(ArrayNames::Folders, out));
        self.muon.iter().for_each(|(name, m)| m.save(&format!("muon/{name}"), out));
    }

    pub(super) fn load(&mut self, from: &Arrays) -> Result<()> {
        self.adam.iter_mut().try_for_each(|o| o.load(ArrayNames::Folders, from))?;
        self.muon.iter_mut().try_for_each(|(name, m)| m.load(&format!("muon/{name}"), from))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lirm::model::config::Config;
    use crate::lirm::model::params::first;

    /// Two steps of every array, written out: β 0.9 and 0.95, eps 10⁻⁸, and 0.05 of the rate for arrays of
    /// rank 2 and more.
    #[test]
    fn adamw_has_the_published_numbers_and_vectors_do_not_decay() {
        let config =
            Config { blocks: 1, width: 16, heads: 2, plane_tokens: 1, embed_tokens: 1, ..Config::SMALL };
        let before = first(&config, 0);
        let (mut after, rate) = (before.clone(), 1e-3);
        let mut states = States::new(Kind::AdamW, 1.0, &before).expect("a rule");
        // Far below eps, and far above it.
        let gradients: [f32; 2] = [3e-8, 0.5];
        for scale in gradients {
            let of = |array: &ndarray::ArrayD<f32>| array.mapv(|_| scale);
            let grads = before.iter().map(|(name, array)| (name.to_owned(), of(array))).collect();
            states.step(&mut after, &Grads(grads), rate).expect("finite");
        }
        let mut ranks = [0; 5];
        for (name, array) in before.iter() {
            let decay = if array.ndim() >= 2 { 0.05 } else { 0.0 };
            ranks[array.ndim()] += 1;
            for (old, new) in array.iter().zip(after.get(name).expect("an array")) {
                let (mut w, [mut m, mut v]) = (f64::from(*old), [0.0; 2]);
                for (t, scale) in gradients.iter().enumerate() {
                    let g = f64::from(*scale);
                    m = 0.9 * m + 0.1 * g;
                    v = 0.95 * v + 0.05 * g * g;
                    let [a, b] = if t == 0 { [0.1, 0.05] } else { [0.19, 0.0975] };
                    w -= rate * decay * w;
                    w -= rate * (m / a) / ((v / b).sqrt() + 1e-8);
                }
                assert!((f64::from(*new) - w).abs() < 2e-7 * (1.0 + w.abs()), "{name}: {new}, not {w}");
            }
        }
        assert!(ranks[1] > 5 && ranks[2] > 5, "vectors and matrices: {ranks:?}");
    }
}
