//! From posteriors to what is decoded, with every loss that looks at factors, and back. In double precision.
//!
//! ```text
//! μ, ℓ, η ──► u = μ + e^(ℓ/2) η ──► decoded: L_rec            reference: u given, ε = u − g(Ã∘u)
//!   │             └─► ε ──► KL                                literal:   ε given, u = S(ε; Ã)
//!   └─ means ─┬─► ε observed ──► L_MI
//!             └─► groups: v̄ = mean u′ᵢ ──► L_eq, hinge
//!                         ε, ε′ ──► L_inv
//!                         S(ε; do(i, v̄)) ──► decoded: L_int
//! ```
//!
//! A batch holds observed items, then the bases of all groups, then their after-images, group by group (`last.md` §7.3). Group losses
//! and L_MI take posterior means; the decoder and KL take samples. KL of an after-image leaves out the factor that was set.

use super::settings::{Placement, Reading, Supervision, Weights};
use super::structure::{Structure, StructureBar};
use crate::Result;
use crate::causal::structure::{self, Saved as Swept};
use crate::causal::{independence, intervene, posterior, posterior_kl, scm_kl};
use crate::loss::groups;

/// What a batch is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// observed items
    pub observed: usize,
    /// factor set in each group
    pub targets: Vec<usize>,
    /// items of a group, before and after alike
    pub members: usize,
}

impl Layout {
    /// Pairs of all groups.
    pub fn pairs(&self) -> usize {
        self.targets.len() * self.members
    }

    /// Items in all.
    pub fn items(&self) -> usize {
        self.observed + 2 * self.pairs()
    }

    /// The base of pair `p`.
    pub fn base(&self, p: usize) -> usize {
        self.observed + p
    }

    /// The after-image of pair `p`.
    pub fn after(&self, p: usize) -> usize {
        self.observed + self.pairs() + p
    }

    /// The factor that was set in an after-image.
    pub fn set_in(&self, item: usize) -> Option<usize> {
        let pair = item.checked_sub(self.observed + self.pairs())?;
        Some(self.targets[pair / self.members])
    }
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// parameters
    pub structure: &'a Structure,
    /// Ã (n, n)
    pub mask: &'a [f64],
    /// what the batch is made of
    pub layout: &'a Layout,
    /// (B, d)
    pub mu: &'a [f64],
    /// (B, d)
    pub ell: &'a [f64],
    /// (B, d)
    pub eta: &'a [f64],
    /// (n) running variances of the factors
    pub spread: &'a [f64],
    /// (G) values that were set; with labels only
    pub labels: &'a [f64],
    /// which model
    pub reading: Reading,
    /// what groups say
    pub supervision: Supervision,
    /// factors of the terms
    pub weights: Weights,
    /// what L_MI looks at
    pub placement: Placement,
    /// (d, d) weighted covariances of earlier batches, and the weight of this one; none at the start
    pub carried: Option<(&'a [f64], f64)>,
}

/// Terms of the loss, without factors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Terms {
    /// KL
    pub kl: f64,
    /// L_MI
    pub independence: f64,
    /// L_eq
    pub equal: f64,
    /// L_inv
    pub invariant: f64,
    /// spread hinge
    pub hinge: f64,
}

/// What is decoded, and what the way back needs.
#[derive(Clone, Debug)]
pub struct Out {
    /// (B + G·M, d): items, then counterfactuals
    pub decoded: Vec<f64>,
    /// (B, d) means of the endogenous factors
    pub means: Vec<f64>,
    /// the terms
    pub terms: Terms,
    log_variance: Vec<f64>,
    sample: Linked,
    mean: Linked,
    held: Vec<f64>,
    set: Vec<Option<usize>>,
    counterfactual: Option<Swept>,
    shared: groups::Out,
    dependence: Option<independence::Saved>,
    among: Option<Vec<f64>>,
}

impl Out {
    /// (d, d) covariance of what L_MI looked at, of this batch alone.
    pub fn covariance(&self) -> Option<&[f64]> {
        self.dependence.as_ref().map(|saved| &saved.covariance[..])
    }
}

/// Gradients.
#[derive(Clone, Debug)]
pub struct Bars {
    /// (B, d)
    pub mu: Vec<f64>,
    /// (B, d)
    pub ell: Vec<f64>,
    /// (n, n)
    pub mask: Vec<f64>,
    /// by the parameters of the structure
    pub structure: StructureBar,
}

/// Factors and noise that belong together; one is given, the other computed.
#[derive(Clone, Debug)]
struct Linked {
    u: Vec<f64>,
    eps: Vec<f64>,
    swept: Option<Swept>,
}

impl<'a> In<'a> {
    fn n(&self) -> usize {
        self.structure.sizes.factors
    }

    fn k(&self) -> usize {
        self.structure.sizes.width
    }

    fn d(&self) -> usize {
        self.structure.sizes.latent()
    }

    fn layer(&self, eps: &'a [f64]) -> structure::In<'a> {
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

    fn link(&self, given: &'a [f64]) -> Linked {
        match self.reading {
            Reading::Reference => {
                Linked { eps: structure::abduct(&self.layer(given)), u: given.to_vec(), swept: None }
            }
            Reading::Literal => {
                let (u, swept) = structure::forward(&self.layer(given));
                Linked { u, eps: given.to_vec(), swept: Some(swept) }
            }
        }
    }

    /// The gradient by what was given.
    fn link_adjoint(
        &self,
        linked: &'a Linked,
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

    /// (B, n) 1 where a factor counts in the KL of an item.
    fn kept(&self) -> Vec<f64> {
        let n = self.n();
        let counts = |at: usize| self.layout.set_in(at / n) != Some(at % n);
        (0..self.layout.items() * n).map(|at| f64::from(u8::from(counts(at)))).collect()
    }

    fn sampled<'b>(&self, eps: &'b [f64], logvar: &'b [f64], kept: &'b [f64]) -> scm_kl::Sampled<'b> {
        let (batch, n, k) = (self.layout.items(), self.n(), self.k());
        scm_kl::Sampled { eps, logvar, kept: Some(kept), batch, n, k }
    }

    fn kl(&self, sample: &Linked, ell: &[f64]) -> f64 {
        match self.reading {
            Reading::Literal => posterior_kl::forward(self.mu, ell, self.layout.items()),
            Reading::Reference => scm_kl::sampled(&self.sampled(&sample.eps, ell, &self.kept())),
        }
    }

    /// What L_MI looks at: the observed items.
    fn dependence<'b>(
        &'b self,
        mean: &'b Linked,
        logvar: &'b [f64],
        among: Option<&'b [f64]>,
    ) -> independence::In<'b> {
        let len = self.layout.observed * self.d();
        let mu = match self.placement {
            Placement::Factors => &mean.u[..len],
            Placement::Noise | Placement::Conditional | Placement::Off => &mean.eps[..len],
        };
        let edges = match (self.structure.mechanism(), self.reading, self.placement) {
            (structure::Mechanism::Linear { weight }, Reading::Reference, Placement::Noise) => {
                Some(independence::Edges { mask: self.mask, weight })
            }
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

    /// Pairs without an edge between them, for the conditional placement.
    fn among(&self) -> Option<Vec<f64>> {
        let n = self.n();
        let joined = |i: usize, j: usize| self.mask[i * n + j] > 0.5 || self.mask[j * n + i] > 0.5;
        (self.placement == Placement::Conditional)
            .then(|| (0..n * n).map(|at| if joined(at / n, at % n) { 0.0 } else { 1.0 }).collect())
    }

    fn intervention<'b>(
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

    /// The groups' means, before and after.
    fn groups<'b>(&'b self, mean: &'b Linked) -> groups::In<'b> {
        let (d, after) = (self.d(), self.layout.after(0) * self.d());
        groups::In {
            after: &mean.u[after..],
            eps: &mean.eps[self.layout.observed * d..after],
            eps_after: &mean.eps[after..],
            target: &self.layout.targets,
            variance: self.spread,
            members: self.layout.members,
            factors: self.n(),
            size: self.k(),
        }
    }

    /// What the factor of pair `p` is set to (k).
    fn held(&self, mean: &Linked, values: &[f64], p: usize) -> Vec<f64> {
        let (d, k, m) = (self.d(), self.k(), self.layout.members);
        let (g, i) = (p / m, self.layout.targets[p / m]);
        match self.supervision {
            Supervision::PerSample => mean.u[self.layout.after(p) * d + i * k..][..k].to_vec(),
            Supervision::Labels => {
                self.structure.values[i * k..][..k].iter().map(|w| self.labels[g] * w).collect()
            }
            Supervision::None | Supervision::Groups => values[g * k..(g + 1) * k].to_vec(),
        }
    }
}

/// What is decoded, and the terms.
///
/// # Errors
/// A covariance of the posterior that is not positive definite.
///
/// # Panics
/// When a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>) -> Result<Out> {
    let d = x.d();
    assert_eq!(x.mu.len(), x.layout.items() * d, "means are (B, d)");
    let log_variance: Vec<f64> = x.ell.iter().map(|l| posterior::limited(*l)).collect();
    let drawn = posterior::forward(x.mu, &log_variance, x.eta);
    let linked = |given: &[f64]| -> Linked {
        // The borrow of `given` ends with the call.
        In { ..*x }.link(given)
    };
    let (sample, mean) = (linked(&drawn), linked(x.mu));
    let mut terms = Terms { kl: x.kl(&sample, &log_variance), ..Terms::default() };
    let mut decoded = sample.u.clone();
    let mut shared = groups::Out::default();
    let (mut held, mut set, mut counterfactual) = (Vec::new(), Vec::new(), None);
    if x.supervision != Supervision::None && x.layout.pairs() > 0 {
        shared = groups::forward(&x.groups(&mean))?;
        (terms.equal, terms.invariant, terms.hinge) = (shared.equal, shared.invariant, shared.spread);
        let pairs = x.layout.pairs();
        held = (0..pairs).flat_map(|p| x.held(&mean, &shared.shared, p)).collect();
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
        dependence,
        among,
    })
}

/// Gradients of the weighted terms, and of what follows `decoded` through its cotangent (B + G·M, d).
///
/// # Panics
/// When the cotangent does not have the size of `decoded`.
pub fn adjoint(x: &In<'_>, out: &Out, decoded_bar: &[f64]) -> Bars {
    let (n, k, d) = (x.n(), x.k(), x.d());
    let items = x.layout.items();
    assert_eq!(decoded_bar.len(), out.decoded.len(), "the cotangent has the size of what is decoded");
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
        // Pairs with a value of their own share none.
        let equal = if x.supervision == Supervision::PerSample { 0.0 } else { w };
        let shared = held_adjoint(x, &bar.value, &mut mean_u, &mut bars.structure.values);
        let cotangent = groups::Out { equal, invariant: w, spread: w, shared };
        let input = x.groups(&out.mean);
        let mut bar = groups::InBar::zeros_like(&input);
        groups::adjoint(&input, &out.shared, &cotangent, &mut bar);
        add(&mut mean_eps[x.layout.observed * d..], &bar.eps);
        add(&mut mean_eps[after..], &bar.eps_after);
        add(&mut mean_u[after..], &bar.after);
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
            let kl = x.weights.kl;
            posterior_kl::adjoint(x.mu, &out.log_variance, items, kl, &mut bars.mu, &mut bars.ell);
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
    for (bar, ell) in bars.ell.iter_mut().zip(x.ell) {
        *bar = if posterior::within(*ell) { *bar } else { 0.0 };
    }
    bars
}

/// From the values that factors were held at to where they came from; gives the part of the shared values (G, k).
fn held_adjoint(x: &In<'_>, held_bar: &[f64], mean_u: &mut [f64], values: &mut [f64]) -> Vec<f64> {
    let (d, k, m) = (x.d(), x.k(), x.layout.members);
    let mut shared = vec![0.0; x.layout.targets.len() * k];
    for (p, bar) in held_bar.chunks_exact(k).enumerate() {
        let (g, i) = (p / m, x.layout.targets[p / m]);
        match x.supervision {
            Supervision::PerSample => add(&mut mean_u[x.layout.after(p) * d + i * k..], bar),
            Supervision::Labels => {
                values[i * k..].iter_mut().zip(bar).for_each(|(w, b)| *w += x.labels[g] * b);
            }
            Supervision::None | Supervision::Groups => add(&mut shared[g * k..], bar),
        }
    }
    shared
}

fn add(into: &mut [f64], what: &[f64]) {
    into.iter_mut().zip(what).for_each(|(into, what)| *into += what);
}

/// Factors (B, n, k) after `targets[b]` was set to `values` (B, k) under the graph `mask`, the other noise `eps` (B, n, k) kept.
///
/// # Panics
/// When a buffer does not have the size of its shape.
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
mod tests {
    use super::*;
    use crate::last::model::structure::{Kind, Sizes};
    use crate::num::order;
    use crate::num::rng::Rng;
    use crate::tape::Params;

    const SIZES: Sizes = Sizes { factors: 3, width: 2, kind: Kind::Networks };

    fn draws(part: u16, len: usize) -> Vec<f64> {
        (0..len).map(|i| Rng::new(3).normal_f64(i as u64, 0, 0x7e58, part)).collect()
    }

    /// Σ of weighted terms and ⟨decoded, c⟩, as the step sums them.
    fn value(x: &In<'_>, c: &[f64]) -> f64 {
        let out = forward(x).expect("positive definite");
        let t = out.terms;
        let equal = if x.supervision == Supervision::PerSample { 0.0 } else { t.equal };
        let own = x.weights.kl * t.kl
            + x.weights.independence * t.independence
            + x.weights.groups * ((equal + t.invariant) + t.hinge);
        out.decoded.iter().zip(c).fold(own, |s, (d, c)| s + d * c)
    }

    /// Gradients of everything by central differences along one direction per input, for every reading, kind of supervision and mechanism.
    #[test]
    fn gradients_are_those_of_differences() {
        let layout = Layout { observed: 4, targets: vec![0, 1, 0, 2, 2], members: 2 };
        let items = layout.items();
        let placements = [Placement::Noise, Placement::Factors, Placement::Conditional];
        for (kind, placement) in
            [Kind::Networks, Kind::Linear].into_iter().flat_map(|kind| placements.map(|p| (kind, p)))
        {
            for reading in [Reading::Reference, Reading::Literal] {
                for supervision in [Supervision::PerSample, Supervision::Groups, Supervision::Labels] {
                    let sizes = Sizes { kind, ..SIZES };
                    let d = sizes.latent();
                    let carried: Vec<f64> =
                        (0..d * d).map(|at| if at / d == at % d { 0.5 } else { 0.05 }).collect();
                    let mut params = Params::new();
                    sizes.draw(1, &mut params);
                    for (at, (name, shape)) in sizes.shapes().into_iter().enumerate() {
                        let values = draws(50 + at as u16, super::super::encoder::size(&shape));
                        let array = params.get_mut(&name).expect("drawn");
                        array.iter_mut().zip(values).for_each(|(a, v)| *a = (0.3 * v) as f32);
                    }
                    let structure = Structure::new(sizes, &params);
                    let n = sizes.factors;
                    let mask: Vec<f64> = (0..n * n)
                        .map(|at| if at / n == at % n { 0.0 } else { 0.2 + 0.07 * at as f64 })
                        .collect();
                    let (mu, eta) = (draws(0, items * d), draws(2, items * d));
                    let ell: Vec<f64> = draws(1, items * d).iter().map(|l| 0.3 * l - 1.0).collect();
                    let labels = draws(3, layout.targets.len());
                    let weights = Weights { kl: 0.7, groups: 1.3, ..Weights::default() };
                    let x = In {
                        structure: &structure,
                        mask: &mask,
                        layout: &layout,
                        mu: &mu,
                        ell: &ell,
                        eta: &eta,
                        spread: &[0.5, 1.5, 1.0],
                        labels: &labels,
                        reading,
                        supervision,
                        weights,
                        placement,
                        carried: Some((&carried, 0.6)),
                    };
                    let out = forward(&x).expect("positive definite");
                    let c = draws(4, out.decoded.len());
                    let bars = adjoint(&x, &out, &c);
                    let what = format!("{kind:?} {placement:?} {reading:?} {supervision:?}");
                    let check = |name: &str, bar: &[f64], direction: &[f64], at: &dyn Fn(f64) -> f64| {
                        let ours = bar.iter().zip(direction).fold(0.0, |s, (b, d)| s + b * d);
                        // Kinks of the networks lie close to one another; the step that meets none tells.
                        let error = |h: f64| {
                            let coarse = (at(2.0 * h) - at(-2.0 * h)) / (4.0 * h);
                            let fine = (at(h) - at(-h)) / (2.0 * h);
                            (ours - (4.0 * fine - coarse) / 3.0).abs() / (1e-3 + ours.abs())
                        };
                        let least =
                            [1e-4, 1e-5, 1e-6, 1e-7].map(error).into_iter().fold(f64::INFINITY, order::min);
                        assert!(least < 1e-7, "{what}, {name}: {ours} is off by {least:e}");
                    };
                    let moved = |values: &[f64], v: &[f64], t: f64| -> Vec<f64> {
                        values.iter().zip(v).map(|(x, v)| x + t * v).collect()
                    };
                    let v = draws(9, items * d);
                    check("mu", &bars.mu, &v, &|t| value(&In { mu: &moved(&mu, &v, t), ..x }, &c));
                    check("ell", &bars.ell, &v, &|t| value(&In { ell: &moved(&ell, &v, t), ..x }, &c));
                    let mut w = draws(10, n * n);
                    (0..n).for_each(|i| w[i * n + i] = 0.0);
                    check("mask", &bars.mask, &w, &|t| value(&In { mask: &moved(&mask, &w, t), ..x }, &c));
                    // Parameters in double precision, one array after the other.
                    let shapes = sizes.shapes();
                    for (at, bar) in bars.structure.arrays(kind).into_iter().enumerate() {
                        let name = &shapes[at].0;
                        if name == "structure.logits" {
                            continue; // they act through the mask
                        }
                        let v = draws(20 + at as u16, bar.len());
                        check(name, bar, &v, &|t| {
                            let mut other = structure.clone();
                            let into = other.array_mut(at);
                            into.iter_mut().zip(&v).for_each(|(x, v)| *x += t * v);
                            value(&In { structure: &other, ..x }, &c)
                        });
                    }
                }
            }
        }
    }
}
