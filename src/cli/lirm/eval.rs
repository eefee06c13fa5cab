//! `lirm eval`: a model on built-in objects that it was not trained on.

use crate::Result;
use crate::choices::{Choices, choices};
use crate::console as cli;
use crate::fit::training::Watch;
use crate::meter::Meter;
use lastlight_lirm::evaluate::{self, Order};
use lastlight_lirm::model::decode::Look;
use lastlight_lirm::model::file::Model;
use lastlight_lirm::model::weights::Ready;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Values of `--light`.
const LIGHTS: &Choices = &[
    ("uniform", "a white dome"),
    ("environment", "an environment map"),
    ("shiny", "the map, and smoother materials"),
];
/// Values of `--input-order`.
const ORDERS: &Choices =
    &[("random", "in a random order"), ("sequential", "around the object: every set shows one side")];

/// Score a LIRM model on built-in objects, after every set of four images.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight lirm eval s1c                                   24 objects of seed 2
  lastlight lirm eval s1c --seed 1 --objects 8              for choices
  lastlight lirm eval s3 --light environment --input-order sequential

Every object has 48 views (lirm gen --cameras test): 16 inputs in four sets, read at 64x64, and 12 outputs, compared at 128x128. Beside the model stand two baselines that know the same foreground: the nearest input image, and the visual hull of the inputs with their mean colours. PSNR in dB over white, means over outputs, then objects.")]
pub(crate) struct Args {
    /// Model, or the folder of a training
    #[arg(value_name = "FILE")]
    model: PathBuf,
    /// Number of objects
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    objects: u32,
    /// Index of the first object
    #[arg(long, value_name = "N", default_value_t = 0)]
    first: u64,
    /// Light
    #[arg(long, value_name = "NAME", default_value = "uniform", value_parser = choices(LIGHTS))]
    light: String,
    /// Order of the inputs
    #[arg(long, value_name = "NAME", default_value = "random", value_parser = choices(ORDERS))]
    input_order: String,
    /// Samples per pixel of the objects' images
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    samples: u32,
    /// Steps of a ray along the diagonal of the box
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(8..=4096))]
    steps: u32,
    /// 1/β, the largest density
    #[arg(long, value_name = "X", default_value_t = 60.0)]
    inverse_beta: f32,
    /// Seed of the objects
    #[arg(long, value_name = "N", default_value_t = 2)]
    seed: u64,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let model = Model::read(&args.model)?;
    let ready = Ready::new(model.config, &model.params);
    let settings = evaluate::settings(args.seed, args.samples);
    let order = if args.input_order == "random" { Order::Random } else { Order::Sequential };
    let look = Look::of_field(args.steps as usize, args.inverse_beta);
    meter.lap("reading");
    let mut all = Vec::new();
    for i in 0..args.objects as usize {
        meter.count(i, args.objects as usize, "scoring");
        all.push(evaluate::object(&ready, &settings, args.first + i as u64, &args.light, order, look)?);
    }
    meter.done();
    let means = evaluate::means(&all);
    let objects: Vec<Value> = all
        .iter()
        .map(|s| json!({ "object": s.object, "psnr_db": s.rounds.iter().map(|r| r.model).collect::<Vec<f64>>() }))
        .collect();
    let record = json!({
        "model": args.model, "stages": model.stages, "light": args.light, "order": args.input_order, "seed": args.seed,
        "rounds": means, "objects": objects,
    });
    if cli::is_json() {
        return cli::say_json(&record);
    }
    let row = |r: &Value| {
        let db = |key: &str| format!("{:8.2}", r[key].as_f64().unwrap_or(f64::NAN));
        format!("{:>6}  {}  {}  {}", r["images"], db("psnr_db"), db("hull_db"), db("nearest_db"))
    };
    let mut lines = vec!["images     model      hull   nearest      PSNR in dB".to_owned()];
    lines.extend(record["rounds"].as_array().into_iter().flatten().map(row));
    cli::say(&lines.join("\n"))
}
