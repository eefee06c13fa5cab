//! `lirm reconstruct` and `lirm update`: a field from a few images of an object, and a better one from more.

use super::init::POSES;
use crate::choices::choices;
use crate::field::{page, read};
use crate::fit::field::place::{Pose, around, placement, posed, unit_ball, upright};
use crate::fit::field::scores::means;
use crate::fit::field::targets::{Picture, Pictures};
use crate::fit::field::{score, view};
use crate::fit::render::flat_name;
use crate::fit::training::Watch;
use crate::io::{atomic, memory};
use crate::meter::Meter;
use crate::num::gemm::{Finish, View, gemm};
use crate::report::run::Run;
use crate::report::{self};
use crate::scene::camera::Camera;
use crate::scene::field::{FILE as FIELD, Placement};
use crate::shared::{ForceArgs, Outcome};
use crate::training::RESULT;
use crate::units::counted;
use crate::{Error, Result, claim, console as cli, version};
use lastlight_lirm::model::config::Config;
use lastlight_lirm::model::decode::Look;
use lastlight_lirm::model::file::{Model, digest};
use lastlight_lirm::model::params::count;
use lastlight_lirm::model::state::{FILE as STATE, State};
use lastlight_lirm::model::transformer::Input;
use lastlight_lirm::model::weights::Ready;
use lastlight_lirm::reading::inputs;
use lastlight_lirm::train::stage::last_inverse_beta;
use lastlight_lirm::views::Views;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Pixels per side of the images that a model is trained with.
const TRAINED: usize = 64;

/// Which images of a capture are read, and how the result is rendered.
#[derive(clap::Args)]
struct Common {
    /// Model, or the folder of a training
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Images to read, by name, comma-separated or repeated [default: all training images]
    #[arg(long, value_name = "FILE", value_delimiter = ',')]
    inputs: Vec<String>,
    /// Images of a set: the state is updated after each [default: all at once]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    images_per_set: Option<u32>,
    /// Cut a square around the object out of every image and bring it to this many pixels, a multiple of 8 [default: square images are
    /// shrunk as a whole to the 64 pixels that the model was trained with, others are cut to 64]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(8..=4096))]
    crop_side: Option<u32>,
    /// Shrink the images by a whole factor, averaging blocks of pixels, and read all of them
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=16))]
    downscale: Option<u8>,
    /// Accept absolute paths and `..` in the files of a capture; only for files that you trust
    #[arg(long)]
    allow_outside: bool,
    /// Steps of a ray along the diagonal of the box
    #[arg(long, value_name = "N", default_value_t = 192)]
    samples: usize,
    /// 1/β, the largest density [default: that at the end of the last stage of the model]
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
  lastlight lirm reconstruct object/uniform --model s1c --inputs 0018,0021,0040,0045 --out r1
  lastlight lirm update r1 object/uniform --model s1c --inputs 0020,0028,0041,0046 --out r2     with four more images
  lastlight lirm reconstruct photos --model s3 --crop-side 64 --out r           any capture with masks
  lastlight field mesh r1 --out mesh.glb                                        as for a fitted field
  lastlight field eval r1 object/uniform --mesh object/object.glb

Written to --out: field.safetensors (for field mesh, relight and eval), state.safetensors (for lirm update; its size does not depend on the number of images), heldout/, result.json and report/index.html. Images need the object's foreground, as for field fit. Cameras may be pinhole or fisheye.")]
pub(crate) struct Args {
    /// Folder with transforms.json or a COLMAP model, or the transforms.json itself
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// Axes of the field, which decide what the model is used to [default: those that the model was trained with]
    #[arg(long, value_name = "NAME", value_parser = choices(POSES))]
    field_axes: Option<String>,
    #[command(flatten)]
    common: Common,
}

/// Improve a reconstruction with more images.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight lirm update r1 object/uniform --model s1c --inputs 0020,0028,0041,0046 --out r2

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
        let stem = |name: &str| {
            let name = std::path::Path::new(name).file_stem().unwrap_or_default();
            name.to_string_lossy().into_owned()
        };
        let find = |wanted: &String| {
            let all = &pictures.pictures;
            let exact = all.iter().position(|p| p.name == *wanted);
            exact.or_else(|| all.iter().position(|p| stem(&p.name) == stem(wanted))).ok_or_else(|| {
                let first = all.first().map_or_else(String::new, |p| p.name.clone());
                Error::input("--inputs")
                    .expected(format!("names of the capture, such as {first}"))
                    .got(wanted.clone())
            })
        };
        self.inputs.iter().map(find).collect()
    }

    /// Images of the size that is read.
    fn sized(&self, views: Views) -> Result<Views> {
        match (self.crop_side, self.downscale) {
            (Some(side), _) => Ok(views.cropped(side as usize)),
            (None, Some(_)) => Ok(views),
            (None, None) => match views.square_factor(TRAINED) {
                Some(factor) => views.small(factor),
                None => Ok(views.cropped(TRAINED)),
            },
        }
    }

    /// The sets as inputs.
    fn sets(
        &self,
        pictures: &Pictures,
        which: &[usize],
        at: Placement,
        has_photo: bool,
    ) -> Result<Vec<Vec<Input>>> {
        let size = self.images_per_set.map_or(which.len(), |n| n as usize);
        let set = |some: &[usize]| {
            let views = Views::of_capture(pictures, some, at)?;
            inputs(&self.sized(views)?, has_photo)
        };
        which.chunks(Ord::max(size, 1)).map(set).collect()
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let pose = args.field_axes.as_deref().and_then(Pose::named);
    made(&args.common, &args.capture, Start::Nothing(pose), "lirm reconstruct")
}

pub(super) fn update(args: &UpdateArgs) -> Result<()> {
    let before = State::read(&args.state)?;
    made(&args.common, &args.capture, Start::State(Box::new(before)), "lirm update")
}

/// Rows, columns and inner numbers of the products by which the speed of the machine is measured.
const SAMPLE: usize = 512;
/// Floating-point operations from which the time is estimated before they start.
const LONG: f64 = 1e12;

/// Prints the size of the work before it starts; refuses what does not fit into the memory.
fn announce(config: &Config, sets: &[Vec<Input>], meter: &mut Meter) -> Result<()> {
    let tokens = |set: &Vec<Input>| set.iter().fold(0, |sum, x| sum + x.tokens());
    let most = sets.iter().map(tokens).fold(0, Ord::max);
    let (parameters, operations) =
        (count(config), sets.iter().fold(0.0, |sum, set| sum + config.flops(tokens(set))[0]));
    let bytes = config.memory(parameters, most);
    memory::check("lirm reconstruct", bytes).map_err(|e| {
        e.hint("--images-per-set and --downscale lower the estimate, --max-memory raises the limit")
    })?;
    let mut line = format!(
        "{parameters} parameters, {} tokens in the largest set, {:.1} GiB, {:.3} TFLOP",
        config.state_tokens() + most,
        bytes as f64 / f64::from(1 << 30),
        1e-12 * operations
    );
    if operations > LONG {
        let factor = vec![0.5; SAMPLE * SAMPLE];
        let mut product = vec![0.0; SAMPLE * SAMPLE];
        let of = || View::new(&factor, SAMPLE, SAMPLE);
        gemm(of(), of(), Finish::Store, &mut product);
        let before = meter.seconds();
        (0..4).for_each(|_| gemm(of(), of(), Finish::Store, &mut product));
        let rate = 8.0 * (SAMPLE * SAMPLE * SAMPLE) as f64 / (meter.seconds() - before);
        line += &format!(", about {} at {:.0} GFLOP/s", report::seconds(operations / rate), 1e-9 * rate);
    }
    meter.note(&line);
    Ok(())
}

/// Cosine of the largest angle between up in the images and z for which a capture is z up.
const LEVEL: f64 = 0.94;

/// The axes that the model was trained with, in a capture whose z may not be up.
fn own_pose(of_model: Pose, cameras: &[&Camera], meter: &Meter) -> Pose {
    match upright(cameras) {
        Some(up) if of_model == Pose::Azimuth && up[2] < LEVEL => {
            meter.note(&format!(
                "up in the images is ({:.2}, {:.2}, {:.2}), not z: the object is read with --field-axes upright",
                up[0], up[1], up[2]
            ));
            Pose::Upright
        }
        _ => of_model,
    }
}

/// What the first set is read after.
enum Start {
    /// With these axes, or those of the model.
    Nothing(Option<Pose>),
    State(Box<State>),
}

fn made(args: &Common, capture: &std::path::Path, start: Start, kind: &'static str) -> Result<()> {
    let (before, pose) = match start {
        Start::Nothing(pose) => (None, pose),
        Start::State(state) => (Some(*state), None),
    };
    let mut meter = Meter::new();
    let model = Model::read(&args.model)?;
    let own = digest(&model.params);
    if let Some(state) = before.as_ref().filter(|s| s.config != model.config || s.model != own) {
        return Err(Error::input("--model")
            .at(args.model.display().to_string())
            .expected(format!("the model of the state, with the digest {}", state.model))
            .got(own));
    }
    if let Some(side) = args.crop_side.filter(|side| !side.is_multiple_of(8)) {
        return Err(Error::input("--crop-side").expected("a multiple of 8").got(side.to_string()));
    }
    let options = read::options(args.downscale.unwrap_or(1), args.allow_outside);
    let pictures = Pictures::load(capture, &options, before.as_ref().map(|s| s.exposure))?;
    let which = args.chosen(&pictures)?;
    if which.is_empty() {
        return Err(Error::input("capture").expected("at least one training image").got("none"));
    }
    let place = match &before {
        Some(state) => state.placement,
        None => {
            let read: Vec<&Picture> = which.iter().map(|i| &pictures.pictures[*i]).collect();
            let scene = match pictures.is_unit_ball {
                true => unit_ball(),
                false => around(&read, pictures.views.scene_box.center)?,
            };
            let cameras: Vec<&Camera> = read.iter().map(|p| &p.camera).collect();
            let pose = pose.unwrap_or_else(|| own_pose(model.config.pose, &cameras, &meter));
            posed(placement(&scene), pose, &cameras)?
        }
    };
    let dir = claim::folder(&args.out, false, args.filling.force)?;
    meter.lap("reading");
    let sets = args.sets(&pictures, &which, place, model.config.is_whole)?;
    meter.lap("inputs");
    announce(&model.config, &sets, &mut meter)?;
    let ready = Ready::new(model.config, &model.params);
    let start = before.as_ref().map_or_else(|| ready.no_state(), |s| s.tokens.clone());
    let tokens = ready.read_all(&start, &sets);
    meter.lap("transformer");
    let look =
        Look::of_field(args.samples, args.inverse_beta.unwrap_or_else(|| last_inverse_beta(&model.stages)));
    let field = ready.decode(&tokens, look, place);
    meter.lap("decoding");
    let mut read_so_far = before.map_or_else(Vec::new, |s| s.sets);
    read_so_far.extend(sets.iter().map(Vec::len));
    let state = State {
        tokens,
        placement: place,
        config: model.config,
        model: own,
        sets: read_so_far,
        exposure: pictures.exposure,
    };
    state.write(&dir.join(STATE))?;
    field.write(&dir.join(FIELD))?;
    let targets = pictures.targets(place);
    let cells = view::occupancy(&field)?;
    let scored = targets.test.iter().map(|t| score(&field, &cells, t)).collect::<Result<Vec<_>>>()?;
    meter.lap("evaluation");
    let mut names = vec![FIELD.to_owned(), STATE.to_owned(), RESULT.to_owned()];
    names.extend(page::write_renders(&dir, &scored, &flat_name)?);
    let means = means(&scored);
    let views: Vec<Value> = scored.iter().map(|s| s.json()).collect();
    let digest = field.digest()?;
    let settings = json!({
        "capture": capture, "model": args.model, "inputs": args.inputs, "images_per_set": args.images_per_set, "crop_side": args.crop_side,
        "downscale": args.downscale, "samples": args.samples, "inverse_beta": look.inverse_beta,
    });
    let record = json!({
        "kind": kind, "lastlight": env!("CARGO_PKG_VERSION"), "digest": digest, "sets": state.sets, "exposure": state.exposure,
        "arguments": cli::arguments(), "build": version::record(), "settings": settings, "seconds": meter.seconds(),
        "evaluation": {"mean": means, "views": views},
    });
    atomic::write_bytes(&dir.join(RESULT), format!("{record:#}\n").as_bytes())?;
    let images = which.len();
    let made = page::page(&page::Input {
        kind,
        title: format!("Object from {} of {}", counted(images, "image"), crate::shared::name(capture)),
        digest: Some(digest.clone()),
        means: &means,
        scored: &scored,
        benchmark: None,
        run: Run::new(&record["settings"], None, &meter, &dir, &names),
    })?;
    let held_out_db = means["psnr_db"].as_f64().unwrap_or(f64::NAN);
    let lines = vec![
        page::summary(&means),
        format!("images      {images} in {}", counted(sets.len(), "set")),
        format!("digest      {digest}"),
        format!("time        {}", report::seconds(meter.seconds())),
        format!("field       {}", dir.join(FIELD).display()),
        format!("next        lastlight field mesh {} --out mesh.glb", dir.display()),
    ];
    Outcome { record, page: Some(made), lines, held_out_db }.publish(&dir)
}
