//! `last fit`: an animatable person from a monocular capture.

use super::scoring;
use crate::cli::meter::Meter;
use crate::cli::report::run::Run;
use crate::cli::shared::{Filling, Outcome, Perception};
use crate::cli::{self, claim, report};
use crate::fit::training::{self, Fit, History, Schedule, Watch};
use crate::io::atomic;
use crate::last::host::calibrate;
use crate::last::host::density::{Density, Mode};
use crate::last::host::evaluate::Evaluation;
use crate::last::host::fit::PersonFit;
use crate::last::host::guide::Guide;
use crate::last::host::progressive::{Cap, Keys, Order, Progressive};
use crate::last::host::settings::Settings;
use crate::last::host::store;
use crate::last::model::file::Trained;
use crate::loss::lpips;
use crate::scene::person::PersonCapture;
use crate::{Error, Result};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Fit an animatable person to a monocular capture.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last fit subject/video --out person                       1 200 iterations
  lastlight last fit subject/video --out person --resume              go on after an interruption, same bits
  lastlight last fit subject/video --out plain --iterations 2000 --sh-degree 1

CAPTURE is a folder in the layout of a person's capture: pictures, masks, cameras, a body with skinning
weights, one pose per moment. --out DIR gets avatar.safetensors (body, Gaussians, poses, cameras; what
`last render` and `last eval` read), checkpoint.safetensors, result.json and report/index.html.")]
pub(in crate::cli) struct Args {
    /// Folder of the capture
    #[arg(value_name = "CAPTURE")]
    capture: PathBuf,
    /// Folder for the results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Iterations; the schedule of 1200 is scaled to it
    #[arg(long, value_name = "N", default_value_t = 1200)]
    iterations: usize,
    /// Spherical-harmonics degree of the colours, 0 to 3
    #[arg(long, value_name = "D", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=3), help_heading = "Host")]
    sh_degree: u8,
    /// Largest number of Gaussians
    #[arg(long, value_name = "N", default_value_t = 8000, help_heading = "Host")]
    max_gaussians: usize,
    /// Weight of 1 - SSIM on the box crop [default: that of the host]
    #[arg(long, value_name = "W", help_heading = "Host")]
    ssim_weight: Option<f32>,
    /// Losses, rates and schedules of the published host: one background, no assumptions about the hidden side, no gains
    #[arg(long, help_heading = "Host")]
    published: bool,
    /// Learn corrections of the skinning weights
    #[arg(long, help_heading = "Host")]
    weights_network: bool,
    /// Learn corrections of the poses
    #[arg(long, help_heading = "Host")]
    pose_network: bool,
    #[command(flatten)]
    guided: Guided,
    #[command(flatten)]
    perception: Perception,
    /// Iterations between checkpoints
    #[arg(long, value_name = "N", default_value_t = 400, value_parser = clap::value_parser!(u32).range(1..))]
    checkpoint_every: u32,
    #[command(flatten)]
    filling: Filling,
}

/// What the image-to-point model decides. Without a model there is the host alone.
#[derive(clap::Args, Clone, Debug)]
pub(in crate::cli) struct Guided {
    /// Image-to-point model that guides the fit, written by last pretrain or last tune; without one the host fits alone
    #[arg(long, value_name = "FILE", help_heading = "Guidance")]
    model: Option<PathBuf>,
    /// Add Gaussians by the host's pixel criterion
    #[arg(long, requires = "model", help_heading = "Guidance")]
    pub(in crate::cli) no_density_adapter: bool,
    /// Update all Gaussians at once
    #[arg(long, requires = "model", help_heading = "Guidance")]
    pub(in crate::cli) no_progressive: bool,
    /// Criterion of the density adapter: replace, or, budget
    #[arg(
        long,
        value_name = "MODE",
        default_value = "replace",
        requires = "model",
        help_heading = "Guidance"
    )]
    pub(in crate::cli) density: String,
    /// Threshold of the latent criterion
    #[arg(long, value_name = "T", default_value_t = 0.003, requires = "model", help_heading = "Guidance")]
    pub(in crate::cli) tau_rec: f64,
    /// What the latent gradient is multiplied by before that [default: found by a calibration on the capture]
    #[arg(long, value_name = "C", requires = "model", help_heading = "Guidance")]
    pub(in crate::cli) tau_scale: Option<f64>,
    /// Iterations from one latent gradient to the next
    #[arg(long, value_name = "N", default_value_t = 1, requires = "model", help_heading = "Guidance")]
    pub(in crate::cli) latent_every: usize,
    /// Weight of the latent discrepancy in the loss
    #[arg(long, value_name = "W", default_value_t = 0.0, requires = "model", help_heading = "Guidance")]
    pub(in crate::cli) latent_weight: f32,
    /// Bound of the steps of child factors; inf binds nothing. The paper's 0.1 costs 0.2 to 0.8 dB in training on the built-in subjects
    #[arg(long, value_name = "L", default_value_t = f64::INFINITY, requires = "model", help_heading = "Guidance")]
    pub(in crate::cli) lambda: f64,
    /// What it bounds: rel, abs or stop
    #[arg(long, value_name = "MODE", default_value = "rel", requires = "model", help_heading = "Guidance")]
    pub(in crate::cli) lambda_mode: String,
    /// Order of the factors: topo, reverse, random or none
    #[arg(long, value_name = "ORDER", default_value = "topo", requires = "model", help_heading = "Guidance")]
    pub(in crate::cli) order: String,
    /// Key Gaussians: swap, random or all
    #[arg(long, value_name = "HOW", default_value = "swap", requires = "model", help_heading = "Guidance")]
    pub(in crate::cli) keys: String,
    /// Share of the Gaussians that are key to a factor
    #[arg(long, value_name = "Q", default_value_t = 0.25, requires = "model", help_heading = "Guidance")]
    pub(in crate::cli) key_share: f64,
}

impl Guided {
    /// What `last fit --model` does unless told otherwise.
    pub(in crate::cli) fn usual() -> Self {
        #[derive(clap::Parser)]
        struct Alone {
            #[command(flatten)]
            guided: Guided,
        }
        <Alone as clap::Parser>::parse_from(["last fit"]).guided
    }

    /// Finds the scale of the latent criterion where the settings depend on it and none was given; it is part of the record of the run.
    ///
    /// # Errors
    /// What the calibration reports.
    pub(in crate::cli) fn calibrate(
        &self,
        settings: &mut Settings,
        capture: &PersonCapture,
        guide: &dyn Guide,
        meter: &mut Meter,
    ) -> Result<()> {
        if self.tau_scale.is_none() && matches!(settings.density.mode, Mode::Replace | Mode::Or) {
            let found = calibrate::latent_scale(settings, capture, guide, &mut ())?;
            meter.lap("calibration");
            settings.density.latent_scale = found.unwrap_or(1.0);
            meter.note(&match found {
                Some(scale) => format!("latent criterion times {scale:.6}"),
                None => "nothing to calibrate the latent criterion by: it is taken as it is".into(),
            });
        }
        Ok(())
    }

    /// Puts what was asked for into the settings of a fit that has a model.
    ///
    /// # Errors
    /// When a name is not one of those listed.
    pub(in crate::cli) fn apply(&self, settings: &mut Settings) -> Result<()> {
        let mode = Mode::parse(&self.density)?;
        let progressive = Progressive {
            lambda: self.lambda,
            cap: Cap::parse(&self.lambda_mode)?,
            order: Order::parse(&self.order)?,
            keys: Keys::parse(&self.keys)?,
            share: self.key_share,
            ..Progressive::published()
        };
        settings.density = Density {
            mode: if self.no_density_adapter { Mode::Pixel } else { mode },
            latent_threshold: self.tau_rec,
            latent_scale: self.tau_scale.unwrap_or(1.0),
            latent_every: self.latent_every,
            ..settings.density.clone()
        };
        settings.progressive = (!self.no_progressive).then_some(progressive);
        settings.latent_weight = self.latent_weight;
        Ok(())
    }
}

impl Args {
    fn settings(&self, has_guide: bool) -> Result<Settings> {
        let host = if self.published { Settings::published() } else { Settings::host() };
        let mut settings = Settings {
            iterations: self.iterations,
            seed: self.filling.seed,
            sh_degree: usize::from(self.sh_degree),
            max_gaussians: self.max_gaussians,
            ssim_weight: self.ssim_weight.unwrap_or(host.ssim_weight),
            weights_network: self.weights_network,
            pose_network: self.pose_network,
            ..host
        };
        if has_guide {
            self.guided.apply(&mut settings)?;
        }
        settings.validate()?;
        Ok(settings)
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new(args.filling.quiet);
    let model = args.guided.model.as_deref().map(Trained::of_pictures).transpose()?;
    let mut settings = args.settings(model.is_some())?;
    claim::check(&args.out, args.filling.resume, args.filling.force)?;
    let perception = args.perception.load(&meter)?;
    let capture = PersonCapture::open(&args.capture)?;
    meter.lap("reading the capture");
    meter.note(&format!(
        "{}: {} pictures to fit, {} held out, a body of {} points and {} joints",
        args.capture.display(),
        capture.train.len(),
        capture.test.len(),
        capture.template.len(),
        capture.template.joints.len()
    ));
    if let Some(model) = &model {
        args.guided.calibrate(&mut settings, &capture, model, &mut meter)?;
    }
    let job = Job {
        kind: "last fit",
        title: scoring::title(&args.capture),
        settings,
        capture: &capture,
        guide: model.as_ref().map(|m| m as &dyn Guide),
        perception: perception.as_ref(),
        dir: claim::folder(&args.out, args.filling.resume, args.filling.force)?,
        checkpoint_every: args.checkpoint_every as usize,
        resume: args.filling.resume,
    };
    job.run(&mut meter)?.publish(&job.dir, args.filling.json)
}

/// A fit with everything around it: checkpoint, evaluation, files, report. `demo` is one too.
pub(in crate::cli) struct Job<'a> {
    pub(in crate::cli) kind: &'static str,
    pub(in crate::cli) title: String,
    pub(in crate::cli) settings: Settings,
    pub(in crate::cli) capture: &'a PersonCapture,
    pub(in crate::cli) guide: Option<&'a dyn Guide>,
    pub(in crate::cli) perception: Option<&'a lpips::Metric>,
    pub(in crate::cli) dir: PathBuf,
    pub(in crate::cli) checkpoint_every: usize,
    pub(in crate::cli) resume: bool,
}

impl Job<'_> {
    /// Fits, evaluates, writes all but the report.
    pub(in crate::cli) fn run(&self, meter: &mut Meter) -> Result<Outcome> {
        let mut fit = PersonFit::new(self.settings.clone(), self.capture, self.guide)?;
        let checkpoint = self.dir.join("checkpoint.safetensors");
        let mut history = History::default();
        if self.resume {
            if checkpoint.exists() {
                history = training::resume(&mut fit, &checkpoint)?;
                meter.note(&format!("resuming after iteration {} of {}", history.len(), fit.iterations()));
            } else {
                meter.note("no checkpoint yet: starting at iteration 0");
            }
        }
        cli::stoppable(|stop| {
            let schedule = Schedule { checkpoint: Some(&checkpoint), every: self.checkpoint_every, stop };
            training::run(&mut fit, &mut history, schedule, meter)
        })?;
        meter.done();
        let (avatar, settings) = (fit.avatar(), Fit::settings(&fit));
        let digest = avatar.digest()?;
        let groups = scoring::groups(
            Evaluation { perception: self.perception, ..Evaluation::of(avatar, self.capture) },
            meter,
        )?;
        meter.lap("evaluation");
        store::write(&self.dir.join("avatar.safetensors"), avatar, self.capture, &settings)?;
        let time: serde_json::Map<String, Value> =
            meter.parts().into_iter().map(|(n, s)| (n, json!(s))).collect();
        let tally = fit.tally();
        let record = json!({
            "kind": self.kind, "lastlight": env!("CARGO_PKG_VERSION"), "digest": digest,
            "gaussians": avatar.gaussians.len(), "iterations": history.len(), "renders": tally.renders,
            "encoder_passes": tally.encodings, "last_loss": history.loss.last(),
            "evaluation": scoring::json(&groups), "settings": settings,
            "seconds": meter.seconds(), "seconds_by_part": time,
        });
        atomic::write_bytes(&self.dir.join("result.json"), format!("{record:#}\n").as_bytes())?;
        meter.lap("writing files");
        let page = report::person::page(&report::person::Input {
            kind: self.kind,
            title: self.title.clone(),
            command: cli::command_line(),
            digest: digest.clone(),
            events: fit.events(),
            tally: Some(tally),
            n_gauss: avatar.gaussians.len(),
            groups: &groups,
            run: Run::new(
                &record["settings"],
                Some(&history),
                meter,
                &self.dir,
                &["avatar.safetensors", "checkpoint.safetensors", "result.json"],
            ),
        })?;
        let lines = vec![
            scoring::text(&groups),
            format!("Gaussians   {}", avatar.gaussians.len()),
            format!("digest      {digest}"),
            format!("time        {}", report::seconds(meter.seconds())),
            format!("avatar      {}", self.dir.join("avatar.safetensors").display()),
        ];
        Ok(Outcome { record, page, lines, held_out_db: scoring::held_out_db(&groups) })
    }
}

/// The avatar file of a run: the folder of `last fit`, or the file itself.
pub(super) fn avatar_file(run: &std::path::Path) -> Result<PathBuf> {
    let file = if run.is_dir() { run.join("avatar.safetensors") } else { run.to_path_buf() };
    if file.is_file() {
        return Ok(file);
    }
    Err(Error::input(run.display().to_string())
        .expected("a folder of `last fit`, or its avatar.safetensors")
        .got("no such file")
        .hint("an interrupted fit is completed by last fit CAPTURE --out DIR --resume"))
}
