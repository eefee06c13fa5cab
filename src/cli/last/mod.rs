//! `last gen`: data with known causes. Arguments are turned into records of `last`, results into files; nothing is computed here.

mod generate;

use crate::Result;
use clap::Subcommand;

/// A person from a video, guided by a learned causal structure.
#[derive(Subcommand)]
pub(super) enum Command {
    /// Make pictures, points and a video of a person whose causes are known
    Gen(generate::Args),
}

/// Runs it.
///
/// # Errors
/// Those of the command.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Gen(args) => generate::run(args),
    }
}
