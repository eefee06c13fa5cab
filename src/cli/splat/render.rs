//! `splat render`: images of a scene file along cameras.

use super::render_args::RenderArgs;
use crate::choices::{Choices, choices};
use crate::claim;
use crate::console as cli;
use crate::fit::orbit::{Orbit, Up};
use crate::fit::render::{self, Passes, Scene, Shot};
use crate::io::capture::Reading;
use crate::last::fit::AVATAR;
use crate::meter::Meter;
use crate::scene::gaussians::Gaussians;
use crate::shared::{DefaultArgs, OrbitArgs, SCENE, SceneArgs};
use crate::{Error, Result};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Of an orbit.
const USUAL: DefaultArgs = DefaultArgs { size: [800, 600], fov: 50.0, elevation: 20.0 };

/// Values of `--passes`.
const PASSES: &Choices = &[
    ("color", "PNG, sRGB-encoded"),
    ("linear", "EXR, linear radiance"),
    ("depth", "EXR, camera z weighted by alpha"),
    ("alpha", "EXR"),
];

/// Render a scene file along cameras.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight splat render fox/ --cameras orbit:60 --out turntable       the scene of a fit, around what was filmed
  lastlight splat render fox/ --cameras fox/ --out again               from the cameras of the fit
  lastlight splat render theirs.ply --cameras orbit:60 --up -y --out turntable
  lastlight splat render scene.ply --cameras photos/ --out again --passes color,depth,alpha
  lastlight splat render theirs.ply --cameras transforms.json --out out --profile inria --background white

Reads PLY files written by 3DGS programs; --drop-invalid leaves out rows with NaN or a zero quaternion, which some programs write. The orbit of a scene that `splat fit` wrote takes its middle, its distance and the direction up from the cameras beside the scene; of any other scene, from the extents of its Gaussians, with z up. Written to --out: one folder per pass and a transforms.json that describes the images, so that it is itself a capture. Passes: color (PNG, sRGB-encoded), linear (EXR, linear radiance), depth (EXR, camera z weighted by alpha: divide by alpha for the mean), alpha (EXR). By default an orbit has images of 800x600 pixels, a field of view of 50° and an elevation of 20°.")]
pub(crate) struct Args {
    /// Scene: .ply, .splat or .npz, or the folder of a fit
    #[arg(value_name = "FILE")]
    scene: PathBuf,
    /// Cameras: a capture, the folder of a fit, a transforms.json, a camera_path.json of nerfstudio, a COLMAP model, or orbit:N for N views around the scene
    #[arg(long, value_name = "FROM")]
    cameras: String,
    /// Folder for the images; new or empty unless --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Replace existing results
    #[arg(long)]
    force: bool,
    /// What is written of each image, comma-separated or repeated
    #[arg(long, value_name = "LIST", default_value = "color", value_delimiter = ',', value_parser = choices(PASSES))]
    passes: Vec<String>,
    /// Shrink the images of a capture's cameras by a whole factor
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    downscale: u8,
    /// Accept absolute paths and `..` in the files of a capture; only for files that you trust
    #[arg(long)]
    allow_outside: bool,
    #[command(flatten)]
    orbit: OrbitArgs,
    /// Centre of an orbit, X,Y,Z [default: the point the cameras of the fit are directed at, else the centre of the scene]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    center: Option<String>,
    /// Up direction of an orbit; auto: as in the images of the fit, else z
    #[arg(long, value_name = "NAME", default_value = "auto", allow_hyphen_values = true, value_parser = ["auto", "x", "y", "z", "-x", "-y", "-z"])]
    up: String,
    #[command(flatten)]
    reading: SceneArgs,
    #[command(flatten)]
    render: RenderArgs,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let (settings, background) = args.render.settings()?;
    let passes = Passes::parse(&args.passes.join(","))?;
    let path = scene_file(&args.scene)?;
    let stored = args.reading.read(&path, &meter)?;
    let shots = shots(args, &path, &stored, &meter)?;
    let dir = claim::folder(&args.out, false, args.force)?;
    let scene = Scene::new(&stored, settings, background);
    let written = render::to_folder(&scene, &shots, passes, &dir, &mut |done, total| {
        meter.count(done, total, "rendering")
    })?;
    meter.done();
    if cli::is_json() {
        return cli::say_json(&json!({
            "scene": args.scene, "out": args.out, "images": shots.len(), "gaussians": stored.len(),
            "profile": args.render.profile, "files": written, "seconds": meter.seconds(),
        }));
    }
    cli::say(&format!(
        "{} views of {} Gaussians: {} ({:.1} images/s)",
        shots.len(),
        stored.len(),
        dir.join("transforms.json").display(),
        shots.len() as f64 / meter.seconds()
    ))
}

/// The file itself, or the scene in the folder of a fit.
pub(super) fn scene_file(path: &Path) -> Result<PathBuf> {
    if !path.exists() {
        return Err(Error::os(path, &std::io::ErrorKind::NotFound.into()));
    }
    if !path.is_dir() {
        return Ok(path.to_path_buf());
    }
    let inside = path.join(SCENE);
    if inside.is_file() {
        return Ok(inside);
    }
    let e = Error::input(path.display().to_string()).expected("a scene file, or a folder with scene.ply");
    if path.join(AVATAR).is_file() {
        return Err(e
            .got("a person of `last fit`")
            .hint("`lastlight last render` and `last eval` are for persons"));
    }
    Err(e.got("a folder without it").hint("`lastlight splat fit CAPTURE --out DIR` makes such a folder"))
}

fn shots(args: &Args, path: &Path, scene: &Gaussians, meter: &Meter) -> Result<Vec<Shot>> {
    let up = Up::parse(&args.up)?;
    let Some(orbit) = args.orbit.parse(&args.cameras, USUAL)? else {
        let reading = Reading { outside: args.allow_outside, ..Reading::default() };
        return render::shots_of(Path::new(&args.cameras), usize::from(args.downscale), &reading);
    };
    let wrong = || Error::input("--center").expected("X,Y,Z").got(args.center.clone().unwrap_or_default());
    let center = match &args.center {
        None => None,
        Some(text) => Some(
            super::render_args::numbers(text).and_then(|v| <[f32; 3]>::try_from(v).ok()).ok_or_else(wrong)?,
        ),
    };
    let cameras = render::fitted_cameras(path)?;
    if cameras.is_empty() && up == Up::Auto {
        meter.note("no cameras beside the scene: the orbit assumes that z is up (--up changes it)");
    }
    let shots = Orbit { center, ..orbit }.shots_from(scene, &cameras, up);
    shots.map_err(|e| e.within(path.display().to_string()))
}
