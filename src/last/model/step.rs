//! One batch: forward, losses, gradients.
//!
//! Prediction by n sweeps gives back what abduction took apart on graphs without cycles only. Masks are drawn while edges are not settled, and along a cycle a counterfactual
//! can grow from sweep to sweep. Where counterfactuals lie ten times as far out as the posterior means, and as values that are told (root mean squares), the mask keeps
//! only edges along an order of the factors that is drawn for the step, and factors and counterfactuals are computed anew.

use super::data::{Data, Item};
use super::decoder::{Decoder, Target};
use super::encoder::Encoder;
use super::latent::{self, Layout, Terms};
use super::purpose;
use super::settings::{Reading, Settings, Supervision, Weights};
use super::structure::{Sizes, Structure};
use super::targets::{self, Pairs};
use crate::Result;
use crate::causal::{acyclic, edges, independence, mask, probability, structure};
use crate::num::rng::Rng;
use crate::num::{order, par};
use crate::tape::{Grads, Params, Tape};
use ndarray::{ArrayD, IxDyn};

/// The networks and their parameters.
#[derive(Clone, Debug)]
pub struct Model {
    /// E
    pub encoder: Encoder,
    /// D
    pub decoder: Decoder,
    /// A, g
    pub sizes: Sizes,
    /// all parameters
    pub params: Params,
}

impl Model {
    /// A model for `data` with its first values.
    ///
    /// # Errors
    /// Pictures of a size that has no encoder.
    pub fn new(settings: &Settings, data: &dyn Data) -> Result<Self> {
        let sizes = Sizes { factors: settings.factors, width: settings.width, kind: settings.kind };
        let frame = data.frame();
        let encoder = Encoder::new(data.input(), sizes.latent())?;
        let decoder = Decoder { features: frame.features, latent: sizes.latent(), outputs: frame.outputs };
        let mut params = Params::new();
        encoder.draw(settings.seed, &mut params);
        decoder.draw(settings.seed, &mut params);
        sizes.draw(settings.seed, &mut params);
        Ok(Self { encoder, decoder, sizes, params })
    }

    /// Means μ and logarithms ℓ of the posterior of some items, (B, d) each.
    pub fn encode(&self, data: &dyn Data, items: &[Item]) -> [Vec<f64>; 2] {
        let mut halves = [Vec::new(), Vec::new()];
        for part in items.chunks(256) {
            let mut tape = Tape::new();
            let x = tape.constant(self.encoder.batch(inputs(data, part)));
            let vars = self.params.of("encoder.").constants(&mut tape);
            let y = self.encoder.record(&mut tape, &vars, x);
            let [mu, ell] = split(&tape.value(y), self.sizes.latent());
            halves[0].extend(mu);
            halves[1].extend(ell);
        }
        halves
    }
}

impl Model {
    /// Factors u and noise ε (B, d) behind means of the encoder, along the edges of `mask` (n, n).
    pub fn linked(&self, reading: Reading, mask: &[f64], mu: Vec<f64>) -> [Vec<f64>; 2] {
        let structure = Structure::new(self.sizes, &self.params);
        let x = structure::In {
            eps: &mu,
            mask,
            mechanism: structure.mechanism(),
            batch: mu.len() / self.sizes.latent(),
            n: self.sizes.factors,
            k: self.sizes.width,
            sweeps: structure.sweeps(),
        };
        match reading {
            Reading::Reference => {
                let eps = structure::abduct(&x);
                [mu, eps]
            }
            Reading::Literal => {
                let u = structure::forward(&x).0;
                [u, mu]
            }
        }
    }
}

/// What the encoder sees of the items.
fn inputs(data: &dyn Data, items: &[Item]) -> Vec<f32> {
    let size = data.input().len();
    let mut x = vec![0.0; items.len() * size];
    par::chunks_mut(&mut x, size, |i, into| data.write_input(items[i], into));
    x
}

/// (B, 2 d) as μ and ℓ.
fn split(y: &ArrayD<f32>, d: usize) -> [Vec<f64>; 2] {
    let mut halves = [Vec::new(), Vec::new()];
    for (at, &y) in y.iter().enumerate() {
        halves[at / d % 2].push(f64::from(y));
    }
    halves
}

/// The items of a step and how they are laid out.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// all items
    pub items: Vec<Item>,
    /// what they are
    pub layout: Layout,
    /// values that were set, per group
    pub labels: Vec<f64>,
}

impl Batch {
    /// Drawn by counter: observed items at random, groups whose targets go round the factors.
    pub fn draw(settings: &Settings, data: &dyn Data, step: u32) -> Self {
        let rng = Rng::new(settings.seed);
        let mut items: Vec<Item> = (0..settings.observed)
            .map(|b| Item::Observed(rng.index(data.observed(), b as u64, step, purpose::BATCH, 0)))
            .collect();
        let observed = items.len();
        let count = if settings.supervision == Supervision::None { 0 } else { settings.groups };
        let mut chosen = Vec::new();
        // Factors that some group sets: others are never asked for.
        let is_set = |target: &usize| data.groups().iter().any(|g| g.target == *target);
        let targets: Vec<usize> = (0..settings.factors).filter(is_set).collect();
        for slot in 0..if targets.is_empty() { 0 } else { count } {
            let target = targets[(slot + step as usize * count) % targets.len()];
            // Where targets are not told, they do not choose either.
            let is_told = settings.supervision != Supervision::Unknown;
            let of: Vec<usize> =
                (0..data.groups().len()).filter(|&g| !is_told || data.groups()[g].target == target).collect();
            chosen.push(of[rng.index(of.len(), slot as u64, step, purpose::BATCH, 1)]);
        }
        let members = data.members();
        items.extend(chosen.iter().flat_map(|&g| (0..members).map(move |m| Item::Base(g, m))));
        items.extend(chosen.iter().flat_map(|&g| (0..members).map(move |m| Item::After(g, m))));
        Self {
            items,
            layout: Layout {
                observed,
                targets: chosen.iter().map(|&g| data.groups()[g].target).collect(),
                members,
            },
            labels: chosen.iter().map(|&g| data.groups()[g].value).collect(),
        }
    }
}

/// State of the training that a step reads.
#[derive(Clone, Debug, PartialEq)]
pub struct Context {
    /// number of the step
    pub step: u32,
    /// w_KL now
    pub kl: f64,
    /// w₄ now
    pub groups: f64,
    /// multiplier λ_h and penalty ρ; none while the logits are at rest
    pub lagrange: Option<[f64; 2]>,
    /// the final graph; none while it is learned
    pub graph: Option<Vec<f64>>,
    /// (n) running variances of the factors
    pub spread: Vec<f64>,
    /// what L_MI looked at in earlier batches
    pub history: independence::History,
}

/// Losses of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// L_rec
    pub reconstruction: f64,
    /// L_int
    pub intervention: f64,
    /// of factors
    pub terms: Terms,
    /// h of the probabilities
    pub acyclic: f64,
    /// Σ p
    pub edges: f64,
}

/// What a step gives.
#[derive(Clone, Debug)]
pub struct Stepped {
    /// losses, without factors
    pub losses: Losses,
    /// by the parameters
    pub grads: Grads,
    /// (n) variances of the factors of this batch, mean over their numbers
    pub spread: Vec<f64>,
    /// (d, d) covariance of what L_MI looked at
    pub covariance: Option<Vec<f64>>,
}

/// Counterfactuals so many times as far out as what is encoded come from a mask with a cycle.
const FAR: f64 = 10.0;

/// Whether counterfactuals have grown along a cycle, beyond what is encoded and what is told.
fn grows(counterfactuals: &[f64], encoded: &[f64], told: &[f64]) -> bool {
    let mean_square = |x: &[f64]| x.iter().fold(0.0, |s, x| s + x * x) / Ord::max(1, x.len()) as f64;
    let usual = order::max(mean_square(encoded), mean_square(told));
    // A NaN grows, too.
    !(mean_square(counterfactuals) <= FAR * FAR * usual)
}

/// (n, n) 1 where the first factor comes before the second in an order drawn for the step.
fn ordered(rng: &Rng, n: usize, step: u32) -> Vec<f64> {
    let place: Vec<f64> = (0..n).map(|i| rng.uniform_f64(i as u64, step, purpose::ORDER, 0)).collect();
    (0..n * n).map(|at| f64::from(u8::from(place[at / n] < place[at % n]))).collect()
}

/// Losses and gradients of a batch.
///
/// # Errors
/// A covariance of the posterior that is not positive definite.
///
/// # Panics
/// When the model does not fit the data.
pub fn run(
    model: &Model,
    settings: &Settings,
    data: &dyn Data,
    batch: &Batch,
    context: &Context,
) -> Result<Stepped> {
    let d = model.sizes.latent();
    let n = model.sizes.factors;
    let rng = Rng::new(settings.seed);
    let step = context.step;
    let (share, carried) = context.history.carried();
    // Encoder.
    let mut tape = Tape::new();
    let x = tape.constant(model.encoder.batch(inputs(data, &batch.items)));
    let vars = model.params.of("encoder.").record(&mut tape);
    let encoded = model.encoder.record(&mut tape, &vars, x);
    let [mu, ell] = split(&tape.value(encoded), d);
    // Factors.
    let structure = Structure::new(model.sizes, &model.params);
    let uniform: Vec<f64> = (0..n * n).map(|at| rng.uniform_f64(at as u64, step, purpose::MASK, 0)).collect();
    let mut sampled = match &context.graph {
        Some(graph) => graph.clone(),
        None => mask::forward(&structure.logits, &uniform, n, settings.tau),
    };
    let layout = &Layout {
        targets: targets(model, settings, batch, &sampled, &mu, &context.spread),
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
    let mut out = latent::forward(&latent::In { mask: &sampled, ..unmasked })?;
    let told: &[f64] = if settings.supervision == Supervision::Labels { &batch.labels } else { &[] };
    let far = context.graph.is_none() && grows(&out.decoded[mu.len()..], &mu, told);
    let along = far.then(|| ordered(&rng, n, step));
    if let Some(along) = &along {
        sampled.iter_mut().zip(along).for_each(|(drawn, along)| *drawn *= along);
        out = latent::forward(&latent::In { mask: &sampled, ..unmasked })?;
    }
    // Decoder.
    let frame = data.frame();
    let chosen = points(settings, frame.points(), out.decoded.len() / d, step);
    let pick = |table: &[f32], width: usize, of: &[usize]| -> Vec<f32> {
        of.iter().flat_map(|&p| table[p * width..(p + 1) * width].iter().copied()).collect()
    };
    let items = batch.items.len();
    let pairs = batch.layout.pairs();
    let rows: Vec<[Vec<f32>; 3]> = chosen
        .iter()
        .enumerate()
        .map(|(b, of)| {
            let shown = if b < items { batch.items[b] } else { batch.items[batch.layout.after(b - items)] };
            [
                pick(&frame.codes, frame.features, of),
                pick(&frame.base, frame.outputs, of),
                pick(data.shown(shown), frame.outputs, of),
            ]
        })
        .collect();
    let weight = |b: usize| {
        let w = if b < items {
            settings.weights.reconstruction / items as f64
        } else {
            context.groups * settings.weights.intervention / pairs as f64
        };
        w as f32
    };
    let targets: Vec<Target<'_>> = rows
        .iter()
        .enumerate()
        .map(|(b, [codes, base, wanted])| Target { codes, base, wanted, weight: weight(b) })
        .collect();
    let z: Vec<f32> = out.decoded.iter().map(|&z| z as f32).collect();
    let passed = model.decoder.pass(&model.params, &z, &targets, &frame.scale, &frame.precision);
    // And back.
    let z_bar: Vec<f64> = passed.z_bar.iter().map(|&z| f64::from(z)).collect();
    let mut bars = latent::adjoint(&latent::In { mask: &sampled, ..unmasked }, &out, &z_bar);
    let mean = |losses: &[f64]| losses.iter().fold(0.0, |s, l| s + l) / Ord::max(1, losses.len()) as f64;
    let mut losses = Losses {
        reconstruction: mean(&passed.losses[..items]),
        intervention: mean(&passed.losses[items..]),
        terms: out.terms,
        ..Losses::default()
    };
    let p = structure.probabilities(settings.tau);
    let (h, saved) = acyclic::forward(&p, n, settings.alpha);
    losses.acyclic = h;
    losses.edges = p.iter().fold(0.0, |s, p| s + p);
    if context.graph.is_none() {
        if let Some(along) = &along {
            bars.mask.iter_mut().zip(along).for_each(|(bar, along)| *bar *= along);
        }
        mask::adjoint(&structure.logits, &uniform, n, settings.tau, &bars.mask, &mut bars.structure.logits);
        if let Some([lambda, rho]) = context.lagrange {
            let cost = edges::Weights { sparsity: settings.weights.sparsity, anchor: 0.0 };
            let mut p_bar = vec![0.0; n * n];
            edges::adjoint(&cost, &p, &p, n, 1.0, &mut p_bar);
            acyclic::adjoint(&p, n, settings.alpha, &saved, lambda + rho * h, &mut p_bar);
            probability::adjoint(&p, n, settings.tau, &p_bar, &mut bars.structure.logits);
        }
    }
    let bar: Vec<f32> = (0..mu.len() * 2)
        .map(|at| {
            let (row, column) = (at / (2 * d), at % (2 * d));
            let from = if column < d { &bars.mu } else { &bars.ell };
            from[row * d + column % d] as f32
        })
        .collect();
    let bar = ArrayD::from_shape_vec(IxDyn(&[items, 2 * d]), bar).expect("(B, 2 d)");
    let mut grads = tape.backward(encoded, bar);
    let mut put = |name: &str, shape: &[usize], values: Vec<f32>| {
        let array = ArrayD::from_shape_vec(IxDyn(shape), values).expect("the shape of the parameter");
        grads.0.insert(name.to_owned(), array);
    };
    for ((name, shape), grad) in model.decoder.shapes().iter().zip(passed.grads) {
        put(name, shape, grad);
    }
    grads.0.extend(bars.structure.grads(model.sizes).0);
    let spread = spread(&out.means[..batch.layout.observed * d], n, model.sizes.width);
    Ok(Stepped { losses, grads, spread, covariance: out.covariance().map(<[f64]>::to_vec) })
}

/// The factor set in each group: as told, or as the noise of the means says.
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

/// One coordinate from each of Q runs of the P, per item; all of them where P ≤ Q.
fn points(settings: &Settings, p: usize, items: usize, step: u32) -> Vec<Vec<usize>> {
    let rng = Rng::new(settings.seed);
    let q = Ord::min(settings.points, p);
    (0..items)
        .map(|b| {
            (0..q)
                .map(|i| {
                    let (from, to) = (i * p / q, (i + 1) * p / q);
                    from + rng.index(to - from, (b * q + i) as u64, step, purpose::POINTS, 0)
                })
                .collect()
        })
        .collect()
}

/// Variance of each factor over rows (B, n, k), mean over its k numbers.
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
        assert!(wild > 1e6 * calm, "a given graph is as it is: {wild:e} and {calm:e}");
        for step in 3..9 {
            let stepped = losses(&model, step, None);
            let drawn = stepped.losses.intervention;
            assert!(drawn < 1e-2 * wild, "step {step}: {drawn:e} instead of {wild:e}");
            // Half of the edges, at least, are not there and have no gradient.
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
        assert_eq!(still, 4, "without growth all edges but the diagonal are there");
    }
}
