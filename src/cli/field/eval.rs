//! `field eval`: a field beside the images of a capture.

use super::page::{self, Input};
use super::read;
use crate::fit::field::scores::means;
use crate::fit::field::targets::Pictures;
use crate::fit::field::{Target, score, view};
use crate::fit::render::flat_name;
use crate::fit::training::Watch;
use crate::meter::Meter;
use crate::report::run::Run;
use crate::splat::missing;
use crate::{Error, Result, claim, console as cli};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Score a field on the images of a capture.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight field eval fit object/uniform                  held-out images of the capture that was fitted
  lastlight field eval fit other/uniform --split all --out scores
  lastlight field eval fit object/uniform --min-psnr 30    exit code 1 below 30 dB

Scores: PSNR, SSIM and mean absolute error over white; with passes also the angles of numerical normals and of the normal head, depth, and albedo. Images that a renderer exposed one by one are brought to the exposure of the fit, which result.json beside the field records.")]
pub(crate) struct Args {
    /// Folder of a fit, or a field.safetensors
    #[arg(value_name = "FILE")]
    field: PathBuf,
    /// Folder with transforms.json or a COLMAP model, or the transforms.json itself
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// Which images
    #[arg(long, value_name = "NAME", default_value = "test", value_parser = ["test", "train", "all"])]
    split: String,
    /// Fail below this mean PSNR, in dB
    #[arg(long, value_name = "DB", allow_hyphen_values = true)]
    min_psnr: Option<f64>,
    /// Shrink the images by a whole factor, averaging blocks of pixels
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    downscale: u8,
    /// Accept absolute paths and `..` in the files of a capture; only for files that you trust
    #[arg(long)]
    allow_outside: bool,
    /// Folder for renders and a report; new or empty unless --force
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace what the folder of --out contains
    #[arg(long, requires = "out")]
    force: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let field = read::field(&args.field)?;
    let options = read::options(args.downscale, args.allow_outside);
    let pictures = Pictures::load(&args.capture, &options, read::exposure_of(&args.field))?;
    missing::note(&pictures.views, &meter);
    let targets = pictures.targets(field.placement);
    let which: Vec<&Target> = match args.split.as_str() {
        "test" => targets.test.iter().collect(),
        "train" => targets.train.iter().collect(),
        _ => targets.train.iter().chain(&targets.test).collect(),
    };
    if which.is_empty() {
        return Err(Error::input("--split")
            .at(args.split.as_str())
            .expected("at least one image")
            .got("none"));
    }
    let dir = args.out.as_deref().map(|d| claim::folder(d, false, args.force)).transpose()?;
    meter.lap("reading");
    let cells = view::occupancy(&field)?;
    let mut scored = Vec::with_capacity(which.len());
    for (i, target) in which.iter().enumerate() {
        meter.count(i, which.len(), "scoring");
        scored.push(score(&field, &cells, target)?);
    }
    meter.done();
    meter.lap("rendering and scoring");
    let means = means(&scored);
    let all: Vec<Value> = scored.iter().map(|s| s.json()).collect();
    let record = json!({
        "field": args.field, "capture": args.capture, "split": args.split, "downscale": args.downscale,
        "evaluation": {"mean": means, "views": all},
    });
    if cli::is_json() {
        cli::say_json(&record)?;
    } else {
        cli::say(&page::summary(&means))?;
    }
    if let Some(dir) = dir {
        let names = page::write_renders(&dir, &scored, &flat_name)?;
        let settings = json!({"field": args.field, "capture": args.capture, "split": args.split, "downscale": args.downscale});
        let title = format!("Scores of {} on {}", args.field.display(), crate::shared::name(&args.capture));
        let run = Run::new(&settings, None, &meter, &dir, &names);
        let made = page::page(&Input {
            kind: "field eval",
            title,
            digest: None,
            means: &means,
            scored: &scored,
            run,
        })?;
        meter.note(&format!("report: {}", made.write(&dir)?.display()));
    }
    let mean = means["psnr_db"].as_f64().unwrap_or(f64::INFINITY);
    match args.min_psnr {
        Some(least) if !(mean >= least) => Err(Error::check("field eval")
            .at("mean PSNR")
            .expected(format!("at least {least} dB"))
            .got(format!("{mean:.3} dB"))),
        _ => Ok(()),
    }
}
