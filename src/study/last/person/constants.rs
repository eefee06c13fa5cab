//! The constants of the guided fit: the scale of the latent criterion, and the hyper-parameters found by a
//! search.
//!
//! *Calibration*: c_τ of every model on subject 0 ([`calibrate`]), chosen once.
//!
//! *Search*: fits of subject 0 under the first model for every combination of the candidates below. For each
//! constant the candidate with the largest mean PSNR-box on the held-out images, at equal renders, over all
//! combinations of the others is selected; of equal ones the first. The mean over many fits is less sensitive
//! to chance than the best fit. The default values are the first candidates. Subject 0 is used for nothing
//! else, and no other experiment includes it.
//!
//! | constant | candidates |
//! |---|---|
//! | density | `replace` at τ_rec 0.003, 0.001, 0.005, 0.01; `budget`; `or` at 0.003 |
//! | λ | `rel` 0.1, 0.5, ∞; `abs` 0.1 |
//! | q | 0.25, 0.1, 0.5 |
//! | first keys | iteration 200, 400 of 1 200 |

use super::super::learn::plain;
use super::budget;
use super::fit_run::{FitRun, Structure};
use super::setup::{Model, Setup};
use crate::experiment::{Cell, Chart, Experiment, Outcome, Report, Results, Summary, Values};
use crate::fit::training::Watch;
use crate::{Error, Result};
use lastlight_last::avatar::calibrate;
use lastlight_last::avatar::density::{Density, Mode};
use lastlight_last::avatar::progressive::{Cap, Progressive};
use lastlight_last::avatar::settings::Settings;
use serde_json::{Value, json};
use std::sync::atomic::AtomicBool;

/// Folder of the cells, shared by these experiments and the search.
pub const FOLDER: &str = "persons";
/// The subject used for calibration and search.
const SUBJECT: u64 = 0;
/// The value that the search maximises.
const VALUE: &str = "PSNR-box@renders";

/// The constants of the guided fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Constants {
    /// c_τ of each model
    pub latent_scales: Vec<f64>,
    /// criterion of the density adapter
    pub mode: Mode,
    /// τ_rec
    pub threshold: f64,
    /// mode and value of λ
    pub cap: (Cap, f64),
    /// q
    pub share: f64,
    /// iteration of the first search for key Gaussians, of 1 200
    pub first: usize,
}

impl Constants {
    /// The default constants.
    pub fn published(latent_scales: Vec<f64>) -> Self {
        let p = Progressive::published();
        Self {
            latent_scales,
            mode: Mode::Replace,
            threshold: Density::pixel().latent_threshold,
            cap: (p.cap, p.lambda),
            share: p.share,
            first: p.first,
        }
    }

    /// The density adapter for a model.
    pub fn density(&self, model: usize) -> Density {
        Density {
            mode: self.mode,
            latent_threshold: self.threshold,
            latent_scale: self.latent_scales[model],
            ..Density::pixel()
        }
    }

    /// The progressive update.
    pub fn progressive(&self) -> Progressive {
        Progressive {
            cap: self.cap.0,
            lambda: self.cap.1,
            share: self.share,
            first: self.first,
            ..Progressive::published()
        }
    }

    /// The full system for a model and a subject.
    pub fn full(&self, setup: &Setup, model: usize, subject: u64) -> Settings {
        Settings {
            seed: subject,
            density: self.density(model),
            progressive: Some(self.progressive()),
            ..setup.size.baseline()
        }
    }

    /// Number of renders of the full system in the iterations of the study: the budget of a second fit.
    ///
    /// # Errors
    /// When the model's graph has a cycle.
    pub fn renders(&self, setup: &Setup, model: usize) -> Result<usize> {
        let (settings, graph) = (self.full(setup, model, 0), &setup.models[model].trained.graph);
        let levels = budget::levels(&settings, graph)?;
        Ok(budget::renders(&settings, levels, setup.size.frames).unwrap_or(settings.iterations))
    }

    /// The constants as text.
    pub fn text(&self) -> String {
        format!(
            "density {} at τ_rec {}, λ {} {}, q {}, first keys at {} of 1 200, c_τ {}",
            self.mode.name(),
            self.threshold,
            self.cap.0.name(),
            self.cap.1,
            self.share,
            self.first,
            self.latent_scales.iter().map(|c| format!("{c:.4}")).collect::<Vec<_>>().join(", ")
        )
    }
}

/// c_τ of every model.
#[derive(Debug)]
pub struct Calibration<'a> {
    /// the models to calibrate
    pub setup: &'a Setup,
}

impl Calibration<'_> {
    /// c_τ of each model, if all results are present.
    pub fn found(&self, results: &Results) -> Option<Vec<f64>> {
        let found: Vec<f64> = results.iter().filter_map(|(_, v)| v.get("c_tau").copied()).collect();
        (found.len() == self.setup.models.len()).then_some(found)
    }
}

impl Experiment for Calibration<'_> {
    fn id(&self) -> &'static str {
        "calibration"
    }

    fn cells(&self) -> Vec<Cell> {
        let cell = |m: &Model| Cell { key: plain(&m.graph), row: m.graph.clone(), seed: SUBJECT };
        self.setup.models.iter().map(cell).collect()
    }

    fn settings(&self, cell: usize) -> Value {
        json!({
            "lastlight": env!("CARGO_PKG_VERSION"), "size": self.setup.size.record(),
            "model": self.setup.models[cell].digest, "subject": SUBJECT, "host": self.setup.size.baseline().json(),
        })
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
        let model = &self.setup.models[cell];
        let capture = self.setup.capture(model, SUBJECT)?;
        let found = calibrate::latent_scale(&self.setup.size.baseline(), &capture, &model.trained, watch)?;
        let scale = found.ok_or_else(|| {
            Error::check("calibration")
                .at(model.graph.clone())
                .expected("Gaussians that reach the pixel criterion and have a latent gradient")
                .got("none")
        })?;
        Ok(Values::from([("c_tau".into(), scale)]))
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        let scale = |v: &Values| v.get("c_tau").copied().unwrap_or(f64::NAN);
        Report {
            id: self.id(),
            claim: "With c_τ, the latent criterion at τ_rec = 0.003 selects as many Gaussians as the pixel criterion, half-way through a fit of subject 0.",
            head: vec!["graph", ">c_τ"],
            rows: results.iter().map(|(c, v)| vec![c.row.clone(), format!("{:.5}", scale(v))]).collect(),
            chart_labels: ["c_τ", "model"],
            chart: Chart::Bars(results.iter().map(|(c, v)| (c.row.clone(), scale(v))).collect()),
            outcome: Outcome::Reported,
            verdict: "Chosen once for each model; every other experiment uses it.".into(),
        }
    }
}

/// A candidate: its name, and the change that it makes to the constants.
type Candidate = (String, Box<dyn Fn(&mut Constants) + Sync>);

/// The hyper-parameter search.
pub struct Search<'a> {
    setup: &'a Setup,
    /// the candidates of each constant
    axes: Vec<(&'static str, Vec<Candidate>)>,
    runs: Vec<(Vec<usize>, FitRun)>,
    base: Constants,
}

fn axes(setup: &Setup) -> Vec<(&'static str, Vec<Candidate>)> {
    let density = [
        (Mode::Replace, 0.003),
        (Mode::Replace, 0.001),
        (Mode::Replace, 0.005),
        (Mode::Replace, 0.01),
        (Mode::Budget, 0.003),
        (Mode::Or, 0.003),
    ];
    let caps =
        [(Cap::Relative, 0.1), (Cap::Relative, 0.5), (Cap::Relative, f64::INFINITY), (Cap::Absolute, 0.1)];
    let size = &setup.size;
    let density: Vec<Candidate> = size
        .some(&density)
        .into_iter()
        .map(|(mode, tau)| -> Candidate {
            let name =
                if mode == Mode::Budget { mode.name().into() } else { format!("{} {tau}", mode.name()) };
            (name, Box::new(move |c: &mut Constants| (c.mode, c.threshold) = (mode, tau)))
        })
        .collect();
    let caps: Vec<Candidate> = size
        .some(&caps)
        .into_iter()
        .map(|cap| -> Candidate {
            (format!("{} {}", cap.0.name(), cap.1), Box::new(move |c: &mut Constants| c.cap = cap))
        })
        .collect();
    // In a quick study two constants are enough to exercise the search.
    let few = size.candidates < usize::MAX;
    let shares: &[f64] = if few { &[0.25] } else { &[0.25, 0.1, 0.5] };
    let firsts: &[usize] = if few { &[200] } else { &[200, 400] };
    let shares = shares
        .iter()
        .map(|&q| -> Candidate { (q.to_string(), Box::new(move |c: &mut Constants| c.share = q)) })
        .collect();
    let firsts = firsts
        .iter()
        .map(|&f| -> Candidate { (f.to_string(), Box::new(move |c: &mut Constants| c.first = f)) })
        .collect();
    vec![("density", density), ("λ", caps), ("q", shares), ("first keys", firsts)]
}

impl<'a> Search<'a> {
    /// Makes the search over all combinations, for the first model.
    ///
    /// # Errors
    /// When the model's graph has a cycle.
    pub fn new(setup: &'a Setup, latent_scales: Vec<f64>) -> Result<Self> {
        let (axes, base) = (axes(setup), Constants::published(latent_scales));
        // All fits have the render budget of the default constants.
        let renders = base.renders(setup, 0)?;
        let total = axes.iter().fold(1, |n, (_, c)| n * c.len());
        let runs = (0..total)
            .map(|mut at| {
                let mut constants = base.clone();
                let choice: Vec<usize> = (axes.iter())
                    .map(|(_, candidates)| {
                        let which = at % candidates.len();
                        at /= candidates.len();
                        candidates[which].1(&mut constants);
                        which
                    })
                    .collect();
                let settings = constants.full(setup, 0, SUBJECT);
                let structure = Structure::Learned;
                (choice, FitRun { model: 0, subject: SUBJECT, structure, settings, renders, factors: false })
            })
            .collect();
        Ok(Self { setup, axes, runs, base })
    }

    /// (axis, candidate) mean of the value over the combinations with it.
    fn means(&self, results: &[(Cell, Values)]) -> Vec<Vec<Summary>> {
        let key = |t: &FitRun| t.cell(self.setup, "").key;
        let known: Vec<(&Vec<usize>, f64)> = (self.runs.iter())
            .filter_map(|(choice, run)| {
                let key = key(run);
                let value = results.iter().find(|(c, _)| c.key == key)?.1.get(VALUE)?;
                Some((choice, *value))
            })
            .collect();
        (self.axes.iter().enumerate())
            .map(|(a, (_, candidates))| {
                let with = |c: usize| known.iter().filter(move |(choice, _)| choice[a] == c).map(|k| k.1);
                (0..candidates.len()).map(|c| Summary::of(&with(c).collect::<Vec<_>>())).collect()
            })
            .collect()
    }

    /// Index of the best candidate of each axis.
    fn best(&self, results: &[(Cell, Values)]) -> Vec<usize> {
        self.means(results)
            .iter()
            .map(|m| first_largest(&m.iter().map(|s| s.mean).collect::<Vec<_>>()))
            .collect()
    }

    /// The selected constants; `None` while results are missing.
    pub fn found(&self, results: &Results) -> Option<Constants> {
        if results.len() < self.runs.len() {
            return None;
        }
        let mut constants = self.base.clone();
        for ((_, candidates), &which) in self.axes.iter().zip(&self.best(results)) {
            candidates[which].1(&mut constants);
        }
        Some(constants)
    }
}

/// The index of the largest value, the first of equal ones.
fn first_largest(values: &[f64]) -> usize {
    (1..values.len()).fold(0, |best, i| if values[i] > values[best] { i } else { best })
}

impl Experiment for Search<'_> {
    fn id(&self) -> &'static str {
        "search"
    }

    fn folder(&self) -> &'static str {
        FOLDER
    }

    fn cells(&self) -> Vec<Cell> {
        let name = |choice: &[usize]| -> String {
            let parts = self.axes.iter().zip(choice).map(|((name, c), &i)| format!("{name} {}", c[i].0));
            parts.collect::<Vec<_>>().join(", ")
        };
        self.runs.iter().map(|(choice, t)| t.cell(self.setup, &name(choice))).collect()
    }

    fn settings(&self, cell: usize) -> Value {
        self.runs[cell].1.record(self.setup)
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
        self.runs[cell].1.run(self.setup, watch)
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        let (means, best) = (self.means(results), self.best(results));
        let mut rows = Vec::new();
        let mut drawn = Vec::new();
        for (a, (name, candidates)) in self.axes.iter().enumerate() {
            let top = means[a][best[a]].mean;
            // Every candidate of a constant has the same number of fits.
            let middle = Summary::of(&means[a].iter().map(|s| s.mean).collect::<Vec<_>>()).mean;
            for (c, (candidate, _)) in candidates.iter().enumerate() {
                let s = means[a][c];
                let taken = if best[a] == c { "selected" } else { "" };
                let count = s.count.to_string();
                rows.push(vec![
                    format!("{name} {candidate}"),
                    format!("{s:.2}"),
                    format!("{:.2}", s.mean - top),
                    count,
                    taken.into(),
                ]);
                drawn.push((
                    format!("{name} {candidate}"),
                    Summary { mean: s.mean - middle, half_width: f64::INFINITY, ..s },
                ));
            }
        }
        let complete = results.to_vec();
        Report {
            id: self.id(),
            claim: "Hyper-parameters with the best results on subject 0; all other experiments use other subjects.",
            head: vec!["constant", ">mean PSNR-box at equal renders", ">below the best", ">fits", "choice"],
            rows,
            chart_labels: [
                "mean PSNR-box at equal renders minus the mean over the candidates of the constant, dB",
                "",
            ],
            chart: Chart::Intervals(drawn),
            outcome: Outcome::Reported,
            verdict: self.found(&complete).map_or_else(
                || format!("{} of {} fits are done.", results.len(), self.runs.len()),
                |c| format!("Selected: {}.", c.text()),
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_equal_candidates_the_first_is_selected() {
        assert_eq!(first_largest(&[1.0, 3.0, 3.0, 2.0]), 1, "the first of two");
        assert_eq!(first_largest(&[0.0]), 0, "one");
    }
}
