//! `field import`: published captures of one object into images with passes.

use crate::Result;
use crate::choices::{Choices, choices};
use crate::claim;
use crate::console as cli;
use crate::io::objects::{self, Axes};
use crate::meter::Meter;
use crate::scene::environment_file::Orientation;
use crate::scene::object::{self, Options};
use crate::shared::ForceArgs;
use crate::units::counted;
use serde_json::json;
use std::path::PathBuf;

/// Values of `--probe-axes`.
const PROBE_AXES: &Choices = &[
    ("orb", "of Stanford-ORB, in the axes of the image's camera"),
    ("ours", "centre column looks along +y, z up"),
    ("mitsuba", "of Mitsuba's envmap"),
    ("nvdiffrec", "of nvdiffrec"),
    ("blender", "of Blender's world texture"),
];

/// Values of `--normals`.
const NORMALS: &Choices =
    &[("camera", "x right, y up, z backward in the axes of the camera"), ("world", "axes of the world")];

/// Make a capture of one object from a data set in a published layout.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight field import orb/blender_LDR/teapot_scene001 --out teapot
  lastlight field fit teapot --out fit
  lastlight field eval fit teapot --mesh teapot/scan.glb
  lastlight field eval fit teapot/transforms_novel.json --relight --split all --out relit
  lastlight field import BirdHouse --out birdhouse

Layouts, recognised by their files:
  Stanford-ORB   blender_LDR/NAME and blender_HDR/NAME: transforms_train.json, transforms_test.json, transforms_novel.json, train/, train_mask/, test/, test_mask/; beside them ground_truth/NAME: env_map, surface_normal, z_depth, pseudo_gt_albedo, mesh_blender/mesh.obj
  DTC renders    images/CameraRig.json, images/image_process_info.json, images/rgb/: rgb0000000.png, mask0000000.png, and depth, normal (EXR), albedo, metallic_roughness (PNG)

--out is a capture as for `field fit`: images/, foreground/, and where the set has them radiance/, depth/, normal/, albedo/, material/ and environment/ (maps in this program's orientation, in the axes of the world), with transforms_train.json and transforms_test.json, or transforms.json for a set without a split; images under another light are listed in transforms_novel.json; scan.glb is the true surface. Larger images are reduced to 512 pixels, as Stanford-ORB scores them. Normals that do not face the cameras, missing files, and sizes or numbers of entries that disagree are refused.")]
pub(crate) struct Args {
    /// Folder of the object in the data set
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Folder for the capture; new or empty unless --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Shrink images by a whole factor [default: to 512 pixels where that divides the larger side]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=64))]
    downscale: Option<u8>,
    /// Axes of the normals [default: camera for Stanford-ORB, world for DTC renders]
    #[arg(long, value_name = "NAME", value_parser = choices(NORMALS))]
    normals: Option<String>,
    /// Orientation of the environment maps
    #[arg(long, value_name = "NAME", default_value = "orb", value_parser = choices(PROBE_AXES))]
    probe_axes: String,
    /// The environment maps are mirror images
    #[arg(long)]
    probe_mirror: bool,
    #[command(flatten)]
    replace: ForceArgs,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let options = Options {
        downscale: args.downscale.map(usize::from),
        normals: args.normals.as_deref().map(|n| if n == "world" { Axes::World } else { Axes::Camera }),
        probe: Some(Orientation::parse(&args.probe_axes)?),
        probe_mirror: args.probe_mirror,
    };
    claim::check(&args.out, false, args.replace.force)?;
    let set = objects::read(&args.dir)?;
    let report = cli::stoppable(|stop| {
        object::write(&set, &options, &args.out, stop, &mut |done, total| meter.count(done, total, "images"))
    })?;
    meter.done();
    let [train, test, own, novel] = report.images;
    if cli::is_json() {
        return cli::say_json(&json!({
            "capture": args.out, "layout": set.layout.name(), "train": train, "test": test, "unsplit": own, "novel_light": novel,
            "size": report.size, "passes": report.passes, "scan": report.scan, "seconds": meter.seconds(),
        }));
    }
    cli::say(&format!(
        "{}: {}, {test} held out, {novel} under another light, {}x{}; passes: {}{} ({}, {:.1} s)",
        args.out.display(),
        counted(train + own, "image"),
        report.size[0],
        report.size[1],
        if report.passes.is_empty() { "none".to_owned() } else { report.passes.join(", ") },
        if report.scan { "; scan.glb" } else { "" },
        set.layout.name(),
        meter.seconds()
    ))
}
