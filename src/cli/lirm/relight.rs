//! `lirm relight`: images of a reconstruction under new light, by way of its mesh, as `field relight` makes them.

use crate::Result;
use crate::field::mesh::FormArgs;
use crate::field::relight::write;
use crate::mesh::render::Images;
use std::path::PathBuf;

/// Render a reconstruction under new light, by way of its mesh.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight lirm relight r1 --env studio --cameras orbit:8 --out relit
  lastlight lirm relight r1 --env probe.exr --cameras object/uniform --out relit

The same as field relight. Materials require a model of stages 2a to 3. Without them the colour is used as base colour: it already contains the light of the images.")]
pub(crate) struct Args {
    /// Folder of lirm reconstruct or lirm update, or its field.safetensors
    #[arg(value_name = "FILE")]
    field: PathBuf,
    #[command(flatten)]
    images: Images,
    #[command(flatten)]
    form: FormArgs,
}

pub(super) fn run(args: &Args) -> Result<()> {
    write(&args.field, &args.images, &args.form)
}
