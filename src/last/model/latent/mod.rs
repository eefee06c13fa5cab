//! The latent part of the model: maps posteriors to decoder inputs, computes all losses of the factors, and
//! propagates gradients back, in double precision.
//!
//! ```text
//! μ, ℓ, η ──► u = μ + e^(ℓ/2) η ──► decoded: L_rec            reference: u given, ε = u − g(Ã∘u)
//!   │             └─► ε ──► KL                                literal:   ε given, u = S(ε; Ã)
//!   └─ means ─┬─► ε observed ──► L_MI
//!             └─► groups: v̄ = mean u′ᵢ, or v·w_i with labels ──► L_eq, hinge
//!                         ε, ε′ ──► L_inv
//!                         S(ε; do(i, v̄)) ──► decoded: L_int
//! ```
//!
//! A batch contains observed items, then the bases of all groups, then their after-images, group by group.
//! Group losses and L_MI (eq. 5 of the LAST paper) use posterior means; the decoder and the KL term (eq. 1)
//! use samples. The KL of an after-image omits the factor that was set. The chapter
//! *Learned causes* explains the group losses.

mod inputs;
mod pieces;

use super::settings::{Placement, Reading, Supervision};
use super::structure::Structure;
use crate::Result;
use crate::causal::structure::{self, Saved as Swept};
use crate::causal::{code, held, independence, intervene, limit, posterior, posterior_kl, scm_kl};
use crate::loss::groups;
pub use inputs::{Bars, In, Layout};
use pieces::FactorsAndNoise;

/// Terms of the loss, unweighted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Terms {
    /// The KL divergence.
    pub kl: f64,
    /// The mutual information L_MI.
    pub independence: f64,
    /// The loss L_eq.
    pub equal: f64,
    /// The loss L_inv.
    pub invariant: f64,
    /// The spread hinge.
    pub hinge: f64,
}

/// Decoder inputs, loss terms and the values saved for the adjoint.
#[derive(Clone, Debug)]
pub struct Out {
    /// Decoder inputs, shape (B + G·M, d): items, then counterfactuals.
    pub decoded: Vec<f64>,
    /// Means of the endogenous factors, shape (B, d).
    pub means: Vec<f64>,
    /// The loss terms.
    pub terms: Terms,
    log_variance: Vec<f64>,
    sample: FactorsAndNoise,
    mean: FactorsAndNoise,
    held: Vec<f64>,
    set: Vec<Option<usize>>,
    counterfactual: Option<Swept>,
    shared: groups::Out,
    told: Option<Vec<f64>>,
    dependence: Option<independence::Saved>,
    among: Option<Vec<f64>>,
}

impl Out {
    /// Covariance of the variables of L_MI for this batch only, shape (d, d).
    pub fn covariance(&self) -> Option<&[f64]> {
        self.dependence.as_ref().map(|saved| &saved.covariance[..])
    }
}

/// Computes the decoder inputs and the loss terms.
///
/// # Errors
/// If a covariance of the posterior is not positive definite.
///
/// # Panics
/// If a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>) -> Result<Out> {
    let d = x.d();
    assert_eq!(x.mu.len(), x.layout.items() * d, "means must have shape (B, d)");
    let log_variance = limit::forward(x.ell);
    let drawn = posterior::forward(x.mu, &log_variance, x.eta);
    let linked = |given: &[f64]| -> FactorsAndNoise {
        // The borrow of `given` ends with the call.
        In { ..*x }.link(given)
    };
    let (sample, mean) = (linked(&drawn), linked(x.mu));
    let mut terms = Terms { kl: x.kl(&sample, &log_variance), ..Terms::default() };
    let mut decoded = sample.u.clone();
    let mut shared = groups::Out::default();
    let (mut held, mut set, mut counterfactual) = (Vec::new(), Vec::new(), None);
    let told = x.told();
    if x.supervision != Supervision::None && x.layout.pairs() > 0 {
        shared = groups::forward(&x.groups(&mean, told.as_deref()))?;
        (terms.equal, terms.invariant, terms.hinge) = (shared.equal, shared.invariant, shared.spread);
        let pairs = x.layout.pairs();
        held = held::forward(&x.held(&mean, &shared.shared));
        set = (0..pairs).map(|p| Some(x.layout.targets[p / x.layout.members])).collect();
        let bases = &mean.eps[x.layout.observed * d..][..pairs * d];
        let (z, swept) = intervene::forward(&x.intervention(bases, &set, &held));
        decoded.extend(z);
        counterfactual = Some(swept);
    }
    let among = x.among();
    let mut dependence = None;
    if x.placement != Placement::Off && x.layout.observed > 1 {
        let (value, saved) = independence::forward(&x.dependence(&mean, &log_variance, among.as_deref()))?;
        terms.independence = value;
        dependence = Some(saved);
    }
    Ok(Out {
        decoded,
        means: mean.u.clone(),
        terms,
        log_variance,
        sample,
        mean,
        held,
        set,
        counterfactual,
        shared,
        told,
        dependence,
        among,
    })
}

/// Gradients of the weighted terms and of the losses that depend on `decoded`, given its cotangent (B + G·M,
/// d).
///
/// # Panics
/// If the cotangent does not have the size of `decoded`.
pub fn adjoint(x: &In<'_>, out: &Out, decoded_bar: &[f64]) -> Bars {
    let (n, k, d) = (x.n(), x.k(), x.d());
    let items = x.layout.items();
    assert_eq!(
        decoded_bar.len(),
        out.decoded.len(),
        "the cotangent must have the size of the decoder inputs"
    );
    let mut bars = Bars {
        mu: vec![0.0; items * d],
        ell: vec![0.0; items * d],
        mask: vec![0.0; n * n],
        structure: x.structure.zeros(),
    };
    let mut mean_u = vec![0.0; items * d];
    let mut mean_eps = vec![0.0; items * d];
    if let Some(swept) = &out.counterfactual {
        let pairs = x.layout.pairs();
        let bases = &out.mean.eps[x.layout.observed * d..][..pairs * d];
        let given = structure::InBar {
            eps: vec![0.0; pairs * d],
            mask: std::mem::take(&mut bars.mask),
            mechanism: std::mem::take(&mut bars.structure.mechanism),
        };
        let mut bar = intervene::InBar { given, value: vec![0.0; pairs * k] };
        let z_bar = &decoded_bar[items * d..];
        intervene::adjoint(&x.intervention(bases, &out.set, &out.held), swept, z_bar, &mut bar);
        bars.mask = bar.given.mask;
        bars.structure.mechanism = bar.given.mechanism;
        let after = x.layout.after(0) * d;
        add(&mut mean_eps[x.layout.observed * d..], &bar.given.eps);
        let w = x.weights.groups;
        // With a separate value for each pair, no value is shared, and L_eq does not apply.
        let equal = if x.supervision == Supervision::PerSample { 0.0 } else { w };
        let mut shared = vec![0.0; x.layout.targets.len() * k];
        let into = match x.supervision {
            Supervision::PerSample => &mut mean_u[x.layout.after(0) * d..],
            _ => &mut shared[..],
        };
        held::adjoint(&x.held(&out.mean, &out.shared.shared), &bar.value, into);
        let cotangent = groups::Out { equal, invariant: w, spread: w * x.weights.spread, shared };
        let input = x.groups(&out.mean, out.told.as_deref());
        let mut bar = groups::InBar::zeros_like(&input);
        groups::adjoint(&input, &out.shared, &cotangent, &mut bar);
        add(&mut mean_eps[x.layout.observed * d..], &bar.eps);
        add(&mut mean_eps[after..], &bar.eps_after);
        add(&mut mean_u[after..], &bar.after);
        if x.supervision == Supervision::Labels {
            code::adjoint(&x.code(), &bar.given, &mut bars.structure.values);
        }
    }
    if let Some(saved) = &out.dependence {
        let input = x.dependence(&out.mean, &out.log_variance, out.among.as_deref());
        let mut bar = independence::InBar::zeros_like(&input);
        independence::adjoint(&input, saved, x.weights.independence, &mut bar);
        let into = if x.placement == Placement::Factors { &mut mean_u } else { &mut mean_eps };
        add(into, &bar.mu);
        add(&mut bars.ell, &bar.logvar);
        add(&mut bars.mask, &bar.mask);
        add(&mut bars.structure.mechanism.weight, &bar.weight);
    }
    let mut sample_eps = vec![0.0; items * d];
    match x.reading {
        Reading::Literal => {
            let (mu, ell) = (x.free(x.mu), x.free(&out.log_variance));
            let [mut mu_bar, mut ell_bar] = [vec![0.0; mu.len()], vec![0.0; ell.len()]];
            posterior_kl::adjoint(&mu, &ell, items, x.weights.kl, &mut mu_bar, &mut ell_bar);
            x.add_free(&mu_bar, &mut bars.mu);
            x.add_free(&ell_bar, &mut bars.ell);
        }
        Reading::Reference => {
            let kept = x.kept();
            let input = x.sampled(&out.sample.eps, &out.log_variance, &kept);
            let mut bar = scm_kl::SampledBar { eps: sample_eps, logvar: std::mem::take(&mut bars.ell) };
            scm_kl::sampled_adjoint(&input, x.weights.kl, &mut bar);
            (sample_eps, bars.ell) = (bar.eps, bar.logvar);
        }
    }
    let given = x.link_adjoint(&out.mean, mean_u, &mean_eps, &mut bars);
    add(&mut bars.mu, &given);
    let drawn_bar = x.link_adjoint(&out.sample, decoded_bar[..items * d].to_vec(), &sample_eps, &mut bars);
    posterior::adjoint(&out.log_variance, x.eta, &drawn_bar, &mut bars.mu, &mut bars.ell);
    let limited_bar = std::mem::replace(&mut bars.ell, vec![0.0; items * d]);
    limit::adjoint(x.ell, &limited_bar, &mut bars.ell);
    bars
}

fn add(into: &mut [f64], what: &[f64]) {
    into.iter_mut().zip(what).for_each(|(into, what)| *into += what);
}

/// Factors (B, n, k) after `targets[b]` was set to `values` (B, k) under the graph `mask`, keeping the other
/// noise `eps` (B, n, k).
///
/// # Panics
/// If a buffer does not have the size of its shape.
pub fn intervene(
    structure: &Structure,
    mask: &[f64],
    eps: &[f64],
    targets: &[usize],
    values: &[f64],
) -> Vec<f64> {
    let k = structure.sizes.width;
    let x = structure::In {
        eps,
        mask,
        mechanism: structure.mechanism(),
        batch: targets.len(),
        n: structure.sizes.factors,
        k,
        sweeps: structure.sweeps(),
    };
    let set: Vec<Option<usize>> = targets.iter().map(|t| Some(*t)).collect();
    intervene::forward(&intervene::In { given: x, target: &set, value: values }).0
}

#[cfg(test)]
mod tests;
