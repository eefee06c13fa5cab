//! One cell: the fit of a person and its scores.

use super::budget;
use super::setup::{Model, Setup};
use crate::experiment::{AROUND, Cell, Values};
use crate::fit::training::{Fit, Watch};
use crate::loss::In;
use crate::loss::lpips::Metric;
use crate::loss::metric::psnr;
use crate::math::digraph::Digraph;
use crate::num::bits::Digest;
use crate::scene::person::PersonCapture;
use crate::{Error, Result};
use data_gen::figure::graph::Graph;
use lastlight_last::avatar::evaluate::{self, Evaluation, Scored};
use lastlight_last::avatar::fit::PersonFit;
use lastlight_last::avatar::guide::Guide;
use lastlight_last::avatar::person::Avatar;
use lastlight_last::avatar::settings::Settings;
use lastlight_last::avatar::view::Target;
use lastlight_last::model::evaluation::{deviations, linked};
use lastlight_last::model::file::Trained;
use lastlight_last::model::guide::{cut, seen};
use lastlight_last::model::tune::{self, Subject};
use serde_json::{Value, json};

/// Number of evaluations on the held-out images during a fit.
const EVALUATIONS: usize = 6;
/// Number of comparisons of factors during a fit in E13.
const STEPS: usize = 24;
/// Maximum number of training images that are scored, or whose factors are compared.
const IMAGES: usize = 8;

/// The graph that the model uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Structure {
    /// The learned graph.
    Learned,
    /// The true graph A*.
    True,
    /// No edges: structure off.
    Empty,
    /// A random graph with as many edges as A*, one per subject.
    Random,
    /// The learned graph with every edge reversed.
    Reversed,
    /// The learned graph, tuned on the subject.
    Tuned,
}

impl Structure {
    /// The name in tables and records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Learned => "learned",
            Self::True => "true",
            Self::Empty => "empty",
            Self::Random => "random",
            Self::Reversed => "reversed",
            Self::Tuned => "tuned",
        }
    }
}

/// One fit with all its settings.
#[derive(Clone, Debug, PartialEq)]
pub struct FitRun {
    /// index of the model
    pub model: usize,
    /// number of the subject
    pub subject: u64,
    /// graph A
    pub structure: Structure,
    /// settings of the host; the seed is the subject
    pub settings: Settings,
    /// number of renders of the second fit
    pub renders: usize,
    /// whether factors are compared during the fit
    pub factors: bool,
}

/// A random graph with as many edges as `truth` that equals neither `truth` nor `learned`.
fn random(truth: &Digraph, learned: &Digraph, subject: u64) -> Result<Digraph> {
    let n = truth.n();
    let draw = |k: u64| -> Result<Digraph> {
        let name = format!("ER-{}", truth.count());
        let fail = |e: String| Error::input("random graph").expected("an admissible number of edges").got(e);
        let a = Graph::named(&name, n, subject.wrapping_mul(1000).wrapping_add(k)).map_err(fail)?.adjacency;
        Ok(Digraph::from_fn(n, |i, j| a[i][j]))
    };
    for k in 0..1000 {
        let graph = draw(k)?;
        if graph != *truth && graph != *learned {
            return Ok(graph);
        }
    }
    Ok(Digraph::empty(n))
}

/// The model with another graph, and the standard deviations of ε under that graph.
fn under(model: &Trained, graph: Digraph, capture: &PersonCapture) -> Result<Trained> {
    let mut other = Trained { graph, ..model.clone() };
    if other.graph != model.graph {
        let mu = Subject::new(model, capture)?.mu;
        let d = model.model.sizes.latent();
        let spread = |t: &Trained| deviations(&linked(t, mu.clone())[1], d);
        let (new, old) = (spread(&other), spread(model));
        for (t, (new, old)) in other.noise_spread.iter_mut().zip(new.iter().zip(&old)) {
            *t *= new / old;
        }
    }
    Ok(other)
}

impl FitRun {
    /// The cell of a row.
    pub fn cell(&self, setup: &Setup, row: &str) -> Cell {
        let mut digest = Digest::new();
        digest.bytes(self.record(setup).to_string().as_bytes());
        let graph = &setup.models[self.model].graph;
        let key = format!("{graph}-{}-{:016x}", self.subject, digest.value());
        Cell { key, row: row.to_owned(), seed: self.subject }
    }

    /// Whether the fit uses the model.
    fn is_guided(&self) -> bool {
        self.settings.needs_guide() || self.factors
    }

    /// All settings that the result depends on.
    pub fn record(&self, setup: &Setup) -> Value {
        let model = &setup.models[self.model];
        let if_guided = |text: &str| if self.is_guided() { text.to_owned() } else { "none".to_owned() };
        let mut record = json!({
            "lastlight": env!("CARGO_PKG_VERSION"), "size": setup.size.record(), "graph": model.graph,
            "subject": self.subject, "model": if_guided(&model.digest), "structure": if_guided(self.structure.name()),
            "tuning": if self.structure == Structure::Tuned { setup.size.tuning } else { 0 },
            "factors": self.factors, "renders": self.renders, "host": self.settings.json(),
        });
        if let Some((_, digest)) = &setup.perception {
            record["lpips"] = format!("{digest:016x}").into();
        }
        record
    }

    /// The model with the graph of this run, and the changes made by tuning.
    fn guide(&self, setup: &Setup, model: &Model, capture: &PersonCapture) -> Result<(Trained, Values)> {
        let mut values = Values::new();
        let (learned, truth) = (&model.trained.graph, &model.truth);
        let guide = match self.structure {
            Structure::Learned => model.trained.clone(),
            Structure::True => under(&model.trained, truth.clone(), capture)?,
            Structure::Empty => under(&model.trained, Digraph::empty(truth.n()), capture)?,
            Structure::Random => under(&model.trained, random(truth, learned, self.subject)?, capture)?,
            Structure::Reversed => {
                let graph = Digraph::from_fn(truth.n(), |i, j| learned.has(j, i));
                under(&model.trained, graph, capture)?
            }
            Structure::Tuned => {
                let mut tuned = model.trained.clone();
                let how =
                    tune::Settings { steps: setup.size.tuning, seed: self.subject, ..Default::default() };
                let done = tune::run(&mut tuned, &Subject::new(&model.trained, capture)?, &how)?;
                let moved = done
                    .before
                    .iter()
                    .zip(&done.after)
                    .fold(0.0, |s, (a, b): (&f64, &f64)| s + (a - b).abs());
                let [before, after] = &done.edges;
                let gone = |a: &[(usize, usize)], b: &[(usize, usize)]| {
                    a.iter().filter(|e| !b.contains(e)).count() as f64
                };
                values.insert("moved".into(), moved);
                values.insert("changed".into(), gone(before, after) + gone(after, before));
                tuned
            }
        };
        values.insert("edges".into(), guide.graph.count() as f64);
        Ok((guide, values))
    }

    /// Runs the cell.
    ///
    /// # Errors
    /// Errors of generation, tuning, fit or evaluation.
    pub fn run(&self, setup: &Setup, watch: &mut dyn Watch) -> Result<Values> {
        let model = &setup.models[self.model];
        let capture = setup.capture(model, self.subject)?;
        let (guide, mut values) = if self.is_guided() {
            self.guide(setup, model, &capture)?
        } else {
            (model.trained.clone(), Values::new())
        };
        let train = capture.train.len();
        let levels = budget::levels(&self.settings, &guide.graph)?;
        watch.lap(AROUND);
        let inputs =
            Inputs { capture: &capture, guide: &guide, perception: setup.perception.as_ref().map(|p| &p.0) };
        let first = self.fit(&self.settings, &inputs, true, watch)?;
        let longer = budget::iterations(&self.settings, levels, train, self.renders);
        let second = match longer {
            None => Values::new(),
            Some(n) if n == self.settings.iterations => first.clone(),
            Some(iterations) => {
                self.fit(&Settings { iterations, ..self.settings.clone() }, &inputs, false, &mut ())?
            }
        };
        let plain = |name: &String| !name.starts_with("curve") && !name.starts_with("factor");
        let second = second.into_iter().filter(|(name, _)| plain(name));
        values.extend(second.map(|(name, x)| (format!("{name}@renders"), x)));
        values.extend(first);
        watch.lap(AROUND);
        Ok(values)
    }

    /// Fits and scores; with `curves` also evaluates during the fit.
    fn fit(
        &self,
        settings: &Settings,
        inputs: &Inputs<'_>,
        curves: bool,
        watch: &mut dyn Watch,
    ) -> Result<Values> {
        let Inputs { capture, guide, .. } = *inputs;
        let mut values = Values::new();
        let mut fit = PersonFit::new(settings.clone(), capture, Some(guide))?;
        let n = fit.iterations();
        let is_at = |done: usize, parts: usize| (1..=parts).any(|k| k * n / parts == done);
        for i in 0..n {
            let step = fit.step(i, watch)?;
            let done = i + 1;
            watch.progress(done, n, step);
            if curves && is_at(done, EVALUATIONS) {
                values.insert(format!("curve {done}"), level(fit.avatar(), capture)?);
            }
            if curves && self.factors && is_at(done, STEPS) {
                for (j, error) in factor_errors(fit.avatar(), capture, guide)?.into_iter().enumerate() {
                    values.insert(format!("factor {j} {done}"), error);
                }
            }
            watch.lap(AROUND);
        }
        let test = inputs.scores(fit.avatar(), &capture.test)?;
        let (_, mean) = evaluate::means(&test)?;
        values
            .extend(mean.named().into_iter().filter(|(_, x)| x.is_finite()).map(|(n, x)| (n.to_owned(), x)));
        let step = Ord::max(1, capture.train.len().div_ceil(IMAGES));
        let some: Vec<usize> = capture.train.iter().copied().step_by(step).collect();
        let (_, mean) = evaluate::means(&inputs.scores(fit.avatar(), &some)?)?;
        let t = fit.tally();
        let share = |a: f64, b: u64| if b == 0 { 0.0 } else { a / b as f64 };
        values.extend(
            [
                ("PSNR-box training", mean.boxed.db.finite().unwrap_or(f64::INFINITY)),
                ("gaussians", fit.avatar().gaussians.len() as f64),
                ("iterations", n as f64),
                ("renders", t.renders as f64),
                ("encodings", t.encodings as f64),
                ("bound", share(t.bound as f64, t.capped)),
                ("blind", share(t.blind, t.gradients)),
                ("rejected", fit.events().iter().fold(0, |s, e| s + e.turned_away) as f64),
            ]
            .map(|(name, x)| (name.to_owned(), x)),
        );
        Ok(values)
    }
}

/// Inputs of a fit and its scores.
struct Inputs<'a> {
    capture: &'a PersonCapture,
    guide: &'a Trained,
    perception: Option<&'a Metric>,
}

impl Inputs<'_> {
    fn scores(&self, avatar: &Avatar, which: &[usize]) -> Result<Vec<Scored>> {
        let all = Evaluation { perception: self.perception, ..Evaluation::of(avatar, self.capture) };
        which.iter().map(|&shot| all.score(shot)).collect()
    }
}

/// Mean PSNR-box of the held-out images.
fn level(avatar: &Avatar, capture: &PersonCapture) -> Result<f64> {
    let mut sum = 0.0;
    for &i in &capture.test {
        let shot = &capture.shots[i];
        let target = Target::read(capture, shot)?;
        let out = avatar.picture(&capture.poses[shot.time], Some(shot.time), &shot.camera)?;
        let (height, width) = (shot.camera.height, shot.camera.width);
        let photo = target.before(avatar.background);
        let x = In { x: &out.image, y: &photo, mask: Some(&target.inside), height, width };
        sum += psnr::forward(&x)?.db.finite().unwrap_or(f64::INFINITY);
    }
    Ok(sum / capture.test.len() as f64)
}

/// (n) mean displacement of the decoded points, over some training images and the points of the template, if
/// a factor of the render is replaced by that of the input image.
fn factor_errors(avatar: &Avatar, capture: &PersonCapture, guide: &Trained) -> Result<Vec<f64>> {
    let train = capture.train.len();
    let count = Ord::min(IMAGES, train);
    let mut sums = vec![0.0; guide.factors()];
    for v in 0..count {
        let shot = &capture.shots[capture.train[v * train / count]];
        let out = avatar.picture(&capture.poses[shot.time], Some(shot.time), &shot.camera)?;
        let real = seen(guide, capture, shot, &shot.photo()?)?;
        let rendered = cut(guide, capture, shot, &out.image)?;
        let scores = guide.swap_scores(&rendered, &real, &guide.template)?;
        for (sum, of_points) in sums.iter_mut().zip(&scores) {
            let total = of_points.iter().fold(0.0, |s, x| s + x);
            *sum += total / (of_points.len() * count) as f64;
        }
    }
    Ok(sums)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_random_graph_is_another_one() {
        let fork = Digraph::new(4, &[(0, 1), (0, 2)]);
        for subject in 1..=20 {
            let graph = random(&fork, &fork, subject).expect("drawn");
            assert!(graph.is_acyclic() && graph.count() == 2 && graph != fork, "{:?}", graph.edges());
            assert_eq!(random(&fork, &fork, subject).expect("drawn"), graph, "the same for one subject");
            assert_ne!(
                random(&fork, &graph, subject).expect("drawn"),
                graph,
                "different from the learned one"
            );
        }
        let none = random(&Digraph::empty(4), &Digraph::empty(4), 1).expect("drawn");
        assert_eq!(none.count(), 0, "there is only one graph without edges");
    }
}
