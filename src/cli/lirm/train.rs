//! `lirm train`: one stage of the training of a LIRM model.

use super::init::FirstArgs;
use crate::choices::{Choices, choices};
use crate::console as cli;
use crate::fit::training::{Fit, History, Watch};
use crate::io::memory;
use crate::meter::Meter;
use crate::report::film::Film;
use crate::report::run::{self, Run};
use crate::report::{self, Page};
use crate::shared::{Outcome, OutputArgs};
use crate::training::{self, CHECKPOINT, Frame, Head, RESULT};
use crate::units::counted;
use crate::{Error, Result, claim, units};
use lastlight_lirm::model::file::{FILE, Model, digest};
use lastlight_lirm::model::origin::Part;
use lastlight_lirm::model::params::count;
use lastlight_lirm::train::optimizer::Kind;
use lastlight_lirm::train::source::{BuiltInObjects, Source};
use lastlight_lirm::train::stage::{NAMES, Stage};
use lastlight_lirm::train::stored::StoredSet;
use lastlight_lirm::train::{Settings, Training};
use serde_json::json;
use std::path::PathBuf;

/// Values of `--stage`.
const STAGES: &Choices = &[
    ("1a", "white dome; colour, mask and normals; 2 200 steps"),
    ("1b", "the same, sharper; 2 200 steps"),
    ("1c", "the same, slower; 1 800 steps"),
    ("2a", "environment maps; all heads; 800 steps"),
    ("2b", "the same, sharper; 800 steps"),
    ("3", "the same, with larger crops; 400 steps"),
];

/// Values of `--optimizer`.
const OPTIMIZERS: &Choices =
    &[("adamw", "as published"), ("muon", "steps that are nearly orthogonal matrices")];

/// Train one stage of a LIRM model on built-in objects.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight lirm train --stage 1a --out s1a
  lastlight lirm train --stage 1b --from s1a --out s1b      the next stage, with fresh moments
  lastlight lirm train --stage 1a --out s1a --resume        go on after an interruption, with the same bits
  lastlight lirm train --stage 1a --iterations 100 --out quick   the same schedule, shorter
  lastlight lirm train --stage 1a --until 700 --out a       the first 700 steps
  lastlight lirm train --stage 1a --from a --out s1a        the remaining steps, with fresh moments
  lastlight lirm train set --stage 1a --out s1a             objects of lirm gen --views 20 --size 128 --lighting both --shiny
  lastlight lirm train --stage 1a --shape-steps 600 --distances 60 --optimizer muon --rate 1e-3 --objects-at-once 200 --iterations 2000 --until 600 --out s1a
                                                            the first part of the included weights

Objects are rendered in memory with the pixels of lirm gen (20 images of 128x128 with 8 samples per pixel); each is in --uses steps, turned about the vertical by a drawn angle (with axes of the first image this changes nothing but rounding). The defaults (adamw, renders from the first step, no signed distances) are not the recipe of the included model: trainings with Muon that began with renders hardly used their cameras. Its commands are in reference/weights/README.md. A step of eight objects takes 3 to 5 seconds on two cores of a Zen 4, 13 to 15 on a Zen 1, and with --updates 7.5 on an Emerald Rapids; about one and a half times as long in stages 2a and 2b, and more than twice as long in stage 3: a stage takes hours. With 200 objects in memory it needs 5.4 GiB (6.9 with --added 0.33); the command prints its estimate first. Written to --out: model.safetensors (half precision, for --from), a checkpoint, result.json and report/index.html. The number of threads changes the time, not the result.")]
pub(crate) struct Args {
    /// Set of lirm gen to train on, 20 images of 128x128 per object [default: built-in objects, rendered in memory]
    #[arg(value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder for the results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The stage
    #[arg(long, value_name = "NAME", value_parser = choices(STAGES))]
    stage: String,
    /// Model of the stage before, or of an earlier part of this one, or the folder of its training [default: first values]
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Configuration of the model, where there is no --from: small, paper, or a .json file with some settings, as for lirm init [default:
    /// small]
    #[arg(long, value_name = "FILE|NAME", conflicts_with = "from")]
    config: Option<String>,
    #[command(flatten)]
    choices: FirstArgs,
    /// Steps [default: those of the stage]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    iterations: Option<u32>,
    /// Stop after this step of the stage; a training with --from and otherwise equal options goes on with the next one [default: the last]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    until: Option<u32>,
    /// Weight of the squared distance of surface points from the true ones, and of the part of it along the optical axis; LIRM has neither term,
    /// its successor weighs both by 10
    #[arg(long, value_name = "X", default_value_t = 0.0)]
    points: f32,
    /// Weight of the squared error of the signed distance at points around the object, from its mesh; with it, 1/β rises from 30 to 120 in stage 1a,
    /// stays 120, and ends at 125 in stage 3
    #[arg(long, value_name = "X", default_value_t = 0.0)]
    distances: f32,
    /// Steps at the beginning that compare signed distances alone: nothing is rendered, and colours and normals are not learned
    #[arg(long, value_name = "N", default_value_t = 0)]
    shape_steps: u32,
    /// Emphasise later sets: at least two sets of two to five images per object, and targets that are not in the first set
    #[arg(long)]
    updates: bool,
    /// Part of the objects to which another one is added after the first set, in images, targets and distances; the object is then at half its size
    /// beside it
    #[arg(long, value_name = "X", default_value_t = 0.0)]
    added: f64,
    /// Let gradients flow through the state, from the losses of a set to the sets before it; needs the memory of all sets
    #[arg(long)]
    state_gradient: bool,
    /// Compare the last set of images of an object only, not every set
    #[arg(long)]
    last_set_only: bool,
    /// Compare albedo as it is, not up to one factor per object
    #[arg(long)]
    absolute_albedo: bool,
    /// Factor on the weight of roughness and metallic
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    material_weight: f32,
    /// Weight of the normal head; above 0 where colours depend on the direction. The numerical normals of stage 3 have 1
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    normal_weight: f32,
    /// The model is the mean of the weights over this many last steps [default: the weights after the last step]
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    average_last: u32,
    /// Share of the weights of --from in the model, the rest are the trained ones: what the stage gains and what it loses both get smaller. Changes
    /// no step: with --resume, a training that has ended is written with another share
    #[arg(long, value_name = "X", default_value_t = 0.0)]
    start_share: f64,
    /// Learning rate after the warm-up; the final rate is scaled by the same factor [default: that of the stage]
    #[arg(long, value_name = "X")]
    rate: Option<f64>,
    /// Factor on the learning rate of the heads that stage 2 adds: albedo, roughness and metallic, ρ
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    head_rate: f64,
    /// Scale every object by a random factor from 1 − X to 1 and move it to a random place in the box [default: that of the stage]
    #[arg(long, value_name = "X")]
    room: Option<f64>,
    /// Multiply the colours of every object by a random colour that takes up to this part of a channel; 0 removes it, as published [default: that
    /// of the stage]
    #[arg(long, value_name = "X")]
    tint: Option<f64>,
    /// Optimiser of the matrices of the blocks and of nn.fuse; all other arrays use adamw
    #[arg(long, value_name = "NAME", default_value = "adamw", value_parser = choices(OPTIMIZERS))]
    optimizer: String,
    /// Objects per step
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u8).range(1..=64))]
    batch: u8,
    /// Objects that are in memory, 23 MB each; the next ones follow after --uses steps of each
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u16).range(1..=4096))]
    objects_at_once: u16,
    /// Steps that an object is in; fewer show more objects, which take time to render
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u16).range(1..=4096))]
    uses: u16,
    /// Objects whose gradients are in memory at once; changes no bit [default: all of a step]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=64))]
    gradients_at_once: Option<u8>,
    /// Run blocks again in the adjoint: less memory, the same bits
    #[arg(long)]
    recompute: bool,
    /// Steps between checkpoints
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..))]
    checkpoint_every: u32,
    #[command(flatten)]
    filling: OutputArgs,
}

impl Args {
    fn settings(&self) -> Result<Settings> {
        let mut stage = Stage::named(&self.stage)?;
        if let Some(steps) = self.iterations {
            stage.steps = steps as usize;
        }
        if let Some(rate) = self.rate {
            stage = stage.with_rate(rate);
        }
        stage.room = self.room.unwrap_or(stage.room);
        stage.tint[1] = self.tint.unwrap_or(stage.tint[1]);
        stage.points = self.points;
        stage.added = self.added;
        stage.state_gradient = self.state_gradient;
        stage.last_set_only = self.last_set_only;
        stage.absolute_albedo = self.absolute_albedo;
        stage.material = self.material_weight;
        stage.normal_weight = self.normal_weight;
        stage.shape_steps = self.shape_steps as usize;
        stage = stage.with_distances(self.distances);
        if self.updates {
            stage = stage.with_updates();
        }
        stage.validate()?;
        Ok(Settings {
            stage,
            head_rate: self.head_rate,
            optimizer: Kind::named(&self.optimizer).unwrap_or_default(),
            seed: self.filling.seed,
            batch: usize::from(self.batch),
            block: usize::from(self.objects_at_once),
            uses: usize::from(self.uses),
            at_once: usize::from(self.gradients_at_once.unwrap_or(self.batch)),
            recompute: self.recompute,
            average_last: self.average_last as usize,
            start_share: self.start_share,
        })
    }
}

/// Steps whose mean loss is printed: single ones scatter.
const TAIL: usize = 100;

/// The report of a stage.
fn page(stage: &str, digest: &str, x: &Run<'_>) -> Result<Page> {
    let mut stats: Vec<_> = x.history.map(|h| run::iterations(h, String::new())).into_iter().collect();
    stats.push(x.card());
    let remark = " A loss is the mean over objects, the sets of images that are compared, and crops.";
    let mut sections: Vec<_> = x.course("Loss", None, remark, &[])?.into_iter().collect();
    sections.extend(x.tail());
    Ok(Page {
        kind: "lirm train".into(),
        title: format!("Stage {stage} of a LIRM model"),
        notice: "",
        command: cli::command_line(),
        facts: vec![("digest", digest.to_owned())],
        stats,
        sections,
    })
}

/// Continues a stage whose part made the weights, or begins one after it; prints which.
fn begin_after(part: &Part, stage: &Stage, training: &mut Training<'_>, meter: &Meter) -> Result<()> {
    match (part.stage == stage.name, part.is_last()) {
        (true, false) => {
            training.continue_from(part)?;
            meter.note(&format!("stage {} goes on after step {}", part.stage, part.range[1]));
        }
        (true, true) => meter.note(&format!("stage {} begins again, from its own result", part.stage)),
        (false, false) => meter.note(&format!("the model has stage {}", part.label())),
        (false, true) => {}
    }
    let (was, is) = (part.distances, stage.distances);
    if (was > 0.0) != (is > 0.0) {
        let option = |x: f32| if x > 0.0 { format!("--distances {x}") } else { "no --distances".to_owned() };
        let [first, _] = stage.inverse_beta;
        meter.note(&format!(
            "the model was trained with {}, this stage has {}: 1/beta goes from {} to {first}",
            option(was),
            option(is),
            part.inverse_beta
        ));
    }
    Ok(())
}

/// A remark on stages before this one that the model does not have.
fn skipped(name: &str, before: Option<&Model>) -> Option<String> {
    let parts = before.map_or(&[][..], |model| &model.training);
    let is_missing = |stage: &&str| parts.iter().all(|part| part.stage != **stage);
    let own = NAMES.iter().position(|stage| *stage == name)?;
    let missing: Vec<&str> = NAMES[..own].iter().copied().filter(is_missing).collect();
    let model = if before.is_some() { "the model of --from has" } else { "first values (no --from) have" };
    (!missing.is_empty())
        .then(|| format!("{model} no stage {}, which are usually trained before {name}", missing.join(", ")))
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new().of("objects");
    let settings = args.settings()?;
    claim::check(&args.out, args.filling.resume, args.filling.force)?;
    if args.from.is_some() && args.choices.is_given() {
        return Err(Error::input("--from")
            .expected("no --field-axes or --first-values together with it: they belong to first values")
            .got("both"));
    }
    if args.start_share > 0.0 && args.from.is_none() {
        let got = args.start_share.to_string();
        return Err(Error::input("--start-share").expected("0 without --from").got(got));
    }
    let before = args.from.as_deref().map(Model::read).transpose()?;
    let config = match &before {
        Some(model) => model.config,
        None => args.choices.config(args.config.as_deref().unwrap_or("small"))?,
    };
    meter.lap("reading");
    let rendered = BuiltInObjects::new(args.filling.seed);
    let stored = args.data.as_deref().map(|dir| StoredSet::open(dir, &settings.stage)).transpose()?;
    let source: &dyn Source = match &stored {
        Some(stored) => stored,
        None => &rendered,
    };
    if let Some(note) = skipped(&settings.stage.name, before.as_ref()) {
        meter.note(&note);
    }
    let bytes = settings.memory(&config);
    memory::check("lirm train", bytes).map_err(|e| {
        e.hint("--objects-at-once, --gradients-at-once and --recompute lower the estimate, --max-memory raises the limit")
    })?;
    let mut training = Training::new(settings.clone(), config, before.as_ref().map(|m| &m.params), source)?;
    if let Some(part) = before.as_ref().and_then(|m| m.training.last()) {
        begin_after(part, &settings.stage, &mut training, &meter)?;
    }
    if let Some(last) = args.until {
        training.stop_after(last as usize)?;
    }
    meter.note(&format!(
        "{} parameters in {} arrays, {} tokens of a state; {} steps of {} objects; about {}",
        count(training.config()),
        training.params().len(),
        training.config().state_tokens(),
        training.iterations(),
        settings.batch,
        units::bytes(bytes)
    ));
    training.show(&BuiltInObjects::new(args.filling.seed.wrapping_add(1)))?;
    let frame = Frame::claim(&args.out, &args.filling, args.checkpoint_every)?;
    let (history, film) = frame.train(&mut training, &mut meter)?;
    let earlier = before.map_or_else(Vec::new, |m| m.training);
    publish(args, &frame, &training, earlier, (&history, &film), &mut meter)
}

/// Writes the model and its record, and prints the result.
fn publish(
    args: &Args,
    frame: &Frame,
    training: &Training<'_>,
    mut parts: Vec<Part>,
    (history, film): (&History, &Film),
    meter: &mut Meter,
) -> Result<()> {
    parts.push(training.part());
    let model = Model { config: *training.config(), params: training.result(), training: parts }.halved();
    let digest = digest(&model.params);
    let mut settings = training.settings();
    if args.start_share > 0.0 {
        settings["start_share"] = json!(args.start_share);
    }
    if let Some(outcome) = frame.finished(&digest, &settings, history, &[FILE]) {
        return outcome.publish(&frame.dir);
    }
    model.write(&frame.file(FILE), crate::io::safetensors::Precision::Half)?;
    let head = Head { kind: "lirm train", digest: &digest, settings };
    let own = training::entries([("stages", json!(model.stages()))]);
    let record = frame.record(head, own, history, meter)?;
    meter.lap("writing files");
    let tail = &history.loss[history.len() - Ord::min(history.len(), TAIL)..];
    let mean = tail.iter().fold(0.0, |sum, x| sum + f64::from(*x)) / tail.len() as f64;
    let run = Run {
        film: Some(film),
        ..Run::new(&record["settings"], Some(history), meter, &frame.dir, &[FILE, CHECKPOINT, RESULT])
    };
    let page = page(&args.stage, &digest, &run)?;
    let lines = vec![
        format!("loss        {mean:.4}, mean of the last {}", counted(tail.len(), "step")),
        format!("digest      {digest}"),
        format!("time        {}", report::seconds(meter.seconds())),
        format!("model       {}", frame.file(FILE).display()),
    ];
    Outcome { record, page: Some(page), lines, held_out_db: f64::NAN }.publish(&frame.dir)
}
