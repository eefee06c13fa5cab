//! `last import`: published layouts into the one of persons.

use crate::choices::{Choices, choices};
use crate::claim;
use crate::console as cli;
use crate::io::captures::{self, LAYOUTS, Layout, Range, Selection};
use crate::io::smpl;
use crate::meter::Meter;
use crate::scene::person::import;
use crate::shared::ForceArgs;
use crate::units::counted;
use crate::{Error, Result};
use serde_json::json;
use std::path::PathBuf;

/// Values of `--layout`.
const LAYOUT_NAMES: &Choices = &[
    ("zju", "ZJU-MoCap as released"),
    ("zju-refine", "ZJU-MoCap with the refined cameras"),
    ("monocap", "MonoCap"),
    ("arah", "ARAH, 3DGS-Avatar"),
    ("people-snapshot", "PeopleSnapshot"),
    ("instant-avatar", "InstantAvatar's version of PeopleSnapshot"),
    ("anim-nerf", "3DGS-Avatar's version of PeopleSnapshot"),
    ("dna", "DNA-Rendering"),
];

/// Make a capture of a person from a data set in one of the published layouts.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last import CoreView_377 --out 377 --body SMPL_NEUTRAL.pkl
  lastlight last import CoreView_377 --layout zju-refine --out 377 --body SMPL_NEUTRAL.pkl
  lastlight last import people_snapshot/male-3-casual --out male --body SMPL_MALE.pkl
  lastlight last import 0012_09.smc --out dancer --body SMPLX_NEUTRAL.npz --train-frames 0:1:50

Layouts, recognised by their files unless --layout names one:
  zju              ZJU-MoCap as released          annots.npy, mask_cihp/, new_params/
  zju-refine       with the refined cameras       annots.npy, mask/, smpl_params/ or new_params/
  monocap          MonoCap                        the same in images/VIEW/FRAME.jpg; known by lan, marc, olek, vlad
  arah             ARAH, 3DGS-Avatar              cam_params.json, models/*.npz
  people-snapshot  PeopleSnapshot                 camera.pkl, masks.hdf5, reconstructed_poses.hdf5, images/ or an mp4
  instant-avatar   InstantAvatar's version of it  cameras.npz, poses.npz, images/, masks/
  anim-nerf        3DGS-Avatar's version of it    camera.pkl, animnerf_models/*.npz, image/, mask/
  dna              DNA-Rendering                  NAME.smc, NAME_annots.smc
Cameras, frames and reduction factor are by default those of the programs published with the data sets. Body models and data sets have their own licences. Pickles are parsed, never executed: a file that contains anything but arrays is refused.")]
pub(crate) struct Args {
    /// Folder of the data set's subject, or its .smc
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Folder for the capture; new or empty unless --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Layout [default: recognised by the files]
    #[arg(long, value_name = "NAME", value_parser = choices(LAYOUT_NAMES))]
    layout: Option<String>,
    /// Body model: SMPL or SMPL-X as .pkl or .npz, or ARAH's folder body_models/misc
    #[arg(long, value_name = "FILE")]
    body: Option<PathBuf>,
    /// Which body of a folder of several [default: as recorded in the layout, else neutral]
    #[arg(long, value_name = "NAME", value_parser = ["neutral", "female", "male"])]
    gender: Option<String>,
    /// Cameras to learn from, comma-separated or repeated
    #[arg(long, value_name = "N", value_delimiter = ',')]
    train_camera: Option<Vec<usize>>,
    /// Cameras held out, comma-separated or repeated
    #[arg(long, value_name = "N", value_delimiter = ',')]
    test_camera: Option<Vec<usize>>,
    /// Frames to learn from
    #[arg(long, value_name = "START:STEP:COUNT")]
    train_frames: Option<String>,
    /// Frames held out
    #[arg(long, value_name = "START:STEP:COUNT")]
    test_frames: Option<String>,
    /// Shrink images by a whole factor
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    downscale: Option<u16>,
    #[command(flatten)]
    replace: ForceArgs,
}

impl Args {
    fn layout(&self) -> Result<Layout> {
        if let Some(name) = &self.layout {
            return Layout::parse(name).map_err(|e| e.within("--layout"));
        }
        Layout::detect(&self.dir).ok_or_else(|| {
            let names: Vec<&str> = LAYOUTS.iter().map(|(n, _)| *n).collect();
            let got = if self.dir.exists() { "files of none of them" } else { "no such folder" };
            Error::input(self.dir.display().to_string())
                .expected(format!("a data set in one of the layouts {}", names.join(", ")))
                .got(got)
                .hint("see last import --help for the files of each layout")
        })
    }

    fn selection(&self) -> Result<Selection> {
        let range = |text: &Option<String>, option: &str| {
            text.as_deref().map(Range::parse).transpose().map_err(|e| e.within(option))
        };
        Ok(Selection {
            train_cameras: self.train_camera.clone(),
            test_cameras: self.test_camera.clone(),
            train_frames: range(&self.train_frames, "--train-frames")?,
            test_frames: range(&self.test_frames, "--test-frames")?,
        })
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let (layout, selection) = (args.layout()?, args.selection()?);
    claim::check(&args.out, false, args.replace.force)?;
    let source = captures::read(layout, &args.dir, &selection, args.gender.as_deref())?;
    let model = args.body.as_ref().map(|p| smpl::read(p, &source.gender)).transpose()?;
    let mut meter = Meter::new();
    let report = cli::stoppable(|stop| {
        let downscale = args.downscale.map(usize::from);
        import::write(&source, model.as_ref(), downscale, &args.out, stop, &mut |done, total| {
            if done == total {
                meter.done();
            } else {
                meter.count(done, total, "images");
            }
        })
    })?;
    meter.done();
    if cli::is_json() {
        return cli::say_json(&json!({
            "capture": args.out, "layout": layout.name(), "kind": source.kind, "train": report.shots[0], "test": report.shots[1],
            "moments": report.moments, "points": report.points, "joints": report.joints, "size": report.size, "notes": report.notes,
        }));
    }
    cli::say(&format!(
        "{}: {}, {} held out, {}x{}; {}, {} points, {} joints ({}, {:.1} s)",
        args.out.display(),
        counted(report.shots[0], "training image"),
        report.shots[1],
        report.size[0],
        report.size[1],
        counted(report.moments, "moment"),
        report.points,
        report.joints,
        layout.name(),
        meter.seconds()
    ))?;
    for note in &report.notes {
        cli::say(&format!("note: {note}"))?;
    }
    cli::say(&format!("check it with: lastlight last inspect {} --out check", args.out.display()))
}
