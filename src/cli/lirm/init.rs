//! `lirm init`: a model with first values.

use crate::choices::{Choices, choices};
use crate::fit::field::place::Pose;
use crate::io::memory;
use crate::io::safetensors::Precision;
use crate::meter::Meter;
use crate::{Error, Result, claim, console as cli, io};
use lastlight_lirm::model::config::{Config, FirstValues};
use lastlight_lirm::model::file::{Model, digest};
use lastlight_lirm::model::params::{count, first};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Values of `--field-axes`.
pub(super) const POSES: &Choices = &[
    ("world", "those of the capture"),
    ("azimuth", "z of the capture; the first input camera is above the positive x axis"),
    (
        "upright",
        "z up as it is in the images, for captures with other axes; the first input camera is above the positive x axis",
    ),
    ("first-camera", "those of the first input camera, an option of DTC's published code"),
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
    /// A configuration with these choices, by its name or from a file.
    ///
    /// # Errors
    /// If there is neither, or a setting of the file is unknown or out of its range.
    pub(super) fn config(&self, name: &str) -> Result<Config> {
        let named = match name.ends_with(".json") {
            false => Config::named(name)?,
            true => {
                let bytes = io::read_bytes(Path::new(name), io::MAX_SMALL_FILE_BYTES)?;
                Config::of_file(&io::json::parse(&bytes, name)?).map_err(|e| e.within(name.to_owned()))?
            }
        };
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

/// Bytes of a parameter: in single precision, rounded to half precision, as an array of the file, and in it.
const BYTES: u64 = 4 + 4 + 4 + 2;

/// Write a LIRM model with first values.
#[derive(clap::Args)]
#[command(after_help = r#"Examples:
  lastlight lirm init --out first.safetensors
  lastlight lirm init --config paper --whole --out paper.safetensors      652 MB
  echo '{"planes": 3, "plane_tokens": 11}' > tri.json
  lastlight lirm init --config tri.json --out tri.safetensors             three planes instead of six

The values are those with which lirm train begins. The zero level of such a model is about a ball a tenth as wide as the box; the file is for tests of other implementations: names, shapes and layout of all arrays are those of a trained model."#)]
pub(crate) struct Args {
    /// File for the model, .safetensors in half precision
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Configuration: small (6 blocks of width 256, 5.7 million parameters, 5.8 with --whole), paper (24 of width 1024, 326 million), or a .json file with some of the
    /// settings that --json prints; the others are those of small
    #[arg(long, value_name = "FILE|NAME", default_value = "small")]
    config: String,
    #[command(flatten)]
    choices: FirstArgs,
    /// Also read the unmasked photos, and add materials and colours that depend on direction
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
    let named = args.choices.config(&args.config)?;
    let config = Config { is_whole: args.whole || named.is_whole, ..named };
    memory::check("lirm init", BYTES * count(&config) as u64)?;
    if args.out.extension().is_none_or(|ending| ending != "safetensors") {
        return Err(Error::input("--out")
            .expected("a name that ends in .safetensors")
            .got(args.out.display().to_string()));
    }
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
