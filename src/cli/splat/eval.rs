//! `splat eval`: scores of a scene file on the photos of a capture.

use super::capture_args::CaptureArgs;
use super::fit::{score, scores_text, write_renders};
use super::render::scene_file;
use super::render_args::RenderArgs;
use crate::choices::{Choices, choices};
use crate::console as cli;
use crate::fit::evaluate::{Evaluation, Scored};
use crate::fit::render::{self, Scene};
use crate::fit::training::Watch;
use crate::loss::metric::rfd;
use crate::loss::{self, lpips};
use crate::meter::Meter;
use crate::num::sum;
use crate::report::run::Run;
use crate::scene::views::Views;
use crate::shared::{MetricArgs, SceneArgs, note_missing_weights};
use crate::{Error, Result};
use crate::{claim, report};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Values of `--split`.
const SPLITS: &Choices =
    &[("test", "held-out images, every 8th"), ("train", "fitted images"), ("all", "both")];

/// Score a scene file on the photos of a capture.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight splat eval fox/scene.ply photos/
  lastlight splat eval fox/scene.ply photos/ --split all --json
  lastlight splat eval theirs.ply photos/ --profile inria --out theirs --min-psnr 25
  lastlight splat eval fox/scene.ply photos/ --lpips lpips_vgg.safetensors

With --min-psnr the command is a check: exit code 1 when the mean is lower.")]
pub(crate) struct Args {
    /// Scene: .ply, .splat or .npz, or the folder of a fit
    #[arg(value_name = "FILE")]
    scene: PathBuf,
    /// Folder with transforms.json or a COLMAP model, or the transforms.json itself
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// Part of the images to score
    #[arg(long, value_name = "NAME", default_value = "test", value_parser = choices(SPLITS))]
    split: String,
    #[command(flatten)]
    input: CaptureArgs,
    /// Fail when the mean PSNR is below this many decibels
    #[arg(long, value_name = "DB")]
    min_psnr: Option<f64>,
    #[command(flatten)]
    perception: MetricArgs,
    /// Folder for renders and report/index.html
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace existing results
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    reading: SceneArgs,
    #[command(flatten)]
    render: RenderArgs,
}

/// LPIPS of every view that was scored, or its surrogate.
fn perceived(
    views: &Views,
    which: &[usize],
    scored: &[Scored],
    metric: Option<&lpips::Metric>,
) -> Result<Vec<f64>> {
    let one = |(&at, s): (&usize, &Scored)| {
        let mask = views.views[at].mask.as_ref();
        let mask = mask.map(|m| m.iter().map(|&b| f32::from(b)).collect::<Vec<f32>>());
        let (height, width) = (s.score.height, s.score.width);
        let x = loss::In { x: &s.image, y: &s.photo, mask: mask.as_deref(), height, width };
        let value = metric.map_or_else(|| rfd::forward(&x), |metric| metric.score(&x));
        value.map_err(|e| e.within(s.score.name.clone()))
    };
    which.iter().zip(scored).map(one).collect()
}

/// Notes that the scene was fitted to images of another size than those that it is scored on.
fn note_other_size(scene: &Path, views: &Views, downscale: u8, meter: &Meter) -> Result<()> {
    let fitted: Vec<[usize; 2]> =
        render::fitted_cameras(scene)?.iter().map(|c| [c.width, c.height]).collect();
    let scored: Vec<[usize; 2]> = views.views.iter().map(|v| [v.camera.width, v.camera.height]).collect();
    let (Some(&[fw, fh]), Some(&[w, h])) = (fitted.first(), scored.first()) else { return Ok(()) };
    if scored.iter().any(|size| fitted.contains(size)) {
        return Ok(());
    }
    // Of the images as they are.
    let full = [w, h].map(|side| side * usize::from(downscale));
    let same = (1..=16).find(|n| [full[0] / n, full[1] / n] == [fw, fh]);
    let advice =
        same.map_or(String::new(), |n| format!("; --downscale {n} scores it at the size of the fit"));
    meter.note(&format!(
        "the scene was fitted to images of {fw}x{fh} pixels, and is scored at {w}x{h}{advice}"
    ));
    Ok(())
}

fn mean(values: &[f64]) -> f64 {
    sum::tree_f64(values) / values.len() as f64
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let (settings, background) = args.render.settings()?;
    let stored = args.reading.read(&scene_file(&args.scene)?, &meter)?;
    let views = Views::load(&args.capture, &args.input.options(background))?;
    args.input.note(&views, &meter);
    note_other_size(&scene_file(&args.scene)?, &views, args.input.downscale, &meter)?;
    let which: Vec<usize> = match args.split.as_str() {
        "test" => views.test.clone(),
        "train" => views.train.clone(),
        _ => (0..views.views.len()).collect(),
    };
    if which.is_empty() {
        return Err(Error::input("--split")
            .at(args.split.as_str())
            .expected("at least one photo")
            .got("none"));
    }
    let dir = args.out.as_deref().map(|d| claim::folder(d, false, args.force)).transpose()?;
    let metric = args.perception.load()?;
    meter.lap("reading");
    let scene = Scene::new(&stored, settings, background);
    let scored = score(&scene, &views, &which, &mut meter)?;
    let evaluation = Evaluation::of(scored.iter().map(|s| s.score.clone()).collect());
    let perceived = perceived(&views, &which, &scored, metric.as_ref())?;
    let name = metric.as_ref().map_or(rfd::NAME, |metric| metric.names()[0]);
    meter.lap("rendering and scoring");
    let record = json!({
        "scene": args.scene, "capture": args.capture, "split": args.split, "gaussians": stored.len(),
        "profile": args.render.profile, "downscale": args.input.downscale, "evaluation": evaluation.json(),
        "perception": {"name": name, "mean": mean(&perceived), "views": perceived},
    });
    if cli::is_json() {
        cli::say_json(&record)?;
    } else {
        cli::say(&scores_text(&evaluation))?;
        cli::say(&format!("{name} {:.4}, mean over views", mean(&perceived)))?;
    }
    note_missing_weights(metric.as_ref(), &meter);
    if let Some(dir) = dir {
        let names = write_renders(&dir, &scored)?;
        let settings = json!({"scene": args.scene, "capture": args.capture, "split": args.split,
            "profile": args.render.profile, "background": background, "downscale": args.input.downscale});
        let page = report::fit::page(&report::fit::Input {
            kind: "splat eval",
            title: format!(
                "Scores of {} on the photos {}",
                args.scene.display(),
                crate::shared::name(&args.capture)
            ),
            command: cli::command_line(),
            digest: None,
            events: &[],
            n_gauss: stored.len(),
            limit: None,
            photos: super::fit::photos(&views),
            scored: &scored,
            distances: if args.split == "test" { super::fit::distances(&views, &which) } else { Vec::new() },
            evaluation: &evaluation,
            run: Run::new(&settings, None, &meter, &dir, &names),
        })?;
        let path = page.write(&dir)?;
        meter.note(&format!("report: {}", path.display()));
    }
    let is_good = args.min_psnr.is_none_or(|least| evaluation.mean_psnr_db >= least);
    match args.min_psnr {
        Some(least) if !is_good => Err(Error::check("splat eval")
            .at("mean PSNR")
            .expected(format!("at least {least} dB"))
            .got(format!("{:.3} dB", evaluation.mean_psnr_db))),
        _ => Ok(()),
    }
}
