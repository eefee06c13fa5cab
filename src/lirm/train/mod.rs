//! `lirm train`: the stages of a training.
//!
//! ```text
//! stage     what a stage is: light, samples, 1/β, resolution, steps, rate
//! distances points around an object with signed distances, for the recipe that compares them
//! settings what a training is beside its stage, and the memory that it needs
//! source    objects by index: rendered in memory                             stored    the same, from the folder of a set
//! optimizer AdamW, or Muon for matrices
//! draws    which object, how turned, which views, in a step
//! object   inputs of one object                 truth    what its fields are compared with, losses and adjoints
//! sets     sets of images in turn, and the state between them        preview    an object as the model sees it, now and then
//!
//! one step, of `batch` objects, `at_once` of them at a time:
//!   draws ──► object: sets of input images, four target crops
//!   for every set:
//!     state ─► transformer ─► state ─► decode ─► field.render ─► losses        (each for all objects, then the next)
//!     gradients ◄─ transformer ◄──── decode ◄── adjoint of field.render ◄──┘
//!   the gradients of an object are added over its sets, then those of objects, in order
//! clip every array to length 1 ──► optimizer
//! ```
//!
//! By default the state between sets is detached: no gradient flows through it, so a step needs the memory of
//! one set. With [`Stage::state_gradient`] the adjoints follow after all forward passes, from the last set to the
//! first; the paper does not state which it was. The loss is the mean over objects, their sets (or their last
//! ones, [`Stage::last_set_only`]) and crops.
//!
//! A stage can be made in parts: [`Training::stop_after`] ends it after a step, and
//! [`Training::continue_from`] goes on from the weights, with fresh moments and a rate that rises again over
//! twenty steps. Draws, rates and 1/β are those of the step of the whole stage.
//!
//! While the rate is high, weights swing around better ones. [`Settings::average_last`] makes the result the
//! mean of the weights after each of the last steps (stochastic weight averaging, Izmailov et al. 2018): mₖ =
//! mₖ₋₁ + (wₖ − mₖ₋₁)/k in single precision. [`Settings::start_share`] makes the result a mean with the
//! weights w₀ that it began with, α·w₀ + (1 − α)·m in double precision, rounded once (Wortsman et al. 2022).
//! Neither changes a step.
//!
//! Every draw is a function of seed, step and place in the batch, and objects are made by index, so a
//! training that is resumed has the bits of one that was not interrupted. Neither threads nor `at_once` nor
//! recomputation change a bit.

pub mod distances;
mod draws;
mod object;
pub mod optimizer;
mod preview;
mod sets;
mod settings;
pub mod source;
pub mod stage;
pub mod stored;
#[cfg(test)]
mod tests;
mod truth;

use self::draws::Draws;
use self::object::Object;
use self::optimizer::{Kind, States};
use self::preview::PreviewObject;
pub use self::settings::Settings;
use self::source::Pool;
use self::stage::Stage;
use super::model::config::Config;
use super::model::file::digest;
use super::model::origin::Part;
use super::model::params::{extended, first};
use super::model::weights::Ready;
use crate::fit::training::{Fit, Preview, Step, Watch};
use crate::num::array::Arrays;
use crate::num::{order, par};
use crate::optim::clip::clip;
use crate::optim::optimiser::ArrayNames;
use crate::tape::Params;
use crate::{Error, Result};
use serde_json::{Value, json};

/// Largest length of the gradient of an array.
const LENGTH: f64 = 1.0;
/// Steps over which the rate rises where a stage goes on with fresh moments.
const RISE_AGAIN: usize = 20;

/// Name in a checkpoint of the step whose weights are the first ones of the mean.
const FIRST_AVERAGED: &str = "mean_first";

/// Beginning of the names of the mean in a checkpoint, beside those of the weights.
const MEAN: &str = "mean/";

/// The mean of the weights with the names in a checkpoint.
fn of_mean(mean: &Params) -> Params {
    let mut all = Params::new();
    mean.iter().for_each(|(name, array)| all.set(&format!("{MEAN}{name}"), array.clone()));
    all
}

/// A training of one stage.
#[derive(Debug)]
pub struct Training<'a> {
    settings: Settings,
    /// First step, and the one after the last.
    range: [usize; 2],
    config: Config,
    params: Params,
    /// The mean of the weights over the last steps so far, once it has begun.
    mean: Option<Params>,
    /// Moments of all arrays.
    states: States,
    pool: Pool<'a>,
    /// Objects of another seed, for people who watch.
    shown: Vec<PreviewObject>,
    /// The weights that it began with, if they have a share of the result.
    begun: Option<Params>,
    /// Their digest.
    start: String,
}

impl<'a> Training<'a> {
    /// Begins a stage: with first values, or from the weights of the stage before. A stage with all heads
    /// makes a whole model of a plain one.
    ///
    /// # Errors
    /// When a setting is out of its range, or the weights are those of another configuration.
    pub fn new(
        settings: Settings,
        config: Config,
        from: Option<&Params>,
        source: &'a dyn source::Source,
    ) -> Result<Self> {
        config.validate()?;
        settings.stage.validate()?;
        if settings.average_last > settings.stage.steps {
            let got = settings.average_last.to_string();
            return Err(Error::input("--average-last").expected("at most the steps of the stage").got(got));
        }
        if !(0.0..1.0).contains(&settings.start_share) {
            let got = settings.start_share.to_string();
            return Err(Error::input("--start-share").expected("0 or more, below 1").got(got));
        }
        if !(settings.head_rate > 0.0 && settings.head_rate <= 1e3) {
            let got = settings.head_rate.to_string();
            return Err(Error::input("--head-rate").expected("above 0, at most 1 000").got(got));
        }
        for (name, count) in [
            ("--batch", settings.batch),
            ("--gradients-at-once", settings.at_once),
            ("--objects-at-once", settings.block),
            ("--uses", settings.uses),
        ] {
            if count == 0 {
                return Err(Error::input(name).expected("at least one").got("0"));
            }
        }
        let whole = Config { is_whole: settings.stage.is_whole || config.is_whole, ..config };
        let begun = match from {
            None => first(&whole, settings.seed),
            Some(params) if whole.is_whole && !config.is_whole => extended(params, &config, settings.seed)?.0,
            Some(params) => params.clone(),
        };
        let config = whole;
        let stage = &settings.stage;
        for (option, is_given) in
            [("--absolute-albedo", stage.absolute_albedo), ("--material-weight", stage.material != 1.0)]
        {
            if is_given && !config.is_whole {
                return Err(Error::input(option)
                    .expected("a model with albedo and materials, which stages 2a to 3 make of any other")
                    .got(format!("stage {} of a model without them", stage.name)));
            }
        }
        if stage.normal_weight == 0.0 && config.is_directed() {
            return Err(Error::input("--normal-weight")
                .expected("above 0 for a model with panoramas, whose colours read the reflection about the normals of the head")
                .got("0"));
        }
        let states = States::new(settings.optimizer, settings.head_rate, &begun)?;
        let start = digest(&begun);
        Ok(Self {
            range: [0, settings.stage.steps],
            begun: (settings.start_share > 0.0).then(|| begun.clone()),
            settings,
            config,
            params: begun,
            mean: None,
            states,
            pool: Pool::new(source),
            shown: Vec::new(),
            start,
        })
    }

    /// Ends after `last` steps of the stage, which the next part can continue.
    ///
    /// # Errors
    /// If the stage does not have this step, or it is already made.
    pub fn stop_after(&mut self, last: usize) -> Result<()> {
        let [first, end] = [self.range[0], self.settings.stage.steps];
        if !(first + 1..=end).contains(&last) {
            let expected = format!("{} to {end}, steps of the stage that are not made yet", first + 1);
            return Err(Error::input("--until").expected(expected).got(last.to_string()));
        }
        self.range[1] = last;
        Ok(())
    }

    /// Continues a stage whose part before this one made the weights.
    ///
    /// # Errors
    /// If that part has other settings; the error names the option.
    pub fn continue_from(&mut self, part: &Part) -> Result<()> {
        let own = self.part();
        // As typed: a JSON number would be in double precision.
        let text = |x: f32| json!(x.to_string());
        let plain = |x: &Value| match x {
            Value::Null => "the default".to_owned(),
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        let pairs = [
            ("--iterations", json!(part.steps), json!(own.steps)),
            ("--seed", json!(part.seed), json!(own.seed)),
            ("--batch", json!(part.batch), json!(own.batch)),
            ("--objects-at-once", json!(part.block), json!(own.block)),
            ("--uses", json!(part.uses), json!(own.uses)),
            ("--optimizer", json!(part.optimizer), json!(own.optimizer)),
            ("objects", json!(part.source), json!(own.source)),
            ("--rate", json!(part.rate), json!(own.rate)),
            ("--head-rate", json!(part.head_rate), json!(own.head_rate)),
            ("--room", json!(part.room), json!(own.room)),
            ("--tint", json!(part.tint), json!(own.tint)),
            ("--shape-steps", json!(part.shape_steps), json!(own.shape_steps)),
            ("--updates", json!(part.updates), json!(own.updates)),
            ("--added", json!(part.added), json!(own.added)),
            ("--state-gradient", json!(part.state_gradient), json!(own.state_gradient)),
            ("--last-set-only", json!(part.last_set_only), json!(own.last_set_only)),
            ("--absolute-albedo", json!(part.absolute_albedo), json!(own.absolute_albedo)),
            (
                "--normal-weight",
                text(part.normal_weight.unwrap_or(1.0)),
                text(own.normal_weight.unwrap_or(1.0)),
            ),
            ("--material-weight", text(part.material.unwrap_or(1.0)), text(own.material.unwrap_or(1.0))),
            ("--points", text(part.points), text(own.points)),
            ("--distances", text(part.distances), text(own.distances)),
        ];
        if let Some((name, before, now)) = pairs.into_iter().find(|(_, before, now)| before != now) {
            return Err(Error::input(name)
                .expected(format!("{}, as in the part before of stage {}", plain(&before), part.stage))
                .got(plain(&now)));
        }
        self.range[0] = part.range[1];
        Ok(())
    }

    /// What this training adds to the model that it begins with.
    pub fn part(&self) -> Part {
        let s = &self.settings;
        let named = Stage::named(&s.stage.name).ok();
        let differs =
            |own: f64, of: fn(&Stage) -> f64| named.as_ref().filter(|named| of(named) != own).map(|_| own);
        Part {
            stage: s.stage.name.clone(),
            optimizer: s.optimizer.name().to_owned(),
            range: self.range,
            steps: s.stage.steps,
            seed: s.seed,
            batch: s.batch,
            block: s.block,
            uses: Some(s.uses).filter(|n| *n != stage::USES),
            source: self.pool.record(),
            object_seed: self.pool.seed().filter(|seed| *seed != s.seed),
            other_objects: self.pool.seed().is_none(),
            rate: differs(s.stage.rates[0], |named| named.rates[0]),
            head_rate: Some(s.head_rate).filter(|x| *x != 1.0),
            room: differs(s.stage.room, |named| named.room),
            tint: differs(s.stage.tint[1], |named| named.tint[1]),
            points: s.stage.points,
            distances: s.stage.distances,
            shape_steps: s.stage.shape_steps,
            updates: s.stage.updates,
            added: Some(s.stage.added).filter(|x| *x > 0.0),
            state_gradient: s.stage.state_gradient,
            last_set_only: s.stage.last_set_only,
            absolute_albedo: s.stage.absolute_albedo,
            material: Some(s.stage.material).filter(|x| *x != 1.0),
            normal_weight: Some(s.stage.normal_weight).filter(|x| *x != 1.0),
            average_last: self.range[1] - self.first_averaged(),
            start_share: Some(s.start_share).filter(|x| *x > 0.0),
            inverse_beta: s.stage.rendering(self.range[1].saturating_sub(1)).inverse_beta,
            start: self.start.clone(),
        }
    }

    /// The learning rate of a step of the stage.
    fn rate(&self, step: usize) -> f64 {
        let [first, _] = self.range;
        let again = if first > 0 { (step - first + 1) as f64 / RISE_AGAIN as f64 } else { 1.0 };
        order::min(again, 1.0) * self.settings.stage.rate(step)
    }

    /// Renders objects of another source that previews show: the first ones that are lit as those of the
    /// stage.
    ///
    /// # Errors
    /// If one cannot be made.
    pub fn show(&mut self, of: &dyn source::Source) -> Result<()> {
        let draws =
            Draws { seed: self.settings.seed, stage: &self.settings.stage, batch: 1, block: 1, uses: 1 };
        let made = par::map(preview::COUNT, |k| {
            PreviewObject::new(of, k as u64, draws.version(k as u64), &self.config)
        });
        self.shown = made.into_iter().collect::<Result<_>>()?;
        Ok(())
    }

    /// The weights after the last step, or their mean over the last steps.
    pub fn params(&self) -> &Params {
        self.mean.as_ref().unwrap_or(&self.params)
    }

    /// The weights of the result: [`Self::params`], or the mean of them and those that it began with.
    pub fn result(&self) -> Params {
        let (share, mut all) = (self.settings.start_share, self.params().clone());
        for (name, begun) in self.begun.iter().flat_map(Params::iter) {
            let trained = all.get_mut(name).expect("both have the same arrays");
            trained.zip_mut_with(begun, |w, begun| {
                *w = (share * f64::from(*begun) + (1.0 - share) * f64::from(*w)) as f32;
            });
        }
        all
    }

    /// The step of the stage whose weights are the first ones of the mean.
    fn first_averaged(&self) -> usize {
        let [first, end] = self.range;
        Ord::max(end.saturating_sub(self.settings.average_last), first)
    }

    /// Takes the weights after step `i` of the stage into the mean, if it is one of the last.
    fn average(&mut self, i: usize) -> Result<()> {
        let first = self.first_averaged();
        if i < first {
            return Ok(());
        }
        if i == first {
            self.mean = Some(self.params.clone());
            return Ok(());
        }
        let Some(mean) = &mut self.mean else {
            return Err(Error::check("lirm train").expected("the mean of the steps before").got("none"));
        };
        let count = (i - first + 1) as f32;
        for (name, w) in self.params.iter() {
            let mean = mean.get_mut(name).expect("both have the same arrays");
            mean.zip_mut_with(w, |m, w| *m += (*w - *m) / count);
        }
        Ok(())
    }

    /// Why a checkpoint after step `done` has no mean for this training: its own, if there is one, begins with
    /// step `first`.
    fn no_mean(&self, first: Option<usize>, done: usize) -> Error {
        let (n, steps) = (self.settings.average_last, self.settings.stage.steps);
        let own = first.map(|first| first + n).filter(|end| *end <= steps);
        let later = (done + n <= steps).then(|| format!("{} or more", done + n));
        let fit: Vec<String> = own.map(|end| end.to_string()).into_iter().chain(later).collect();
        Error::input("--until")
            .expected(format!(
                "{}: {done} steps are done, and the mean is over the last {n}",
                fit.join(", or ")
            ))
            .got(self.range[1].to_string())
            .hint("lirm train --from of the result, in another folder, goes on with fresh moments")
    }

    /// The sizes of the model.
    pub fn config(&self) -> &Config {
        &self.config
    }
}

impl Fit for Training<'_> {
    fn kind(&self) -> &'static str {
        "lirm train"
    }

    fn settings(&self) -> Value {
        let mut all = self.config.json();
        let own = self.settings.stage.json();
        for (key, value) in own.as_object().expect("an object") {
            all[key] = value.clone();
        }
        all["seed"] = json!(self.settings.seed);
        if self.settings.optimizer != Kind::AdamW {
            all["optimizer"] = json!(self.settings.optimizer.name());
        }
        if self.settings.head_rate != 1.0 {
            all["head_rate"] = json!(self.settings.head_rate);
        }
        all["batch"] = json!(self.settings.batch);
        all["block"] = json!(self.settings.block);
        if self.settings.uses != stage::USES {
            all["uses"] = json!(self.settings.uses);
        }
        all["source"] = json!(self.pool.record());
        all["start"] = json!(self.start);
        if self.range[0] > 0 {
            all["first_step"] = json!(self.range[0]);
        }
        if self.settings.average_last > 0 {
            all["average_last"] = json!(self.settings.average_last);
        }
        all
    }

    fn iterations(&self) -> usize {
        self.range[1] - self.range[0]
    }

    fn step(&mut self, i: usize, watch: &mut dyn Watch) -> Result<Step> {
        let i = self.range[0] + i;
        let named = |e: Error| e.at(format!("step {}", i + 1));
        let s = &self.settings;
        let draws = Draws { seed: s.seed, stage: &s.stage, batch: s.batch, block: s.block, uses: s.uses };
        self.pool.fill(&draws, i).map_err(named)?;
        watch.lap("objects");
        let ready = Ready::new(self.config, &self.params);
        let (mut losses, mut total) = (Vec::with_capacity(s.batch), ready.zeros());
        let places: Vec<usize> = (0..s.batch).collect();
        for some in places.chunks(s.at_once) {
            let objects = par::map(some.len(), |j| Object::new(&draws, &self.config, i, some[j], &self.pool));
            let objects = objects.into_iter().collect::<Result<Vec<_>>>().map_err(named)?;
            watch.lap("inputs");
            let (part, gradients) = self.losses(&ready, &objects, i, watch).map_err(named)?;
            losses.extend(part);
            gradients.iter().for_each(|g| total.add(g));
        }
        let loss = losses.iter().fold(0.0, |sum, x| sum + x);
        let mut grads = ready.finish(total);
        if !loss.is_finite() {
            return Err(named(
                Error::check("lirm train")
                    .at("loss")
                    .expected("a finite number")
                    .got(loss.to_string())
                    .hint("lower --rate"),
            ));
        }
        for g in grads.0.values_mut() {
            clip(g.as_slice_mut().expect("gradients are contiguous"), LENGTH);
        }
        let rate = self.rate(i);
        self.states.step(&mut self.params, &grads, rate).map_err(named)?;
        self.average(i).map_err(named)?;
        watch.lap("optimiser");
        Ok(Step { loss, size: self.settings.batch })
    }

    fn preview(&self, k: usize, count: usize) -> Option<Preview> {
        let shown = self.shown.get(k * self.shown.len() / Ord::max(count, 1))?;
        let rendering = self.settings.stage.rendering(self.range[1].saturating_sub(1));
        shown.preview(&Ready::new(self.config, self.params()), rendering)
    }

    fn save(&self, out: &mut Arrays) {
        ArrayNames::Folders.save(&self.params, out);
        self.states.save(out);
        if let Some(mean) = &self.mean {
            ArrayNames::Folders.save(&of_mean(mean), out);
            out.put(FIRST_AVERAGED, &[], vec![self.first_averaged() as f32]);
        }
    }

    fn load(&mut self, from: &Arrays) -> Result<()> {
        let (mut params, mut states) = (self.params.clone(), self.states.clone());
        ArrayNames::Folders.load(&mut params, from)?;
        states.load(from)?;
        let first = from.get(FIRST_AVERAGED).map(|_| from.scalar(FIRST_AVERAGED)).transpose()?;
        let first = first.map(|first| first as usize);
        let done = self.range[0] + from.need("history/loss")?.len();
        let mean = if first == Some(self.first_averaged()) {
            let (mut stored, mut mean) = (of_mean(&params), Params::new());
            ArrayNames::Folders.load(&mut stored, from)?;
            stored.iter().for_each(|(name, array)| mean.set(&name[MEAN.len()..], array.clone()));
            Some(mean)
        } else if self.settings.average_last > 0 && done > self.first_averaged() {
            return Err(self.no_mean(first, done));
        } else {
            // The mean of other steps, if there is one, is not that of this training.
            None
        };
        self.mean = mean;
        (self.params, self.states) = (params, states);
        Ok(())
    }
}
