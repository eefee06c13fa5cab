//! One training step: forward pass, losses and gradients of a batch.
//!
//! Prediction by n sweeps inverts abduction only on graphs without cycles. While edges are not settled, masks
//! are drawn at random, and along a cycle a counterfactual can grow from sweep to sweep. If the root mean
//! square of the counterfactuals is more than ten times that of the posterior means and of the given values,
//! the mask is restricted to edges along an order of the factors drawn for the step, and factors and
//! counterfactuals are computed again.

mod batch;
mod mask;
mod model;
mod shown;

pub use batch::Batch;
pub use model::Model;

use super::data::Data;
use super::latent::{self, Layout, Terms};
use super::purpose;
use super::settings::{Settings, Supervision, Weights};
use super::structure::Structure;
use super::targets::{self, Pairs};
use crate::Result;
use crate::causal::{acyclic, edges, independence, probability};
use crate::num::order;
use crate::num::rng::Rng;
use crate::tape::{Grads, Tape};
use mask::{Draw, Mask};
use model::{inputs, joined, split};
use ndarray::{ArrayD, IxDyn};
use shown::Shown;

/// State of the training that a step reads.
#[derive(Clone, Debug, PartialEq)]
pub struct Context {
    /// Number of the step.
    pub step: u32,
    /// Current value of w_KL.
    pub kl: f64,
    /// Current value of w₄.
    pub groups: f64,
    /// Multiplier λ_h and penalty ρ; `None` while the logits are not trained.
    pub lagrange: Option<[f64; 2]>,
    /// The final graph; `None` while it is learned.
    pub graph: Option<Vec<f64>>,
    /// Running variances of the factors, shape (n).
    pub spread: Vec<f64>,
    /// Covariances of L_MI from earlier batches.
    pub history: independence::History,
}

/// Losses of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// The reconstruction loss L_rec.
    pub reconstruction: f64,
    /// The counterfactual loss L_int.
    pub intervention: f64,
    /// Terms of the latent part.
    pub terms: Terms,
    /// The acyclicity h of the probabilities.
    pub acyclic: f64,
    /// The sum Σ p of the probabilities.
    pub edges: f64,
}

/// The result of a step.
#[derive(Clone, Debug)]
pub struct StepResult {
    /// Losses, unweighted.
    pub losses: Losses,
    /// Gradients with respect to the parameters.
    pub grads: Grads,
    /// Variances of the factors of this batch, averaged over their dimensions, shape (n).
    pub spread: Vec<f64>,
    /// Covariance of the variables of L_MI, shape (d, d).
    pub covariance: Option<Vec<f64>>,
}

/// Losses and gradients of a batch.
///
/// # Errors
/// If a covariance of the posterior is not positive definite.
///
/// # Panics
/// If the model does not match the data.
pub fn run(
    model: &Model,
    settings: &Settings,
    data: &dyn Data,
    batch: &Batch,
    context: &Context,
) -> Result<StepResult> {
    let d = model.sizes.latent();
    let n = model.sizes.factors;
    let (rng, step) = (Rng::new(settings.seed), context.step);
    let (share, carried) = context.history.carried();
    // Encoder.
    let mut tape = Tape::new();
    let x = tape.constant(model.encoder.batch(inputs(data, &batch.items)));
    let vars = model.params.of("encoder.").record(&mut tape);
    let encoded = model.encoder.record(&mut tape, &vars, x);
    let [mu, ell] = split(&tape.value(encoded), d);
    // Factors.
    let structure = Structure::new(model.sizes, &model.params);
    let draw = Draw { rng, step, factors: n, tau: settings.tau };
    let mut mask = Mask::new(&structure, context.graph.as_deref(), draw);
    let layout = &Layout {
        targets: targets(model, settings, batch, &mask.edges, &mu, &context.spread),
        ..batch.layout.clone()
    };
    let eta: Vec<f64> = (0..mu.len()).map(|at| rng.normal_f64(at as u64, step, purpose::ETA, 0)).collect();
    let unmasked = latent::In {
        structure: &structure,
        mask: &[],
        layout,
        mu: &mu,
        ell: &ell,
        eta: &eta,
        spread: &context.spread,
        labels: &batch.labels,
        reading: settings.reading,
        supervision: settings.supervision,
        weights: Weights { kl: context.kl, groups: context.groups, ..settings.weights },
        placement: settings.placement,
        carried: carried.as_deref().map(|sum| (sum, share)),
    };
    let mut out = latent::forward(&latent::In { mask: &mask.edges, ..unmasked })?;
    let told: &[f64] = if settings.supervision == Supervision::Labels { &batch.labels } else { &[] };
    if context.graph.is_none() && mask::grows(&out.decoded[mu.len()..], &mu, told) {
        mask.limit(&structure, draw);
        out = latent::forward(&latent::In { mask: &mask.edges, ..unmasked })?;
    }
    // Decoder.
    let frame = data.frame();
    let shown = Shown::new(settings, data, batch, out.decoded.len() / d, context.groups, step);
    let z: Vec<f32> = out.decoded.iter().map(|&z| z as f32).collect();
    let passed = model.decoder.pass(&model.params, &z, &shown.targets(), &frame.scale, &frame.precision);
    // Backward pass.
    let z_bar: Vec<f64> = passed.z_bar.iter().map(|&z| f64::from(z)).collect();
    let mut bars = latent::adjoint(&latent::In { mask: &mask.edges, ..unmasked }, &out, &z_bar);
    if context.graph.is_none() {
        mask.to_logits(&structure, draw, &mut bars);
    }
    let [acyclic, edges] = graph_costs(settings, context, &structure, n, &mut bars);
    let mut grads = tape.backward(encoded, joined([&bars.mu, &bars.ell], d));
    for ((name, shape), grad) in model.decoder.shapes().iter().zip(passed.grads) {
        let array = ArrayD::from_shape_vec(IxDyn(shape), grad).expect("the shape of the parameter");
        grads.0.insert(name.to_owned(), array);
    }
    grads.0.extend(bars.structure.grads(model.sizes).0);
    let mean = |losses: &[f64]| losses.iter().fold(0.0, |s, l| s + l) / Ord::max(1, losses.len()) as f64;
    let items = batch.items.len();
    let losses = Losses {
        reconstruction: mean(&passed.losses[..items]),
        intervention: mean(&passed.losses[items..]),
        terms: out.terms,
        acyclic,
        edges,
    };
    let spread = spread(&out.means[..batch.layout.observed * d], n, model.sizes.width);
    Ok(StepResult { losses, grads, spread, covariance: out.covariance().map(<[f64]>::to_vec) })
}

/// h and Σ p of the probabilities; while edges are trained, their gradients are added to those of the logits.
fn graph_costs(
    settings: &Settings,
    context: &Context,
    structure: &Structure,
    n: usize,
    bars: &mut latent::Bars,
) -> [f64; 2] {
    let p = structure.probabilities(settings.tau);
    let (h, saved) = acyclic::forward(&p, n, settings.alpha);
    if let (None, Some([lambda, rho])) = (&context.graph, context.lagrange) {
        let cost = edges::Weights { sparsity: settings.weights.sparsity, anchor: 0.0 };
        let mut p_bar = vec![0.0; n * n];
        edges::adjoint(&cost, &p, &p, n, 1.0, &mut p_bar);
        acyclic::adjoint(&p, n, settings.alpha, &saved, lambda + rho * h, &mut p_bar);
        probability::adjoint(&p, n, settings.tau, &p_bar, &mut bars.structure.logits);
    }
    [h, p.iter().fold(0.0, |s, p| s + p)]
}

/// The factor set in each group, as given or as inferred from the noise of the means.
fn targets(
    model: &Model,
    settings: &Settings,
    batch: &Batch,
    mask: &[f64],
    mu: &[f64],
    spread: &[f64],
) -> Vec<usize> {
    let (layout, k) = (&batch.layout, model.sizes.width);
    if settings.supervision != Supervision::Unknown || layout.pairs() == 0 {
        return layout.targets.clone();
    }
    let pairs = &mu[layout.base(0) * model.sizes.latent()..];
    let [_, eps] = model.linked(settings.reading, mask, pairs.to_vec());
    let (before, after) = eps.split_at(eps.len() / 2);
    let spread: Vec<f64> = spread.iter().flat_map(|v| vec![order::max(v.sqrt(), 1e-3); k]).collect();
    targets::voted(&Pairs {
        eps: before,
        eps_after: after,
        spread: &spread,
        factors: model.sizes.factors,
        members: layout.members,
    })
}

/// Variance of each factor over rows (B, n, k), averaged over its k dimensions.
fn spread(means: &[f64], n: usize, k: usize) -> Vec<f64> {
    let d = n * k;
    let count = (means.len() / d) as f64;
    let variance = |c: usize| {
        let column = || means.iter().skip(c).step_by(d);
        let mean = column().fold(0.0, |s, x| s + x) / count;
        column().fold(0.0, |s, x| s + (x - mean) * (x - mean)) / count
    };
    (0..n).map(|i| (0..k).fold(0.0, |s, c| s + variance(i * k + c)) / k as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::last::model::vectors::Vectors;
    use data_gen::figure::graph::Graph;
    use data_gen::figure::mechanism::{Mechanism, Scm};

    #[test]
    fn masks_along_which_counterfactuals_grow_lose_their_cycles() {
        let scm = Scm::new(Graph::named("FORK", 4, 1).expect("a name"), Mechanism::Lin, true, 1);
        let data = Vectors::new(&scm, 1, 64, 16);
        let settings = Settings {
            points: 1,
            width: 1,
            observed: 16,
            groups: 4,
            kind: super::super::structure::Kind::Linear,
            ..Settings::default()
        };
        let mut model = Model::new(&settings, &data).expect("a model");
        let losses = |model: &Model, step: u32, graph: Option<Vec<f64>>| {
            let batch = Batch::draw(&settings, &data, step);
            let history = independence::History::default();
            let context =
                Context { step, kl: 1e-3, groups: 1.0, lagrange: None, graph, spread: vec![1.0; 4], history };
            run(model, &settings, &data, &batch, &context).expect("finite")
        };
        let weight = |model: &mut Model, size: f32| {
            model.params.get_mut("structure.weight").expect("linear").fill(size);
        };
        let cycle: Vec<f64> = (0..16).map(|at| f64::from(u8::from(at / 4 != at % 4))).collect();
        let calm = losses(&model, 3, Some(cycle.clone())).losses.intervention;
        weight(&mut model, 30.0);
        let wild = losses(&model, 3, Some(cycle)).losses.intervention;
        assert!(wild > 1e6 * calm, "a given graph is not restricted: {wild:e} and {calm:e}");
        for step in 3..9 {
            let stepped = losses(&model, step, None);
            let drawn = stepped.losses.intervention;
            assert!(drawn < 1e-2 * wild, "step {step}: {drawn:e} instead of {wild:e}");
            // At least half of the edges are absent and have no gradient.
            let still =
                stepped.grads.get("structure.logits").expect("U").iter().filter(|g| **g == 0.0).count();
            assert!(still >= 4 + 6, "step {step}: {still} of 16 are 0");
        }
        weight(&mut model, 0.1);
        let still = losses(&model, 3, None)
            .grads
            .get("structure.logits")
            .expect("U")
            .iter()
            .filter(|g| **g == 0.0)
            .count();
        assert_eq!(still, 4, "without growth all edges except the diagonal are present");
    }
}
