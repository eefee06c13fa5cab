//! `last render`: images of a fitted person in any pose from any camera.

use super::fit;
use crate::claim;
use crate::console as cli;
use crate::fit::render::capture_shots;
use crate::io::image_file;
use crate::meter::Meter;
use crate::num::order;
use crate::scene::camera::Camera;
use crate::scene::person::{PersonCapture, Pose};
use crate::shared::{DefaultArgs, ForceArgs, OrbitArgs};
use crate::{Error, Result};
use lastlight_last::avatar::store::{self, Stored};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Of an orbit.
const USUAL: DefaultArgs = DefaultArgs { size: [512, 512], fov: 40.0, elevation: 10.0 };

/// Render a fitted person in any pose from any camera.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last render person --out film                               every frame of its capture, its camera
  lastlight last render person --cameras orbit:60 --pose 40 --out turntable   one moment from all sides
  lastlight last render person --cameras orbit:100 --out both            frames and cameras advance together
  lastlight last render person --pose-from dancer/video --out dance      the poses of another capture, same body
  lastlight last render person --cameras 3 --out side                    camera 3 of the capture

Images are numbered. With one camera there is one image per pose, with one pose one per camera; otherwise the k-th image shows the k-th pose from the k-th camera. By default an orbit has images of 512x512 pixels, a field of view of 40° and an elevation of 10°.")]
pub(crate) struct Args {
    /// Folder of `last fit`, or an avatar.safetensors
    #[arg(value_name = "DIR")]
    run: PathBuf,
    /// Folder for the images; new or empty unless --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A camera's number in the capture, a capture folder or transforms.json, or orbit:N [default: the training camera]
    #[arg(long, value_name = "FROM")]
    cameras: Option<String>,
    /// Moments: one, or FIRST:LAST [default: all]
    #[arg(long, value_name = "FIRST:LAST")]
    pose: Option<String>,
    /// Take the poses of another capture of the same body
    #[arg(long, value_name = "DIR")]
    pose_from: Option<PathBuf>,
    #[command(flatten)]
    orbit: OrbitArgs,
    #[command(flatten)]
    replace: ForceArgs,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let stored = store::read(&fit::avatar_file(&args.run)?)?;
    let (poses, first) = poses(args, &stored)?;
    let cameras = cameras(args, &stored, &poses)?;
    let pairs = pairs(poses.len(), cameras.len())?;
    if let Some(note) = pairing(poses.len(), cameras.len()) {
        meter.note(&note);
    }
    let dir = claim::folder(&args.out, false, args.replace.force)?;
    let mut names = Vec::with_capacity(pairs.len());
    for (k, &(p, c)) in pairs.iter().enumerate() {
        meter.count(k, pairs.len(), "rendering");
        let camera = &cameras[c];
        let out = stored.picture(&poses[p], first.map(|t| t + p), camera)?;
        let image: Vec<f32> = out.image.iter().map(|&x| order::clamp(x, 0.0, 1.0)).collect();
        let name = format!("{k:04}.png");
        image_file::write_png(&dir.join(&name), camera.width, camera.height, 3, &image_file::to_u8(&image)?)?;
        names.push(name);
    }
    meter.done();
    if cli::is_json() {
        return cli::say_json(&json!({
            "run": args.run, "out": args.out, "images": names, "poses": poses.len(), "cameras": cameras.len(),
            "gaussians": stored.avatar.gaussians.len(), "seconds": meter.seconds(),
        }));
    }
    cli::say(&format!(
        "{} of {} Gaussians: {} ({:.1} images/s)",
        crate::units::counted(pairs.len(), "image"),
        stored.avatar.gaussians.len(),
        dir.display(),
        pairs.len() as f64 / meter.seconds()
    ))
}

/// The poses, and the moment of the first if they are those of the fit.
fn poses(args: &Args, stored: &Stored) -> Result<(Vec<Pose>, Option<usize>)> {
    let all = match &args.pose_from {
        None => stored.poses.clone(),
        Some(folder) => PersonCapture::open(folder)?.poses,
    };
    let joints = stored.avatar.body.joints();
    if let Some(other) = all.iter().find(|p| p.transforms.len() != joints) {
        return Err(Error::input("--pose-from")
            .expected(format!("a body of {joints} joints"))
            .got(other.transforms.len().to_string()));
    }
    let moment = |t: usize| args.pose_from.is_none().then_some(t);
    let Some(text) = &args.pose else { return Ok((all, moment(0))) };
    let wrong = || {
        let last = all.len().saturating_sub(1);
        Error::input("--pose").expected(format!("T or FIRST:LAST within 0 to {last}")).got(text.as_str())
    };
    let (first, last) = text.split_once(':').unwrap_or((text, text));
    let at = |s: &str| s.trim().parse::<usize>().map_err(|_| wrong());
    let (first, last) = (at(first)?, at(last)?);
    let some = if first > last { None } else { all.get(first..=last) };
    some.map(|p| (p.to_vec(), moment(first))).ok_or_else(wrong)
}

fn cameras(args: &Args, stored: &Stored, poses: &[Pose]) -> Result<Vec<Camera>> {
    let known: Vec<String> = stored.cameras.iter().map(|(n, _)| n.to_string()).collect();
    let none =
        || Error::input("--cameras").expected(format!("a camera of the capture: {}", known.join(", ")));
    let Some(from) = &args.cameras else {
        return stored.cameras.first().map(|(_, c)| vec![c.clone()]).ok_or_else(none);
    };
    if let Ok(number) = from.parse::<usize>() {
        let found = stored.cameras.iter().find(|(n, _)| *n == number);
        return found.map(|(_, c)| vec![c.clone()]).ok_or_else(|| none().got(from.as_str()));
    }
    if let Some(orbit) = args.orbit.parse(from, USUAL)? {
        return stored.around(orbit, poses);
    }
    Ok(capture_shots(Path::new(from), 1)?.into_iter().map(|s| s.camera).collect())
}

/// Which pose with which camera.
fn pairs(poses: usize, cameras: usize) -> Result<Vec<(usize, usize)>> {
    if poses == 0 || cameras == 0 {
        return Err(Error::input("last render").expected("a pose and a camera").got("none"));
    }
    Ok(match (poses, cameras) {
        (n, 1) => (0..n).map(|k| (k, 0)).collect(),
        (1, n) => (0..n).map(|k| (0, k)).collect(),
        (a, b) => (0..Ord::min(a, b)).map(|k| (k, k)).collect(),
    })
}

/// How unequal numbers of poses and cameras are paired, if neither is one.
fn pairing(poses: usize, cameras: usize) -> Option<String> {
    let least = Ord::min(poses, cameras);
    (least > 1 && poses != cameras).then(|| {
        let (more, how) = if cameras > poses {
            ("cameras", "--pose T renders one moment from all cameras")
        } else {
            ("poses", "--cameras orbit:N with as many views renders all of them")
        };
        format!(
            "{poses} poses and {cameras} cameras: image k shows pose k from camera k, {least} images in all, and the other {more} are not \
             used ({how})"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_and_cameras_go_together() {
        assert_eq!(pairs(3, 1).expect("some"), [(0, 0), (1, 0), (2, 0)], "one camera");
        assert_eq!(pairs(1, 2).expect("some"), [(0, 0), (0, 1)], "one pose");
        assert_eq!(pairs(3, 2).expect("some"), [(0, 0), (1, 1)], "side by side");
        assert_eq!((pairing(3, 1), pairing(1, 9), pairing(4, 4)), (None, None, None), "nothing is left out");
        let note = pairing(3, 9).expect("a note");
        assert!(note.starts_with("3 poses and 9 cameras") && note.contains("3 images"), "{note}");
        assert!(
            note.contains("other cameras") && pairing(9, 3).is_some_and(|n| n.contains("other poses")),
            "{note}"
        );
        assert!(pairs(0, 2).is_err(), "nothing to show");
    }
}
