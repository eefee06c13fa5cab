//! How a capture is read: the options of the commands that load its images.

use crate::meter::Meter;
use crate::report::thousands;
use crate::scene::views::{self, Views};
use std::path::PathBuf;

/// How masks are applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Masks {
    /// Masked pixels count neither in the loss nor in scores
    Ignore,
    /// Masked pixels get the background's colour, so that nothing grows there
    Background,
    /// Masks are not read
    Off,
}

/// How a capture is read.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct CaptureArgs {
    /// Shrink the images by a whole factor, averaging blocks of pixels
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    pub(super) downscale: u8,
    /// Refuse a capture with missing images instead of leaving those frames out
    #[arg(long)]
    strict: bool,
    /// How the masks of a capture are applied
    #[arg(long, value_enum, value_name = "NAME", default_value = "ignore")]
    masks: Masks,
    /// Folder of the images, in place of the one that the capture names
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
    /// Accept absolute paths and `..` in the files of a capture; only for files that you trust
    #[arg(long)]
    allow_outside: bool,
}

impl CaptureArgs {
    /// How images are loaded on this background.
    pub(super) fn options(&self, background: [f32; 3]) -> views::Options {
        views::Options {
            background,
            downscale: usize::from(self.downscale),
            strict: self.strict,
            masks: match self.masks {
                Masks::Ignore => views::Masks::Ignore,
                Masks::Background => views::Masks::Background,
                Masks::Off => views::Masks::Off,
            },
            images: self.images.clone(),
            outside: self.allow_outside,
        }
    }

    /// Notes on files that a capture lists and does not have, and on its masks.
    pub(super) fn note(&self, views: &Views, meter: &Meter) {
        super::missing::note(views, meter);
        if views.masked == 0 {
            return;
        }
        let (how, others) = match self.masks {
            Masks::Background => ("masked pixels are trained toward the background colour", "ignore|off"),
            _ => ("masked pixels count neither in the loss nor in scores", "background|off"),
        };
        meter.note(&format!(
            "masks: {} of {} images have one; {how} (--masks {others} changes it)",
            thousands(views.masked),
            thousands(views.views.len())
        ));
    }
}
