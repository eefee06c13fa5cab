//! `field fit | eval | mesh | relight | import`: one object as a field, from posed images to a relightable mesh.
//!
//! Arguments are turned into records of `fit::field`, results into files and reports; nothing is computed here.

mod eval;
mod fit;
mod import;
pub(super) mod mesh;
pub(super) mod page;
pub(super) mod read;
pub(super) mod relight;
pub(super) mod scoring;

use crate::Result;
use clap::Subcommand;

/// One object as a field.
#[derive(Subcommand)]
pub(super) enum Command {
    /// Fit a field to the images of one object
    Fit(fit::Args),
    /// Score a field on the images of a capture
    Eval(eval::Args),
    /// Make a textured mesh of a field
    Mesh(mesh::Args),
    /// Render a field under new light
    Relight(Box<relight::Args>),
    /// Make a capture of one object from a data set in a published layout
    Import(import::Args),
}

/// Runs one of them.
///
/// # Errors
/// Those of the command.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Fit(args) => fit::run(args),
        Command::Eval(args) => eval::run(args),
        Command::Mesh(args) => mesh::run(args),
        Command::Relight(args) => relight::run(args),
        Command::Import(args) => import::run(args),
    }
}
