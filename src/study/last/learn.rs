//! E4, E10, E11, E12: structure learned from vectors of known factors (chapter *Learned causes*).
//!
//! A run trains a model on [`Vectors`] of a generator, compares its graph with the true one, and evaluates it
//! on other vectors of the same generator. The table of E10 also lists the scores of the same search on the
//! true factors, because some scores cannot reach 1 even for a perfect model.

use crate::experiment::{
    Cell, Chart, Curve, Experiment, Outcome, Report, Summary, Values, differences, median, of, rows,
};
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

/// Values of n in E4.
const NUMBERS: [usize; 7] = [1, 2, 3, 4, 5, 6, 8];

const GRAPHS: [&str; 6] = ["FORK", "CHAIN", "COLLIDER", "DIAMOND", "FULL", "EMPTY"];

fn three(values: &[f64]) -> String {
    if values.is_empty() { "–".into() } else { format!("{:.2}", Summary::of(values)) }
}

/// E10: is the structure learned correctly?
pub fn correct(size: Size) -> Learning {
    let kinds = [Supervision::Groups, Supervision::Labels, Supervision::PerSample, Supervision::None];
    let mut list = Vec::new();
    // First the supervision of interest, then the controls.
    for supervision in kinds {
        for mechanism in [Mechanism::Lin, Mechanism::Nl, Mechanism::Ng] {
            for graph in GRAPHS {
                let row = format!("{graph} {} {}", mechanism.name(), supervision.name());
                list.push((row, TrainingRun { supervision, ..TrainingRun::new(graph, mechanism, 0) }));
            }
        }
    }
    for graph in GRAPHS {
        for supervision in [Supervision::Groups, Supervision::None] {
            let row = format!("{graph} NL {} raw", supervision.name());
            list.push((
                row,
                TrainingRun { supervision, raw: true, ..TrainingRun::new(graph, Mechanism::Nl, 0) },
            ));
        }
        let row = format!("{graph} NL unknown");
        let supervision = Supervision::Unknown;
        list.push((row, TrainingRun { supervision, ..TrainingRun::new(graph, Mechanism::Nl, 0) }));
        let row = format!("{graph} NL groups literal");
        list.push((
            row,
            TrainingRun { reading: Reading::Literal, ..TrainingRun::new(graph, Mechanism::Nl, 0) },
        ));
        // The equations as printed: no supervision, dependence of the factors.
        let row = format!("{graph} NL none literal");
        let printed = TrainingRun {
            supervision: Supervision::None,
            placement: Placement::Factors,
            ..TrainingRun::new(graph, Mechanism::Nl, 0)
        };
        list.push((row, TrainingRun { reading: Reading::Literal, ..printed }));
    }
    Learning { id: "E10", runs: TrainingRuns::new(size, list), report: report_e10 }
}

/// Table and chart of the scores of all rows, the median SHD first.
pub(super) fn scores(results: &[(Cell, Values)], columns: &[&str]) -> (Vec<Vec<String>>, Chart) {
    let names = rows(results);
    let shd = |row: &String| median(&of(results, row, "shd"));
    let line = |row: &String| -> Vec<String> {
        let mut cells = summaries(results, row, columns);
        cells.insert(1, format!("{}", shd(row)));
        cells
    };
    (names.iter().map(line).collect(), Chart::Bars(names.iter().map(|row| (row.clone(), shd(row))).collect()))
}

fn report_e10(results: &[(Cell, Values)]) -> Report {
    let names = rows(results);
    let columns = [
        "shd",
        "sid",
        "mcc",
        "targets",
        "tpr",
        "fdr",
        "disentanglement",
        "disentanglement of truth",
        "information_gap",
        "information_gap of truth",
        "oracle_shd",
    ];
    let (rows, chart) = scores(results, &columns);
    let is_found = |row: &str| median(&of(results, row, "shd")) <= 1.0;
    let supervised = |how: &str| -> Vec<&str> {
        names.iter().map(String::as_str).filter(|row| row.ends_with(how)).collect()
    };
    let good = supervised(" groups");
    let missed: Vec<&str> = good.iter().copied().filter(|row| !is_found(row)).collect();
    // Without shared values the edges are not identifiable: a graph with edges that is found anyway would be
    // a leak.
    let has_edges = |row: &&str| !row.starts_with("EMPTY");
    let controls: Vec<&str> =
        [" none", " pairs"].iter().flat_map(|how| supervised(how)).filter(|row| has_edges(row)).collect();
    let leaks: Vec<&str> = controls.iter().copied().filter(|row| is_found(row)).collect();
    let leaks = match (controls.is_empty(), leaks.is_empty()) {
        (true, _) => String::new(),
        (false, true) => " Without supervision, or with pairs, no graph with edges is found.".into(),
        (false, false) => format!(
            " Without supervision, or with pairs, the median SHD is also at most 1 for {}.",
            leaks.join(", ")
        ),
    };
    Report {
        id: "E10",
        claim: "The structure is learned correctly; the paper does not measure it. Criterion: with groups, median SHD ≤ 1 at n = 4.",
        head: vec![
            "graph, mechanism, supervision",
            ">median SHD",
            ">SHD",
            ">SID",
            ">MCC",
            ">targets",
            ">TPR",
            ">FDR",
            ">disentanglement",
            ">disentanglement of true factors",
            ">information gap",
            ">information gap of true factors",
            ">SHD on true factors",
        ],
        rows,
        chart_labels: ["median SHD", "row"],
        chart,
        outcome: Outcome::of((!good.is_empty()).then_some(missed.is_empty())),
        verdict: if good.is_empty() {
            leaks.trim_start().to_owned()
        } else if missed.is_empty() {
            format!("With groups that share a value the median SHD is at most 1 on every graph.{leaks}")
        } else {
            format!("With groups the median SHD exceeds 1 for {}.{leaks}", missed.join(", "))
        },
    }
}

/// E11: the spurious edge between two effects of one cause.
pub fn spurious(size: Size) -> Learning {
    let list = [Supervision::Groups, Supervision::None].into_iter().flat_map(|supervision| {
        [Mechanism::Lin, Mechanism::Nl].map(|mechanism| {
            let row = format!("FORK {} {}", mechanism.name(), supervision.name());
            (row, TrainingRun { supervision, ..TrainingRun::new("FORK", mechanism, 0) })
        })
    });
    Learning { id: "E11", runs: TrainingRuns::new(size, list), report: report_e11 }
}

fn report_e11(results: &[(Cell, Values)]) -> Report {
    let names = rows(results);
    let line = |row: &String| summaries(results, row, &["p_wo", "p_ow", "nnz", "shd"]);
    let low =
        |row: &&String| ["p_wo", "p_ow"].iter().all(|name| Summary::of(&of(results, row, name)).mean < 0.5);
    let supervised: Vec<&String> = names.iter().filter(|row| row.ends_with("groups")).collect();
    let holds = supervised.iter().all(low);
    Report {
        id: "E11",
        claim: "W and O share the cause P, and no edge between them is learned: p(W→O), p(O→W) < ½ with interventions, undetermined without.",
        head: vec![
            "mechanism, supervision",
            ">p(W→O)",
            ">p(O→W)",
            ">edges of the graph",
            ">SHD of the graph",
        ],
        rows: names.iter().map(line).collect(),
        chart_labels: ["mean of p(W→O)", "row"],
        chart: Chart::Bars(
            names.iter().map(|row| (row.clone(), Summary::of(&of(results, row, "p_wo")).mean)).collect(),
        ),
        outcome: Outcome::of((!supervised.is_empty()).then_some(holds)),
        verdict: if supervised.is_empty() {
            String::new()
        } else if holds {
            "No spurious edge is probable with interventions.".into()
        } else {
            "A spurious edge remains probable in the mask; the score-based search removes it where SHD is 0."
                .into()
        },
    }
}

/// E12: variables that the independence penalty applies to.
pub fn dependence(size: Size) -> Learning {
    let places = [Placement::Noise, Placement::Factors, Placement::Conditional, Placement::Off];
    let list = ["FORK", "CHAIN", "FULL"].into_iter().flat_map(|graph| {
        places.map(|placement| {
            let row = format!("{graph} NL {}", placement.name());
            (row, TrainingRun { placement, ..TrainingRun::new(graph, Mechanism::Nl, 0) })
        })
    });
    Learning { id: "E12", runs: TrainingRuns::new(size, list), report: report_e12 }
}

fn report_e12(results: &[(Cell, Values)]) -> Report {
    let names = rows(results);
    let line = |row: &String| summaries(results, row, &["tpr", "fdr", "shd", "mcc"]);
    let of_graph = |graph: &&str| {
        let row = |placement: &str| format!("{graph} NL {placement}");
        differences(results, [&row("noise"), &row("factors")], "tpr")
    };
    let all: Vec<f64> = ["FORK", "CHAIN", "FULL"].iter().flat_map(of_graph).collect();
    let paired = (!all.is_empty()).then(|| Summary::of(&all));
    Report {
        id: "E12",
        claim: "L_MI on endogenous factors, as printed, penalises the dependence caused by edges and lowers the share of true edges found.",
        head: vec!["graph, L_MI on", ">TPR", ">FDR", ">SHD", ">MCC"],
        rows: names.iter().map(line).collect(),
        chart_labels: ["mean TPR", "row"],
        chart: Chart::Bars(
            names.iter().map(|row| (row.clone(), Summary::of(&of(results, row, "tpr")).mean)).collect(),
        ),
        outcome: Outcome::of(paired.map(|p| p.is_positive())),
        verdict: paired.map_or_else(String::new, |p| {
            format!("TPR on noise minus on factors: {:.3}, 95 % interval ± {:.3}.", p.mean, p.half_width)
        }),
    }
}

/// E4: the number of factors.
pub fn number(size: Size) -> Learning {
    let graphs: [(usize, &'static str); 3] = [(4, "DIAMOND"), (2, "ER-1"), (6, "ER-6")];
    let list = graphs.into_iter().flat_map(|(truth, graph)| {
        NUMBERS.map(|factors| {
            let row = format!("n* {truth}, n {factors}");
            (row, TrainingRun { truth, factors, ..TrainingRun::new(graph, Mechanism::Nl, 0) })
        })
    });
    Learning { id: "E4", runs: TrainingRuns::new(size, list), report: report_e4 }
}

fn report_e4(results: &[(Cell, Values)]) -> Report {
    let names = rows(results);
    let line = |row: &String| summaries(results, row, &["reconstruction", "counterfactual", "mcc", "nnz"]);
    let curve = |truth: usize| -> Curve {
        let point = |n: usize| {
            let s = Summary::of(&of(results, &format!("n* {truth}, n {n}"), "reconstruction"));
            (s.count > 0).then_some((n as f64, s.mean, s.deviation))
        };
        Curve { name: format!("n* = {truth}"), points: NUMBERS.into_iter().filter_map(point).collect() }
    };
    let curves: Vec<Curve> = [4, 2, 6].map(curve).to_vec();
    // The smallest n within 10 % of the best reconstruction.
    let knee = |c: &Curve| -> Option<f64> {
        let best = c.points.iter().fold(f64::INFINITY, |m, p| if p.1 < m { p.1 } else { m });
        c.points.iter().find(|p| p.1 <= 1.1 * best).map(|p| p.0)
    };
    let found: Vec<Option<f64>> = curves.iter().map(knee).collect();
    let follows = found == [Some(4.0), Some(2.0), Some(6.0)];
    let shown: Vec<String> = curves
        .iter()
        .zip(&found)
        .map(|(c, n)| format!("{}: {}", c.name, n.map_or("–".into(), |n| n.to_string())))
        .collect();
    Report {
        id: "E4",
        claim: "n = 4 is best (Fig. 5). If the knee of L_rec follows the true number n*, the value 4 is a property of the data.",
        head: vec![
            "true and model n",
            ">L_rec",
            ">counterfactual error / error without change",
            ">MCC",
            ">edges",
        ],
        rows: names.iter().map(line).collect(),
        chart_labels: ["L_rec", "n"],
        chart: Chart::Lines { curves, from_zero: true },
        outcome: Outcome::of((!results.is_empty()).then_some(follows)),
        verdict: format!("Smallest n within 10 % of the best L_rec: {}.", shown.join("; ")),
    }
}
