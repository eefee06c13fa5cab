//! Fine-tuning of the structure on one subject (`last.md` §8): encoder, decoder and node networks stay, U (and Ω) move.
//!
//! The subject's pictures are encoded once. `reference`: reconstruction does not depend on A, so what moves it is the likelihood of the subject's
//! factors under the graph (KL), the dependence of their noise, h and Σp; no points are needed. `literal`: the decoded points are held to the posed
//! template, in space alone. Both add 0.1 Σ (p − p₀)², so that A does not drift without evidence. All pictures are one batch; a step draws a
//! mask and the noise of the posterior. Before the first, logits of edges that the search took or added are mirrored: masks are drawn from the graph's own
//! probabilities. After the last, the deviations of factors and noise follow the graph.

use super::decoder::{Target, code};
use super::file::Trained;
use super::guide;
use super::latent::{self, Layout};
use super::purpose;
use super::settings::{Reading, Supervision, Weights};
use super::structure::{Kind, Structure};
use super::verdict;
use crate::causal::{acyclic, mask, repair};
use crate::num::rng::Rng;
use crate::optim::adam::{Adam, Counters, Rule};
use crate::scene::person::PersonCapture;
use crate::{Error, Result};

/// How long and how fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// steps
    pub steps: u32,
    /// rate of U and Ω
    pub lr: f64,
    /// factor of Σ (p − p₀)²
    pub anchor: f64,
    /// of all draws
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { steps: 500, lr: 3e-3, anchor: 0.1, seed: 0 }
    }
}

/// The subject: what the encoder makes of its pictures, and where its points are.
#[derive(Clone, Debug, Default)]
pub struct Subject {
    /// (T, d) means
    pub mu: Vec<f64>,
    /// (T, d) ℓ
    pub ell: Vec<f64>,
    /// codes (P, 27) and positions at rest (P, 3), for the literal reading
    pub codes: Vec<f32>,
    /// (P, 3)
    pub rest: Vec<[f32; 3]>,
    /// (T, P, 3) the posed template
    pub posed: Vec<Vec<[f32; 3]>>,
}

impl Subject {
    /// What the model makes of the training pictures of a capture.
    ///
    /// # Errors
    /// A picture that cannot be read; no training pictures.
    pub fn new(trained: &Trained, capture: &PersonCapture) -> Result<Self> {
        let mut subject = Self::default();
        if trained.settings.reading == Reading::Literal {
            subject.rest = capture.template.points.clone();
            subject.codes = code(&subject.rest);
        }
        for &i in &capture.train {
            let shot = &capture.shots[i];
            let [mu, ell] = trained.posterior(&guide::seen(trained, capture, shot, &shot.photo()?)?);
            subject.mu.extend(mu);
            subject.ell.extend(ell);
            if trained.settings.reading == Reading::Literal {
                subject.posed.push(capture.posed_points(shot.time));
            }
        }
        if subject.mu.is_empty() {
            return Err(Error::input(capture.folder.display().to_string())
                .expected("at least one training picture")
                .got("none"));
        }
        Ok(subject)
    }
}

/// What tuning did.
#[derive(Clone, Debug, PartialEq)]
pub struct Tuned {
    /// (n, n) before
    pub before: Vec<f64>,
    /// (n, n) after
    pub after: Vec<f64>,
    /// edges of the graph before and after
    pub edges: [Vec<(usize, usize)>; 2],
    /// the loss at the first and the last step
    pub losses: [f64; 2],
}

/// Tunes the structure of `trained` in place.
///
/// # Errors
/// No pictures; a loss that is not finite.
pub fn run(trained: &mut Trained, subject: &Subject, settings: &Settings) -> Result<Tuned> {
    let sizes = trained.model.sizes;
    let (n, d) = (sizes.factors, sizes.latent());
    let frames = subject.mu.len() / d;
    if frames == 0 {
        return Err(Error::input("subject").expected("at least one picture").got("none"));
    }
    let tau = trained.settings.tau;
    let deviations =
        |t: &Trained| verdict::linked(t, subject.mu.clone()).map(|rows| verdict::deviations(&rows, d));
    let spread_before = deviations(trained);
    agree(trained);
    let before = Structure::new(sizes, &trained.model.params).probabilities(tau);
    let edges_before = trained.graph.edges();
    let layout = Layout { observed: frames, targets: Vec::new(), members: 0 };
    let mut names = vec!["structure.logits"];
    if sizes.kind != Kind::Networks {
        names.push("structure.weight");
    }
    let rule = Rule { counters: Counters::Global, ..Rule::default() };
    let mut optimisers = names.iter().map(|_| Adam::new(rule, n * n, 1)).collect::<Result<Vec<_>>>()?;
    let rng = Rng::new(settings.seed);
    let [mut first, mut last] = [0.0; 2];
    for step in 0..settings.steps {
        let structure = Structure::new(sizes, &trained.model.params);
        let draw = |item: usize, purpose: u16| rng.uniform_f64(item as u64, step, purpose, 1);
        let uniform: Vec<f64> = (0..n * n).map(|at| draw(at, purpose::MASK)).collect();
        let sampled = mask::forward(&structure.logits, &uniform, n, tau);
        let eta: Vec<f64> =
            (0..subject.mu.len()).map(|at| rng.normal_f64(at as u64, step, purpose::ETA, 1)).collect();
        let spread = vec![1.0; n];
        // KL at full weight: it is the likelihood that carries the evidence.
        let weights = Weights { kl: 1.0, ..trained.settings.weights };
        let x = latent::In {
            structure: &structure,
            mask: &sampled,
            layout: &layout,
            mu: &subject.mu,
            ell: &subject.ell,
            eta: &eta,
            spread: &spread,
            labels: &[],
            reading: trained.settings.reading,
            supervision: Supervision::None,
            weights,
            placement: trained.settings.placement,
            carried: None,
        };
        let out = latent::forward(&x)?;
        let mut loss = weights.kl * out.terms.kl + weights.independence * out.terms.independence;
        let mut z_bar = vec![0.0; out.decoded.len()];
        if trained.settings.reading == Reading::Literal {
            loss += reconstruct(trained, subject, &out.decoded, &mut z_bar);
        }
        let mut bars = latent::adjoint(&x, &out, &z_bar);
        mask::adjoint(&structure.logits, &uniform, n, tau, &bars.mask, &mut bars.structure.logits);
        let p = structure.probabilities(tau);
        let (h, saved) = acyclic::forward(&p, n, trained.settings.alpha);
        let mut p_bar = vec![0.0; n * n];
        acyclic::adjoint(&p, n, trained.settings.alpha, &saved, 1.0 + h, &mut p_bar);
        loss += h + 0.5 * h * h;
        for at in (0..n * n).filter(|at| at / n != at % n) {
            let off = p[at] - before[at];
            loss += weights.sparsity * p[at] + settings.anchor * (off * off);
            let slope = p_bar[at] + weights.sparsity + 2.0 * settings.anchor * off;
            bars.structure.logits[at] += slope * (p[at] * (1.0 - p[at]) / tau);
        }
        if !loss.is_finite() {
            let at = format!("step {step}");
            return Err(Error::check("fine-tuning").at(at).expected("a finite loss").got(loss.to_string()));
        }
        first = if step == 0 { loss } else { first };
        last = loss;
        let arrays = bars.structure.arrays(sizes.kind);
        for (name, (adam, bar)) in names.iter().zip(optimisers.iter_mut().zip(arrays)) {
            let grad: Vec<f32> = bar.iter().map(|&g| g as f32).collect();
            let param = trained.model.params.get_mut(name).expect("a parameter of the structure");
            adam.step(param.as_slice_mut().expect("contiguous"), &grad, &[settings.lr], None)?;
        }
    }
    let after = Structure::new(sizes, &trained.model.params).probabilities(tau);
    trained.graph = repair::repair(n, &after, 0.5).0;
    // Deviations are those of the training set; what another graph makes of them is measured on the subject.
    let spread_after = deviations(trained);
    let spreads = [&mut trained.factor_spread, &mut trained.noise_spread];
    for (spread, (new, old)) in spreads.into_iter().zip(spread_after.iter().zip(&spread_before)) {
        for (s, (new, old)) in spread.iter_mut().zip(new.iter().zip(old)) {
            *s *= new / old;
        }
    }
    Ok(Tuned { before, after, edges: [edges_before, trained.graph.edges()], losses: [first, last] })
}

/// Mirrors the logits of edges that the search of the pre-training took or added, so that masks are drawn from the graph's own probabilities.
fn agree(trained: &mut Trained) {
    let n = trained.model.sizes.factors;
    let logits = trained.model.params.get_mut("structure.logits").expect("a parameter of the structure");
    for (at, u) in logits.iter_mut().enumerate() {
        if at / n != at % n && trained.graph.has(at / n, at % n) != (*u > 0.0) {
            *u = -*u;
        }
    }
}

/// Loss of the decoded points against the posed template, in space alone, and its gradient by the factors.
fn reconstruct(trained: &Trained, subject: &Subject, decoded: &[f64], z_bar: &mut [f64]) -> f64 {
    let frame = super::pictures::frame(&subject.rest);
    let precision: Vec<f32> =
        frame.precision.iter().enumerate().map(|(c, w)| if c < 3 { *w } else { 0.0 }).collect();
    let wanted: Vec<Vec<f32>> = subject
        .posed
        .iter()
        .map(|points| points.iter().flat_map(|x| [x[0], x[1], x[2], 0.0, 0.0, 0.0]).collect())
        .collect();
    let weight = (trained.settings.weights.reconstruction / wanted.len() as f64) as f32;
    let targets: Vec<Target<'_>> = wanted
        .iter()
        .map(|wanted| Target { codes: &subject.codes, base: &frame.base, wanted, weight })
        .collect();
    let z: Vec<f32> = decoded.iter().map(|&z| z as f32).collect();
    let passed = trained.model.decoder.pass(&trained.model.params, &z, &targets, &frame.scale, &precision);
    z_bar.iter_mut().zip(&passed.z_bar).for_each(|(b, g)| *b = f64::from(*g));
    passed.losses.iter().fold(0.0, |s, l| s + l) * f64::from(weight)
}
