//! The report of a trained image-to-point model: structure, scores, decoded points, loss, time, files, settings.

use super::charts::{Lines, Series, bucket};
use super::graph::{self, Graph};
use super::images::{Label, Sheet};
use super::run::{self, LOSS_POINTS, Run};
use super::{Page, Section, Stat, metric, table, text};
use crate::Result;
use lastlight_last::model::data::{Data, Item};
use lastlight_last::model::evaluation::{self, Evaluation};
use lastlight_last::model::file::Trained;
use lastlight_last::model::intervene;
use lastlight_last::model::pictures::Pictures;
use maud::{Markup, html};
use serde_json::{Map, Value};

/// What the report is made of.
pub(crate) struct Input<'a> {
    /// the result and its input
    pub(crate) title: String,
    /// the command line
    pub(crate) command: String,
    /// digest of the model
    pub(crate) digest: String,
    /// the scores
    pub(crate) evaluation: &'a Evaluation,
    /// the true graph, where it is known
    pub(crate) truth: Option<&'a [Vec<bool>]>,
    /// that codes were rescaled, see [`rescaled`]
    pub(crate) rescaled: Option<String>,
    /// see [`samples`]
    pub(crate) samples: &'a Sheet,
    /// settings, course, time, files
    pub(crate) run: Run<'a>,
}

/// The rescaling of codes in words.
pub(crate) fn rescaled(scales: &[f64], iteration: u32) -> String {
    let times: Vec<String> = scales.iter().map(ToString::to_string).collect();
    format!(
        "the codes of the factors were multiplied by {} at iteration {iteration}, where the group losses begin: some had almost no variance",
        times.join(", ")
    )
}

/// Images of some observed items, and below each the decoded points through the camera of the sets.
pub(crate) fn samples(trained: &Trained, data: &Pictures) -> Result<Sheet> {
    const COUNT: usize = 10;
    let side = data.side();
    let camera = data.camera();
    let count = Ord::min(COUNT, data.observed());
    let items: Vec<Item> = (0..count).map(|i| Item::Observed(i * data.observed() / count)).collect();
    let d = trained.model.sizes.latent();
    let [factors, _] = evaluation::posterior(trained, data, &items);
    let mut sheet = Sheet::new([count, 2], [side, side], 0);
    for (i, item) in items.iter().enumerate() {
        let points = trained.decoded(&factors[i * d..(i + 1) * d], &trained.template);
        sheet.put([i, 0], &data.seen(*item));
        sheet.put([i, 1], &data.window(*item).take(&intervene::picture(trained, &points, &camera)?));
    }
    Ok(sheet)
}

/// The page.
///
/// # Errors
/// When an image cannot be encoded.
pub(crate) fn page(x: &Input<'_>) -> Result<Page> {
    let e = x.evaluation;
    let mut facts = vec![("digest", x.digest.clone())];
    facts.extend(x.run.settings.get("seed").map(|seed| ("seed", seed.to_string())));
    let mut stats = vec![
        Stat {
            label: "position error",
            value: format!("{:.4}", e.space_error),
            note: "the figure is 2 high".into(),
        },
        Stat { label: "MCC", value: format!("{:.3}", e.mcc), note: "1 is best".into() },
        Stat { label: "edges", value: e.graph.count().to_string(), note: e.against_truth() },
        Stat {
            label: "targets",
            value: format!("{:.1} %", 100.0 * e.target_accuracy),
            note: "inferred from the noise".into(),
        },
    ];
    stats.extend(x.run.history.map(|h| run::iterations(h, String::new())));
    stats.push(x.run.card());
    let mut sections = vec![
        structure(e, x.truth),
        Section {
            id: "scores",
            title: "Scores",
            lead: "Computed on the training data. The last column is what the score is compared with: the true factors are dependent where \
                   the graph has edges, so they do not reach the best value of every score themselves."
                .into(),
            body: scores(e),
        },
        Section {
            id: "samples",
            title: "Encoder inputs and decoded points",
            lead: "Above the images that the encoder receives, below the points that the decoder returns, drawn as discs through the same \
                   camera and window."
                .into(),
            body: x.samples.columns(&|c| Label {
                alt: format!("encoder input {0}, and below it the points decoded from it", c + 1),
                caption: format!("input {0}, decoded points", c + 1),
            })?,
        },
    ];
    sections.extend(loss(x));
    let defaults = x.run.defaults.as_ref().map(by_option);
    sections.extend(x.run.tail_of(&by_option(x.run.settings), defaults.as_ref()));
    Ok(Page {
        kind: "last pretrain".into(),
        title: x.title.clone(),
        notice: "",
        command: x.command.clone(),
        facts,
        stats,
        sections,
    })
}

/// The graph as a drawing and as a table.
fn structure(evaluation: &Evaluation, truth: Option<&[Vec<bool>]>) -> Section {
    let n = evaluation.graph.n();
    let (p, edges) = (evaluation.rows().flatten().copied().collect::<Vec<f64>>(), evaluation.graph.edges());
    let truth = truth.filter(|t| t.len() == n && t.iter().all(|row| row.len() == n));
    let drawing = Graph {
        title: "after training",
        names: &(0..n).map(|j| format!("factor {j}")).collect::<Vec<_>>(),
        p: &p,
        kept: &edges,
        truth,
        levels: &graph::levels(n, &edges),
    };
    let names: Vec<String> = (0..n).map(|j| format!(">{j}")).collect();
    let head: Vec<&str> = std::iter::once("from").chain(names.iter().map(String::as_str)).collect();
    let rows: Vec<Vec<Markup>> = evaluation
        .rows()
        .enumerate()
        .map(|(i, row)| {
            let cell = |(j, p): (usize, &f64)| {
                let value = format!("{p:.3}");
                if evaluation.graph.has(i, j) {
                    html! { strong { (value) } }
                } else {
                    html! { (value) }
                }
            };
            std::iter::once(text(i)).chain(row.iter().enumerate().map(cell)).collect()
        })
        .collect();
    Section {
        id: "structure",
        title: "Structure",
        lead: "Edges are as wide as they are probable; in the table, a row is the cause, a column the effect, and edges in the graph are \
               bold."
            .into(),
        body: html! { div.two { div { (drawing.html()) (graph::legend(truth.is_some())) } (table(&head, &rows)) } },
    }
}

fn scores(e: &Evaluation) -> Markup {
    let number = |x: f64| format!("{x:.4}");
    let score = |x: Option<f64>| x.map_or_else(|| "–".to_owned(), |x| format!("{x:.3}"));
    let mut rows = vec![
        ("position error", number(e.space_error), "0, where the figure is 2 high".to_owned()),
        ("colour error", number(e.colour_error), "0, where values are in 0…1".to_owned()),
        ("active units", e.active.to_string(), String::new()),
        ("MCC", format!("{:.3}", e.mcc), "1".to_owned()),
        ("targets", format!("{:.1} %", 100.0 * e.target_accuracy), "100 %".to_owned()),
    ];
    if let Some([moved, still]) = e.counterfactual {
        let without = format!("{} without the intervention", number(still.space));
        rows.push(("counterfactual error", number(moved.space), without));
    }
    let [own, best] = e.likeness.map(|l| l.named());
    rows.extend(own.into_iter().zip(best).map(|((name, own), (_, best))| {
        let name = if name == "information_gap" { "information gap" } else { name };
        (name, score(own), format!("{} for the true factors", score(best)))
    }));
    rows.extend(e.locality.map(|locality| ("locality", score(Some(locality)), "0".to_owned())));
    if let Some([shd, sid]) = e.distances {
        rows.extend([("SHD", shd.to_string(), "0".to_owned()), ("SID", sid.to_string(), "0".to_owned())]);
    }
    let rows: Vec<Vec<Markup>> =
        rows.into_iter().map(|(name, value, best)| vec![metric(name), text(value), text(best)]).collect();
    table(&["score", ">value", "compare with"], &rows)
}

/// The curve of the loss, if there was a training.
fn loss(x: &Input<'_>) -> Option<Section> {
    let (points, band) = bucket(&x.run.history?.loss, LOSS_POINTS);
    let curve = Lines {
        title: "L_rec + L_int",
        x_label: "iteration",
        log_y: true,
        from_zero: false,
        series: vec![Series { name: "loss", color: 'a', points, band }],
        marks: marks(x.run.settings),
    };
    let rescaled =
        x.rescaled.as_ref().map_or_else(String::new, |text| format!(" At the first mark, {text}."));
    Some(Section {
        id: "loss",
        title: "Loss",
        lead: format!(
            "The weighted errors of decoded images and of decoded counterfactuals. Every iteration draws other images: the line is the median of \
             consecutive iterations, the band contains the middle 80 % of them.{rescaled}"
        ),
        body: html! { (curve.html()) },
    })
}

/// Where the logits begin to move, the graph is fixed, the search runs.
fn marks(settings: &Value) -> Vec<(f64, String)> {
    let at = |key: &str| settings[key].as_f64().unwrap_or(0.0);
    vec![
        (at("alone"), "groups begin".into()),
        (at("freeze"), "logits move".into()),
        (at("steps"), "graph fixed".into()),
        (at("steps") + at("refit") / 2.0, "search".into()),
    ]
}

/// Names of settings in records, and the ones that the page shows: those of the options, or what is counted.
const NAMES: [(&str, &str); 10] = [
    ("width", "factor_dim"),
    ("framing", "crop"),
    ("dependence", "independence_on"),
    ("observed", "batch_images"),
    ("groups", "batch_groups"),
    ("points", "batch_points"),
    ("steps", "iterations_joint"),
    ("refit", "iterations_final_graph"),
    ("alone", "iterations_before_groups"),
    ("freeze", "iterations_before_graph"),
];

/// Settings under the names that the page shows.
fn by_option(settings: &Value) -> Value {
    let shown =
        |name: &str| NAMES.iter().find(|(n, _)| *n == name).map_or(name, |(_, shown)| shown).to_owned();
    let all: Map<String, Value> = settings
        .as_object()
        .into_iter()
        .flatten()
        .map(|(name, value)| (shown(name), value.clone()))
        .collect();
    Value::Object(all)
}
