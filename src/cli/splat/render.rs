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
use crate::scene::camera::Camera;
use crate::scene::gaussians::Gaussians;
use crate::shared::{DefaultArgs, OrbitArgs, SCENE, SceneArgs};
use crate::units::counted;
use crate::{Error, Result};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Of an orbit; width and height are exchanged for the scene of a capture in portrait format.
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

Reads PLY files written by 3DGS programs; --drop-invalid leaves out rows with NaN or a zero quaternion, which some programs write. The orbit of a scene that `splat fit` wrote takes its middle, its distance, the direction up and the part of a turn that was filmed from the cameras beside the scene; of any other scene, from the extents of its Gaussians, with z up. Written to --out: one folder per pass and a transforms.json that describes the images, so that it is itself a capture. Passes: color (PNG, sRGB-encoded), linear (EXR, linear radiance), depth (EXR, camera z weighted by alpha: divide by alpha for the mean), alpha (EXR). By default an orbit has images of 800x600 pixels (600x800 for a capture in portrait format), a field of view of 50° along the longer side and an elevation of 20°.")]
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
    /// Arc of an orbit in degrees [default: 360; the part that was filmed, if the cameras of the fit cover less than 300]
    #[arg(long, value_name = "DEG")]
    arc: Option<f64>,
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
    let (shots, arc) = shots(args, &path, &stored, &meter)?;
    let dir = claim::folder(&args.out, false, args.force)?;
    let scene = Scene::new(&stored, settings, background);
    let written = render::to_folder(&scene, &shots, passes, &dir, &mut |done, total| {
        meter.count(done, total, "rendering")
    })?;
    meter.done();
    if cli::is_json() {
        return cli::say_json(&json!({
            "scene": args.scene, "out": args.out, "images": shots.len(), "gaussians": stored.len(),
            "profile": args.render.profile, "arc_degrees": arc, "files": written, "seconds": meter.seconds(),
        }));
    }
    cli::say(&format!(
        "{} of {}: {} ({:.1} images/s)",
        counted(shots.len(), "view"),
        counted(stored.len(), "Gaussian"),
        dir.join("transforms.json").display(),
        shots.len() as f64 / meter.seconds()
    ))
}

/// The file itself, or the scene in the folder of a fit.
pub(crate) fn scene_file(path: &Path) -> Result<PathBuf> {
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

/// The defaults of an orbit around a scene with these cameras: most of them in portrait format, images in portrait format, with the same field
/// of view along the longer side.
fn usual(cameras: &[Camera]) -> DefaultArgs {
    let upright = cameras.iter().filter(|c| c.height > c.width).count();
    if 2 * upright <= cameras.len() {
        return USUAL;
    }
    let [w, h] = USUAL.size;
    let slope = libm::tan(0.5 * USUAL.fov.to_radians()) * h as f64 / w as f64;
    DefaultArgs { size: [h, w], fov: (2.0 * libm::atan(slope)).to_degrees(), ..USUAL }
}

/// Views for rendering, and the extent in degrees of the arc to which an orbit is limited.
fn shots(args: &Args, path: &Path, scene: &Gaussians, meter: &Meter) -> Result<(Vec<Shot>, Option<f64>)> {
    let up = Up::parse(&args.up)?;
    let is_orbit = args.cameras.starts_with("orbit:");
    let cameras = if is_orbit { render::fitted_cameras(path)? } else { Vec::new() };
    let Some(orbit) = args.orbit.parse(&args.cameras, usual(&cameras))? else {
        if args.arc.is_some() {
            meter.note(&format!(
                "--arc has no effect: it is for --cameras orbit:N, and those of {} are complete",
                args.cameras
            ));
        }
        let reading = Reading { outside: args.allow_outside, ..Reading::default() };
        let shots = render::shots_of(Path::new(&args.cameras), usize::from(args.downscale), &reading)?;
        return Ok((shots, None));
    };
    let wrong = || Error::input("--center").expected("X,Y,Z").got(args.center.clone().unwrap_or_default());
    let center = match &args.center {
        None => None,
        Some(text) => Some(
            super::render_args::numbers(text).and_then(|v| <[f32; 3]>::try_from(v).ok()).ok_or_else(wrong)?,
        ),
    };
    if cameras.is_empty() && up == Up::Auto {
        meter.note("no cameras beside the scene: the orbit assumes that z is up (--up changes it)");
    }
    let orbit = Orbit { center, arc_rad: args.arc.map(f64::to_radians), ..orbit };
    let shots = orbit.shots_from(scene, &cameras, up).map_err(|e| e.within(path.display().to_string()))?;
    let arc = orbit.limited(&cameras, up).map(f64::to_degrees);
    if let Some(degrees) = arc {
        meter.note(&format!(
            "the photos of the fit were taken from {degrees:.0} degrees around the scene, and the orbit stays within them; --arc 360 goes \
             all around, where nothing was filmed"
        ));
    }
    Ok((shots, arc))
}
