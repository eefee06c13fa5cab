//! `last gen`: the figure's data sets.

use crate::Result;
use crate::choices::{self, Choices, Known, PASSES, choices};
use crate::claim;
use crate::console as cli;
use crate::fit::passes::PassSet;
use crate::meter::Meter;
use crate::shared::OutputArgs;
use lastlight_last::character::CharacterSettings;
use lastlight_last::figure::Rendering;
use lastlight_last::generate::{self, BASES, RECORD, Report, Settings};
use std::path::PathBuf;

/// Values of `--split`.
const SPLITS: &Choices = &[
    ("video", "frames of one person from several cameras"),
    ("observational", "images of many persons, factors drawn from the graph"),
    ("interventions", "groups of images that share an intervention"),
    ("training", "observational and interventions"),
    ("all", "everything"),
];
/// Values of `--equations`.
const EQUATIONS: &Choices = &[
    ("LIN", "linear, Gaussian noise"),
    ("NL", "nonlinear, Gaussian noise"),
    ("NG", "linear, uniform noise"),
    ("NL-NG", "nonlinear, uniform noise"),
];
/// Values of `--scale`.
const SCALES: &Choices = &[("full", "minutes"), ("smoke", "seconds: a test that everything runs")];
/// Values of `--render-as`.
const RENDERINGS: &Choices = &[
    ("mesh", "path-traced surface"),
    ("points", "discs at the points"),
    ("splats", "Gaussians at the points"),
];
/// Values of `--graph`, beside ER-m.
const GRAPHS: &Choices = &[
    ("FORK", "P>W P>O"),
    ("CHAIN", "P>W>O>L"),
    ("COLLIDER", "P>W<O"),
    ("DIAMOND", "P>W P>O W>L O>L"),
    ("FULL", "every edge from an earlier factor to a later one"),
    ("EMPTY", "no edge"),
];

/// Whether a graph is one with a number of random edges: ER-m.
fn is_random(graph: &str) -> bool {
    graph.strip_prefix("ER-").is_some_and(|edges| edges.parse::<usize>().is_ok())
}

/// Make images, points and a video of a person whose causes are known.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last gen --out data                              video, observational and intervention sets
  lastlight last gen --split video --out subject --video-size 128
  lastlight last gen --split interventions --graph ER-6 --factors 6 --mechanism LIN --out six
  lastlight last gen --scale smoke --out small             seconds instead of minutes
  lastlight last gen --character Knight.glb --animation Walking_A --out knight     a video of another character
  lastlight last gen --character Knight.glb --animation Walking_A --split all --out knight    also the sets for last pretrain

Graphs over posture P, self-occlusion O, wrinkles W, light L (more factors: body width B, skirt length S, hue H, head yaw Y): FORK P>W P>O, CHAIN P>W>O>L, COLLIDER P>W<O, DIAMOND P>W P>O W>L O>L, FULL, EMPTY, and ER-m with m random edges. --out gets dataset.json with the graph, the coefficients and a digest of every file; the same settings give the same bytes for any number of threads. Varsortability and R2-sortability measure how much of the causal order can be read off variances, or off how well the other factors explain one: 0.5 none, 1 all.")]
pub(crate) struct Args {
    /// Folder for the data; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Part of the data [default with --character: video]
    #[arg(
        long,
        value_name = "NAME",
        default_value = "all",
        default_value_if("character", clap::builder::ArgPredicate::IsPresent, "video"),
        value_parser = choices(SPLITS)
    )]
    split: String,
    /// Causal graph: FORK, CHAIN, COLLIDER, DIAMOND, FULL, EMPTY or ER-m
    #[arg(long, value_name = "NAME", default_value = "FORK", value_parser = Known { names: GRAPHS, accepts: is_random })]
    graph: String,
    /// Number of factors, 2 to 8
    #[arg(long, value_name = "N", default_value_t = 4)]
    factors: usize,
    /// Form of the equations
    #[arg(long, value_name = "NAME", default_value = "NL", value_parser = choices(EQUATIONS))]
    equations: String,
    /// Do not rescale factors to unit variance
    #[arg(long)]
    no_standardize: bool,
    /// Sizes
    #[arg(long, value_name = "NAME", default_value = "full", value_parser = choices(SCALES))]
    scale: String,
    /// Number of observational images [default: 2048; smoke 128]
    #[arg(long, value_name = "N")]
    observational: Option<usize>,
    /// Number of intervention groups of eight bases [default: 256; smoke 16]
    #[arg(long, value_name = "N")]
    groups: Option<usize>,
    /// Different persons in the sets [default: 64; smoke 8; a character 1]
    #[arg(long, value_name = "N")]
    appearances: Option<usize>,
    /// Points of the template [default: 2048; smoke 1024]
    #[arg(long, value_name = "N")]
    body_points: Option<usize>,
    /// Frames of the video [default: 100; smoke 20]
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
    /// Test cameras of the video, 1 to 22 [default: 22; smoke 4]
    #[arg(long, value_name = "N")]
    test_cameras: Option<usize>,
    /// Index of the person in the video
    #[arg(long, value_name = "N", default_value_t = 0)]
    subject: u64,
    /// A character instead of the built-in figure: .gltf, .glb, or the folder of the open body
    #[arg(long, value_name = "FILE")]
    character: Option<PathBuf>,
    /// Animations that the posture factor blends: one (two opposite moments are blended) or two (blended with each other), comma-separated or repeated; a file's animations are listed when it has no such name
    #[arg(long, value_name = "NAME", requires = "character", value_delimiter = ',')]
    animation: Vec<String>,
    /// Joint bent by the self-occlusion factor [default: found by name, right side first]
    #[arg(long, value_name = "NAME", requires = "character")]
    elbow: Option<String>,
    /// Nodes or meshes to leave out, comma-separated or repeated
    #[arg(long, value_name = "NAME", requires = "character", value_delimiter = ',')]
    hide: Vec<String>,
    /// Also play the animation over the video, one loop (posture then also depends on time)
    #[arg(long, requires = "character")]
    animate: bool,
    /// How everything is rendered [default: mesh for the video, points for the sets]
    #[arg(long, value_name = "NAME", value_parser = choices(RENDERINGS))]
    render_as: Option<String>,
    /// How the video is rendered
    #[arg(long, value_name = "NAME", value_parser = choices(RENDERINGS))]
    video_render_as: Option<String>,
    /// How the sets are rendered
    #[arg(long, value_name = "NAME", value_parser = choices(RENDERINGS))]
    set_render_as: Option<String>,
    /// Size of all images, which are square: S, or SxS [default: 256 for the video, smoke 64; 64 for the sets]
    #[arg(long, value_name = "S|WxH", value_parser = choices::square)]
    size: Option<usize>,
    /// Size of the video's images
    #[arg(long, value_name = "S|WxH", value_parser = choices::square)]
    video_size: Option<usize>,
    /// Size of the sets' images
    #[arg(long, value_name = "S|WxH", value_parser = choices::square)]
    set_size: Option<usize>,
    /// What is written of each image of the video, comma-separated or repeated
    #[arg(long, value_name = "LIST", default_value = "photo", value_delimiter = ',', value_parser = choices(PASSES))]
    passes: Vec<String>,
    /// Samples per pixel [default: 16]
    #[arg(long, value_name = "N")]
    samples: Option<u32>,
    #[command(flatten)]
    filling: OutputArgs,
}

impl Args {
    fn settings(&self) -> Result<Settings> {
        let base = if self.scale == "smoke" { Settings::smoke() } else { Settings::full() };
        let look = |own: &Option<String>, otherwise: Rendering| match own.as_ref().or(self.render_as.as_ref())
        {
            Some(name) => Rendering::parse(name),
            None => Ok(otherwise),
        };
        let size = |own: Option<usize>, otherwise: usize| own.or(self.size).unwrap_or(otherwise);
        let settings = Settings {
            set: self.split.clone(),
            graph: self.graph.clone(),
            factors: self.factors,
            mechanism: self.equations.clone(),
            raw: self.no_standardize,
            video_look: look(&self.video_render_as, base.video_look)?,
            set_look: look(&self.set_render_as, base.set_look)?,
            video_size: size(self.video_size, base.video_size),
            set_size: size(self.set_size, base.set_size),
            samples: self.samples.unwrap_or(base.samples),
            count: self.observational.unwrap_or(base.count),
            groups: self.groups.unwrap_or(base.groups),
            appearances: self.appearances.unwrap_or(if self.character.is_some() {
                1
            } else {
                base.appearances
            }),
            points: self.body_points.unwrap_or(base.points),
            frames: self.frames.unwrap_or(base.frames),
            test_cameras: self.test_cameras.unwrap_or(base.test_cameras),
            passes: PassSet::parse(&self.passes)?,
            subject: self.subject,
            character: self.character.as_ref().map(|file| CharacterSettings {
                file: file.clone(),
                animations: self.animation.clone(),
                elbow: self.elbow.clone(),
                hide: self.hide.clone(),
                play: self.animate,
            }),
            seed: self.filling.seed,
        };
        settings.validate()?;
        Ok(settings)
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let settings = args.settings()?;
    claim::check(&args.out, args.filling.resume, args.filling.force)?;
    let mut meter = Meter::new();
    let report = cli::stoppable(|stop| {
        generate::run(&settings, &args.out, args.filling.resume, stop, &mut |done, total, what| {
            if done == total {
                meter.done();
            } else {
                meter.count(done, total, what);
            }
        })
    })?;
    meter.done();
    if cli::is_json() {
        return cli::say_json(&report.record);
    }
    for line in lines(args, &settings, &report, meter.seconds()) {
        cli::say(&line)?;
    }
    Ok(())
}

/// What was made, set by set.
fn contents(settings: &Settings) -> Vec<String> {
    let is = |names: &[&str]| names.contains(&settings.set.as_str());
    let mut all = Vec::new();
    if is(&["all", "training", "observational"]) {
        all.push(format!("{} observational images", settings.count));
    }
    if is(&["all", "training", "interventions"]) {
        all.push(format!("{} groups of {BASES} intervention pairs", settings.groups));
    }
    if is(&["all", "video"]) {
        all.push(format!("a video of {} frames", settings.frames));
    }
    all
}

fn lines(args: &Args, settings: &Settings, report: &Report, seconds: f64) -> Vec<String> {
    let mut lines = vec![
        format!("{}: {} ({seconds:.1} s)", args.out.display(), contents(settings).join(", ")),
        format!(
            "{} factors, graph {}, equations {}, {}; all settings and files are listed in {}",
            settings.factors,
            settings.graph,
            settings.mechanism,
            if settings.raw { "variances as they grow along the graph" } else { "standardised" },
            args.out.join(RECORD).display(),
        ),
    ];
    if report.record["video_causes_are_balanced"] == false && !cli::is_quiet() {
        lines.push(format!(
            "note: in a video of {} frames the noises of {} factors are correlated; at least {} frames avoid it (--frames)",
            settings.frames,
            settings.factors,
            4 * settings.factors + 1
        ));
    }
    lines.push(format!(
        "{:<20} {:>8} {:>15} {:>16}",
        "factor set", "samples", "varsortability", "R2-sortability"
    ));
    let shown = |x: Option<f64>| x.map_or_else(|| "undefined".to_owned(), |x| format!("{x:.3}"));
    for s in &report.sortabilities {
        lines.push(format!(
            "{:<20} {:>8} {:>15} {:>16}",
            s.set,
            s.samples,
            shown(s.varsortability),
            shown(s.r2_sortability)
        ));
    }
    lines
}
