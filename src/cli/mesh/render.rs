//! `mesh render`: images of a model under light.

use super::light;
use crate::claim;
use crate::console as cli;
use crate::fit::passes::Shot;
use crate::fit::relight::{self, Exposure, Relight};
use crate::fit::render::capture_shots;
use crate::io;
use crate::meter::Meter;
use crate::scene::character::Character;
use crate::scene::light::Lights;
use crate::scene::mesh::Object;
use crate::scene::model;
use crate::shade::render::Settings;
use crate::shared::{DefaultArgs, OrbitArgs, OutputArgs};
use crate::{Error, Result};
use data_gen::figure::factors::Drive;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Of an orbit.
const USUAL: DefaultArgs = DefaultArgs { size: "512x512", fov: 35.0, elevation: 15.0 };

/// Render a glTF or OBJ under an environment map.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight mesh render helmet.gltf --env studio --out helmet
  lastlight mesh render cow.obj --env dresden.hdr --env-axes blender --cameras orbit:36 --out turntable
  lastlight mesh render Knight.glb --animation Walking_A --time 0.4 --hide 1H_Sword --env uniform --out knight
  lastlight mesh render model.glb --env probe.exr --cameras capture/transforms.json --out relit --passes all
  lastlight mesh render ball.obj --env axes --out which-way

--out is a capture: images/ (PNG, sRGB-encoded), foreground/ (PNG) and transforms.json; with --passes all also
radiance/ (EXR, linear), depth/, normal/ (EXR), albedo/ and material/ (PNG). An interrupted run continues with
--resume, if model, light and cameras are what they were. By default an orbit has
images of 512x512 pixels, a field of view of 35° and an elevation of 15°. glTF and OBJ are y up; cameras and passes are z up, as everywhere in this program. --env axes colours directions by axis: +x red, -x cyan, +y green, -y magenta,
+z blue, -z yellow, the negative ones with a dark middle; --env-axes gives the orientation of the environment map's axes.")]
pub(crate) struct Args {
    /// Model: .gltf, .glb, .obj; or the folder of the open body
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    light: light::Args,
    /// Cameras: orbit:N for N views around the model, a transforms.json, or a capture folder
    #[arg(long, value_name = "FROM", default_value = "orbit:1", help_heading = "Cameras")]
    cameras: String,
    #[command(flatten)]
    orbit: OrbitArgs,
    /// Shrink the images of a capture's cameras by an integer factor
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
    /// Factor from radiance to the photo: auto or a positive number
    #[arg(long, value_name = "auto|X", default_value = "auto")]
    exposure: String,
    /// Photos of the model alone, with an alpha channel
    #[arg(long)]
    transparent: bool,
    /// What is written: photo or all
    #[arg(long, value_name = "photo|all", default_value = "all", value_parser = ["photo", "all"])]
    passes: String,
    /// Folder for the images; new or empty unless --force or --resume
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    filling: OutputArgs,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let exposure = exposure(&args.exposure)?;
    if !args.time.is_finite() {
        return Err(Error::input("--time").expected("a number of seconds").got(args.time.to_string()));
    }
    claim::check(&args.out, args.filling.resume, args.filling.force)?;
    let (object, notes) = object(args)?;
    notes.iter().for_each(|n| meter.note(&format!("note: {n}")));
    let lights = Lights { environment: Some(args.light.environment(args.filling.seed)?), lamps: Vec::new() };
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
    let header = header(args)?;
    let digest = cli::stoppable(|stop| {
        job.to_folder(&shots, &args.out, header, args.filling.resume, stop, &mut |done, total| {
            meter.count(done, total, "rendering");
        })
    })?;
    meter.done();
    let (v, t) = (object.mesh.positions.len(), object.mesh.triangles.len());
    if cli::is_json() {
        return cli::say_json(&json!({
            "file": args.file, "out": args.out, "images": shots.len(), "vertices": v, "triangles": t,
            "materials": object.materials.len(), "notes": notes, "digest": format!("{digest:016x}"), "seconds": meter.seconds(),
        }));
    }
    cli::say(&format!(
        "{} images of {t} triangles: {} (digest {digest:016x}, {:.1} s)",
        shots.len(),
        args.out.join("transforms.json").display(),
        meter.seconds()
    ))
}

/// What a continued run must have in common with the one that was interrupted, besides what is shown. Files are known by name and bytes:
/// the result does not depend on where they lie.
fn header(args: &Args) -> Result<Map<String, Value>> {
    let is_orbit = args.cameras.starts_with("orbit:");
    let (size, fov, elevation, radius) = args.orbit.resolved(USUAL);
    let orbit = json!([args.cameras, size, fov, elevation, radius]);
    let of_capture = json!({ "capture": name_of(&args.cameras), "downscale": args.downscale });
    // The open body is a folder, whose mesh stands for it.
    let model = if args.file.is_dir() { args.file.join("base.obj") } else { args.file.clone() };
    let record = json!({
        "model": io::identity(&model)?,
        "env": args.light.record()?,
        "cameras": if is_orbit { orbit } else { of_capture },
        "pose": [json!(args.animation), json!(args.time), json!(args.hide)],
        "samples": args.samples,
        "bounces": args.bounces,
        "seed": args.filling.seed,
        "exposure": args.exposure,
        "style": [json!(args.transparent), json!(args.passes)],
    });
    Ok(Map::from_iter([("mesh_render".to_owned(), record)]))
}

/// The last part of a path.
fn name_of(path: &str) -> String {
    Path::new(path).file_name().map_or_else(|| path.to_owned(), |n| n.to_string_lossy().into_owned())
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
    let mut character = Character::read(&args.file).map_err(|e| match args.animation.is_none() {
        true => e.within("--hide"),
        false => e.within("--animation"),
    })?;
    let names: Vec<&str> = args.hide.iter().map(String::as_str).collect();
    character.hide(&names)?;
    let pose = match &args.animation {
        None => character.rest(),
        Some(name) => character.pose(character.animation(name)?, args.time),
    };
    Ok((character.posed(&pose, &Drive::new(&[]))?, character.notes().to_vec()))
}

fn shots(args: &Args, object: &Object) -> Result<Vec<Shot>> {
    let Some(orbit) = args.orbit.parse(&args.cameras, USUAL)? else {
        let shots = capture_shots(Path::new(&args.cameras), usize::from(args.downscale))?;
        return Ok(shots.into_iter().map(|s| relight::still(s.name, s.camera)).collect());
    };
    relight::around(&object.mesh, &orbit)
}
