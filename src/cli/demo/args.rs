//! Arguments of `demo`.

use crate::choices::{self, Choices, choices};
use std::path::PathBuf;

/// Values of `--only`.
const PARTS: &Choices = &[("last", "the person"), ("lirm", "the object"), ("splat", "the scene")];

fn person_size(text: &str) -> Result<usize, String> {
    let side = choices::square(text)?;
    if (32..=1024).contains(&side) {
        Ok(side)
    } else {
        Err("expected a side of 32 to 1024 pixels".to_owned())
    }
}

/// Fit a built-in person from a video, reconstruct a built-in object and fit a built-in scene from images; one report with images.
///
/// A person is filmed by one camera; the image-to-point model that comes with the program adapts its causal structure
/// to the video and guides the fit of an animatable person of Gaussians; images that were held out are compared, the
/// person is shown from the front half, and one factor after the other is set. An object that the included model of LIRM has
/// not been trained with is reconstructed from four images, then from four more, and shown under another light. Then new
/// Gaussians are fitted to rendered images of a scene of known Gaussians. Takes about a minute on two cores and needs no input.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight demo
  lastlight demo --only last --size 160 --iterations 1200     the person alone, larger and longer
  lastlight demo --only lirm                                  the object alone
  lastlight demo --model s3                                   the object by a model of lirm train
  lastlight demo --only splat --out /tmp/demo --seed 1")]
pub(crate) struct Args {
    /// Folder for the results [default: demo; an earlier demo there is replaced]
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// One part alone
    #[arg(long, value_name = "NAME", value_parser = choices(PARTS))]
    pub(super) only: Option<String>,
    /// LIRM model, or the folder of a training, that reconstructs the object [default: the included model, whose training is
    /// unfinished]
    #[arg(long, value_name = "FILE")]
    pub(super) model: Option<PathBuf>,
    /// Iterations of a fit [default: 400 for the person, 1200 for the scene]
    #[arg(long, value_name = "N")]
    pub(super) iterations: Option<usize>,
    /// Size of the person's images, which are square: S, or SxS, 32 to 1024
    #[arg(long, value_name = "S|WxH", default_value = "96", value_parser = person_size)]
    pub(super) size: usize,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,
    /// Replace existing results
    #[arg(long)]
    pub(super) force: bool,
}
