//! `last inspect`: what a person's capture holds and what is missing.

use crate::claim;
use crate::console as cli;
use crate::io::captures::Layout;
use crate::io::person;
use crate::{Error, Result};
use lastlight_last::inspect::{self, Report};
use serde_json::json;
use std::path::PathBuf;

/// Check a capture of a person for missing or inconsistent data.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last inspect data/video                       list missing or inconsistent data
  lastlight last inspect data/video --out check           also draw skeleton, mask and box over frames

Green is the outline of the mask, yellow and red are bones and joints, blue is the box in which metrics are computed. 'points on mask' is the fraction of the template's points that project onto the mask; a small value means that poses, cameras and images are inconsistent. Exit code 1 when required data is missing or wrong; every problem is listed. last import converts captures in published layouts to this one.")]
pub(crate) struct Args {
    /// Folder with transforms_train.json and body.npz, or one with such a folder 'video'
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// Folder for the images; new or empty unless --force
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of training images to draw
    #[arg(long, value_name = "N", default_value_t = 4)]
    max_images: usize,
    /// Replace existing results
    #[arg(long)]
    force: bool,
}

/// Problems printed.
const SHOWN: usize = 20;

pub(super) fn run(args: &Args) -> Result<()> {
    if !person::is_person(&args.capture)
        && let Some(layout) = Layout::detect(&args.capture)
    {
        return Err(Error::input(args.capture.display().to_string())
            .expected("a person's capture, with transforms_train.json and body.npz")
            .got(format!("the layout {}", layout.name()))
            .hint(format!(
                "{} last import {} --out DIR makes one of it",
                cli::program(),
                args.capture.display()
            )));
    }
    if let Some(out) = &args.out {
        claim::check(out, false, args.force)?;
    }
    let report = inspect::inspect(&args.capture, args.max_images)?;
    let pictures = match &args.out {
        Some(out) => report.write(&claim::folder(out, false, args.force)?)?,
        None => Vec::new(),
    };
    if cli::is_json() {
        let mut record = report.record();
        record["images"] = json!(pictures);
        cli::say_json(&record)?;
    } else {
        for line in lines(args, &report) {
            cli::say(&line)?;
        }
    }
    match report.problems.len() {
        0 => Ok(()),
        n => Err(Error::check("last inspect")
            .at(args.capture.display().to_string())
            .expected("nothing that is needed to be missing or wrong")
            .got(format!("{n} {}", if n == 1 { "problem" } else { "problems" }))),
    }
}

fn lines(args: &Args, report: &Report) -> Vec<String> {
    let mut out = Vec::new();
    if let Some(c) = &report.capture {
        let t = &c.template;
        let record = report.record();
        let count = |key: &str| record[key].as_array().map_or(0, Vec::len);
        let sizes: Vec<String> = (record["sizes"].as_array().into_iter().flatten())
            .map(|s| format!("{}x{}", s[0], s[1]))
            .collect();
        out.push(format!("{}: {}", c.folder.display(), t.kind.name()));
        out.push(format!(
            "body      {} points, {} faces, {} joints, {} m per unit{}",
            t.len(),
            t.faces.len(),
            t.joints.len(),
            t.unit_m,
            if t.pose_shapes.is_some() { ", pose shapes" } else { "" }
        ));
        out.push(format!(
            "images  {} to learn from, {} held out; {} cameras, {} moments, {}",
            c.train.len(),
            c.test.len(),
            count("cameras"),
            c.moments(),
            sizes.join(", ")
        ));
        if let Some(f) = c.factors.first() {
            out.push(format!("causes    {} factors are known", f.len()));
        }
    }
    if !report.images.is_empty() {
        out.push(format!(
            "{:<28} {:>6} {:>6} {:>15} {:>12}",
            "checked", "camera", "moment", "points on mask", "mask in box"
        ));
        for l in &report.images {
            out.push(format!(
                "{:<28} {:>6} {:>6} {:>14.1}% {:>11.1}%",
                l.name,
                l.camera,
                l.time,
                100.0 * l.on_mask,
                100.0 * l.in_box
            ));
        }
    }
    out.extend(report.notes.iter().map(|n| format!("note      {n}")));
    let problems = report.problems.iter().take(SHOWN);
    out.extend(problems.map(|e| format!("problem   {}", cli::one_line(&e.to_string()))));
    if let Some(more) = report.problems.len().checked_sub(SHOWN).filter(|n| *n > 0) {
        out.push(format!("problem   and {more} more, which --json lists"));
    }
    match &args.out {
        Some(dir) => out.push(format!("{} images in {}", report.images.len(), dir.display())),
        None if !report.images.is_empty() => {
            out.push("--out DIR writes images with skeleton and mask".to_owned())
        }
        None => {}
    }
    out
}
