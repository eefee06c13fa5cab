//! `splat fit | render | eval`: plain Gaussian splatting of a static capture.
//!
//! Arguments are turned into records of `fit` and `scene`, results into files and reports; nothing is computed here. `demo` shares
//! the job of `fit`.

mod capture_args;
mod check;
mod eval;
pub(super) mod fit;
pub(super) mod missing;
mod render;
mod render_args;

pub(crate) use render::scene_file;

use crate::Result;
use clap::Subcommand;

/// Gaussian splatting of a static capture.
#[derive(Subcommand)]
pub(super) enum Command {
    /// Fit Gaussians to the photos of a capture
    Fit(fit::Args),
    /// Render a scene file along cameras
    Render(render::Args),
    /// Score a scene file on the photos of a capture
    Eval(eval::Args),
}

/// Runs one of the three.
///
/// # Errors
/// Those of the command.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Fit(args) => fit::run(args),
        Command::Render(args) => render::run(args),
        Command::Eval(args) => eval::run(args),
    }
}
