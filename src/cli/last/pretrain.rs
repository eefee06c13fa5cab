//! `last pretrain`: the image-to-point model from pictures of known causes.

use crate::claim;
use crate::console as cli;
use crate::fit::training::{History, Watch};
use crate::meter::Meter;
use crate::report::charts::{Lines, Series, bucket};
use crate::report::pictures::Sheet;
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

/// Train the image-to-point model on pictures of known causes.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last gen --out data                           pictures, points, groups of interventions
  lastlight last pretrain data --out model                13 000 steps
  lastlight last pretrain data --out model --resume       go on after an interruption, with the same bits
  lastlight last pretrain data --out quick --steps 1000   the same schedule in fewer steps
  lastlight last pretrain data --out control --supervision pairs

DATA is what last gen writes. --out gets model.safetensors (for last tune, fit, intervene), a checkpoint,
result.json and report/index.html. --reading literal is the paper as printed: the encoder gives noise and
eq. 2, then eq. 3, act on it on the way to the decoder.")]
pub(crate) struct Args {
    /// Folder made by last gen, with observational pictures and groups of interventions
    #[arg(value_name = "DATA")]
    data: PathBuf,
    /// Folder for the results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Steps of joint training; the schedule of 12000 is scaled to it
    #[arg(long, value_name = "N", default_value_t = 12_000, value_parser = clap::value_parser!(u32).range(1..))]
    steps: u32,
    /// Number of factors
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=8), help_heading = "Model")]
    factors: u8,
    /// Numbers of a factor
    #[arg(long, value_name = "K", default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=16), help_heading = "Model")]
    width: u8,
    /// How parents act on a factor: networks, linear, or printed (linear, then networks; the literal reading alone)
    /// [default: networks; printed for the literal reading]
    #[arg(long, value_name = "NAME", help_heading = "Model")]
    mechanism: Option<String>,
    /// Reading of the paper: reference or literal
    #[arg(long, value_name = "NAME", default_value = "reference", help_heading = "Model")]
    reading: String,
    /// What the encoder sees of a picture: person (the square around the projected body, a tenth wider on either side) or whole
    #[arg(long, value_name = "NAME", default_value = "person", help_heading = "Model")]
    framing: String,
    /// What is told of interventions: none, pairs (a value of its own for each), groups (a shared value), unknown (its
    /// target is guessed) or labels
    #[arg(long, value_name = "NAME", default_value = "groups", help_heading = "Training")]
    supervision: String,
    /// Where dependence is punished: noise, factors (as printed), conditional or off
    #[arg(long, value_name = "NAME", default_value = "noise", help_heading = "Training")]
    dependence: String,
    /// Coordinates decoded per picture and step
    #[arg(long, value_name = "Q", default_value_t = 256, help_heading = "Training")]
    points: usize,
    /// Observed pictures of a batch
    #[arg(long, value_name = "N", default_value_t = 64, help_heading = "Training")]
    observed: usize,
    /// Groups of a batch
    #[arg(long, value_name = "N", default_value_t = 8, help_heading = "Training")]
    groups: usize,
    /// Steps of the schedule of 12000 before groups count; from there they count more and more, until edges move
    #[arg(long, value_name = "N", default_value_t = Settings::of_pictures().alone, help_heading = "Training")]
    alone: u32,
    /// Steps of the schedule of 12000 before edges move
    #[arg(long, value_name = "N", default_value_t = Settings::of_pictures().freeze, help_heading = "Training")]
    freeze: u32,
    /// Another factor of a term of the loss, NAME=VALUE: reconstruction, kl, independence, groups, intervention (of
    /// decoded counterfactuals, times groups), spread (of the hinge, times groups), sparsity
    #[arg(long, value_name = "TERM", num_args = 1.., help_heading = "Training")]
    weight: Vec<String>,
    /// Steps between checkpoints
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
            width: usize::from(self.width),
            kind,
            reading,
            framing: Framing::parse(&self.framing)?,
            supervision: Supervision::parse(&self.supervision)?,
            placement: Placement::parse(&self.dependence)?,
            points: self.points,
            observed: self.observed,
            groups: self.groups,
            seed: self.filling.seed,
            freeze: self.freeze,
            alone: self.alone,
            ..Settings::of_pictures()
        };
        for term in &self.weight {
            let wrong = || {
                Error::input("--weight")
                    .expected("NAME=VALUE: reconstruction, kl, independence, groups, intervention, spread or sparsity, and a number not below 0")
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
        let s = s.scaled(self.steps);
        s.validate()?;
        Ok(s)
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new(args.filling.quiet).of("edges");
    let settings = args.settings()?;
    claim::check(&args.out, args.filling.resume, args.filling.force)?;
    let data = Pictures::read(&args.data, settings.supervision != Supervision::None, settings.framing)?;
    meter.lap("reading pictures");
    meter.note(&format!(
        "{}: {} pictures of {2}x{2}, {3} groups of {4}, {5} points each",
        args.data.display(),
        data.observed(),
        data.side(),
        data.groups().len(),
        data.members(),
        data.template.len()
    ));
    let frame = Frame::claim(&args.out, &args.filling, args.checkpoint_every)?;
    let mut training = Training::new(settings, &data)?;
    let history = frame.train(&mut training, &mut meter)?;
    let units = training.units().map(<[f64]>::to_vec);
    let trained = training.finish()?;
    let verdict = evaluation::of(&trained, &data, &truth(&args.data))?;
    meter.lap("evaluation");
    let remarks = [("command", cli::command_line())];
    trained.write(&frame.file(MODEL), &remarks)?;
    let digest = trained.digest()?;
    let head = Head { kind: "last pretrain", digest: &digest, settings: settings.json() };
    let own = training::entries([("verdict", verdict.json()), ("units", json!(&units))]);
    let record = frame.record(head, own, &history, &meter)?;
    let sheet = samples(&trained, &data)?;
    sheet.write(&frame.file("samples.png"))?;
    let told = units.as_ref().map(|units| changed(units, settings.alone));
    let mut page = page(args, &record, &history, &verdict, told.clone(), &meter);
    page.sections.push(Section {
        id: "samples",
        title: "Pictures and what is decoded",
        lead: "Above what the encoder sees, below the points that the decoder gives back, as discs, through the same camera and the same window.".into(),
        body: sheet.html("pictures and decoded points")?,
    });
    let mut lines = vec![verdict.text()];
    lines.extend(told.map(|told| format!("units       {told}")));
    lines.push(format!("digest      {digest}"));
    lines.push(format!("time        {}", report::seconds(meter.seconds())));
    lines.push(format!("model       {}", frame.file(MODEL).display()));
    Outcome { record, page, lines, held_out_db: f64::NAN }.publish(&frame.dir, args.filling.json)
}

/// A change of units in words.
fn changed(units: &[f64], step: u32) -> String {
    let times: Vec<String> = units.iter().map(ToString::to_string).collect();
    format!("codes too small when groups came in, at step {step}: times {}", times.join(", "))
}

/// Pictures of some observed items, and below each the decoded points through the camera of the sets.
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

/// The true graph, where the data says it: rows of zeros and ones.
pub(crate) fn truth(data: &Path) -> Option<Vec<Vec<bool>>> {
    let text = std::fs::read_to_string(data.join(lastlight_last::generate::RECORD)).ok()?;
    let record: Value = serde_json::from_str(&text).ok()?;
    let rows = record["adjacency"].as_array()?;
    rows.iter()
        .map(|row| {
            row.as_array()?.iter().map(|x| x.as_bool().or_else(|| x.as_i64().map(|x| x != 0))).collect()
        })
        .collect()
}

/// `units` says in words that they changed, if they did.
fn page(
    args: &Args,
    record: &Value,
    history: &History,
    verdict: &Evaluation,
    units: Option<String>,
    meter: &Meter,
) -> Page {
    let (points, band) = bucket(&history.loss, 300);
    let settings = training_marks(&record["settings"]);
    let losses = Lines {
        title: "L_rec + L_int",
        x_label: "step",
        log_y: true,
        from_zero: false,
        series: vec![Series { name: "loss", color: 'a', points, band }],
        marks: settings,
    };
    let n = verdict.graph.n();
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
    Page {
        kind: "last pretrain".into(),
        title: args.data.display().to_string(),
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
            Section {
                id: "structure",
                title: "Structure",
                lead: "Probability of each edge, row to column; what the graph keeps is bold.".into(),
                body: report::table(&head, &rows),
            },
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
