//! E4, E10, E11, E12: structure learned from vectors of known factors (chapter *Learned causes*).
//!
//! A run trains a model on [`Vectors`] of a generator, compares its graph with the true one, and evaluates it
//! on other vectors of the same generator. The table of E10 also lists the scores of the same search on the
//! true factors, because some scores cannot reach 1 even for a perfect model.

mod experiments;

pub use experiments::{correct, dependence, number, spurious};

use crate::experiment::{Cell, Chart, Experiment, Report, Summary, Values, median, of, rows};
use crate::fit::training::Watch;
use crate::loss::metric::structure::edges;
use crate::math::digraph::Digraph;
use crate::{Error, Result};
use data_gen::figure::graph::Graph;
use data_gen::figure::mechanism::{Mechanism, Scm};
use lastlight_last::model::data::{Data, Item};
use lastlight_last::model::evaluation::{self, Evaluation};
use lastlight_last::model::file::Trained;
use lastlight_last::model::settings::{Placement, Reading, Settings, Supervision};
use lastlight_last::model::train::Training;
use lastlight_last::model::vectors::Vectors;
use lastlight_last::structure::oracle;
use lastlight_last::structure::samples::Samples;
use lastlight_last::structure::score::{Features, Table};
use serde_json::{Value, json};
use std::sync::atomic::AtomicBool;

/// Sizes of the runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// steps of joint training
    pub steps: u32,
    /// steps of the refit
    pub refit: u32,
    /// steps before the logits of the edges train
    pub freeze: u32,
    /// number of observed items and of groups in a data set
    pub data: [usize; 2],
    /// number of repetitions
    pub seeds: u64,
}

impl Size {
    /// Sizes of the complete study.
    pub fn full() -> Self {
        Self { steps: 1800, refit: 300, freeze: 150, data: [2048, 256], seeds: 5 }
    }

    /// Sizes for a quick overview.
    pub fn quick() -> Self {
        Self { steps: 300, refit: 60, freeze: 40, data: [512, 64], seeds: 1 }
    }

    /// Sizes for a smoke test.
    pub fn smoke() -> Self {
        Self { steps: 4, refit: 2, freeze: 1, data: [64, 8], seeds: 1 }
    }
}

/// Offset from the seeds of training data to those of evaluation data.
const FRESH: u64 = 1 << 32;

/// Settings of one training.
#[derive(Clone, Debug, PartialEq)]
struct TrainingRun {
    graph: &'static str,
    /// n*, the true number of factors
    truth: usize,
    mechanism: Mechanism,
    raw: bool,
    /// n, the number of factors of the model
    factors: usize,
    supervision: Supervision,
    reading: Reading,
    placement: Placement,
    seed: u64,
}

impl TrainingRun {
    fn new(graph: &'static str, mechanism: Mechanism, seed: u64) -> Self {
        Self {
            graph,
            truth: 4,
            mechanism,
            raw: false,
            factors: 4,
            supervision: Supervision::Groups,
            reading: Reading::Reference,
            placement: Placement::Noise,
            seed,
        }
    }

    fn run(&self, size: &Size) -> Result<Values> {
        let fail = |e: String| Error::input("graph").expected("a graph of the list").got(e);
        let graph = Graph::named(self.graph, self.truth, self.seed).map_err(fail)?;
        let scm = Scm::new(graph.clone(), self.mechanism, !self.raw, self.seed);
        let data = Vectors::new(&scm, self.seed, size.data[0], size.data[1]);
        let mut settings = Settings {
            factors: self.factors,
            width: 1,
            supervision: self.supervision,
            reading: self.reading,
            kind: self.reading.mechanism(),
            placement: self.placement,
            points: 1,
            seed: self.seed,
            ..Settings::default()
        }
        .scaled(size.steps);
        (settings.refit, settings.freeze) = (size.refit, size.freeze);
        let mut training = Training::new(settings, &data)?;
        for _ in 0..settings.steps + settings.refit {
            training.advance()?;
        }
        let trained = training.finish()?;
        // Evaluate on new data of the same generator.
        let fresh = Vectors::drawn(&scm, [self.seed, self.seed + FRESH], size.data[0], size.data[1]);
        let score = evaluation::of(&trained, &fresh, &Some(graph.adjacency.clone()))?;
        let observed: Vec<Item> = (0..fresh.observed()).map(Item::Observed).collect();
        let [u, _] = evaluation::posterior(&trained, &fresh, &observed);
        let truth = Digraph::from_fn(self.truth, |i, j| graph.adjacency[i][j]);
        let mut values = measured(&trained, &score, &truth);
        let shown = evaluation::errors(&trained, &fresh, &u, &observed);
        values.insert("reconstruction".into(), shown.weighted);
        if self.truth <= 5 {
            let best =
                oracle::enumerate(&Table::new(&known(&data, self.truth).standardised()?, Features::Spline)?)?;
            values.insert("oracle_shd".into(), edges::compare(&truth, &best.graph).shd as f64);
        }
        Ok(values)
    }
}

/// Scores of a learned graph and its model against the truth.
pub(super) fn measured(trained: &Trained, score: &Evaluation, truth: &Digraph) -> Values {
    let found = edges::compare(truth, &score.matched.relabel(&trained.graph));
    let mut values = Values::from([
        ("shd".into(), found.shd as f64),
        ("nnz".into(), found.nnz as f64),
        ("mcc".into(), score.mcc),
        ("targets".into(), score.target_accuracy),
    ]);
    if let Some(rates) = found.rates {
        values.insert("tpr".into(), rates.tpr);
        values.insert("fdr".into(), rates.fdr);
    }
    for (suffix, likeness) in ["", " of truth"].into_iter().zip(&score.likeness) {
        let defined = likeness.named().into_iter().filter_map(|(name, x)| Some((name, x?)));
        values.extend(defined.map(|(name, x)| (format!("{name}{suffix}"), x)));
    }
    if let Some([_, sid]) = score.distances {
        values.insert("sid".into(), sid as f64);
    }
    if let Some(left) = score.counterfactual.and_then(|[moved, still]| moved.over(&still)) {
        values.insert("counterfactual".into(), left);
    }
    if trained.settings.factors == 4 && truth.n() == 4 {
        // E11 needs the factors P, O, W, L. Without interventions any block may represent any factor.
        if let [_, Some(o), Some(w), _] = score.matched.block[..] {
            values.insert("p_wo".into(), score.probabilities[w * 4 + o]);
            values.insert("p_ow".into(), score.probabilities[o * 4 + w]);
        }
    }
    values
}

/// The true factors as samples, including pairs.
fn known(data: &Vectors, n: usize) -> Samples {
    let mut samples = Samples::new(n, 1);
    (0..data.observed()).for_each(|i| samples.observe(data.truth(Item::Observed(i))));
    for (g, group) in data.groups().iter().enumerate() {
        for m in 0..data.members() {
            samples.intervene(data.truth(Item::Base(g, m)), data.truth(Item::After(g, m)), group.target);
        }
    }
    samples
}

/// A row name as part of a file name.
pub(super) fn plain(row: &str) -> String {
    row.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect()
}

/// The runs of one experiment with their rows.
#[derive(Clone, Debug)]
struct TrainingRuns {
    size: Size,
    list: Vec<(String, TrainingRun)>,
}

impl TrainingRuns {
    fn new(size: Size, rows: impl IntoIterator<Item = (String, TrainingRun)>) -> Self {
        let list = rows
            .into_iter()
            .flat_map(|(row, run)| {
                (0..size.seeds).map(move |seed| (row.clone(), TrainingRun { seed, ..run.clone() }))
            })
            .collect();
        Self { size, list }
    }

    fn cells(&self) -> Vec<Cell> {
        self.list
            .iter()
            .map(|(row, t)| Cell {
                key: format!("{}_{}", plain(row), t.seed),
                row: row.clone(),
                seed: t.seed,
            })
            .collect()
    }
}

/// An experiment with vectors of known factors.
#[derive(Clone, Debug)]
pub struct Learning {
    id: &'static str,
    runs: TrainingRuns,
    report: fn(&[(Cell, Values)]) -> Report,
}

impl Experiment for Learning {
    fn id(&self) -> &'static str {
        self.id
    }

    fn cells(&self) -> Vec<Cell> {
        self.runs.cells()
    }

    fn settings(&self, _: usize) -> Value {
        let s = &self.runs.size;
        json!({
            "steps": s.steps, "refit": s.refit, "freeze": s.freeze, "data": s.data, "fresh": FRESH,
            "lastlight": env!("CARGO_PKG_VERSION"),
        })
    }

    fn run(&self, cell: usize, _: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
        let (_, run) = &self.runs.list[cell];
        run.run(&self.runs.size)
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        (self.report)(results)
    }
}

/// The name of a row, and mean and standard deviation of each of the named values.
fn summaries(results: &[(Cell, Values)], row: &str, names: &[&str]) -> Vec<String> {
    std::iter::once(row.to_owned()).chain(names.iter().map(|name| three(&of(results, row, name)))).collect()
}

fn three(values: &[f64]) -> String {
    if values.is_empty() { "–".into() } else { format!("{:.2}", Summary::of(values)) }
}

/// Scores of a learned graph that the reports of E10 and E10p show: name of the value, head of the column.
const SCORES: [(&str, &str); 6] = [
    ("shd", ">SHD"),
    ("sid", ">SID"),
    ("mcc", ">MCC"),
    ("targets", ">targets"),
    ("tpr", ">TPR"),
    ("fdr", ">FDR"),
];

/// Head, rows and chart of the scores of all rows, the median SHD first, with more columns after them.
pub(super) fn scores(
    results: &[(Cell, Values)],
    more: &[(&str, &'static str)],
) -> (Vec<&'static str>, Vec<Vec<String>>, Chart) {
    let names = rows(results);
    let shd = |row: &String| median(&of(results, row, "shd"));
    let columns = || SCORES.iter().chain(more);
    let values: Vec<&str> = columns().map(|(value, _)| *value).collect();
    let line = |row: &String| -> Vec<String> {
        let mut cells = summaries(results, row, &values);
        cells.insert(1, format!("{}", shd(row)));
        cells
    };
    let head =
        ["graph, mechanism, supervision", ">median SHD"].into_iter().chain(columns().map(|(_, head)| *head));
    let chart = Chart::Bars(names.iter().map(|row| (row.clone(), shd(row))).collect());
    (head.collect(), names.iter().map(line).collect(), chart)
}
