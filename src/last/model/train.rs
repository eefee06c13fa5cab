//! The schedule of `last.md` §8: batches, Adam, the augmented Lagrangian, the final graph, refit.

use super::data::Data;
use super::settings::Settings;
use super::step::{self, Batch, Context, Losses, Model};
use super::structure::Structure;
use crate::Result;
use crate::num::order;
use crate::optim::adam::{Adam, Counters, Rule};
use std::collections::BTreeMap;

/// First penalty ρ of the augmented Lagrangian.
const FIRST_RHO: f64 = 1e-3;
/// Factor by which it grows.
const GROWTH: f64 = 10.0;
/// It grows where h has not fallen below this share in a round.
const SHARE: f64 = 0.25;
/// Largest ρ.
const LAST_RHO: f64 = 1e8;
/// h that counts as 0.
const CLOSED: f64 = 1e-10;
/// Rounds at most.
const ROUNDS: u32 = 25;
/// Share of the running variances that a step keeps.
const MEMORY: f64 = 0.99;

/// A training on its way.
#[derive(Debug)]
pub struct Training<'a> {
    /// what is trained
    pub model: Model,
    settings: Settings,
    data: &'a dyn Data,
    optimisers: BTreeMap<String, Adam>,
    step: u32,
    lambda: f64,
    rho: f64,
    last_h: Option<f64>,
    rounds: u32,
    spread: Option<Vec<f64>>,
    /// the final graph, once it is fixed
    pub graph: Option<Vec<f64>>,
}

impl<'a> Training<'a> {
    /// From the first values.
    ///
    /// # Errors
    /// See [`Model::new`].
    pub fn new(settings: Settings, data: &'a dyn Data) -> Result<Self> {
        let model = Model::new(&settings, data)?;
        let rule = Rule { counters: Counters::Global, ..Rule::default() };
        let optimisers = model
            .params
            .iter()
            .filter(|(_, a)| !a.is_empty())
            .map(|(name, a)| Ok((name.to_owned(), Adam::new(rule, 1, a.len())?)))
            .collect::<Result<_>>()?;
        Ok(Self {
            model,
            settings,
            data,
            optimisers,
            step: 0,
            lambda: 0.0,
            rho: FIRST_RHO,
            last_h: None,
            rounds: 0,
            spread: None,
            graph: None,
        })
    }

    /// Steps made.
    pub fn step(&self) -> u32 {
        self.step
    }

    /// Probabilities of the edges (n, n).
    pub fn probabilities(&self) -> Vec<f64> {
        Structure::new(self.model.sizes, &self.model.params).probabilities(self.settings.tau)
    }

    fn rates(&self) -> [f64; 2] {
        let late = if self.step * 10 >= self.settings.steps * 8 { 0.1 } else { 1.0 };
        let slowed = if self.rho > GROWTH {
            1.0 / (crate::num::elem::f64::ln(self.rho) / crate::num::elem::f64::ln(10.0))
        } else {
            1.0
        };
        [self.settings.lr * late, self.settings.lr_logits * late * slowed]
    }

    /// One step.
    ///
    /// # Errors
    /// A number that is not finite.
    pub fn advance(&mut self) -> Result<Losses> {
        let s = &self.settings;
        let moving = self.step >= s.freeze && self.graph.is_none();
        let warmth = order::min(1.0, f64::from(self.step) / f64::from(s.warm_up));
        let batch = Batch::draw(s, self.data, self.step);
        let context = Context {
            step: self.step,
            kl: s.weights.kl * warmth,
            lagrange: moving.then_some([self.lambda, self.rho]),
            graph: self.graph.clone(),
            spread: self.spread.clone().unwrap_or_else(|| vec![1.0; s.factors]),
        };
        let stepped = step::run(&self.model, s, self.data, &batch, &context);
        let [lr, lr_logits] = self.rates();
        for (name, adam) in &mut self.optimisers {
            let logits = name == "structure.logits";
            if logits && !moving {
                continue;
            }
            let rate = if logits { lr_logits } else { lr };
            let grad = stepped.grads.get(name).expect("every parameter has a gradient");
            let param = self.model.params.get_mut(name).expect("every state has its parameter");
            let param = param.as_slice_mut().expect("contiguous");
            adam.step(param, grad.as_slice().expect("contiguous"), &[rate], None)?;
        }
        let mix = |old: f64, new: f64| MEMORY * old + (1.0 - MEMORY) * new;
        self.spread = Some(match &self.spread {
            None => stepped.spread,
            Some(old) => old.iter().zip(&stepped.spread).map(|(o, n)| mix(*o, *n)).collect(),
        });
        self.step += 1;
        if moving && (self.step - self.settings.freeze) % self.settings.round == 0 {
            self.next_round(stepped.losses.acyclic);
        }
        Ok(stepped.losses)
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
