//! `last pretrain`: the image-to-point model from images of known causes.

use crate::choices::{Choices, choices};
use crate::claim;
use crate::console as cli;
use crate::fit::training::Watch;
use crate::io::{MAX_SMALL_FILE_BYTES, read_bytes};
use crate::meter::Meter;
use crate::report::run::Run;
use crate::report::{self, model};
use crate::shared::{Outcome, OutputArgs};
use crate::training::{self, CHECKPOINT, Frame, Head, RESULT};
use crate::{Error, Result};
use lastlight_last::avatar::guide::Framing;
use lastlight_last::model::data::Data;
use lastlight_last::model::evaluation;
use lastlight_last::model::file::FILE as MODEL;
use lastlight_last::model::pictures::Pictures;
use lastlight_last::model::settings::{Placement, Reading, Settings, Supervision};
use lastlight_last::model::structure::Kind;
use lastlight_last::model::train::Training;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Encoder inputs and decoded points in `--out`.
const SAMPLES: &str = "samples.png";

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
  lastlight last pretrain data --out quick --iterations 1000   the same schedule, scaled
  lastlight last pretrain data --out control --supervision pairs

DIR is written by last gen. Written to --out: model.safetensors (for last tune, fit, intervene), samples.png, a checkpoint, result.json and report/index.html, which explains the scores. With --reading literal the mechanism is that of the paper as printed: the encoder predicts noise, and eq. 2, then eq. 3, are applied before the decoder; groups, hinge and weights stay.")]
pub(crate) struct Args {
    /// Folder made by last gen, with observational images and groups of interventions
    #[arg(value_name = "DIR")]
    data: PathBuf,
    /// Folder for the results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Iterations; the schedule of 13 000 (12 000 of joint training, 1 000 with the final graph) is scaled to it
    #[arg(long, value_name = "N", default_value_t = 13_000, value_parser = clap::value_parser!(u32).range(3..))]
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
    /// Reconstruction-only iterations; afterwards the group losses ramp up until --graph-from. Counted on the schedule of 13 000
    #[arg(long, value_name = "N", default_value_t = Settings::of_pictures().alone)]
    warmup_iterations: u32,
    /// Iteration at which the graph's edges start to train. Counted on the schedule of 13 000
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
    /// What the command does without options.
    fn usual() -> Result<Settings> {
        #[derive(clap::Parser)]
        struct Alone {
            #[command(flatten)]
            args: Args,
        }
        let Alone { args } = clap::Parser::parse_from(["last pretrain", "-", "--out", "-"]);
        args.settings()
    }

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
        let s = s.scaled_to_all(self.iterations);
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
        "{}: {} images of {2}x{2}, {3} groups of {4} pairs, {5} points each",
        args.data.display(),
        data.observed(),
        data.side(),
        data.groups().len(),
        data.members(),
        data.template.len()
    ));
    let truth = truth(&args.data)?;
    let mut training = Training::new(settings, &data)?;
    let frame = Frame::claim(&args.out, &args.filling, args.checkpoint_every)?;
    let (history, _) = frame.train(&mut training, &mut meter)?;
    let units = training.units().map(<[f64]>::to_vec);
    let trained = training.finish()?;
    let digest = trained.digest()?;
    if let Some(outcome) = frame.finished(&digest, &settings.json(), &history, &[MODEL]) {
        return outcome.publish(&frame.dir);
    }
    let evaluation = evaluation::of(&trained, &data, &truth)?;
    meter.lap("evaluation");
    trained.write(&frame.file(MODEL))?;
    let head = Head { kind: "last pretrain", digest: &digest, settings: settings.json() };
    let own = training::entries([("verdict", evaluation.json()), ("units", json!(&units))]);
    let record = frame.record(head, own, &history, &meter)?;
    let sheet = model::samples(&trained, &data)?;
    sheet.write(&frame.file(SAMPLES))?;
    meter.lap("writing files");
    let rescaled = units.as_ref().map(|units| model::rescaled(units, settings.alone));
    let page = model::page(&model::Input {
        title: format!("Image-to-point model from {}", args.data.display()),
        command: cli::command_line(),
        digest: digest.clone(),
        evaluation: &evaluation,
        truth: truth.as_deref(),
        rescaled: rescaled.clone(),
        samples: &sheet,
        run: Run {
            defaults: Some(Args::usual()?.json()),
            ..Run::new(
                &record["settings"],
                Some(&history),
                &meter,
                &frame.dir,
                &[MODEL, SAMPLES, CHECKPOINT, RESULT],
            )
        },
    })?;
    let mut lines = vec![evaluation.text()];
    lines.extend(rescaled.map(|text| format!("rescaled    {text}")));
    lines.push(format!("scores      {}", report::EXPLAINED));
    lines.push(format!("digest      {digest}"));
    lines.push(format!("time        {}", report::seconds(meter.seconds())));
    lines.push(format!("model       {}", frame.file(MODEL).display()));
    Outcome { record, page: Some(page), lines, held_out_db: f64::NAN }.publish(&frame.dir)
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
