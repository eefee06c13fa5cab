//! `last fit`: an animatable person from a monocular capture.

use super::scoring;
use crate::choices::{Choices, choices};
use crate::console as cli;
use crate::fit::training::{Fit, Watch};
use crate::loss::lpips;
use crate::meter::Meter;
use crate::report::run::Run;
use crate::scene::person::PersonCapture;
use crate::shared::{MetricArgs, Outcome, OutputArgs, SCENE};
use crate::training::{self, CHECKPOINT, Frame, Head, RESULT};
use crate::units::counted;
use crate::{Error, Result};
use crate::{claim, report};
use lastlight_last::avatar::calibrate;
use lastlight_last::avatar::density::{Density, Mode};
use lastlight_last::avatar::evaluate::Evaluation;
use lastlight_last::avatar::fit::PersonFit;
use lastlight_last::avatar::guide::Guide;
use lastlight_last::avatar::progressive::{Cap, Keys, Order, Progressive};
use lastlight_last::avatar::settings::Settings;
use lastlight_last::avatar::{store, view};
use lastlight_last::model::file::Trained;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Values of `--density`.
const DENSITIES: &Choices = &[
    ("replace", "the latent criterion takes the place of the pixel criterion"),
    ("or", "a Gaussian becomes a candidate when either criterion is exceeded"),
    ("budget", "as many candidates as the pixel criterion, chosen by the latent one"),
    ("pixel", "the pixel criterion alone"),
];
/// Values of `--lambda-mode`.
const BOUNDS: &Choices = &[
    ("rel", "relative to the parents' update"),
    ("abs", "absolute"),
    ("stop", "no update beyond the bound"),
];
/// Values of `--order`.
const ORDERS: &Choices = &[
    ("topo", "causes before effects"),
    ("reverse", "effects before causes"),
    ("random", "drawn anew"),
    ("none", "all at once"),
];
/// Values of `--keys`.
const KEYS: &Choices = &[
    ("swap", "counterfactual displacement, as in LAST"),
    ("random", "drawn at random, a control"),
    ("all", "every Gaussian, a control"),
];

/// The avatar in `--out`.
pub(crate) const AVATAR: &str = "avatar.safetensors";

/// Fit an animatable person to a monocular capture.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last fit subject/video --out person                       1 200 iterations
  lastlight last fit subject/video --out person --resume              go on after an interruption, same bits
  lastlight last fit subject/video --out plain --iterations 2000 --sh-degree 1

DIR is a folder in the layout of a person's capture: images, masks, cameras, a body with skinning weights, one pose per moment. Written to --out: avatar.safetensors (body, Gaussians, poses, cameras; the input of `last render` and `last eval`), checkpoint.safetensors, result.json and report/index.html.")]
pub(crate) struct Args {
    /// Folder of the capture
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// Folder for the results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Iterations; the schedule of 1200 is scaled to it
    #[arg(long, value_name = "N", default_value_t = 1200)]
    iterations: usize,
    /// Spherical-harmonics degree of the colours, 0 to 3
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: u8,
    /// Largest number of Gaussians
    #[arg(long, value_name = "N", default_value_t = 8000)]
    max_gaussians: usize,
    /// Weight of 1 - SSIM on the box crop [default: that of the preset]
    #[arg(long, value_name = "X")]
    ssim_weight: Option<f32>,
    /// Losses, rates and schedules
    #[arg(long, value_enum, value_name = "NAME", default_value = "lastlight")]
    preset: Preset,
    /// Learn corrections of the skinning weights
    #[arg(long)]
    weights_network: bool,
    /// Learn corrections of the poses
    #[arg(long)]
    pose_network: bool,
    #[command(flatten)]
    guided: Guided,
    #[command(flatten)]
    perception: MetricArgs,
    /// Iterations between checkpoints
    #[arg(long, value_name = "N", default_value_t = 400, value_parser = clap::value_parser!(u32).range(1..))]
    checkpoint_every: u32,
    #[command(flatten)]
    filling: OutputArgs,
}

/// Guidance by the image-to-point model; without a model the fit is unguided.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct Guided {
    /// Image-to-point model that guides the fit, written by last pretrain (or its folder) or last tune; without it the fit is unguided
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Add Gaussians by the pixel criterion alone
    #[arg(long, requires = "model")]
    pub(crate) no_density_adapter: bool,
    /// Update all Gaussians at once
    #[arg(long, requires = "model")]
    pub(crate) no_progressive: bool,
    /// Criterion of the density adapter
    #[arg(long, value_name = "NAME", default_value = "replace", requires = "model", value_parser = choices(DENSITIES))]
    pub(crate) density: String,
    /// Threshold of the latent criterion
    #[arg(long, value_name = "X", default_value_t = 0.003, requires = "model")]
    pub(crate) tau_rec: f64,
    /// Scale c_τ of the latent gradient before it is compared with the threshold [default: calibrated on the capture]
    #[arg(long, value_name = "X", requires = "model")]
    pub(crate) tau_scale: Option<f64>,
    /// Compute the latent gradient every N iterations
    #[arg(long, value_name = "N", default_value_t = 1, requires = "model")]
    pub(crate) latent_every: usize,
    /// Weight of the latent discrepancy in the loss
    #[arg(long, value_name = "X", default_value_t = 0.0, requires = "model")]
    pub(crate) latent_weight: f32,
    /// Bound λ of the update of child factors; inf: no bound. The paper's 0.1 costs 0.2 to 0.8 dB in training on the built-in subjects
    #[arg(long, value_name = "X", default_value_t = f64::INFINITY, requires = "model")]
    pub(crate) lambda: f64,
    /// Form of the bound
    #[arg(long, value_name = "NAME", default_value = "rel", requires = "model", value_parser = choices(BOUNDS))]
    pub(crate) lambda_mode: String,
    /// Order of the factors
    #[arg(long, value_name = "NAME", default_value = "topo", requires = "model", value_parser = choices(ORDERS))]
    pub(crate) order: String,
    /// How key Gaussians are chosen
    #[arg(long, value_name = "NAME", default_value = "swap", requires = "model", value_parser = choices(KEYS))]
    pub(crate) keys: String,
    /// Fraction of the Gaussians that are key Gaussians of a factor
    #[arg(long, value_name = "X", default_value_t = 0.25, requires = "model")]
    pub(crate) key_share: f64,
}

impl Guided {
    /// What `last fit --model` does by default.
    pub(crate) fn usual() -> Self {
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
    pub(crate) fn calibrate(
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
                Some(scale) => format!("latent threshold scale c_τ = {scale:.6} (calibrated)"),
                None => "latent threshold scale c_τ = 1 (not calibrated: no latent gradient)".into(),
            });
        }
        Ok(())
    }

    /// Applies the options to the settings of a fit that has a model.
    ///
    /// # Errors
    /// When a name is not one of those listed.
    pub(crate) fn apply(&self, settings: &mut Settings) -> Result<()> {
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

/// Named settings of a fit.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Preset {
    /// the project's own
    Lastlight,
    /// as published for GauHuman, as far as implemented: fixed background, no priors for unseen surfaces, no per-frame brightness
    Published,
}

impl Preset {
    fn settings(self) -> Settings {
        match self {
            Self::Lastlight => Settings::baseline(),
            Self::Published => Settings::published(),
        }
    }
}

impl Args {
    /// What the command does without options, on the same capture as the fit with these settings.
    fn usual(fit: &Settings, has_guide: bool) -> Result<Settings> {
        #[derive(clap::Parser)]
        struct Alone {
            #[command(flatten)]
            args: Args,
        }
        let Alone { args } = clap::Parser::parse_from(["last fit", "-", "--out", "-"]);
        let mut usual = args.settings(has_guide)?;
        // Calibrated on the capture.
        usual.density.latent_scale = fit.density.latent_scale;
        Ok(usual)
    }

    fn settings(&self, has_guide: bool) -> Result<Settings> {
        let host = self.preset.settings();
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
    let mut meter = Meter::new();
    let model = args.guided.model.as_deref().map(Trained::of_pictures).transpose()?;
    let mut settings = args.settings(model.is_some())?;
    claim::check(&args.out, args.filling.resume, args.filling.force)?;
    let perception = args.perception.load()?;
    let capture = PersonCapture::open(&args.capture)?;
    meter.lap("reading the capture");
    meter.note(&format!(
        "{}: {}, {} held out, a body of {} points and {} joints",
        args.capture.display(),
        counted(capture.train.len(), "training image"),
        capture.test.len(),
        capture.template.len(),
        capture.template.joints.len()
    ));
    // Held-out images are read after the fit, to score it; what is wrong with one is reported before.
    capture.test.iter().try_for_each(|&i| capture.shots[i].photo().map(drop))?;
    capture.train.iter().chain(&capture.test).try_for_each(|&i| view::check(&capture, &capture.shots[i]))?;
    if let Some(model) = &model {
        check_skeleton(model, &capture, &meter)?;
        super::graph_note::note_empty_graph(model, &meter);
        args.guided.calibrate(&mut settings, &capture, model, &mut meter)?;
    }
    let job = Job {
        kind: "last fit",
        title: format!("Person from the video {}", crate::shared::name(&args.capture)),
        capture: &capture,
        guide: model.as_ref().map(|m| m as &dyn Guide),
        perception: perception.as_ref(),
        defaults: Some(Args::usual(&settings, model.is_some())?.json()),
        settings,
        frame: Frame::claim(&args.out, &args.filling, args.checkpoint_every)?,
    };
    job.run(&mut meter)?.publish(&job.frame.dir)
}

/// Refuses a model of another skeleton than the capture's: the positions that its factors move would be those of another body.
///
/// # Errors
/// When the model records another skeleton.
pub(super) fn check_skeleton(model: &Trained, capture: &PersonCapture, meter: &Meter) -> Result<()> {
    let body = &capture.template;
    match model.is_of(body) {
        Some(true) => Ok(()),
        None => {
            meter.note("the model does not record its skeleton; that of the capture is taken to be the same");
            Ok(())
        }
        Some(false) => Err(Error::input("--model")
            .at("skeleton")
            .expected(format!("that of the capture ({}, {} joints)", body.kind.name(), body.joints.len()))
            .got(format!("another one ({} joints)", model.skeleton.len()))
            .hint("a model fits captures of the skeleton it was trained on; without --model the avatar is fitted without factors")),
    }
}

/// A fit with everything around it: checkpoint, evaluation, files, report. `demo` is one too.
pub(crate) struct Job<'a> {
    pub(crate) kind: &'static str,
    pub(crate) title: String,
    pub(crate) settings: Settings,
    pub(crate) capture: &'a PersonCapture,
    pub(crate) guide: Option<&'a dyn Guide>,
    pub(crate) perception: Option<&'a lpips::Metric>,
    pub(crate) frame: Frame,
    /// settings of the command without options, for the report
    pub(crate) defaults: Option<Value>,
}

impl Job<'_> {
    /// Fits, evaluates, writes all but the report.
    pub(crate) fn run(&self, meter: &mut Meter) -> Result<Outcome> {
        let mut fit = PersonFit::new(self.settings.clone(), self.capture, self.guide)?;
        let (history, film) = self.frame.train(&mut fit, meter)?;
        let (avatar, settings) = (fit.avatar(), Fit::settings(&fit));
        let digest = avatar.digest()?;
        if let Some(outcome) = self.frame.finished(&digest, &settings, &history, &[AVATAR]) {
            return Ok(outcome);
        }
        let groups = scoring::groups(
            Evaluation { perception: self.perception, ..Evaluation::of(avatar, self.capture) },
            meter,
        )?;
        meter.lap("evaluation");
        store::write(&self.frame.file(AVATAR), avatar, self.capture, &settings)?;
        let tally = fit.tally();
        let own = training::entries([
            ("gaussians", json!(avatar.gaussians.len())),
            ("renders", json!(tally.renders)),
            ("encoder_passes", json!(tally.encodings)),
            ("evaluation", scoring::json(&groups)),
        ]);
        let record =
            self.frame.record(Head { kind: self.kind, digest: &digest, settings }, own, &history, meter)?;
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
            run: Run {
                film: Some(&film),
                defaults: self.defaults.clone(),
                ..Run::new(
                    &record["settings"],
                    Some(&history),
                    meter,
                    &self.frame.dir,
                    &[AVATAR, CHECKPOINT, RESULT],
                )
            },
        })?;
        let lines = vec![
            scoring::text(&groups),
            format!("metrics     {}", report::EXPLAINED),
            format!("Gaussians   {}", avatar.gaussians.len()),
            format!("digest      {digest}"),
            format!("time        {}", report::seconds(meter.seconds())),
            format!("avatar      {}", self.frame.file(AVATAR).display()),
        ];
        Ok(Outcome { record, page: Some(page), lines, held_out_db: scoring::held_out_db(&groups) })
    }
}

/// The avatar file of a run: the folder of `last fit`, or the file itself.
pub(super) fn avatar_file(run: &std::path::Path) -> Result<PathBuf> {
    let file = if run.is_dir() { run.join(AVATAR) } else { run.to_path_buf() };
    let is_scene_file = file.extension().is_some_and(|e| e == "ply" || e == "splat");
    if file.is_file() && !is_scene_file {
        return Ok(file);
    }
    let wrong =
        Error::input(run.display().to_string()).expected("a folder of `last fit`, or its avatar.safetensors");
    Err(if file.is_file() || run.join(SCENE).is_file() {
        wrong.got("a scene of `splat fit`").hint("`lastlight splat render` and `splat eval` are for scenes")
    } else {
        wrong
            .got("no such file")
            .hint("an interrupted fit is completed by last fit CAPTURE --out DIR --resume")
    })
}
