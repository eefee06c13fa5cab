//! `lirm init`: a model with first values.

use crate::choices::{Choices, choices};
use crate::io::safetensors::Precision;
use crate::meter::Meter;
use crate::{Result, claim, console as cli};
use lastlight_lirm::model::config::Config;
use lastlight_lirm::model::file::{Model, digest};
use lastlight_lirm::model::params::{count, first};
use serde_json::json;
use std::path::PathBuf;

/// Values of `--config`.
pub(super) const CONFIGS: &Choices = &[
    ("small", "6 blocks of width 256: 5.8 million parameters"),
    ("paper", "24 blocks of width 1024: 326 million parameters"),
];

/// Write a LIRM model with first values.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight lirm init --out first.safetensors
  lastlight lirm init --config paper --whole --out paper.safetensors      652 MB

The values are those with which lirm train begins. A field of such a model is a ball of a tenth of the box; the file is for tests of other implementations: names, shapes and layout of all arrays are those of a trained model.")]
pub(crate) struct Args {
    /// File for the model, .safetensors in half precision
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Sizes of the model
    #[arg(long, value_name = "NAME", default_value = "small", value_parser = choices(CONFIGS))]
    config: String,
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
    let config = Config { is_whole: args.whole, ..Config::named(&args.config)? };
    claim::file(&args.out, args.force)?;
    let model = Model { config, params: first(&config, args.seed), stages: Vec::new() }.halved();
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
