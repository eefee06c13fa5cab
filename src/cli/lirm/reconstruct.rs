//! `lirm reconstruct` and `lirm update`: a field from a few images of an object, and a better one from more.

use super::init::POSES;
use super::job::Job;
use super::weights;
use crate::choices::choices;
use crate::field::read;
use crate::fit::field::place::Pose;
use crate::fit::field::targets::Pictures;
use crate::meter::Meter;
use crate::shared::ForceArgs;
use crate::splat::missing;
use crate::{Error, Result, claim};
use lastlight_lirm::model::decode::Rendering;
use lastlight_lirm::model::file::digest;
use lastlight_lirm::model::state::State;
use lastlight_lirm::reconstruct::{Reconstruction, Size, Start};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// The first training images of a capture, by name.
fn some(pictures: &Pictures) -> String {
    let names = pictures.views.train.iter().take(4).map(|i| pictures.pictures[*i].name.clone());
    names.collect::<Vec<_>>().join(", ")
}

/// Which images of a capture are read, and how the result is rendered.
#[derive(clap::Args)]
struct Common {
    /// Model, or the folder of a training [default: the included model]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Images to read, comma-separated or repeated: names as in the capture, or file names, with or without extension [default: all training images]
    #[arg(long, value_name = "FILE", value_delimiter = ',')]
    inputs: Vec<String>,
    /// Images of a set: the state is updated after each [default: all at once]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    images_per_set: Option<u32>,
    /// Cut a square around the object out of every image and bring it to this many pixels, a multiple of 8 [default: square images
    /// of 64, 128, 192 … pixels are shrunk as a whole to the 64 that the model was trained with, others are cut to 64]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(8..=4096))]
    crop_side: Option<u32>,
    /// Shrink the images by an integer factor, averaging blocks of pixels, and read them uncropped unless --crop-side is given; the sides must then be multiples of 8
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=16))]
    downscale: Option<u8>,
    /// Accept absolute paths and `..` in the files of a capture; only for files that you trust
    #[arg(long)]
    allow_outside: bool,
    /// Samples of a ray along the diagonal of the box
    #[arg(long, value_name = "N", default_value_t = 192, value_parser = clap::value_parser!(u32).range(1..=4096))]
    ray_samples: u32,
    /// 1/β, the largest density [default: that of the last step of the training]
    #[arg(long, value_name = "X")]
    inverse_beta: Option<f32>,
    /// Folder for the results; new or empty unless --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    filling: ForceArgs,
}

/// Reconstruct an object from a few images, without an optimisation.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight lirm gen --cameras test --size 128 --seed 2 --out unseen            an object, to try it on
  lastlight lirm reconstruct unseen/object_00000/uniform --inputs 0017,0025,0035,0043 --out r1
  lastlight lirm update r1 unseen/object_00000/uniform --inputs 0020,0029,0038,0046 --out r2
  lastlight lirm reconstruct photos --crop-side 64 --out r                      any capture with masks
  lastlight lirm reconstruct photos --crop-side 64 --model s3 --out r           with a model of lirm train
  lastlight field mesh r1 --out mesh.glb                                        as for a fitted field
  lastlight field eval r1 unseen/object_00000/uniform --mesh unseen/object_00000/object.glb

Written to --out: field.safetensors (for field mesh, relight and eval), state.safetensors (for lirm update; its size does not depend on the number of images), heldout/, result.json and report/index.html. Images need the object's foreground, as for field fit. Cameras may be pinhole or fisheye.")]
pub(crate) struct Args {
    /// Folder with transforms.json or a COLMAP model, or the transforms.json itself
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// Axes of the field [default: those that the model was trained with]
    #[arg(long, value_name = "NAME", value_parser = choices(POSES))]
    field_axes: Option<String>,
    /// Box that holds the object; the field is the cube around it [default: from the foreground, around the point nearest to the optical axes; for
    /// a single camera that point is one unit ahead]
    #[arg(long = "box", value_name = "X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true)]
    bounds: Option<String>,
    #[command(flatten)]
    common: Common,
}

/// Improve a reconstruction with more images.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight lirm update r1 unseen/object_00000/uniform --inputs 0020,0029,0038,0046 --out r2     after the first example of lirm reconstruct

The state must have been made by the same model. The box of the object stays that of the state.")]
pub(crate) struct UpdateArgs {
    /// State, or the folder of a reconstruction
    #[arg(value_name = "FILE")]
    state: PathBuf,
    /// Folder with transforms.json or a COLMAP model, or the transforms.json itself
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    #[command(flatten)]
    common: Common,
}

impl Common {
    /// The images to read: indices among those of the capture.
    fn chosen(&self, pictures: &Pictures) -> Result<Vec<usize>> {
        if self.inputs.is_empty() {
            return Ok(pictures.views.train.clone());
        }
        let all = &pictures.pictures;
        // A file name, with or without its extension.
        let ends = |name: &str, wanted: &str| {
            let path = Path::new(name);
            [path.file_name(), path.file_stem()].into_iter().flatten().any(|part| part == wanted)
        };
        let find = |wanted: &String| -> Result<usize> {
            if let Some(i) = all.iter().position(|p| p.name == *wanted) {
                return Ok(i);
            }
            let alike: Vec<usize> = (0..all.len()).filter(|i| ends(&all[*i].name, wanted)).collect();
            match alike[..] {
                [i] => Ok(i),
                [] => Err(Error::input("--inputs")
                    .expected(format!("names of images that the capture lists, such as {}", some(pictures)))
                    .got(wanted.clone())
                    .hint("images that are missing, and those of a transforms_val.json, are not read")),
                [a, b, ..] => Err(Error::input("--inputs")
                    .expected(format!("a name of one image: {} and {} end so", all[a].name, all[b].name))
                    .got(wanted.clone())),
            }
        };
        let found = self.inputs.iter().map(find).collect::<Result<Vec<usize>>>()?;
        if let Some(k) = (0..found.len()).find(|k| found[..*k].contains(&found[*k])) {
            let twice = all[found[k]].name.clone();
            return Err(Error::input("--inputs").expected("every image once").got(format!("{twice} twice")));
        }
        Ok(found)
    }

    /// Size of the images that are read.
    fn size(&self) -> Size {
        match (self.crop_side, self.downscale) {
            (Some(side), _) => Size::Cropped(side as usize),
            (None, Some(_)) => Size::Own,
            (None, None) => Size::Usual,
        }
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let pose = args.field_axes.as_deref().and_then(Pose::named);
    let cube = args.bounds.as_deref().map(read::cube).transpose()?;
    let own = [("box", json!(args.bounds)), ("field_axes", json!(args.field_axes))];
    made(&args.common, &args.capture, Start::Nothing(pose, cube), "lirm reconstruct", &own)
}

pub(super) fn update(args: &UpdateArgs) -> Result<()> {
    let before = State::read(&args.state).map_err(|e| match State::read(&args.capture) {
        Ok(_) => e.hint("the state is the first argument, the capture the second"),
        Err(_) => e,
    })?;
    let own = [("state", json!(args.state))];
    made(&args.common, &args.capture, Start::State(Box::new(before)), "lirm update", &own)
}

fn made(
    args: &Common,
    capture: &Path,
    start: Start,
    kind: &'static str,
    own: &[(&str, Value)],
) -> Result<()> {
    let mut meter = Meter::new();
    let (model, name) = weights::model(args.model.as_deref(), &meter)?;
    if let Some(side) = args.crop_side.filter(|side| !side.is_multiple_of(8)) {
        return Err(Error::input("--crop-side").expected("a multiple of 8").got(side.to_string()));
    }
    let inverse_beta = weights::inverse_beta(args.inverse_beta, &model)?;
    let options = read::options(args.downscale.unwrap_or(1), args.allow_outside);
    let exposure = match &start {
        Start::State(state) => state.exposure,
        Start::Nothing(..) => None,
    };
    let pictures = Pictures::load(capture, &options, exposure)?;
    missing::note(&pictures.views, &meter);
    let which = args.chosen(&pictures)?;
    if which.is_empty() {
        return Err(Error::input("capture").expected("at least one training image").got("none"));
    }
    let of_set = Ord::max(args.images_per_set.map_or(which.len(), |n| n as usize), 1);
    let mut settings = json!({
        "capture": capture, "model": name, "model_digest": digest(&model.params), "inputs": args.inputs, "images_per_set": args.images_per_set, "crop_side": args.crop_side,
        "downscale": args.downscale, "ray_samples": args.ray_samples, "inverse_beta": inverse_beta,
    });
    own.iter().for_each(|(name, value)| settings[*name] = value.clone());
    let reading = Reconstruction {
        model: &model,
        pictures: &pictures,
        sets: which.chunks(of_set).map(<[usize]>::to_vec).collect(),
        size: args.size(),
        rendering: Rendering::of_field(args.ray_samples as usize, inverse_beta),
    };
    let job = Job { kind, capture, reading, settings };
    let place = job.place(&start, &meter)?;
    let dir = claim::folder(&args.out, false, args.filling.force)?;
    let (_, outcome) = job.run(start, place, &dir, &mut meter)?;
    outcome.publish(&dir)
}
