//! `mesh render`: images of a model under light.

use crate::choices::{PASSES, choices};
use crate::claim;
use crate::console as cli;
use crate::fit::orbit::Orbit;
use crate::fit::passes::{PassSet, Shot};
use crate::fit::relight::{self, Exposure, Relight};
use crate::fit::render::capture_shots;
use crate::io;
use crate::light::{Light, MapArgs};
use crate::meter::Meter;
use crate::scene::character::Character;
use crate::scene::light::Lights;
use crate::scene::mesh::Object;
use crate::scene::model;
use crate::shade::render::Settings;
use crate::shared::{DefaultArgs, OrbitArgs, OutputArgs};
use crate::units::counted;
use crate::{Error, Result};
use data_gen::figure::factors::Drive;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Of an orbit.
const USUAL: DefaultArgs = DefaultArgs { size: [512, 512], fov: 35.0, elevation: 15.0 };

/// Render a glTF, OBJ or PLY mesh under an environment map.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight mesh render helmet.gltf --env studio --out helmet
  lastlight mesh render cow.obj --env dresden.hdr --env-axes blender --cameras orbit:36 --out turntable
  lastlight mesh render Knight.glb --animation Walking_A --time 0.4 --hide 1H_Sword --env uniform --out knight
  lastlight mesh render model.glb --env probe.exr --cameras capture/transforms.json --out relit
  lastlight mesh render ball.obj --env axes --out which-way

--out is a capture: images/ (PNG, sRGB-encoded), foreground/ (PNG) and transforms.json, and by default radiance/ (EXR, linear), depth/, normal/ (EXR), albedo/ and material/ (PNG). An interrupted run continues with --resume, if model, light and cameras are what they were. By default an orbit has images of 512x512 pixels, a field of view of 35° and an elevation of 15°. glTF and OBJ are y up, and a PLY is read as if it were; cameras and passes are z up, as everywhere in this program. --env axes colours directions by axis: +x red, -x cyan, +y green, -y magenta, +z blue, -z yellow, the negative ones with a dark middle; --env-axes gives the orientation of the environment map's axes.")]
pub(crate) struct Args {
    /// Model: .gltf, .glb, .obj, .ply; or the folder of the open body
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    images: Images,
    /// Pose of a character: one of its animations
    #[arg(long, value_name = "NAME")]
    animation: Option<String>,
    /// Seconds into the animation
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, requires = "animation")]
    time: f64,
    /// Nodes or meshes to leave out, comma-separated or repeated
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    hide: Vec<String>,
}

/// Images of an object: light, cameras, passes, folder.
#[derive(clap::Args)]
pub(crate) struct Images {
    /// Light: a .hdr, .exr, .png or .jpg panorama, or uniform, sky, sunset, overcast, studio, indoor, night, axes
    #[arg(long, value_name = "FILE|NAME", default_value = "uniform")]
    env: String,
    #[command(flatten)]
    map: MapArgs,
    /// Cameras: orbit:N for N views around the model, a transforms.json, or a capture folder
    #[arg(long, value_name = "FROM", default_value = "orbit:1")]
    cameras: String,
    #[command(flatten)]
    orbit: OrbitArgs,
    /// Shrink the images of a capture's cameras by a whole factor
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    downscale: u8,
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
    /// What is written of each image, comma-separated or repeated
    #[arg(long, value_name = "LIST", default_value = "all", value_delimiter = ',', value_parser = choices(PASSES))]
    passes: Vec<String>,
    /// Folder for the images; new or empty unless --force or --resume
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    filling: OutputArgs,
}

/// What is rendered.
pub(crate) struct Subject {
    /// the object
    pub(crate) object: Object,
    /// sentences about what a file holds and the object does not
    pub(crate) notes: Vec<String>,
    /// the key of the record in the header of the images
    pub(crate) key: &'static str,
    /// what a continued run must have in common with the one that was interrupted, besides light, cameras and settings
    pub(crate) record: Map<String, Value>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    if !args.time.is_finite() {
        return Err(Error::input("--time").expected("a number of seconds").got(args.time.to_string()));
    }
    args.images.write(&args.file, &mut |_| {
        let (object, notes) = object(args)?;
        // The open body is a folder, which is identified by its mesh.
        let model = if args.file.is_dir() { args.file.join("base.obj") } else { args.file.clone() };
        let record = Map::from_iter([
            ("model".to_owned(), io::identity(&model)?),
            ("pose".to_owned(), json!([json!(args.animation), json!(args.time), json!(args.hide)])),
        ]);
        Ok(Subject { object, notes, key: "mesh_render", record })
    })
}

/// Where images are taken from.
enum Cameras {
    /// The cameras of a capture.
    Listed(Vec<Shot>),
    /// A circle, whose size may depend on the object.
    Around(Orbit),
}

impl Images {
    fn light(&self) -> Light<'_> {
        Light { env: &self.env, map: &self.map }
    }

    /// Renders the subject that `make` gives into the folder, and prints what was written. Options are checked and the folder is claimed
    /// before it is made.
    ///
    /// # Errors
    /// Those of the options, the subject, the renderer and the files.
    pub(crate) fn write(
        &self,
        file: &Path,
        make: &mut dyn FnMut(&mut Meter) -> Result<Subject>,
    ) -> Result<()> {
        let mut meter = Meter::new();
        let exposure = exposure(&self.exposure)?;
        let passes = PassSet::parse(&self.passes)?;
        claim::check(&self.out, self.filling.resume, self.filling.force)?;
        let seed = self.filling.seed;
        let lights = Lights { environment: Some(self.light().environment(seed)?), lamps: Vec::new() };
        let cameras = self.cameras()?;
        let subject = make(&mut meter)?;
        let object = &subject.object;
        subject.notes.iter().for_each(|n| meter.note(&format!("note: {n}")));
        let shots = match cameras {
            Cameras::Listed(shots) => shots,
            Cameras::Around(orbit) => relight::around(&object.mesh, &orbit)?,
        };
        let settings = Settings { samples: self.samples, bounces: self.bounces, seed, ..Settings::default() };
        let job =
            Relight { object, lights: &lights, settings, exposure, transparent: self.transparent, passes };
        let header = self.header(&subject, passes)?;
        let digest = cli::stoppable(|stop| {
            job.to_folder(&shots, &self.out, header, self.filling.resume, stop, &mut |done, total| {
                meter.count(done, total, "rendering");
            })
        })?;
        meter.done();
        let (v, t) = (object.mesh.positions.len(), object.mesh.triangles.len());
        if cli::is_json() {
            return cli::say_json(&json!({
                "file": file, "out": self.out, "images": shots.len(), "vertices": v, "triangles": t,
                "materials": object.materials.len(), "notes": subject.notes, "digest": format!("{digest:016x}"), "seconds": meter.seconds(),
            }));
        }
        cli::say(&format!(
            "{} of {}: {} (digest {digest:016x}, {:.1} s)",
            counted(shots.len(), "image"),
            counted(t, "triangle"),
            self.out.join("transforms.json").display(),
            meter.seconds()
        ))
    }

    /// What a continued run must have in common with the one that was interrupted, besides what is shown. Files are known by name and bytes:
    /// the result does not depend on where they lie.
    fn header(&self, subject: &Subject, passes: PassSet) -> Result<Map<String, Value>> {
        let is_orbit = self.cameras.starts_with("orbit:");
        let (size, fov, elevation, radius) = self.orbit.resolved(USUAL);
        let orbit = json!([self.cameras, format!("{}x{}", size[0], size[1]), fov, elevation, radius]);
        let of_capture = json!({ "capture": name_of(&self.cameras), "downscale": self.downscale });
        let mut record = json!({
            "env": self.light().record()?,
            "cameras": if is_orbit { orbit } else { of_capture },
            "samples": self.samples,
            "bounces": self.bounces,
            "seed": self.filling.seed,
            "exposure": self.exposure,
            "style": [json!(self.transparent), passes.record()],
        });
        for (key, value) in &subject.record {
            record[key] = value.clone();
        }
        Ok(Map::from_iter([(subject.key.to_owned(), record)]))
    }

    fn cameras(&self) -> Result<Cameras> {
        if let Some(orbit) = self.orbit.parse(&self.cameras, USUAL)? {
            return Ok(Cameras::Around(orbit));
        }
        let shots = capture_shots(Path::new(&self.cameras), usize::from(self.downscale))?;
        Ok(Cameras::Listed(shots.into_iter().map(|s| relight::still(s.name, s.camera)).collect()))
    }
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
    // A folder is a body, with or without these options; any other file is read as a character because of them.
    let mut character = Character::read(&args.file).map_err(|e| match (&args.animation, &args.hide[..]) {
        (Some(_), _) => e.within("--animation"),
        (None, [_, ..]) => e.within("--hide"),
        (None, []) => e,
    })?;
    let names: Vec<&str> = args.hide.iter().map(String::as_str).collect();
    character.hide(&names)?;
    let pose = match &args.animation {
        None => character.rest(),
        Some(name) => character.pose(character.animation(name)?, args.time),
    };
    Ok((character.posed(&pose, &Drive::new(&[]))?, character.notes().to_vec()))
}
