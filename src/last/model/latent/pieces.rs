//! Parts of [`super::forward`] and [`super::adjoint`]: each function prepares the operator inputs of one loss
//! term.

use super::super::settings::{Placement, Reading, Supervision};
use super::inputs::{Bars, In};
use crate::causal::structure::{self, Saved as Swept};
use crate::causal::{code, held, independence, intervene, posterior_kl, scm_kl};
use crate::loss::groups;

/// Factors and the corresponding noise; one is given, the other is computed.
#[derive(Clone, Debug)]
pub(super) struct FactorsAndNoise {
    pub(super) u: Vec<f64>,
    pub(super) eps: Vec<f64>,
    swept: Option<Swept>,
}

impl<'a> In<'a> {
    pub(super) fn n(&self) -> usize {
        self.structure.sizes.factors
    }

    pub(super) fn k(&self) -> usize {
        self.structure.sizes.width
    }

    pub(super) fn d(&self) -> usize {
        self.structure.sizes.latent()
    }

    pub(super) fn layer(&self, eps: &'a [f64]) -> structure::In<'a> {
        structure::In {
            eps,
            mask: self.mask,
            mechanism: self.structure.mechanism(),
            batch: eps.len() / self.d(),
            n: self.n(),
            k: self.k(),
            sweeps: self.structure.sweeps(),
        }
    }

    pub(super) fn link(&self, given: &'a [f64]) -> FactorsAndNoise {
        match self.reading {
            Reading::Reference => {
                FactorsAndNoise { eps: structure::abduct(&self.layer(given)), u: given.to_vec(), swept: None }
            }
            Reading::Literal => {
                let (u, swept) = structure::forward(&self.layer(given));
                FactorsAndNoise { u, eps: given.to_vec(), swept: Some(swept) }
            }
        }
    }

    /// Gradient with respect to the given one of the two.
    pub(super) fn link_adjoint(
        &self,
        linked: &'a FactorsAndNoise,
        u_bar: Vec<f64>,
        eps_bar: &[f64],
        bars: &mut Bars,
    ) -> Vec<f64> {
        let (given, through, mut direct) = match self.reading {
            Reading::Reference => (&linked.u, eps_bar, u_bar),
            Reading::Literal => (&linked.eps, &u_bar[..], eps_bar.to_vec()),
        };
        let layer = self.layer(given);
        let mut bar = structure::InBar {
            eps: vec![0.0; given.len()],
            mask: std::mem::take(&mut bars.mask),
            mechanism: std::mem::take(&mut bars.structure.mechanism),
        };
        match &linked.swept {
            None => structure::abduct_adjoint(&layer, through, &mut bar),
            Some(swept) => structure::adjoint(&layer, swept, through, &mut bar),
        }
        bars.mask = bar.mask;
        bars.structure.mechanism = bar.mechanism;
        direct.iter_mut().zip(bar.eps).for_each(|(d, g)| *d += g);
        direct
    }

    /// Mask (B, n) with 1 for factors that contribute to the KL of an item.
    pub(super) fn kept(&self) -> Vec<f64> {
        let n = self.n();
        let counts = |at: usize| self.layout.set_in(at / n) != Some(at % n);
        (0..self.layout.items() * n).map(|at| f64::from(u8::from(counts(at)))).collect()
    }

    pub(super) fn sampled<'b>(
        &self,
        eps: &'b [f64],
        logvar: &'b [f64],
        kept: &'b [f64],
    ) -> scm_kl::Sampled<'b> {
        let (batch, n, k) = (self.layout.items(), self.n(), self.k());
        scm_kl::Sampled { eps, logvar, kept: Some(kept), batch, n, k }
    }

    /// Blocks of all items, without the blocks of factors that were set.
    pub(super) fn free(&self, values: &[f64]) -> Vec<f64> {
        let blocks = values.chunks_exact(self.k()).zip(self.kept());
        blocks.filter(|(_, kept)| *kept > 0.0).flat_map(|(block, _)| block).copied().collect()
    }

    /// Adds gradients of these blocks.
    pub(super) fn add_free(&self, what: &[f64], into: &mut [f64]) {
        let k = self.k();
        let blocks = into.chunks_exact_mut(k).zip(self.kept()).filter(|(_, kept)| *kept > 0.0);
        for ((into, _), what) in blocks.zip(what.chunks_exact(k)) {
            into.iter_mut().zip(what).for_each(|(into, what)| *into += what);
        }
    }

    pub(super) fn kl(&self, sample: &FactorsAndNoise, ell: &[f64]) -> f64 {
        match self.reading {
            Reading::Literal => {
                posterior_kl::forward(&self.free(self.mu), &self.free(ell), self.layout.items())
            }
            Reading::Reference => scm_kl::sampled(&self.sampled(&sample.eps, ell, &self.kept())),
        }
    }

    /// The variables of L_MI, for the observed items.
    pub(super) fn dependence<'b>(
        &'b self,
        mean: &'b FactorsAndNoise,
        logvar: &'b [f64],
        among: Option<&'b [f64]>,
    ) -> independence::In<'b> {
        let len = self.layout.observed * self.d();
        let mu = match self.placement {
            Placement::Factors => &mean.u[..len],
            Placement::Noise | Placement::Conditional | Placement::Off => &mean.eps[..len],
        };
        let edges = match (self.structure.mechanism(), self.reading, self.placement) {
            (
                structure::Mechanism::Linear { weight },
                Reading::Reference,
                Placement::Noise | Placement::Conditional,
            ) => Some(independence::Edges { mask: self.mask, weight }),
            _ => None,
        };
        independence::In {
            edges,
            among,
            carried: self.carried.map(|(carried, _)| carried),
            share: self.carried.map_or(1.0, |(_, share)| share),
            ..independence::In::new(mu, &logvar[..len], self.layout.observed, self.n(), self.k())
        }
    }

    /// Mask of pairs without an edge between them, for the conditional placement.
    pub(super) fn among(&self) -> Option<Vec<f64>> {
        let n = self.n();
        let joined = |i: usize, j: usize| self.mask[i * n + j] > 0.5 || self.mask[j * n + i] > 0.5;
        (self.placement == Placement::Conditional)
            .then(|| (0..n * n).map(|at| if joined(at / n, at % n) { 0.0 } else { 1.0 }).collect())
    }

    pub(super) fn intervention<'b>(
        &'b self,
        eps: &'b [f64],
        target: &'b [Option<usize>],
        value: &'b [f64],
    ) -> intervene::In<'b> {
        let given = structure::In {
            eps,
            mask: self.mask,
            mechanism: self.structure.mechanism(),
            batch: target.len(),
            n: self.n(),
            k: self.k(),
            sweeps: self.structure.sweeps(),
        };
        intervene::In { given, target, value }
    }

    /// The values set in the groups, as inputs of the code operator.
    pub(super) fn code(&self) -> code::In<'_> {
        let values = &self.structure.values;
        code::In { labels: self.labels, target: &self.layout.targets, values, k: self.k() }
    }

    /// Codes (G, k) of the values set in the groups, if the values are given.
    pub(super) fn told(&self) -> Option<Vec<f64>> {
        (self.supervision == Supervision::Labels).then(|| code::forward(&self.code()))
    }

    /// The groups' means before and after the intervention, and the given values.
    pub(super) fn groups<'b>(&'b self, mean: &'b FactorsAndNoise, told: Option<&'b [f64]>) -> groups::In<'b> {
        let (d, after) = (self.d(), self.layout.after(0) * self.d());
        groups::In {
            after: &mean.u[after..],
            eps: &mean.eps[self.layout.observed * d..after],
            eps_after: &mean.eps[after..],
            target: &self.layout.targets,
            variance: self.spread,
            given: told,
            members: self.layout.members,
            factors: self.n(),
            size: self.k(),
        }
    }

    /// The values to which the factors of all pairs are set.
    pub(super) fn held<'b>(&'b self, mean: &'b FactorsAndNoise, shared: &'b [f64]) -> held::In<'b> {
        let from = match self.supervision {
            Supervision::PerSample => held::From::Own(&mean.u[self.layout.after(0) * self.d()..]),
            _ => held::From::Shared(shared),
        };
        held::In {
            from,
            target: &self.layout.targets,
            members: self.layout.members,
            n: self.n(),
            k: self.k(),
        }
    }
}
