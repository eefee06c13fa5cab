//! `last pretrain`: the image-to-point model from images of known causes.

use crate::choices::{Choices, choices};
use crate::claim;
use crate::console as cli;
use crate::fit::training::{History, Watch};
use crate::io::{MAX_SMALL_FILE_BYTES, read_bytes};
use crate::meter::Meter;
use crate::report::charts::{Lines, Series, bucket};
use crate::report::graph::{self, Graph};
use crate::report::images::{Label, Sheet};
use crate::report::run::LOSS_POINTS;
use crate::report::{self, Page, Section, Stat};
use crate::shared::{Outcome, OutputArgs};
use crate::training::{self, Frame, Head};
use crate::{Error, Result};
use lastlight_last::avatar::guide::Framing;
use lastlight_last::model::data::{Data, Item};
use lastlight_last::model::evaluation::{self, Evaluation};
use lastlight_last::model::file::Trained;
use lastlight_last::model::intervene;
use lastlight_last::model::pictures::Pictures;
use lastlight_last::model::settings::{Placement, Reading, Settings, Supervision};
use lastlight_last::model::structure::Kind;
use lastlight_last::model::train::Training;
use maud::{Markup, html};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// The model in `--out`.
const MODEL: &str = "model.safetensors";

/// Values of `--mechanism`.
const MECHANISMS: &Choices = &[
    ("networks", "a network per factor"),
    ("linear", "one matrix"),
    ("printed", "linear, then networks; only with --reading literal"),
];
/// Values of `--reading`.
const READINGS: &Choices =
    &[("reference", "this project's: the encoder predicts factors"), ("literal", "the mechanism as printed")];
/// Values of `--crop`.
const CROPS: &Choices = &[
    ("person", "the square around the projected body, a tenth wider on each side"),
    ("whole", "the whole image"),
];
/// Values of `--supervision`.
const SUPERVISION: &Choices = &[
    ("none", "no interventions"),
    ("pairs", "each before/after pair has its own value"),
    ("groups", "several pairs share one value"),
    ("unknown", "as groups, the target is inferred"),
    ("labels", "true factor values"),
];
/// Values of `--independence-on`.
const INDEPENDENCE: &Choices = &[
    ("noise", "the noise of the factors"),
    ("factors", "the factors, as in the paper"),
    ("conditional", "the factors, given their parents"),
    ("off", "no penalty"),
];

/// Train the image-to-point model on images with known causal factors.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last gen --out data                           images, points, groups of interventions
  lastlight last pretrain data --out model                13 000 iterations
  lastlight last pretrain data --out model --resume       go on after an interruption, with the same bits
  lastlight last pretrain data --out quick --iterations 1000   a shorter schedule
  lastlight last pretrain data --out control --supervision pairs

DIR is written by last gen. Written to --out: model.safetensors (for last tune, fit, intervene), a checkpoint, result.json and report/index.html. With --reading literal the mechanism is that of the paper as printed: the encoder predicts noise, and eq. 2, then eq. 3, are applied before the decoder; groups, hinge and weights stay.")]
pub(crate) struct Args {
    /// Folder made by last gen, with observational images and groups of interventions
    #[arg(value_name = "DIR")]
    data: PathBuf,
    /// Folder for the results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Iterations of joint training; the schedule of 12 000 is scaled to it
    #[arg(long, value_name = "N", default_value_t = 12_000, value_parser = clap::value_parser!(u32).range(1..))]
    iterations: u32,
    /// Number of factors
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=8))]
    factors: u8,
    /// Latent dimensions per factor
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=16))]
    factor_dim: u8,
    /// Form of the mechanisms [default: networks; printed with --reading literal]
    #[arg(long, value_name = "NAME", value_parser = choices(MECHANISMS))]
    mechanism: Option<String>,
    /// Reading of the paper
    #[arg(long, value_name = "NAME", default_value = "reference", value_parser = choices(READINGS))]
    reading: String,
    /// Part of the image given to the encoder
    #[arg(long, value_name = "NAME", default_value = "person", value_parser = choices(CROPS))]
    crop: String,
    /// Intervention labels used in training
    #[arg(long, value_name = "NAME", default_value = "groups", value_parser = choices(SUPERVISION))]
    supervision: String,
    /// Variables the independence penalty applies to
    #[arg(long, value_name = "NAME", default_value = "noise", value_parser = choices(INDEPENDENCE))]
    independence_on: String,
    /// Coordinates decoded per image and step
    #[arg(long, value_name = "N", default_value_t = 256)]
    batch_points: usize,
    /// Observational images per batch
    #[arg(long, value_name = "N", default_value_t = 64)]
    batch_images: usize,
    /// Intervention groups per batch
    #[arg(long, value_name = "N", default_value_t = 8)]
    batch_groups: usize,
    /// Reconstruction-only iterations; afterwards the group losses ramp up until --graph-from. Counted on the schedule of 12 000
    #[arg(long, value_name = "N", default_value_t = Settings::of_pictures().alone)]
    warmup_iterations: u32,
    /// Iteration at which the graph's edges start to train. Counted on the schedule of 12 000
    #[arg(long, value_name = "N", default_value_t = Settings::of_pictures().freeze)]
    graph_from: u32,
    /// Weight of a loss term, comma-separated or repeated: reconstruction, kl, independence, groups, intervention (decoded counterfactuals, multiplied by groups), spread (variance hinge, multiplied by groups), sparsity
    #[arg(long, value_name = "KEY=VALUE", value_delimiter = ',')]
    weight: Vec<String>,
    /// Iterations between checkpoints
    #[arg(long, value_name = "N", default_value_t = 250, value_parser = clap::value_parser!(u32).range(1..))]
    checkpoint_every: u32,
    #[command(flatten)]
    filling: OutputArgs,
}

impl Args {
    fn settings(&self) -> Result<Settings> {
        let reading = Reading::parse(&self.reading)?;
        let kind = self.mechanism.as_ref().map_or(Ok(reading.mechanism()), |name| Kind::parse(name))?;
        let mut s = Settings {
            factors: usize::from(self.factors),
            width: usize::from(self.factor_dim),
            kind,
            reading,
            framing: Framing::parse(&self.crop)?,
            supervision: Supervision::parse(&self.supervision)?,
            placement: Placement::parse(&self.independence_on)?,
            points: self.batch_points,
            observed: self.batch_images,
            groups: self.batch_groups,
            seed: self.filling.seed,
            freeze: self.graph_from,
            alone: self.warmup_iterations,
            ..Settings::of_pictures()
        };
        for term in &self.weight {
            let wrong = || {
                Error::input("--weight")
                    .expected("KEY=VALUE: reconstruction, kl, independence, groups, intervention, spread or sparsity, and a number not below 0")
                    .got(term.as_str())
            };
            let (name, value) = term.split_once('=').ok_or_else(wrong)?;
            let value: f64 = value.parse().map_err(|_| wrong())?;
            if !(value >= 0.0 && value.is_finite()) {
                return Err(wrong());
            }
            let w = &mut s.weights;
            *match name {
                "reconstruction" => &mut w.reconstruction,
                "kl" => &mut w.kl,
                "independence" => &mut w.independence,
                "groups" => &mut w.groups,
                "intervention" => &mut w.intervention,
                "spread" => &mut w.spread,
                "sparsity" => &mut w.sparsity,
                _ => return Err(wrong()),
            } = value;
        }
        let s = s.scaled(self.iterations);
        s.validate()?;
        Ok(s)
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new().of("edges");
    let settings = args.settings()?;
    claim::check(&args.out, args.filling.resume, args.filling.force)?;
    let data = Pictures::read(&args.data, settings.supervision != Supervision::None, settings.framing)?;
    meter.lap("reading images");
    meter.note(&format!(
        "{}: {} images of {2}x{2}, {3} groups of {4}, {5} points each",
        args.data.display(),
        data.observed(),
        data.side(),
        data.groups().len(),
        data.members(),
        data.template.len()
    ));
    let truth = truth(&args.data)?;
    let frame = Frame::claim(&args.out, &args.filling, args.checkpoint_every)?;
    let mut training = Training::new(settings, &data)?;
    let (history, _) = frame.train(&mut training, &mut meter)?;
    let units = training.units().map(<[f64]>::to_vec);
    let trained = training.finish()?;
    let digest = trained.digest()?;
    if let Some(outcome) = frame.finished(&digest, &settings.json(), &history) {
        return outcome.publish(&frame.dir);
    }
    let verdict = evaluation::of(&trained, &data, &truth)?;
    meter.lap("evaluation");
    trained.write(&frame.file(MODEL))?;
    let head = Head { kind: "last pretrain", digest: &digest, settings: settings.json() };
    let own = training::entries([("verdict", verdict.json()), ("units", json!(&units))]);
    let record = frame.record(head, own, &history, &meter)?;
    let sheet = samples(&trained, &data)?;
    sheet.write(&frame.file("samples.png"))?;
    let told = units.as_ref().map(|units| changed(units, settings.alone));
    let mut page = page(args, &record, &history, &verdict, told.clone(), &meter);
    page.sections.push(Section {
        id: "samples",
        title: "Encoder inputs and decoded points",
        lead: "Above the images that the encoder receives, below the points that the decoder returns, drawn as discs through the same camera and \
               window."
            .into(),
        body: sheet.columns(&|c| Label {
            alt: format!("encoder input {0}, and below it the points decoded from it", c + 1),
            caption: format!("input {0}, decoded points", c + 1),
        })?,
    });
    let mut lines = vec![verdict.text()];
    lines.extend(told.map(|told| format!("units       {told}")));
    lines.push(format!("digest      {digest}"));
    lines.push(format!("time        {}", report::seconds(meter.seconds())));
    lines.push(format!("model       {}", frame.file(MODEL).display()));
    Outcome { record, page: Some(page), lines, held_out_db: f64::NAN }.publish(&frame.dir)
}

/// A change of units in words.
fn changed(units: &[f64], step: u32) -> String {
    let times: Vec<String> = units.iter().map(ToString::to_string).collect();
    format!("codes too small when groups came in, at step {step}: times {}", times.join(", "))
}

/// Images of some observed items, and below each the decoded points through the camera of the sets.
fn samples(trained: &Trained, data: &Pictures) -> Result<Sheet> {
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

/// The true graph of a folder of data, as rows: A_ij is true for an edge from i to j. `None` if the folder has no `dataset.json`, as data of another
/// program may have none.
///
/// # Errors
/// When there is a `dataset.json` from which the graph cannot be read.
pub(crate) fn truth(data: &Path) -> Result<Option<Vec<Vec<bool>>>> {
    let path = data.join(lastlight_last::generate::RECORD);
    if !path.exists() {
        return Ok(None);
    }
    let name = path.display().to_string();
    let hint = "write the data again with last gen, or remove the file: the structure is then not compared with a true one";
    let bytes = read_bytes(&path, MAX_SMALL_FILE_BYTES)?;
    let record: Value = serde_json::from_slice(&bytes).map_err(|e| {
        Error::input(&name).expected("the JSON record of last gen").got(e.to_string()).hint(hint)
    })?;
    let entry = |x: &Value| x.as_bool().or_else(|| x.as_u64().filter(|x| *x < 2).map(|x| x == 1));
    let row = |row: &Value| -> Option<Vec<bool>> { row.as_array()?.iter().map(entry).collect() };
    let rows: Option<Vec<Vec<bool>>> =
        record["adjacency"].as_array().and_then(|rows| rows.iter().map(row).collect());
    match rows {
        Some(rows) if rows.iter().all(|row| row.len() == rows.len()) => Ok(Some(rows)),
        _ => Err(Error::input(name)
            .at("adjacency")
            .expected("a square matrix of zeros and ones")
            .got(record["adjacency"].to_string())
            .hint(hint)),
    }
}

/// The graph as a drawing and as a table.
fn structure(data: &Path, verdict: &Evaluation) -> Section {
    let n = verdict.graph.n();
    let (p, edges, truth) = (
        verdict.rows().flatten().copied().collect::<Vec<f64>>(),
        verdict.graph.edges(),
        truth(data).ok().flatten(),
    );
    let truth = truth.filter(|t| t.len() == n && t.iter().all(|row| row.len() == n));
    let drawing = Graph {
        title: "after training",
        names: &(0..n).map(|j| format!("factor {j}")).collect::<Vec<_>>(),
        p: &p,
        kept: &edges,
        truth: truth.as_deref(),
        levels: &graph::levels(n, &edges),
    };
    let names: Vec<String> = (0..n).map(|j| format!(">{j}")).collect();
    let head: Vec<&str> = std::iter::once("from").chain(names.iter().map(String::as_str)).collect();
    let rows: Vec<Vec<Markup>> = verdict
        .rows()
        .enumerate()
        .map(|(i, row)| {
            let cell = |(j, p): (usize, &f64)| {
                let value = format!("{p:.3}");
                if verdict.graph.has(i, j) {
                    html! { strong { (value) } }
                } else {
                    html! { (value) }
                }
            };
            std::iter::once(report::text(i)).chain(row.iter().enumerate().map(cell)).collect()
        })
        .collect();
    Section {
        id: "structure",
        title: "Structure",
        lead: "Edges are as wide as they are probable; in the table, a row is the cause, a column the effect, and edges in the graph are \
               bold."
            .into(),
        body: html! { div.two { div { (drawing.html()) (graph::legend(truth.is_some())) } (report::table(&head, &rows)) } },
    }
}

/// `units` describes a change of units, if there was one.
fn page(
    args: &Args,
    record: &Value,
    history: &History,
    verdict: &Evaluation,
    units: Option<String>,
    meter: &Meter,
) -> Page {
    let (points, band) = bucket(&history.loss, LOSS_POINTS);
    let settings = training_marks(&record["settings"]);
    let losses = Lines {
        title: "L_rec + L_int",
        x_label: "step",
        log_y: true,
        from_zero: false,
        series: vec![Series { name: "loss", color: 'a', points, band }],
        marks: settings,
    };
    Page {
        kind: "last pretrain".into(),
        title: format!("Image-to-point model from {}", args.data.display()),
        notice: "",
        command: cli::command_line(),
        facts: vec![
            ("digest", record["digest"].as_str().unwrap_or("").to_owned()),
            ("seed", args.filling.seed.to_string()),
        ],
        stats: vec![
            Stat {
                label: "points",
                value: format!("{:.4}", verdict.space_error),
                note: "mean error, figure units".into(),
            },
            Stat { label: "edges", value: verdict.graph.count().to_string(), note: verdict.against_truth() },
            Stat {
                label: "targets",
                value: format!("{:.1} %", 100.0 * verdict.target_accuracy),
                note: "found from noise alone".into(),
            },
            Stat {
                label: "time",
                value: report::seconds(meter.seconds()),
                note: format!("{} steps", history.len()),
            },
        ],
        sections: vec![
            structure(&args.data, verdict),
            Section {
                id: "loss",
                title: "Loss",
                lead: units.map_or_else(String::new, |text| text + "."),
                body: html! { (losses.html()) },
            },
        ],
    }
}

/// Where the logits begin to move, the graph is fixed, the search runs.
fn training_marks(settings: &Value) -> Vec<(f64, String)> {
    let at = |key: &str| settings[key].as_f64().unwrap_or(0.0);
    vec![
        (at("alone"), "groups begin".into()),
        (at("freeze"), "logits move".into()),
        (at("steps"), "graph fixed".into()),
        (at("steps") + at("refit") / 2.0, "search".into()),
    ]
}
