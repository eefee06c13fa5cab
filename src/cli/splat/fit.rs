//! `splat fit`: Gaussians from the photos of a capture.

use super::capture_args::CaptureArgs;
use super::check;
use super::render_args::RenderArgs;
use crate::choices::{Choices, choices};
use crate::console as cli;
use crate::fit::evaluate::{self, Evaluation, Scored};
use crate::fit::frames;
use crate::fit::render::{Scene, flat_name};
use crate::fit::seeds;
use crate::fit::seeds::Start;
use crate::fit::splat::{MAX_GAUSSIANS, Settings, SplatFit, Strategy};
use crate::fit::survey::Survey;
use crate::fit::training::{Fit, Watch};
use crate::io::{atomic, image_file, memory};
use crate::like::COMMAND;
use crate::meter::Meter;
use crate::report::fit::Photos;
use crate::report::run::Run;
use crate::scene::convert::write_scene;
use crate::scene::gaussians::Gaussians;
use crate::scene::views::Views;
use crate::shared::{Outcome, OutputArgs};
use crate::training::{self, CHECKPOINT, Frame, Head, RESULT};
use crate::units::counted;
use crate::{Error, Result};
use crate::{claim, report};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  lastlight splat fit photos/ --out fox                    7 000 iterations, about 10 minutes on two cores
  lastlight splat fit --out fox --resume                   go on after an interruption, with the same options and bits
  lastlight splat fit photos/ --out fox --iterations 30000 the published schedule
  lastlight splat fit photos/ --out quick --downscale 2 --iterations 2000
  lastlight splat fit colmap/ --out garden --strategy mcmc --max-gaussians 300000

DIR is a folder with transforms.json (NeRF-synthetic, instant-ngp or nerfstudio) or a COLMAP model (sparse/0, binary or text), or such a transforms.json itself. Every 8th photo in file-name order is held out and scored. Lens distortion is removed on load.

--out DIR gets scene.ply, scene.splat, checkpoint.safetensors, result.json, command.json (the options, for --resume), transforms.json (the cameras), images.png (a sheet of the images as they are fitted), held-out renders, and report/index.html.";

/// The Gaussians, in two formats.
const SCENES: [&str; 2] = ["scene.ply", "scene.splat"];
/// The cameras of the images, beside the scene.
const CAMERAS: &str = "transforms.json";

/// Number of random first Gaussians by default.
const INITIAL: usize = 10_000;

/// Held-out PSNR in dB below which the terminal names the hints of the report.
const LOW_DB: f64 = 20.0;

/// Values of `--strategy`.
const STRATEGIES: &Choices = &[
    ("inria", "as the original implementation"),
    ("gsplat", "as gsplat's default strategy"),
    ("gsplat-abs", "as gsplat's, with absolute gradients"),
    ("mcmc", "3DGS as Markov chain Monte Carlo"),
];

/// Fit Gaussians to the photos of a capture.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Folder with transforms.json or a COLMAP model, or the transforms.json itself
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// Folder for the results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Iterations; the schedule of 30000 is scaled to it
    #[arg(long, value_name = "N", default_value_t = 7000)]
    iterations: usize,
    /// First Gaussians: auto (points of the capture, else random), random, or a .ply of points or Gaussians
    #[arg(long, value_name = "FROM", default_value = "auto")]
    init: String,
    /// Number of random first Gaussians [default: 10000, or --max-gaussians if that is less]
    #[arg(long, value_name = "N")]
    initial: Option<usize>,
    /// Box of the scene for random first Gaussians [default: cube around the point the cameras are directed at]
    #[arg(long = "box", value_name = "X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true)]
    bounds: Option<String>,
    /// Spherical-harmonics degree of the colours, 0 to 3
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: u8,
    /// Density control
    #[arg(long, value_name = "NAME", default_value = "inria", value_parser = choices(STRATEGIES))]
    strategy: String,
    /// Largest number of Gaussians [default: one per 60 pixels that show something, 10000 to 1000000; at least those of the start, and half as many again for --init FILE]
    #[arg(long, value_name = "N")]
    max_gaussians: Option<usize>,
    #[command(flatten)]
    input: CaptureArgs,
    #[command(flatten)]
    render: RenderArgs,
    /// Iterations between checkpoints
    #[arg(long, value_name = "N", default_value_t = 500, value_parser = clap::value_parser!(u32).range(1..))]
    checkpoint_every: u32,
    #[command(flatten)]
    filling: OutputArgs,
}

impl Args {
    fn settings(&self) -> Result<Settings> {
        let (render, background) = self.render.settings()?;
        Ok(Settings {
            iterations: self.iterations,
            seed: self.filling.seed,
            sh_degree: usize::from(self.sh_degree),
            strategy: Strategy::parse(&self.strategy)?,
            max_gaussians: self.max_gaussians.unwrap_or(MAX_GAUSSIANS),
            render,
            background,
        })
    }

    /// What the command does without options, on the same capture as the fit with these settings.
    fn usual(most: usize) -> Result<Settings> {
        #[derive(clap::Parser)]
        struct Alone {
            #[command(flatten)]
            args: Args,
        }
        let Alone { args } = clap::Parser::parse_from(["splat fit", "-", "--out", "-"]);
        Ok(Settings { max_gaussians: most, ..args.settings()? })
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let mut settings = args.settings()?;
    let background = settings.background;
    settings.validate()?;
    let bounds = args.bounds.as_deref().map(parse_box).transpose()?;
    claim::check(&args.out, args.filling.resume, args.filling.force)?;
    let views = Views::load(&args.capture, &args.input.options(background))?;
    args.input.note(&views, &meter);
    let determined = Settings::determined(&views, background);
    meter.lap("reading photos");
    meter.note(&format!(
        "{}: {}, {} held out, {}",
        args.capture.display(),
        counted(views.train.len(), "training photo"),
        views.test.len(),
        sizes(&views)
    ));
    let start = start(args, bounds, args.max_gaussians.unwrap_or(determined));
    let first = seeds::gaussians(&start, &views, &settings)?;
    // Before the first file is written.
    let source = match start {
        Start::File(_) => args.init.clone(),
        Start::Auto { .. } => format!("{}: initial Gaussians", args.capture.display()),
        Start::Random { .. } => "initial Gaussians".to_owned(),
    };
    first.validate(&source)?;
    let usual = Settings::limit(determined, first.len(), matches!(start, Start::File(_)));
    settings.max_gaussians = args.max_gaussians.unwrap_or(usual);
    let is_random = match start {
        Start::Auto { .. } => views.starting_points().is_none(),
        Start::Random { .. } => bounds.is_none(),
        Start::File(_) => false,
    };
    check::note(&views, &Survey::of(&views), is_random, &meter);
    check_memory(&settings, &views, &meter)?;
    let job = Job {
        kind: "splat fit",
        title: format!("Scene from the photos {}", crate::shared::name(&args.capture)),
        settings,
        views: &views,
        defaults: Some(Args::usual(usual)?.json()),
        frame: Frame::claim(&args.out, &args.filling, args.checkpoint_every)?,
    };
    // A fit that is resumed has its sheet, and may be refused for other images.
    if !job.frame.is_resumed() {
        check::write_sheet(&views, &job.frame.dir)?;
        meter.note(&format!("sheet of the images: {}", job.frame.file(check::SHEET).display()));
    }
    job.run(first, &mut meter)?.publish(&job.frame.dir)
}

/// Prints an estimate of the fit's memory and time; refuses a fit above the limit.
fn check_memory(settings: &Settings, views: &Views, meter: &Meter) -> Result<()> {
    let estimate = settings.memory_estimate(views);
    let most = report::thousands(settings.max_gaussians);
    meter.note(&format!("memory: about {}, if it comes to {most} Gaussians", report::bytes(estimate)));
    memory::check("splat fit", estimate).map_err(|e| {
        e.hint("--downscale and --max-gaussians lower the estimate, --max-memory raises the limit")
    })
}

fn sizes(views: &Views) -> String {
    let mut all: Vec<(usize, usize)> =
        views.views.iter().map(|v| (v.camera.width, v.camera.height)).collect();
    all.sort_unstable();
    all.dedup();
    match all.as_slice() {
        [(w, h)] => format!("{w}x{h} pixels"),
        other => format!("{} image sizes", other.len()),
    }
}

/// The corners of a box.
///
/// # Errors
/// When the text is not six numbers, or a side is empty.
pub(crate) fn parse_box(text: &str) -> Result<[[f32; 3]; 2]> {
    let wrong =
        || Error::input("--box").expected("x0,y0,z0,x1,y1,z1 with x0 < x1, y0 < y1, z0 < z1").got(text);
    let v: [f32; 6] = super::render_args::numbers(text).ok_or_else(wrong)?.try_into().map_err(|_| wrong())?;
    let corners = [[v[0], v[1], v[2]], [v[3], v[4], v[5]]];
    if (0..3).all(|k| corners[0][k] < corners[1][k]) { Ok(corners) } else { Err(wrong()) }
}

fn start(args: &Args, bounds: Option<[[f32; 3]; 2]>, most: usize) -> Start {
    let count = args.initial.unwrap_or(INITIAL.min(most));
    match args.init.as_str() {
        "auto" => Start::Auto { count, bounds },
        "random" => Start::Random { count, bounds },
        file => Start::File(PathBuf::from(file)),
    }
}

/// A fit with everything around it: checkpoint, evaluation, files, report. `demo` is one too.
pub(crate) struct Job<'a> {
    pub(crate) kind: &'static str,
    pub(crate) title: String,
    pub(crate) settings: Settings,
    pub(crate) views: &'a Views,
    pub(crate) frame: Frame,
    /// settings of the command without options, for the report
    pub(crate) defaults: Option<Value>,
}

impl Job<'_> {
    /// Fits, evaluates, writes all but the report.
    pub(crate) fn run(&self, first: Gaussians, meter: &mut Meter) -> Result<Outcome> {
        let mut fit = SplatFit::new(self.settings.clone(), self.views, first)?;
        let (history, film) = self.frame.train(&mut fit, meter)?;
        let scene_values = fit.gaussians();
        let digest = fit.digest()?;
        if let Some(outcome) = self.frame.finished(&digest, &Fit::settings(&fit), &history, &SCENES) {
            return Ok(outcome);
        }
        let scene = Scene::new(scene_values, self.settings.render.clone(), self.settings.background);
        let scored = score(&scene, self.views, &self.views.test, meter)?;
        let evaluation = Evaluation::of(scored.iter().map(|s| s.score.clone()).collect());
        meter.lap("evaluation");

        let mut names = vec![CHECKPOINT.to_owned(), COMMAND.to_owned()];
        let comments = [format!(
            "lastlight {}, {}, digest {digest}",
            env!("CARGO_PKG_VERSION"),
            counted(history.len(), "iteration")
        )];
        for name in SCENES {
            write_scene(&self.frame.file(name), scene_values, &comments)?;
            names.push(name.to_owned());
        }
        let cameras = format!("{:#}\n", frames::cameras(self.views, "scene.ply"));
        atomic::write_bytes(&self.frame.file(CAMERAS), cameras.as_bytes())?;
        names.extend([CAMERAS, check::SHEET].map(str::to_owned));
        names.extend(write_renders(&self.frame.dir, &scored)?);
        let full = fit.full_since();
        // The demo has no option for it.
        let raised = full.filter(|_| self.kind != "demo");
        let own = training::entries([
            ("gaussians", json!(scene_values.len())),
            ("limit_reached_at", json!(full)),
            ("sh_degree", json!(scene_values.sh_degree)),
            ("images", images(self.views)),
            ("check", Survey::of(self.views).json()),
            ("evaluation", evaluation.json()),
        ]);
        let head = Head { kind: self.kind, digest: &digest, settings: Fit::settings(&fit) };
        let record = self.frame.record(head, own, &history, meter)?;
        names.push(RESULT.to_owned());
        meter.lap("writing files");
        let page = report::fit::page(&report::fit::Input {
            kind: self.kind,
            title: self.title.clone(),
            command: cli::command_line(),
            digest: Some(digest.clone()),
            events: fit.events(),
            n_gauss: scene_values.len(),
            limit: raised.map(|at| limit_text(at, self.settings.max_gaussians)),
            // Those of the demo are built in.
            photos: if self.kind == "demo" {
                Photos::default()
            } else {
                Photos { fitted: Some(self.views.train.len()), ..photos(self.views) }
            },
            scored: &scored,
            evaluation: &evaluation,
            distances: distances(self.views, &self.views.test),
            run: Run {
                film: Some(&film),
                defaults: self.defaults.clone(),
                ..Run::new(&record["settings"], Some(&history), meter, &self.frame.dir, &names)
            },
        })?;
        let scores = if cli::is_quiet() { mean_text(&evaluation) } else { scores_text(&evaluation) };
        let mut lines = vec![scores, format!("Gaussians   {}", scene_values.len())];
        lines.extend(raised.map(|at| format!("limit       {}", limit_text(at, self.settings.max_gaussians))));
        if evaluation.mean_psnr_db < LOW_DB && page.has("hints") {
            let hints = format!("below {LOW_DB:.0} dB: see \"What to try\" in the report");
            lines.push(format!("low score   {hints}"));
        }
        lines.extend([
            format!("digest      {digest}"),
            format!("time        {}", report::seconds(meter.seconds())),
            format!("scene       {}", self.frame.file("scene.ply").display()),
        ]);
        Ok(Outcome { record, page: Some(page), lines, held_out_db: evaluation.mean_psnr_db })
    }
}

/// Number of images by what became of them.
fn images(views: &Views) -> Value {
    json!({"fitted": views.train.len(), "held_out": views.test.len(), "missing": views.missing.len()})
}

/// The same numbers for a report of scores.
pub(super) fn photos(views: &Views) -> Photos {
    Photos {
        fitted: None,
        held_out: views.test.len(),
        listed: views.views.len() + views.missing.len(),
        missing: views.missing.len(),
    }
}

/// That there was no room for more Gaussians, and what makes room.
fn limit_text(at: usize, most: usize) -> String {
    let most = report::thousands(most);
    let when =
        if at == 0 { "from the start".to_owned() } else { format!("at iteration {}", report::thousands(at)) };
    format!("{most} Gaussians, reached {when}; --max-gaussians N raises it")
}

/// Distance of the listed views to the nearest fitted one, see [`report::hints::distances`].
pub(super) fn distances(views: &Views, which: &[usize]) -> Vec<f64> {
    let centers = |which: &[usize]| which.iter().map(|&i| views.views[i].camera.center()).collect::<Vec<_>>();
    report::hints::distances(&centers(&views.train), &centers(which))
}

/// Renders and compares the listed views.
pub(crate) fn score(
    scene: &Scene<'_>,
    views: &Views,
    which: &[usize],
    meter: &mut Meter,
) -> Result<Vec<Scored>> {
    let mut scored = Vec::with_capacity(which.len());
    for (done, &i) in which.iter().enumerate() {
        meter.count(done, which.len(), "scoring");
        scored.push(evaluate::score(scene, &views.views[i])?);
    }
    meter.done();
    Ok(scored)
}

/// The mean scores for the terminal.
fn mean_text(e: &Evaluation) -> String {
    scores_text(e).lines().last().unwrap_or_default().trim_end().to_owned()
}

/// A table of scores for the terminal.
pub(crate) fn scores_text(e: &Evaluation) -> String {
    if e.views.is_empty() {
        return "no score: with a single image nothing is held out".to_owned();
    }
    let width = e.views.iter().map(|v| v.name.chars().count()).fold(4, usize::max);
    let row = |name: &str, psnr: f64, ssim: f64, mae: f64| {
        format!("{name:width$}  {psnr:9.3} dB  {ssim:.4}  {mae:.4}")
    };
    let mut lines = vec![format!("{:width$}  {:>12}  {:6}  {:6}", "view", "PSNR", "SSIM", "MAE")];
    lines.extend(e.views.iter().map(|v| row(&v.name, v.psnr_db, v.ssim, v.mae)));
    lines.push(row("mean", e.mean_psnr_db, e.mean_ssim, e.mean_mae));
    lines.join("\n")
}

/// Held-out renders as `heldout/NAME.png`; gives the names.
pub(crate) fn write_renders(dir: &Path, scored: &[Scored]) -> Result<Vec<String>> {
    let folder = dir.join("heldout");
    std::fs::create_dir_all(&folder).map_err(|e| Error::os(&folder, &e))?;
    let mut names = Vec::new();
    for s in scored {
        let name = format!("heldout/{}.png", flat_name(&s.score.name));
        image_file::write_png(
            &dir.join(&name),
            s.score.width,
            s.score.height,
            3,
            &image_file::to_u8(&s.image)?,
        )?;
        names.push(name);
    }
    Ok(names)
}
