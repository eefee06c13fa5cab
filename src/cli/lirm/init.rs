//! `lirm init`: a model with first values.

use crate::choices::{Choices, choices};
use crate::fit::field::place::Pose;
use crate::io::safetensors::Precision;
use crate::meter::Meter;
use crate::{Result, claim, console as cli};
use lastlight_lirm::model::config::{Config, FirstValues};
use lastlight_lirm::model::file::{Model, digest};
use lastlight_lirm::model::params::{count, first};
use serde_json::json;
use std::path::PathBuf;

/// Values of `--config`.
pub(super) const CONFIGS: &Choices = &[
    ("small", "6 blocks of width 256: 5.8 million parameters"),
    ("paper", "24 blocks of width 1024: 326 million parameters"),
];

/// Values of `--field-axes`.
pub(super) const POSES: &Choices = &[
    ("world", "those of the capture"),
    ("azimuth", "z of the capture; the first input camera is above the positive x axis"),
    (
        "upright",
        "z up as it is in the images, for captures with other axes; the first input camera is above the positive x axis",
    ),
    ("first-camera", "those of the first input camera, as published"),
];

/// Values of `--first-values`.
pub(super) const FIRST: &Choices = &[
    ("published", "as in the paper, for a width of 1024 and a long training"),
    ("scaled", "larger in narrow layers and heads, place tokens from their positions: for a short training"),
];

/// Choices of a model that begins.
#[derive(clap::Args)]
pub(super) struct FirstArgs {
    /// Axes of the field [default: those of the configuration]
    #[arg(long, value_name = "NAME", value_parser = choices(POSES))]
    field_axes: Option<String>,
    /// First values of weights and tokens [default: those of the configuration]
    #[arg(long, value_name = "NAME", value_parser = choices(FIRST))]
    first_values: Option<String>,
}

impl FirstArgs {
    /// A configuration with these choices.
    ///
    /// # Errors
    /// If there is none of that name.
    pub(super) fn config(&self, name: &str) -> Result<Config> {
        let named = Config::named(name)?;
        let pose = self.field_axes.as_deref().and_then(Pose::named).unwrap_or(named.pose);
        let first_values =
            self.first_values.as_deref().and_then(FirstValues::named).unwrap_or(named.first_values);
        Ok(Config { pose, first_values, ..named })
    }

    /// Whether there is one.
    pub(super) fn is_given(&self) -> bool {
        self.field_axes.is_some() || self.first_values.is_some()
    }
}

/// Write a LIRM model with first values.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight lirm init --out first.safetensors
  lastlight lirm init --config paper --whole --out paper.safetensors      652 MB

The values are those with which lirm train begins. A field of such a model is about a ball of a tenth of the box; the file is for tests of other implementations: names, shapes and layout of all arrays are those of a trained model.")]
pub(crate) struct Args {
    /// File for the model, .safetensors in half precision
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Sizes of the model
    #[arg(long, value_name = "NAME", default_value = "small", value_parser = choices(CONFIGS))]
    config: String,
    #[command(flatten)]
    choices: FirstArgs,
    /// Whether photos are read, and there are materials and colours that depend on direction
    #[arg(long)]
    whole: bool,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Replace existing results
    #[arg(long)]
    force: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let meter = Meter::new();
    let config = Config { is_whole: args.whole, ..args.choices.config(&args.config)? };
    claim::file(&args.out, args.force)?;
    let model = Model { config, params: first(&config, args.seed), training: Vec::new() }.halved();
    model.write(&args.out, Precision::Half)?;
    let digest = digest(&model.params);
    if cli::is_json() {
        return cli::say_json(&json!({
            "out": args.out, "parameters": count(&config), "arrays": model.params.len(), "digest": digest,
            "configuration": config.json(), "seconds": meter.seconds(),
        }));
    }
    cli::say(&format!(
        "{}: {} parameters in {} arrays, digest {digest}",
        args.out.display(),
        count(&config),
        model.params.len()
    ))
}
