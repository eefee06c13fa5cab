//! `lirm gen`: data sets of rendered objects.

use crate::choices::{self, Choices, ENV_AXES, PASSES, choices};
use crate::claim;
use crate::console as cli;
use crate::fit::passes::PassSet;
use crate::meter::Meter;
use crate::scene::camera::Model;
use crate::scene::environment_file::{Options, Orientation};
use crate::shared::OutputArgs;
use crate::units::counted;
use crate::{Error, Result};
use data_gen::cameras::Framing;
use lastlight_lirm::r#gen::{self as set, Lighting, Set, Settings};
use serde_json::json;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  lastlight lirm gen --out train --objects 100                          built-in objects under a white dome
  lastlight lirm gen --out lit --objects 100 --lighting both --shiny    and under environment maps, rough and shiny
  lastlight lirm gen --out small --objects 5000 --views 12 --size 64 --samples 16
  lastlight lirm gen --out test --cameras test --lighting environment --size 512
  lastlight lirm gen --out ego --cameras egocentric --lens pinhole --lighting environment --views 60
  lastlight lirm gen --out mine --mesh helmet.gltf,cow.obj --env dresden.hdr --lighting environment

Each object gets a folder with object.json, its truth (object.glb, and environment.exr if it is lit by a map) and one capture per light: transforms.json, images/, foreground/, and by default radiance/, depth/, normal/, albedo/, material/. `mesh render object.glb --env environment.exr` renders it anew. Object k is the same whatever --objects and --first are, so a set can be made in pieces, each in a folder of its own. An interrupted run continues with --resume; --objects may then be larger.";

/// Images per object and light.
const VIEWS: usize = 32;

/// Values of `--lighting`.
const LIGHTING: &Choices =
    &[("uniform", "a white dome"), ("environment", "a map per object"), ("both", "each object under both")];
/// Values of `--cameras`.
const CAMERAS: &Choices = &[
    ("train", "drawn at random"),
    ("test", "48 fixed views, inputs and outputs"),
    ("egocentric", "on a moving head"),
];
/// Values of `--lens`.
const LENSES: &Choices = &[("fisheye", "130 degrees, equidistant"), ("pinhole", "70 degrees")];
/// Values of `--framing`.
const FRAMINGS: &Choices =
    &[("loose", "off the centre, sometimes cut by the border"), ("whole", "the whole object is visible")];

/// Render objects with known shape, materials and light.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Folder of the set; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Number of objects [default: 1, or the number of --mesh files]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    objects: Option<u32>,
    /// Index of the first object
    #[arg(long, value_name = "N", default_value_t = 0)]
    first: u32,
    /// Models to use instead of the built-in ones: .gltf, .glb, .obj or .ply, comma-separated or repeated
    #[arg(long, value_name = "FILE", value_delimiter = ',')]
    mesh: Vec<PathBuf>,
    /// Light of the objects
    #[arg(long, value_name = "NAME", default_value = "uniform", value_parser = choices(LIGHTING))]
    lighting: String,
    /// Panoramas to use instead of the built-in ones, comma-separated or repeated: .hdr, .exr, .png and .jpg files are turned about the vertical by a random angle per object; axes is a test map that colours the directions of the axes, and is not turned
    #[arg(long, value_name = "FILE|NAME", value_delimiter = ',')]
    env: Vec<PathBuf>,
    /// Orientation of the panorama's axes
    #[arg(long, value_name = "NAME", default_value = "ours", value_parser = choices(ENV_AXES), requires = "env")]
    env_axes: String,
    /// Columns of built-in maps [default: twice --size, 128 to 1024]
    #[arg(long, value_name = "N", conflicts_with = "env")]
    env_width: Option<usize>,
    /// A second version under the map, with all roughness times U(0.3, 0.6)
    #[arg(long)]
    shiny: bool,
    /// Cameras of the images
    #[arg(long, value_name = "FROM", default_value = "train", value_parser = choices(CAMERAS))]
    cameras: String,
    /// Lens of egocentric cameras [default: fisheye]
    #[arg(long, value_name = "NAME", value_parser = choices(LENSES))]
    lens: Option<String>,
    /// Images per object and light, of train and egocentric [default: 32]
    #[arg(long, value_name = "N")]
    views: Option<usize>,
    /// Frames of egocentric cameras, which have ten per second, from one image to the next [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    every: Option<u16>,
    /// Size of the images, which are square: S, or SxS
    #[arg(long, value_name = "S|WxH", default_value = "256", value_parser = choices::square)]
    size: usize,
    /// How training views frame the object [default: loose]
    #[arg(long, value_name = "NAME", value_parser = choices(FRAMINGS))]
    framing: Option<String>,
    /// Samples per pixel
    #[arg(long, value_name = "N", default_value_t = 64)]
    samples: u32,
    /// Further bounces of light after the first surface; 0 is direct light only
    #[arg(long, value_name = "N", default_value_t = 1)]
    bounces: u32,
    /// Side of a square with as many texels as the textures of an object [default: twice --size, 128 to 1024]
    #[arg(long, value_name = "N")]
    texture: Option<usize>,
    /// What is written of each image, comma-separated or repeated
    #[arg(long, value_name = "LIST", default_value = "all", value_delimiter = ',', value_parser = choices(PASSES))]
    passes: Vec<String>,
    /// Leave out object.glb and environment.exr
    #[arg(long)]
    no_truth: bool,
    #[command(flatten)]
    filling: OutputArgs,
}

impl Args {
    fn settings(&self) -> Result<Settings> {
        let unused = |name: &str, expected: &str, hint: String| {
            Err(Error::input(name).expected(expected).got(format!("--cameras {}", self.cameras)).hint(hint))
        };
        if let Some(lens) = &self.lens
            && self.cameras != "egocentric"
        {
            let hint = format!("other cameras are pinhole cameras; leave out --lens {lens}");
            return unused("--lens", "--cameras egocentric", hint);
        }
        if let Some(n) = self.every
            && self.cameras != "egocentric"
        {
            let hint = format!("other cameras do not move; leave out --every {n}");
            return unused("--every", "--cameras egocentric", hint);
        }
        if let Some(n) = self.views
            && self.cameras == "test"
        {
            let hint = format!("a test set has 48 images; leave out --views {n}");
            return unused("--views", "--cameras train or egocentric", hint);
        }
        if let Some(framing) = &self.framing
            && self.cameras != "train"
        {
            let hint = format!("other cameras are not framed; leave out --framing {framing}");
            return unused("--framing", "--cameras train", hint);
        }
        let fine = (2 * self.size).clamp(128, 1024);
        let (axes, maps): (Vec<_>, Vec<_>) = self.env.iter().cloned().partition(|m| m == Path::new("axes"));
        if self.env_width.is_some() && self.lighting == "uniform" {
            let e = Error::input("--env-width").expected("built-in maps: --lighting environment or both");
            return Err(e.got("uniform light alone"));
        }
        Ok(Settings {
            objects: self.objects.map_or(Ord::max(self.mesh.len(), 1) as u64, u64::from),
            first: u64::from(self.first),
            meshes: self.mesh.clone(),
            maps,
            axes: !axes.is_empty(),
            map_options: Options {
                orientation: Orientation::parse(&self.env_axes).map_err(|e| e.within("--env-axes"))?,
                ..Options::default()
            },
            lighting: Lighting::named(&self.lighting).expect("a value of LIGHTING"),
            shiny: self.shiny,
            set: Set::named(&self.cameras).expect("a value of CAMERAS"),
            camera: if self.lens.as_deref() == Some("pinhole") { Model::Pinhole } else { Model::Fisheye },
            views: self.views.unwrap_or(VIEWS),
            every: usize::from(self.every.unwrap_or(1)),
            size: self.size,
            framing: Framing::named(self.framing.as_deref().unwrap_or("loose")).expect("a value of FRAMINGS"),
            samples: self.samples,
            bounces: self.bounces,
            texture: self.texture.unwrap_or(fine),
            map_width: self.env_width.unwrap_or(fine),
            passes: PassSet::parse(&self.passes)?,
            truth: !self.no_truth,
            seed: self.filling.seed,
        })
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let settings = args.settings()?;
    settings.validate()?;
    // The set makes its folder when there is something to write.
    claim::check(&args.out, args.filling.resume, args.filling.force)?;
    let made = cli::stoppable(|stop| {
        set::run(&args.out, &settings, args.filling.resume, stop, &mut |done, total, message| {
            meter.count(done, total, message);
        })
    })?;
    meter.done();
    let seconds = meter.seconds();
    if cli::is_json() {
        return cli::say_json(&json!({
            "out": args.out, "objects": made.objects, "rendered": made.rendered,
            "digest": format!("{:016x}", made.digest), "settings": settings.record()?, "seconds": seconds,
        }));
    }
    cli::say(&format!(
        "{}, {} rendered: {} (digest {:016x}, {seconds:.1} s)",
        counted(made.objects, "object"),
        counted(made.rendered, "image"),
        args.out.join("dataset.json").display(),
        made.digest
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_of_an_option_has_a_meaning() {
        let names = |list: &Choices| list.iter().map(|(name, _)| *name).collect::<Vec<_>>();
        assert!(names(LIGHTING).into_iter().all(|name| Lighting::named(name).is_some()));
        assert!(names(CAMERAS).into_iter().all(|name| Set::named(name).is_some()));
        assert!(names(FRAMINGS).into_iter().all(|name| Framing::named(name).is_some()));
    }
}
