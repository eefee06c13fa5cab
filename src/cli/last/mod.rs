//! `last gen | fit | render | eval`: data with known causes, and a person fitted to a video. Arguments are turned into records of `last`, results
//! into files and reports; nothing is computed here.

mod eval;
pub(super) mod fit;
mod generate;
mod render;
mod scoring;

use crate::Result;
use clap::Subcommand;

/// A person from a video, guided by a learned causal structure.
#[derive(Subcommand)]
#[expect(clippy::large_enum_variant, reason = "parsed once, moved once")]
pub(super) enum Command {
    /// Make pictures, points and a video of a person whose causes are known
    Gen(generate::Args),
    /// Fit an animatable person to a monocular capture
    Fit(fit::Args),
    /// Render a fitted person in any pose from any camera
    Render(render::Args),
    /// Score a fitted person on the pictures of a capture
    Eval(eval::Args),
}

/// Runs it.
///
/// # Errors
/// Those of the command.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Gen(args) => generate::run(args),
        Command::Fit(args) => fit::run(args),
        Command::Render(args) => render::run(args),
        Command::Eval(args) => eval::run(args),
    }
}
