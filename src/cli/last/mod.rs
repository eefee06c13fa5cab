//! `last gen`: data with known causes. `last pretrain`: the image-to-point model. Arguments are turned into records of `last`, results into files; nothing is computed here.

mod generate;
mod pretrain;

use crate::Result;
use clap::Subcommand;

/// A person from a video, guided by a learned causal structure.
#[derive(Subcommand)]
pub(super) enum Command {
    /// Make pictures, points and a video of a person whose causes are known
    Gen(generate::Args),
    /// Train the image-to-point model on pictures of known causes
    Pretrain(pretrain::Args),
}

/// Runs it.
///
/// # Errors
/// Those of the command.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Gen(args) => generate::run(args),
        Command::Pretrain(args) => pretrain::run(args),
    }
}
