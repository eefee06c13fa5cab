//! `convert`: scenes of Gaussians between file formats.

use super::{claim, report};
use crate::Result;
use crate::scene::convert::{SceneFormat, convert_with};
use crate::shared::{SceneArgs, dropped_text};
use crate::splat::scene_file;
use serde_json::json;
use std::path::PathBuf;

/// Convert a scene of Gaussians between .ply, .splat and .npz.
///
/// The formats are recognised by their extensions. A 3DGS PLY and an NPZ hold everything; .splat keeps 8 bits of
/// colour, opacity and rotation and no view dependence, so a scene read from it differs.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight convert scene.ply scene.splat
  lastlight convert fox/ fox.npz                            the scene of a fit
  lastlight convert scene.npz scene.ply --force
  lastlight convert theirs.ply clean.ply --drop-invalid     without Gaussians that hold NaN or a zero quaternion")]
pub(super) struct Args {
    /// Scene to read: .ply, .splat or .npz, or the folder of a fit
    #[arg(value_name = "FILE")]
    input: PathBuf,
    /// Scene to write: .ply, .splat or .npz
    #[arg(value_name = "FILE")]
    output: PathBuf,
    /// Replace existing results
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    reading: SceneArgs,
}

pub(super) fn run(args: &Args) -> Result<()> {
    SceneFormat::of(&args.output)?;
    claim::file(&args.output, args.force)?;
    let input = scene_file(&args.input)?;
    let (scene, dropped) = convert_with(&input, &args.output, args.reading.invalid())?;
    if dropped > 0 && !crate::console::is_quiet() {
        crate::console::note(&dropped_text(dropped, dropped + scene.len()));
    }
    // A .splat file holds one colour per Gaussian.
    let written = if SceneFormat::of(&args.output)? == SceneFormat::Splat { 0 } else { scene.sh_degree };
    if written < scene.sh_degree && !crate::console::is_quiet() {
        crate::console::note(&format!(
            "a .splat file has no view-dependent colour: SH degree {} is reduced to {written}",
            scene.sh_degree
        ));
    }
    let size = std::fs::metadata(&args.output).map_or(0, |m| m.len());
    if crate::console::is_json() {
        crate::console::say_json(&json!({
            "input": args.input, "output": args.output, "gaussians": scene.len(), "sh_degree": scene.sh_degree, "sh_degree_written": written, "bytes": size, "dropped": dropped,
        }))
    } else {
        crate::console::say(&format!(
            "{} Gaussian{}, SH degree {written}: {} ({})",
            report::thousands(scene.len()),
            if scene.len() == 1 { "" } else { "s" },
            args.output.display(),
            report::bytes(size)
        ))
    }
}
