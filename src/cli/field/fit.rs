//! `field fit`: a field from the images of one object.

use super::page::{self, Input};
use super::read;
use crate::claim;
use crate::fit::field::place::{around, placement, unit_ball};
use crate::fit::field::scores::means;
use crate::fit::field::shaded::reduced;
use crate::fit::field::targets::{Picture, Pictures};
use crate::fit::field::{Beta, FieldFit, HeadForm, Materials, Settings, score, view};
use crate::fit::render::flat_name;
use crate::fit::training::{Fit, Watch};
use crate::io::{image_file, memory};
use crate::light::MapArgs;
use crate::like::COMMAND;
use crate::loss::lpips::Metric;
use crate::meter::Meter;
use crate::report::run::Run;
use crate::scene::field::{Combine, FILE, Rule};
use crate::scene::views::SceneBox;
use crate::shared::{Outcome, OutputArgs};
use crate::splat::missing;
use crate::training::{self, CHECKPOINT, Frame, Head, RESULT};
use crate::units::counted;
use crate::{Error, Result, report};
use serde_json::{Value, json};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  lastlight field fit object/uniform --out fit             4 000 iterations, seven to nine minutes on two cores
  lastlight field fit --out fit --resume                   go on after an interruption, with the same options and bits
  lastlight field fit object/shiny --out fit --nde         colours that depend on the direction of view
  lastlight field fit photos/ --out fit --env probe.exr    materials by shading under a known light

DIR is a capture as for `splat fit`. Every image needs the object's foreground: an alpha channel, a mask, or a pass. With passes of albedo, material and normals (`lirm gen`, `mesh render`) materials are learned from them, otherwise by shading with direct light under --env or under a light that is learned.

--out DIR gets field.safetensors, checkpoint.safetensors, result.json, command.json (the options, for --resume), held-out renders, light.exr where a light was learned, and report/index.html.";

/// Fit a field to the images of one object.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Folder with transforms.json or a COLMAP model, or the transforms.json itself
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// Folder for the results; new or empty unless --resume or --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Iterations
    #[arg(long, value_name = "N", default_value_t = 4000)]
    iterations: usize,
    /// Number of planes: 6 (one per side of each axis) or 3
    #[arg(long, value_name = "N", default_value_t = 6)]
    planes: usize,
    /// Texels per side of a plane
    #[arg(long, value_name = "N", default_value_t = 128)]
    side: usize,
    /// Channels of a plane
    #[arg(long, value_name = "N", default_value_t = 16)]
    channels: usize,
    /// How the features of planes are combined
    #[arg(long, value_name = "NAME", default_value = "concat", value_parser = ["concat", "sum"])]
    combine: String,
    /// Networks: one per value, or one trunk for distance and colour (needs --rule midpoint)
    #[arg(long, value_name = "NAME", default_value = "separate", value_parser = ["separate", "trunk"])]
    heads: String,
    /// Colours read a directional embedding: what is seen depends on the reflected direction of view
    #[arg(long)]
    nde: bool,
    /// The embedding's colour does not read the cosine of normal and reflection (LIRM does not)
    #[arg(long, requires = "nde")]
    no_cosine: bool,
    /// Samples of a ray along the diagonal of the box
    #[arg(long, value_name = "N", default_value_t = 192)]
    ray_samples: usize,
    /// Where the density of a step is taken
    #[arg(long, value_name = "NAME", default_value = "analytic", value_parser = ["left", "midpoint", "analytic"])]
    rule: String,
    /// Pixels per side of a crop
    #[arg(long, value_name = "N", default_value_t = 32)]
    crop_side: usize,
    /// Crops per iteration
    #[arg(long, value_name = "N", default_value_t = 4)]
    crops: usize,
    /// Last 1/β, the largest density
    #[arg(long, value_name = "X", default_value_t = 200.0)]
    inverse_beta: f32,
    /// First 1/β
    #[arg(long, value_name = "X", default_value_t = 10.0)]
    first_inverse_beta: f32,
    /// Course of 1/β: linear, or learned like a weight (less stable, according to LIRM)
    #[arg(long, value_name = "NAME", default_value = "linear", value_parser = ["linear", "learned"])]
    beta: String,
    /// Where materials come from: auto takes passes where all images have them, else shaded, which reads no pass
    #[arg(long, value_name = "NAME", default_value = "auto", value_parser = ["auto", "off", "passes", "shaded"])]
    materials: String,
    /// Known light for --materials shaded: a panorama or the name of a built-in light, as for `mesh render` [default: the light is learned]
    #[arg(long, value_name = "FILE|NAME")]
    env: Option<String>,
    #[command(flatten)]
    map: MapArgs,
    /// Largest learning rate of planes and panoramas
    #[arg(long, value_name = "X", default_value_t = 0.01)]
    plane_rate: f64,
    /// Largest learning rate of networks
    #[arg(long, value_name = "X", default_value_t = 0.005)]
    network_rate: f64,
    /// Weight of the eikonal term, which keeps the gradient of the signed distance near length 1, such as 0.001
    #[arg(long, value_name = "X", default_value_t = 0.0)]
    eikonal: f32,
    /// Weight of the squared variation of planes; 0 removes it
    #[arg(long, value_name = "X", default_value_t = 2e-3)]
    variation: f32,
    /// Weight of the squared jump of the signed distance between the two sides of the centre planes, in texels; 0 removes it
    #[arg(long, value_name = "X", default_value_t = 1e-2)]
    seams: f32,
    /// Box that holds the object; the field is the cube around it [default: from the foreground]
    #[arg(long = "box", value_name = "X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true)]
    bounds: Option<String>,
    /// Rays whose gradients are in memory at once; changes no bit
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    chunk: u32,
    /// Weights of LPIPS for the loss; without them the structural similarity is used
    #[arg(long, value_name = "FILE")]
    lpips: Option<PathBuf>,
    /// Shrink the images by a whole factor, averaging blocks of pixels
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    downscale: u8,
    /// Accept absolute paths and `..` in the files of a capture; only for files that you trust
    #[arg(long)]
    allow_outside: bool,
    /// Iterations between checkpoints
    #[arg(long, value_name = "N", default_value_t = 250, value_parser = clap::value_parser!(u32).range(1..))]
    checkpoint_every: u32,
    #[command(flatten)]
    filling: OutputArgs,
}

impl Args {
    fn settings(&self, materials: Materials) -> Result<Settings> {
        let made = Settings {
            iterations: self.iterations,
            seed: self.filling.seed,
            planes: self.planes,
            side: self.side,
            channels: self.channels,
            combine: Combine::parse(&self.combine)?,
            heads: if self.heads == "trunk" { HeadForm::Trunk } else { HeadForm::Separate },
            embedding: self.nde,
            cosine: !self.no_cosine,
            samples: self.ray_samples,
            rule: Rule::parse(&self.rule)?,
            crop: self.crop_side,
            crops: self.crops,
            inverse_beta: [self.first_inverse_beta, self.inverse_beta],
            beta: if self.beta == "learned" { Beta::Learned } else { Beta::Linear },
            materials,
            rates: [self.plane_rate, self.network_rate],
            eikonal: self.eikonal,
            variation: self.variation,
            seams: self.seams,
            chunk: self.chunk as usize,
        };
        made.validate()?;
        Ok(made)
    }

    /// The materials of the option, where it does not depend on the images.
    fn given_materials(&self) -> Option<Materials> {
        match self.materials.as_str() {
            "off" => Some(Materials::Off),
            "passes" => Some(Materials::Passes),
            "shaded" => Some(Materials::Shaded),
            _ => None,
        }
    }

    fn cube(&self, pictures: &Pictures) -> Result<SceneBox> {
        if let Some(text) = &self.bounds {
            return read::cube(text);
        }
        let train: Vec<&Picture> = pictures.views.train.iter().map(|i| &pictures.pictures[*i]).collect();
        match pictures.is_unit_ball {
            true => Ok(unit_ball()),
            false => around(&train, pictures.views.scene_box.center),
        }
    }

    /// The known light in the units of the images.
    fn light(&self, exposure: f64) -> Result<Option<Vec<[f32; 3]>>> {
        let map = self.map.environment(self.env.as_deref(), self.filling.seed)?;
        Ok(map.map(|map| reduced(&map, exposure as f32)))
    }
}

/// The learned light as a file.
const LIGHT: &str = "light.exr";

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new().of("samples");
    let usual = args.settings(args.given_materials().unwrap_or_default())?;
    memory::check("field fit", usual.memory_estimate())
        .map_err(|e| e.hint("--side and --channels lower the estimate, --max-memory raises the limit"))?;
    claim::check(&args.out, args.filling.resume, args.filling.force)?;
    let pictures = Pictures::load(&args.capture, &read::options(args.downscale, args.allow_outside), None)?;
    let cube = args.cube(&pictures)?;
    let targets = pictures.targets(placement(&cube));
    let by_images = if targets.have_passes() { Materials::Passes } else { Materials::Shaded };
    let settings = args.settings(args.given_materials().unwrap_or(by_images))?;
    if args.env.is_some() && settings.materials != Materials::Shaded {
        return Err(Error::input("--env")
            .expected("--materials shaded, which uses a light")
            .got(format!("--materials {}", settings.materials.name())));
    }
    let lpips = args.lpips.as_deref().map(|path| Metric::load(path, true)).transpose()?;
    let light = args.light(targets.exposure)?;
    missing::note(&pictures.views, &meter);
    meter.lap("reading images");
    let [x, y, z] = cube.center;
    meter.note(&format!(
        "{}: {}, {} held out; box {x:.3},{y:.3},{z:.3} ± {:.3}; materials: {}",
        args.capture.display(),
        counted(targets.train.len(), "training image"),
        targets.test.len(),
        cube.half_size,
        settings.materials.name()
    ));
    let mut fit = FieldFit::new(settings, &targets, lpips.as_ref(), light)?;
    let frame = Frame::claim(&args.out, &args.filling, args.checkpoint_every)?;
    let (history, film) = frame.train(&mut fit, &mut meter)?;
    let field = fit.field();
    let digest = field.digest()?;
    if let Some(outcome) = frame.finished(&digest, &Fit::settings(&fit), &history, &[FILE]) {
        return outcome.publish(&frame.dir);
    }
    field.write(&frame.file(FILE))?;
    let mut names = vec![FILE.to_owned(), CHECKPOINT.to_owned(), COMMAND.to_owned()];
    if let Some(light) = fit.learned_light() {
        let bytes = light.as_flattened();
        image_file::write_exr(&frame.file(LIGHT), 32, 16, &["R", "G", "B"], bytes)?;
        names.push(LIGHT.to_owned());
    }
    let cells = view::occupancy(field)?;
    let scored = targets.test.iter().map(|t| score(field, &cells, t)).collect::<Result<Vec<_>>>()?;
    meter.lap("evaluation");
    names.extend(write_renders(&frame, &scored)?);
    let means = means(&scored);
    let all: Vec<Value> = scored.iter().map(|s| s.json()).collect();
    let own = training::entries([
        ("images", json!({"fitted": targets.train.len(), "held_out": targets.test.len()})),
        ("box", json!({"center": cube.center, "half_size": cube.half_size})),
        ("exposure", json!(targets.exposure)),
        ("evaluation", json!({"mean": means, "views": all})),
    ]);
    let head = Head { kind: "field fit", digest: &digest, settings: Fit::settings(&fit) };
    let record = frame.record(head, own, &history, &meter)?;
    names.push(RESULT.to_owned());
    meter.lap("writing files");
    let made = page::page(&Input {
        kind: "field fit",
        title: format!("Object from the images {}", crate::shared::name(&args.capture)),
        digest: Some(digest.clone()),
        means: &means,
        scored: &scored,
        read: &[],
        facts: shading(&record["settings"]),
        benchmark: None,
        run: Run {
            film: Some(&film),
            ..Run::new(&record["settings"], Some(&history), &meter, &frame.dir, &names)
        },
    })?;
    let held_out_db = means["psnr_db"].as_f64().unwrap_or(f64::NAN);
    let lines = vec![
        page::summary(&means),
        format!("digest      {digest}"),
        format!("time        {}", report::seconds(meter.seconds())),
        format!("field       {}", frame.file(FILE).display()),
        format!("next        lastlight field mesh {} --out mesh.glb", frame.dir.display()),
    ];
    Outcome { record, page: Some(made), lines, held_out_db }.publish(&frame.dir)
}

/// What shading leaves out, where materials are found by it.
fn shading(settings: &Value) -> Vec<(&'static str, String)> {
    let is_shaded = settings["materials"] == "shaded";
    let limits = "direct light, no shadows, no light from other surfaces";
    is_shaded.then(|| ("shading", limits.to_owned())).into_iter().collect()
}

/// Held-out renders as `heldout/NAME.png`; gives the names.
fn write_renders(frame: &Frame, scored: &[crate::fit::field::Scores]) -> Result<Vec<String>> {
    super::page::write_renders(&frame.dir, scored, &flat_name)
}
