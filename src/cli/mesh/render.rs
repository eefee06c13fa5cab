//! `mesh render`: pictures of a model under light.

use crate::cli::meter::Meter;
use crate::cli::shared::{Filling, OrbitArgs, Usual};
use crate::cli::{self, claim};
use crate::fit::passes::Shot;
use crate::fit::relight::{self, Exposure, Relight};
use crate::fit::render::capture_shots;
use crate::scene::character::Character;
use crate::scene::environment_file::{self, Options, Orientation};
use crate::scene::from_data_gen;
use crate::scene::light::{Environment, Lights};
use crate::scene::material::Transfer;
use crate::scene::mesh::Object;
use crate::scene::model;
use crate::shade::render::Settings;
use crate::{Error, Result};
use data_gen::figure::factors::Drive;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Names of the built-in environments, in the order of `data_gen::environments::KINDS`.
const BUILT_IN: [&str; 6] = ["sky", "sunset", "overcast", "studio", "indoor", "night"];

/// Of an orbit.
const USUAL: Usual = Usual { size: "512x512", fov: 35.0, elevation: 15.0 };

/// Render a glTF or OBJ under an environment map.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight mesh render helmet.gltf --env studio --out helmet
  lastlight mesh render cow.obj --env dresden.hdr --env-axes blender --cameras orbit:36 --out turntable
  lastlight mesh render Knight.glb --animation Walking_A --time 0.4 --hide 1H_Sword --env uniform --out knight
  lastlight mesh render model.glb --env probe.exr --cameras capture/transforms.json --out relit --passes all

--out is a capture: images/ (PNG, sRGB-encoded), foreground/ (PNG) and transforms.json; with --passes all also
radiance/ (EXR, linear), depth/, normal/ (EXR), albedo/ and material/ (PNG). An interrupted run continues with
--resume. An orbit has pictures of 512x512 pixels, a field of view of 35° and stands 15° above the horizon
unless told otherwise. glTF and OBJ are y up; cameras and passes are z up, as everywhere in this program.")]
pub(in crate::cli) struct Args {
    /// Model: .gltf, .glb, .obj; or the folder of the open body
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Light: a .hdr, .exr, .png or .jpg panorama, or uniform, sky, sunset, overcast, studio, indoor, night
    #[arg(long, value_name = "FILE|NAME", default_value = "uniform", help_heading = "Light")]
    env: String,
    /// Whose axes the panorama has: ours, mitsuba, nvdiffrec, blender or orb
    #[arg(long, value_name = "NAME", default_value = "ours", help_heading = "Light")]
    env_axes: String,
    /// Degrees the light turns about the vertical, counter-clockwise from above
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 0.0,
        allow_hyphen_values = true,
        help_heading = "Light"
    )]
    env_rotate: f64,
    /// Factor of the light
    #[arg(long, value_name = "X", default_value_t = 1.0, help_heading = "Light")]
    env_scale: f32,
    /// The panorama is a mirror image
    #[arg(long, help_heading = "Light")]
    env_mirror: bool,
    /// Values of a PNG or JPEG panorama are linear, not sRGB-encoded
    #[arg(long, help_heading = "Light")]
    env_linear: bool,
    /// Cameras: orbit:N for N views around the model, a transforms.json, or a capture folder
    #[arg(long, value_name = "FROM", default_value = "orbit:1", help_heading = "Cameras")]
    cameras: String,
    #[command(flatten)]
    orbit: OrbitArgs,
    /// Shrink the pictures of a capture's cameras by a whole factor
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16), help_heading = "Cameras")]
    downscale: u8,
    /// Pose of a character: one of its animations
    #[arg(long, value_name = "NAME", help_heading = "Model")]
    animation: Option<String>,
    /// Seconds into the animation
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 0.0,
        requires = "animation",
        help_heading = "Model"
    )]
    time: f64,
    /// Nodes or meshes to leave out
    #[arg(long, value_name = "NAME", help_heading = "Model", num_args = 1..)]
    hide: Vec<String>,
    /// Samples per pixel
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    samples: u32,
    /// Surfaces after the first that light may come by; 0 is direct light only
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(0..=64))]
    bounces: u32,
    /// Factor from radiance to the photograph: auto or a positive number
    #[arg(long, value_name = "auto|X", default_value = "auto")]
    exposure: String,
    /// Photographs of the model alone, with an alpha channel
    #[arg(long)]
    transparent: bool,
    /// What is written: photo or all
    #[arg(long, value_name = "photo|all", default_value = "all", value_parser = ["photo", "all"])]
    passes: String,
    /// Folder for the pictures; new or empty unless --force or --resume
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    filling: Filling,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new(args.filling.quiet);
    let exposure = exposure(&args.exposure)?;
    claim::check(&args.out, args.filling.resume, args.filling.force)?;
    let (object, notes) = object(args)?;
    notes.iter().for_each(|n| meter.note(&format!("note: {n}")));
    let lights = Lights { environment: Some(environment(args)?), lamps: Vec::new() };
    let shots = shots(args, &object)?;
    let settings = Settings {
        samples: args.samples,
        bounces: args.bounces,
        seed: args.filling.seed,
        ..Settings::default()
    };
    let job = Relight {
        object: &object,
        lights: &lights,
        settings,
        exposure,
        transparent: args.transparent,
        passes: args.passes == "all",
    };
    let dir = claim::folder(&args.out, args.filling.resume, args.filling.force)?;
    let digest = cli::stoppable(|stop| {
        job.to_folder(&shots, &dir, header(args), args.filling.resume, stop, &mut |done, total| {
            meter.count(done, total, "rendering");
        })
    })?;
    meter.done();
    let (v, t) = (object.mesh.positions.len(), object.mesh.triangles.len());
    if args.filling.json {
        return cli::say_json(&json!({
            "file": args.file, "out": args.out, "pictures": shots.len(), "vertices": v, "triangles": t,
            "materials": object.materials.len(), "notes": notes, "digest": format!("{digest:016x}"), "seconds": meter.seconds(),
        }));
    }
    cli::say(&format!(
        "{} pictures of {t} triangles: {} (digest {digest:016x}, {:.1} s)",
        shots.len(),
        dir.join("transforms.json").display(),
        meter.seconds()
    ))
}

/// What a continued run must have in common with the one that was interrupted.
fn header(args: &Args) -> Map<String, Value> {
    let (size, fov, elevation, radius) = args.orbit.resolved(USUAL);
    let entries = [
        ("model", json!(args.file)),
        (
            "env",
            json!([
                args.env,
                args.env_axes,
                args.env_rotate,
                args.env_scale,
                args.env_mirror,
                args.env_linear
            ]),
        ),
        ("cameras", json!([args.cameras, size, fov, elevation, radius, args.downscale])),
        ("pose", json!([args.animation, args.time, args.hide])),
        ("samples", json!(args.samples)),
        ("bounces", json!(args.bounces)),
        ("seed", json!(args.filling.seed)),
        ("exposure", json!(args.exposure)),
        ("style", json!([args.transparent, args.passes])),
    ];
    Map::from_iter([(
        "mesh_render".to_owned(),
        Value::Object(entries.map(|(k, v)| (k.to_owned(), v)).into_iter().collect()),
    )])
}

fn exposure(text: &str) -> Result<Exposure> {
    if text == "auto" {
        return Ok(Exposure::Auto);
    }
    match text.parse::<f32>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(Exposure::Fixed(x)),
        _ => Err(Error::input("--exposure").expected("auto or a positive number").got(text)),
    }
}

/// The model at rest, or a character in a pose.
fn object(args: &Args) -> Result<(Object, Vec<String>)> {
    if args.animation.is_none() && args.hide.is_empty() && !args.file.is_dir() {
        return model::read_with_notes(&args.file);
    }
    let mut character = Character::read(&args.file)?;
    let names: Vec<&str> = args.hide.iter().map(String::as_str).collect();
    character.hide(&names)?;
    let pose = match &args.animation {
        None => character.rest(),
        Some(name) => character.pose(character.animation(name)?, args.time),
    };
    Ok((character.posed(&pose, &Drive::new(&[]))?, character.notes().to_vec()))
}

fn environment(args: &Args) -> Result<Environment> {
    let options = Options {
        orientation: Orientation::parse(&args.env_axes).map_err(|e| e.within("--env-axes"))?,
        mirror: args.env_mirror,
        rotate: args.env_rotate,
        scale: args.env_scale,
        transfer: if args.env_linear { Transfer::Linear } else { Transfer::Srgb },
        world_from_map: None,
    };
    if args.env == "uniform" {
        return Ok(environment_file::orient(Environment::constant([1.0; 3]), &options));
    }
    if let Some(k) = BUILT_IN.iter().position(|n| *n == args.env) {
        // Ours by birth: axes of files do not apply.
        let map = data_gen::environments::make(args.filling.seed, k as u64, 1024, 512);
        let options = Options { orientation: Orientation::Ours, mirror: false, ..options };
        return Ok(environment_file::orient(from_data_gen::environment(&map), &options));
    }
    let path = Path::new(&args.env);
    if !path.exists() {
        let e = Error::input("--env").expected(format!("a picture, uniform, {}", BUILT_IN.join(", ")));
        return Err(e.got(format!("'{}', which is not there", args.env)));
    }
    environment_file::read(path, &options)
}

fn shots(args: &Args, object: &Object) -> Result<Vec<Shot>> {
    let Some(orbit) = args.orbit.parse(&args.cameras, USUAL)? else {
        let shots = capture_shots(Path::new(&args.cameras), usize::from(args.downscale))?;
        return Ok(shots.into_iter().map(|s| relight::still(s.name, s.camera)).collect());
    };
    relight::around(&object.mesh, &orbit)
}
