//! The training schedule for the objective (eq. 7 of the LAST paper, with additional terms): batches, Adam,
//! the augmented Lagrangian, the final graph, refit.
//!
//! ```text
//! 0 ── alone ── freeze ──────────── steps ─────────── steps + refit/2 ─────────── steps + refit
//!  w₄ 0 │ w₄ grows │ U moves: h, Σp │ graph: p > ½, cycles cut │ graph: search by score │
//! ```
//!
//! If the group losses start only after `alone` steps and a code is too small by then, all codes are rescaled
//! ([`super::units`]).
//!
//! The learning rate of all parameters is reduced to a tenth at 80 % of the steps; that of U is also
//! multiplied by 1/log₁₀ρ once ρ exceeds 10. Every 500 steps the multiplier of h grows by ρh, and ρ grows
//! tenfold unless h has fallen to a quarter. The final search scores graphs on the means of all items, each
//! block along its main axis, with splines of the parents, and omits the mechanism of a factor where it was
//! set.
//!
//! Adam's second moments keep the effect of a short burst of large gradients for thousands of steps. A
//! gradient with respect to all parameters except U whose norm exceeds ten times the running mean of these
//! norms is therefore scaled down to that limit.

mod fit;

use super::data::{Data, Item};
use super::settings::{Settings, Supervision};
use super::step::{self, Batch, Context, Losses, Model};
use super::structure::{LOGITS, Structure};
use super::targets::{Pairs, voted};
use super::{evaluation, file::Trained, intervene, units};
use crate::causal::independence::History;
use crate::causal::repair::repair;
use crate::last::structure::samples::Samples;
use crate::last::structure::score::{self, Features, Table};
use crate::last::structure::search;
use crate::math::digraph::Digraph;
use crate::num::elem::f64::ln;
use crate::num::order;
use crate::optim::adam::{Counters, Rule};
use crate::optim::optimiser::Optimiser;
use crate::{Error, Result};

/// Initial penalty ρ of the augmented Lagrangian.
const FIRST_RHO: f64 = 1e-3;
/// Factor by which ρ grows.
const GROWTH: f64 = 10.0;
/// ρ grows unless h has fallen below this fraction in a round.
const SHARE: f64 = 0.25;
/// Largest ρ.
const LAST_RHO: f64 = 1e8;
/// Values of h up to this one count as 0.
const CLOSED: f64 = 1e-10;
/// Maximum number of rounds.
const ROUNDS: u32 = 25;
/// Decay of the running variances per step.
const MEMORY: f64 = 0.99;

/// Gradients longer than this multiple of the running mean are scaled down.
const BURST: f64 = 10.0;

/// Basis functions of the mechanisms in the final search.
const FEATURES: Features = Features::Spline;

/// Whether the graph is searched by score: with a single step of refitting, or with too many factors, it is not.
fn searches(settings: &Settings) -> bool {
    settings.refit / 2 > 0 && settings.factors <= score::MOST
}

/// Refuses data on which the search at the end of the training would fail: every image without an intervention
/// is a draw of the noise of all factors.
fn enough(settings: &Settings, data: &dyn Data) -> Result<()> {
    let pairs = match settings.supervision {
        Supervision::None => 0,
        _ => data.groups().len() * data.members(),
    };
    let (images, few) = (data.observed(), score::too_few(settings.factors, 1, FEATURES));
    if !searches(settings) || images + pairs > few {
        return Ok(());
    }
    Err(Error::input("training data")
        .expected(format!("more than {few} images and intervention pairs for {} factors", settings.factors))
        .got(format!("{images} images and {pairs} pairs"))
        .hint("make more with last gen --observational N --groups N"))
}

/// A training run in progress.
#[derive(Debug)]
pub struct Training<'a> {
    /// The model being trained.
    pub model: Model,
    settings: Settings,
    data: &'a dyn Data,
    optimiser: Optimiser,
    step: u32,
    lambda: f64,
    rho: f64,
    last_h: Option<f64>,
    rounds: u32,
    spread: Option<Vec<f64>>,
    /// Running mean of the gradient's norm.
    length: Option<f64>,
    history: History,
    /// The scales c of the rescaling of codes, if there was one.
    units: Option<Vec<f64>>,
    /// Losses of the last step.
    pub losses: Losses,
    /// The final graph, once it is fixed.
    pub graph: Option<Vec<f64>>,
}

impl<'a> Training<'a> {
    /// Starts from the initial values.
    ///
    /// # Errors
    /// See [`Model::new`]; or if there are too few data for the final search.
    pub fn new(settings: Settings, data: &'a dyn Data) -> Result<Self> {
        enough(&settings, data)?;
        let model = Model::new(&settings, data)?;
        let rule = Rule { counters: Counters::Global, ..Rule::default() };
        Ok(Self {
            optimiser: Optimiser::new(rule, &model.params)?,
            model,
            settings,
            data,
            step: 0,
            lambda: 0.0,
            rho: FIRST_RHO,
            last_h: None,
            rounds: 0,
            spread: None,
            length: None,
            history: History::default(),
            units: None,
            losses: Losses::default(),
            graph: None,
        })
    }

    /// Number of completed steps.
    pub fn step(&self) -> u32 {
        self.step
    }

    /// Probabilities of the edges, shape (n, n).
    pub fn probabilities(&self) -> Vec<f64> {
        Structure::new(self.model.sizes, &self.model.params).probabilities(self.settings.tau)
    }

    fn rates(&self) -> [f64; 2] {
        let late = if self.step * 10 >= self.settings.steps * 8 { 0.1 } else { 1.0 };
        let slowed = if self.rho > GROWTH { ln(10.0) / ln(self.rho) } else { 1.0 };
        [self.settings.lr * late, self.settings.lr_logits * late * slowed]
    }

    /// The current graph: probable edges, with cycles removed.
    fn repaired(&self) -> Digraph {
        repair(self.settings.factors, &self.probabilities(), 0.5).0
    }

    /// Posterior means of all items as samples of the factors.
    fn samples(&self) -> Samples {
        let (n, k) = (self.settings.factors, self.settings.width);
        let d = n * k;
        let mask = self.graph.clone().unwrap_or_else(|| self.repaired().adjacency());
        let linked = |items: &[Item]| {
            let [mu, _] = self.model.encode(self.data, items);
            self.model.linked(self.settings.reading, &mask, mu)
        };
        let mut samples = Samples::new(n, k);
        let observed: Vec<Item> = (0..self.data.observed()).map(Item::Observed).collect();
        for row in linked(&observed)[0].chunks_exact(d) {
            samples.observe(row);
        }
        if self.settings.supervision == Supervision::None {
            return samples;
        }
        let members = self.data.members();
        let all = |item: fn(usize, usize) -> Item| -> Vec<Item> {
            (0..self.data.groups().len()).flat_map(|g| (0..members).map(move |m| item(g, m))).collect()
        };
        let [[before, eps], [after, eps_after]] =
            [all(Item::Base), all(Item::After)].map(|items| linked(&items));
        let targets: Vec<usize> = if self.settings.supervision == Supervision::Unknown {
            let spread = evaluation::deviations(&eps, d);
            voted(&Pairs { eps: &eps, eps_after: &eps_after, spread: &spread, factors: n, members })
        } else {
            self.data.groups().iter().map(|g| g.target).collect()
        };
        for (pair, (b, a)) in before.chunks_exact(d).zip(after.chunks_exact(d)).enumerate() {
            let target = targets[pair / members];
            if target < n {
                samples.intervene(b, a, target);
            }
        }
        samples
    }

    /// Fixes the graph at the step given by the schedule.
    fn settle(&mut self) -> Result<()> {
        if self.step == self.settings.steps {
            self.graph = Some(self.repaired().adjacency());
        } else if searches(&self.settings) && self.step == self.settings.steps + self.settings.refit / 2 {
            let n = self.settings.factors;
            let table = Table::new(&self.samples().along_axes(), FEATURES)?;
            let start = self.graph.clone().unwrap_or_else(|| vec![0.0; n * n]);
            let (best, _) = search::climb(&table, &Digraph::from_weights(&start, n, 0.5));
            self.graph = Some(best.graph.adjacency());
        }
        Ok(())
    }

    /// Performs one step.
    ///
    /// # Errors
    /// If a number is not finite.
    pub fn advance(&mut self) -> Result<Losses> {
        self.settle()?;
        let s = &self.settings;
        let come = s.supervision != Supervision::None && s.groups > 0 && s.weights.groups > 0.0;
        if come && s.alone > 0 && self.step == s.alone {
            self.change_units();
        }
        let s = &self.settings;
        let moving = self.step >= s.freeze && self.graph.is_none();
        let warmth = order::min(1.0, f64::from(self.step) / f64::from(s.warm_up));
        let told = s.told(self.step);
        // Groups with weight 0 are not drawn, which reduces the images of a step to a third.
        let batch = Batch::draw(
            &Settings { groups: if told > 0.0 { s.groups } else { 0 }, ..*s },
            self.data,
            self.step,
        );
        let context = Context {
            step: self.step,
            kl: s.weights.kl * warmth,
            groups: s.weights.groups * told,
            lagrange: moving.then_some([self.lambda, self.rho]),
            graph: self.graph.clone(),
            spread: self.spread.clone().unwrap_or_else(|| vec![1.0; s.factors]),
            history: self.history.clone(),
        };
        let mut stepped = step::run(&self.model, s, self.data, &batch, &context)?;
        if let Some(covariance) = stepped.covariance {
            self.history.push(covariance);
        }
        let mix = |old: f64, new: f64| MEMORY * old + (1.0 - MEMORY) * new;
        let length = self.optimiser.names().filter(|name| *name != LOGITS).fold(0.0, |sum, name| {
            let grad = stepped.grads.get(name).expect("every parameter has a gradient");
            grad.iter().fold(sum, |sum, g| sum + f64::from(*g) * f64::from(*g))
        });
        let length = length.sqrt();
        // A first gradient of 0 provides no scale for the next ones.
        let usual = self.length.filter(|usual| *usual > 0.0).unwrap_or(length);
        let shorter = (length > BURST * usual).then(|| (BURST * usual / length) as f32);
        self.length = Some(mix(usual, order::min(length, BURST * usual)));
        let [lr, lr_logits] = self.rates();
        if let Some(factor) = shorter {
            let grads = stepped.grads.0.iter_mut().filter(|(name, _)| *name != LOGITS);
            grads.for_each(|(_, grad)| grad.iter_mut().for_each(|g| *g *= factor));
        }
        let rate = |name: &str| if name == LOGITS { moving.then_some(lr_logits) } else { Some(lr) };
        self.optimiser.step(&mut self.model.params, &stepped.grads, rate)?;
        self.spread = Some(match &self.spread {
            None => stepped.spread,
            Some(old) => old.iter().zip(&stepped.spread).map(|(o, n)| mix(*o, *n)).collect(),
        });
        self.step += 1;
        if moving && (self.step - self.settings.freeze).is_multiple_of(self.settings.round) {
            self.next_round(stepped.losses.acyclic);
        }
        Ok(stepped.losses)
    }

    /// Rescales the codes to a variance of about 1, if one of them has almost no variance.
    fn change_units(&mut self) {
        let Some(spread) = self.spread.as_mut().filter(|spread| units::are_needed(spread)) else { return };
        let c = units::of(spread);
        units::change(&mut self.model, &mut self.optimiser, &mut self.history, &c);
        spread.iter_mut().zip(&c).for_each(|(s, c)| *s *= c * c);
        self.units = Some(c);
    }

    /// The scales by which the codes of the factors were multiplied when the group losses started; `None` if
    /// no rescaling was needed, or if a checkpoint of an earlier version did not record them.
    pub fn units(&self) -> Option<&[f64]> {
        self.units.as_deref()
    }

    /// The trained model with its graph and the statistics of the observed items.
    ///
    /// # Errors
    /// If steps remain.
    pub fn finish(self) -> Result<Trained> {
        let all = self.settings.steps + self.settings.refit;
        let Some(graph) = self.graph.as_ref().filter(|_| self.step == all) else {
            return Err(Error::check("image-to-point model")
                .at(format!("step {}", self.step))
                .expected(format!("all {all} steps done")));
        };
        let mut trained = Trained {
            graph: Digraph::from_weights(graph, self.settings.factors, 0.5),
            model: self.model,
            settings: self.settings,
            factor_spread: Vec::new(),
            noise_spread: Vec::new(),
            codes: Vec::new(),
            template: self.data.template().to_vec(),
            skeleton: self.data.skeleton().to_vec(),
        };
        let observed: Vec<Item> = (0..self.data.observed()).map(Item::Observed).collect();
        let [u, eps] = evaluation::posterior(&trained, self.data, &observed);
        let d = trained.model.sizes.latent();
        [trained.factor_spread, trained.noise_spread] =
            [evaluation::deviations(&u, d), evaluation::deviations(&eps, d)];
        trained.codes = intervene::codes(&u, trained.model.sizes.factors, trained.model.sizes.width);
        Ok(trained)
    }

    fn next_round(&mut self, h: f64) {
        if h <= CLOSED || self.rho >= LAST_RHO || self.rounds >= ROUNDS {
            return;
        }
        self.lambda += self.rho * h;
        if self.last_h.is_some_and(|last| h > SHARE * last) {
            self.rho *= GROWTH;
        }
        self.last_h = Some(h);
        self.rounds += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::training::Fit;
    use crate::last::model::vectors::Vectors;
    use crate::num::array::Arrays;
    use data_gen::figure::graph::Graph;
    use data_gen::figure::mechanism::{Mechanism, Scm};
    use ndarray::ArrayD;

    #[test]
    fn units_change_once_and_only_where_a_code_is_too_small() {
        let scm = Scm::new(Graph::named("FORK", 4, 1).expect("a name"), Mechanism::Lin, true, 1);
        let data = Vectors::new(&scm, 1, 64, 16);
        let settings = Settings { points: 1, width: 1, observed: 16, groups: 4, ..Settings::of_pictures() };
        let settings = Settings { alone: 1, freeze: 2, ..settings.scaled(40) };
        // The first weights of the decoder after a step, with these variances before it.
        let after = |settings: Settings, spread: [f64; 4]| {
            let mut training = Training::new(settings, &data).expect("a model");
            training.advance().expect("finite");
            training.spread = Some(spread.to_vec());
            let before = training.model.params.get("decoder.latent.weight").expect("weights").clone();
            training.advance().expect("finite");
            let now = training.model.params.get("decoder.latent.weight").expect("weights").clone();
            let ratio = |c: usize| {
                let sum = |a: &ArrayD<f32>| a.iter().skip(c).step_by(4).fold(0.0, |s, w| s + w.abs());
                sum(&before) / sum(&now)
            };
            let units = training.units().map(<[f64]>::to_vec);
            let mut saved = Arrays::default();
            training.save(&mut saved);
            let mut resumed = Training::new(settings, &data).expect("a model");
            resumed.load(&saved).expect("a checkpoint");
            assert_eq!(resumed.units().map(<[f64]>::to_vec), units, "units of a resumed training");
            ([0, 1, 2, 3].map(ratio), training.spread.clone().expect("variances"), units)
        };
        let near = |ratios: [f32; 4], c: [f32; 4]| {
            assert!(ratios.iter().zip(c).all(|(r, c)| (r / c - 1.0).abs() < 0.3), "{ratios:?} for {c:?}");
        };
        let (ratios, spread, units) = after(settings, [0.004, 0.06, 1.0, 0.25]);
        assert_eq!(units, Some(vec![16.0, 4.0, 1.0, 2.0]), "the reported scales");
        near(ratios, [16.0, 4.0, 1.0, 2.0]);
        assert!(spread.iter().all(|s| (0.5..2.1).contains(s)), "variances in new units: {spread:?}");
        near(after(settings, [0.02, 0.06, 1.0, 0.25]).0, [1.0; 4]);
        let alone = Settings { supervision: Supervision::None, ..settings };
        near(after(alone, [0.004, 0.06, 1.0, 0.25]).0, [1.0; 4]);
    }

    #[test]
    fn a_gradient_far_longer_than_usual_is_shortened() {
        let scm = Scm::new(Graph::named("FORK", 4, 1).expect("a name"), Mechanism::Lin, true, 1);
        let data = Vectors::new(&scm, 1, 64, 16);
        let settings = Settings { points: 1, width: 1, observed: 16, groups: 4, ..Settings::default() };
        // Adam's first moment after the first step: m = (1 − β₁) g.
        let seen = |usual: Option<f64>| {
            let mut training = Training::new(settings.scaled(40), &data).expect("a model");
            training.length = usual;
            training.advance().expect("finite");
            let mut state = Arrays::new();
            training.save(&mut state);
            let squares = training.optimiser.names().filter(|name| *name != LOGITS).map(|name| {
                let m = state.get(&format!("adam/{name}.m")).expect("its moments").to_f64();
                m.iter().fold(0.0, |s, x| s + x * x)
            });
            (squares.fold(0.0, |s, x| s + x).sqrt() / 0.1, training.length.expect("a mean"))
        };
        let (own, mean) = seen(None);
        assert!((own / mean - 1.0).abs() < 1e-5, "the first is as usual: {own} and {mean}");
        assert_eq!(seen(Some(own)).0, own, "one of the usual length stays");
        assert_eq!(seen(Some(0.0)).0, own, "as does one after 0");
        // The logits have their own learning rate, and their gradient is not scaled down.
        let logits = |usual: Option<f64>| {
            let mut training = Training::new(Settings { freeze: 0, alone: 0, ..settings.scaled(40) }, &data)
                .expect("a model");
            training.length = usual;
            training.advance().expect("finite");
            let mut state = Arrays::new();
            training.save(&mut state);
            state.get("adam/structure.logits.m").expect("its moments").to_f64()
        };
        let free = logits(None);
        assert!(free.iter().any(|m| *m != 0.0), "they move from the first step on");
        assert_eq!(logits(Some(own / 1000.0)), free, "whatever the others do");
        let (short, after) = seen(Some(own / 1000.0));
        assert!((short / own - 0.01).abs() < 1e-5, "ten times a thousandth of it: {short} of {own}");
        assert!((after / (own / 1000.0) - 1.09).abs() < 1e-5, "and counts as that in the mean: {after}");
    }
}
