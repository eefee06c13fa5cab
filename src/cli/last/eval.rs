//! `last eval`: scores of an avatar on the images of a capture.

use super::{fit, scoring};
use crate::console as cli;
use crate::fit::training::Watch;
use crate::meter::Meter;
use crate::report::run::Run;
use crate::scene::person::PersonCapture;
use crate::shared::{ForceArgs, MetricArgs, note_missing_weights};
use crate::{Error, Result};
use crate::{claim, report};
use lastlight_last::avatar::evaluate::Evaluation;
use lastlight_last::avatar::store;
use serde_json::json;
use std::path::PathBuf;

/// Score a fitted person on the images of a capture.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last eval person subject/video
  lastlight last eval person subject/video --json
  lastlight last eval person subject/video --min-psnr 24 --out scores
  lastlight last eval person subject/video --lpips lpips_vgg.safetensors

Every metric is named by its variant; PSNR-box counts the pixels of the projected box of the body. The surrogate RFD is not LPIPS. With --min-psnr the command is a check: exit code 1 when the mean PSNR-box of the held-out images is lower.")]
pub(crate) struct Args {
    /// Folder of `last fit`, or an avatar.safetensors
    #[arg(value_name = "DIR")]
    run: PathBuf,
    /// Folder of the capture
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// Fail when the mean PSNR-box of held-out images is below this many decibels
    #[arg(long, value_name = "DB")]
    min_psnr: Option<f64>,
    #[command(flatten)]
    perception: MetricArgs,
    /// Folder for report/index.html
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    replace: ForceArgs,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let stored = store::read(&fit::avatar_file(&args.run)?)?;
    let capture = PersonCapture::open(&args.capture)?;
    if args.min_psnr.is_some() && capture.test.is_empty() {
        return Err(Error::input("--min-psnr")
            .at(args.capture.display().to_string())
            .expected("a capture with held-out images")
            .got("none"));
    }
    let dir = args.out.as_deref().map(|d| claim::folder(d, false, args.replace.force)).transpose()?;
    let perception = args.perception.load()?;
    meter.lap("reading");
    let of = Evaluation {
        learned_at: Some(&stored.poses),
        perception: perception.as_ref(),
        ..Evaluation::of(&stored.avatar, &capture)
    };
    let groups = scoring::groups(of, &mut meter)?;
    meter.lap("rendering and scoring");
    let digest = stored.avatar.digest()?;
    if cli::is_json() {
        cli::say_json(&json!({
            "run": args.run, "capture": args.capture, "digest": digest,
            "gaussians": stored.avatar.gaussians.len(), "evaluation": scoring::json(&groups),
        }))?;
    } else {
        cli::say(&scoring::text(&groups))?;
        let place = if dir.is_some() { "" } else { " that --out DIR writes" };
        cli::say(&format!("metrics     {}{place}", report::EXPLAINED))?;
    }
    note_missing_weights(perception.as_ref(), &meter);
    if let Some(dir) = dir {
        let page = report::person::page(&report::person::Input {
            kind: "last eval",
            title: format!(
                "Scores of the person {} on {}",
                args.run.display(),
                crate::shared::name(&args.capture)
            ),
            command: cli::command_line(),
            digest,
            events: &[],
            tally: None,
            n_gauss: stored.avatar.gaussians.len(),
            groups: &groups,
            run: Run::new::<&str>(&stored.settings, None, &meter, &dir, &[]),
        })?;
        meter.note(&format!("report: {}", page.write(&dir)?.display()));
    }
    let held_out = scoring::held_out_db(&groups);
    match args.min_psnr {
        Some(least) if !(held_out >= least) => Err(Error::check("last eval")
            .at("mean PSNR-box")
            .expected(format!("at least {least} dB"))
            .got(format!("{held_out:.3} dB"))),
        _ => Ok(()),
    }
}
