//! Fine-tuning of the structure on one subject: encoder, decoder and node networks are fixed, U (and Ω) are
//! trained.
//!
//! The images of the subject are encoded once. In the reading `reference`, reconstruction does not depend on
//! A, so A is trained by the likelihood of the subject's factors under the graph (KL), the dependence of
//! their noise, h and Σp; no points are required. In the reading `literal`, the decoded points are compared
//! with the posed template, using positions only. Both add 0.1 Σ (p − p₀)², so that A does not drift without
//! evidence. All images form one batch; a step draws a mask and the noise of the posterior. Before the first
//! step, the logits of edges that the search removed or added are mirrored, so that masks are drawn from
//! probabilities consistent with the graph. After the last step, the standard deviations of factors and noise
//! are updated for the new graph.

use super::decoder::{Target, code};
use super::evaluation;
use super::file::Trained;
use super::guide;
use super::latent::{self, Layout};
use super::purpose;
use super::settings::{Reading, Supervision, Weights};
use super::structure::{EFFECTS, LOGITS, Structure};
use crate::causal::{acyclic, edges, mask, probability, repair};
use crate::fit::training::{Fit, Step, Watch};
use crate::num::array::Arrays;
use crate::num::rng::Rng;
use crate::optim::adam::{Counters, Rule};
use crate::optim::optimiser::{ArrayNames, Optimiser};
use crate::scene::person::PersonCapture;
use crate::{Error, Result};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Settings of the fine-tuning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Number of steps.
    pub steps: u32,
    /// Learning rate of U and Ω.
    pub lr: f64,
    /// Weight of Σ (p − p₀)².
    pub anchor: f64,
    /// Seed of all random draws.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { steps: 500, lr: 3e-3, anchor: 0.1, seed: 0 }
    }
}

/// The subject: the encoder outputs of its images, and the positions of its points.
#[derive(Clone, Debug, Default)]
pub struct Subject {
    /// Posterior means, shape (T, d).
    pub mu: Vec<f64>,
    /// Log-variances ℓ, shape (T, d).
    pub ell: Vec<f64>,
    /// Codes of the template points, shape (P, 27), for the literal reading.
    pub codes: Vec<f32>,
    /// Positions at rest, shape (P, 3).
    pub rest: Vec<[f32; 3]>,
    /// The posed template, shape (T, P, 3).
    pub posed: Vec<Vec<[f32; 3]>>,
}

impl Subject {
    /// Encodes the training images of a capture.
    ///
    /// # Errors
    /// If an image cannot be read, or there are no training images.
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
                .expected("at least one training image")
                .got("none"));
        }
        Ok(subject)
    }
}

/// The result of the fine-tuning.
#[derive(Clone, Debug, PartialEq)]
pub struct Tuned {
    /// Edge probabilities before, shape (n, n).
    pub before: Vec<f64>,
    /// Edge probabilities after, shape (n, n).
    pub after: Vec<f64>,
    /// Edges of the graph before and after.
    pub edges: [Vec<(usize, usize)>; 2],
    /// The loss at the first and the last step.
    pub losses: [f64; 2],
}

/// Fine-tuning in progress: the model, which is changed in place, and the data.
#[derive(Debug)]
pub struct Tuning<'a> {
    trained: &'a mut Trained,
    subject: &'a Subject,
    settings: Settings,
    optimiser: Optimiser,
    /// Probabilities of the edges before the first step, shape (n, n).
    before: Vec<f64>,
    edges_before: Vec<(usize, usize)>,
    spread_before: [Vec<f64>; 2],
    /// The loss at the first and the last step.
    losses: [f64; 2],
}

/// Standard deviations of factors and noise on the subject.
fn deviations(trained: &Trained, subject: &Subject) -> [Vec<f64>; 2] {
    let d = trained.model.sizes.latent();
    evaluation::linked(trained, subject.mu.clone()).map(|rows| evaluation::deviations(&rows, d))
}

impl<'a> Tuning<'a> {
    /// Prepares the first step.
    ///
    /// # Errors
    /// If there are no images.
    pub fn new(trained: &'a mut Trained, subject: &'a Subject, settings: Settings) -> Result<Self> {
        if subject.mu.len() < trained.model.sizes.latent() {
            return Err(Error::input("subject").expected("at least one image").got("none"));
        }
        let spread_before = deviations(trained, subject);
        agree(trained);
        let rule = Rule { counters: Counters::Global, ..Rule::default() };
        Ok(Self {
            optimiser: Optimiser::of(rule, &trained.model.params, |name| [LOGITS, EFFECTS].contains(&name))?,
            before: Structure::new(trained.model.sizes, &trained.model.params)
                .probabilities(trained.settings.tau),
            edges_before: trained.graph.edges(),
            spread_before,
            losses: [0.0; 2],
            trained,
            subject,
            settings,
        })
    }

    /// Performs one step; returns the loss before it and Σp.
    fn advance(&mut self, step: u32) -> Result<[f64; 2]> {
        let (trained, subject, settings) = (&mut *self.trained, self.subject, &self.settings);
        let sizes = trained.model.sizes;
        let (n, tau, alpha) = (sizes.factors, trained.settings.tau, trained.settings.alpha);
        let layout = Layout { observed: subject.mu.len() / sizes.latent(), targets: Vec::new(), members: 0 };
        let structure = Structure::new(sizes, &trained.model.params);
        let rng = Rng::new(settings.seed);
        let draw = |item: usize, purpose: u16| rng.uniform_f64(item as u64, step, purpose, 1);
        let uniform: Vec<f64> = (0..n * n).map(|at| draw(at, purpose::MASK)).collect();
        let drawn = mask::In { logits: &structure.logits, uniform: &uniform, allowed: None, n, tau };
        let sampled = mask::forward(&drawn);
        let eta: Vec<f64> =
            (0..subject.mu.len()).map(|at| rng.normal_f64(at as u64, step, purpose::ETA, 1)).collect();
        let spread = vec![1.0; n];
        // KL has its full weight here, because it is the likelihood that provides the evidence for A.
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
        mask::adjoint(&drawn, &bars.mask, &mut bars.structure.logits);
        let p = structure.probabilities(tau);
        let (h, saved) = acyclic::forward(&p, n, alpha);
        let mut p_bar = vec![0.0; n * n];
        acyclic::adjoint(&p, n, alpha, &saved, 1.0 + h, &mut p_bar);
        loss += h + 0.5 * h * h;
        let cost = edges::Weights { sparsity: weights.sparsity, anchor: settings.anchor };
        loss += edges::forward(&cost, &p, &self.before, n);
        edges::adjoint(&cost, &p, &self.before, n, 1.0, &mut p_bar);
        probability::adjoint(&p, n, tau, &p_bar, &mut bars.structure.logits);
        if !loss.is_finite() {
            let at = format!("step {step}");
            return Err(Error::check("fine-tuning").at(at).expected("a finite loss").got(loss.to_string()));
        }
        let grads = bars.structure.grads(sizes);
        self.optimiser.step(&mut trained.model.params, &grads, |_| Some(settings.lr))?;
        Ok([loss, p.iter().fold(0.0, |s, p| s + p)])
    }

    /// Sets the model's graph from its probabilities, and the corresponding standard deviations.
    pub fn finish(self) -> Tuned {
        let trained = self.trained;
        let sizes = trained.model.sizes;
        let after = Structure::new(sizes, &trained.model.params).probabilities(trained.settings.tau);
        trained.graph = repair::repair(sizes.factors, &after, 0.5).0;
        // The standard deviations are those of the training set; the effect of the new graph on them is
        // measured on the subject.
        let spread_after = deviations(trained, self.subject);
        let spreads = [&mut trained.factor_spread, &mut trained.noise_spread];
        for (spread, (new, old)) in spreads.into_iter().zip(spread_after.iter().zip(&self.spread_before)) {
            for (s, (new, old)) in spread.iter_mut().zip(new.iter().zip(old)) {
                *s *= new / old;
            }
        }
        Tuned {
            before: self.before,
            after,
            edges: [self.edges_before, trained.graph.edges()],
            losses: self.losses,
        }
    }
}

impl Fit for Tuning<'_> {
    fn kind(&self) -> &'static str {
        "last tune"
    }

    fn settings(&self) -> Value {
        let s = &self.settings;
        json!({ "steps": s.steps, "lr": s.lr, "anchor": s.anchor, "seed": s.seed })
    }

    fn iterations(&self) -> usize {
        self.settings.steps as usize
    }

    fn step(&mut self, i: usize, watch: &mut dyn Watch) -> Result<Step> {
        let [loss, edges] = self.advance(u32::try_from(i).expect("steps are counted in 32 bits"))?;
        watch.lap("step");
        self.losses = [if i == 0 { loss } else { self.losses[0] }, loss];
        Ok(Step { loss: loss as f32, size: libm::round(edges) as usize })
    }

    fn save(&self, out: &mut Arrays) {
        ArrayNames::Folders.save(&self.trained.model.params, out);
        self.optimiser.save(ArrayNames::Folders, out);
        out.put("state/losses", &[2], self.losses.to_vec());
    }

    fn load(&mut self, from: &Arrays) -> Result<()> {
        let losses = from.shape("state/losses", "2", &mut BTreeMap::new())?.to_f64();
        self.optimiser.load(ArrayNames::Folders, from)?;
        ArrayNames::Folders.load(&mut self.trained.model.params, from)?;
        self.losses = [losses[0], losses[1]];
        Ok(())
    }
}

/// Fine-tunes the structure of `trained` in place.
///
/// # Errors
/// If there are no images, or a loss is not finite.
pub fn run(trained: &mut Trained, subject: &Subject, settings: &Settings) -> Result<Tuned> {
    let mut tuning = Tuning::new(trained, subject, *settings)?;
    for i in 0..tuning.iterations() {
        tuning.step(i, &mut ())?;
    }
    Ok(tuning.finish())
}

/// Mirrors the logits of edges that the search of the pre-training removed or added, so that masks are drawn
/// from probabilities consistent with the graph.
fn agree(trained: &mut Trained) {
    let n = trained.model.sizes.factors;
    let logits = trained.model.params.get_mut(LOGITS).expect("a parameter of the structure");
    for (at, u) in logits.iter_mut().enumerate() {
        if at / n != at % n && trained.graph.has(at / n, at % n) != (*u > 0.0) {
            *u = -*u;
        }
    }
}

/// Loss of the decoded points with respect to the posed template, using positions only, and its gradient with
/// respect to the factors.
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
