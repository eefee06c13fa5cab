//! `last gen | import | inspect`: captures of persons. Arguments are turned into records, results into files; nothing is computed here.

mod generate;
mod import;
mod inspect;

use crate::Result;
use clap::Subcommand;

/// A person from a video, guided by a learned causal structure.
#[derive(Subcommand)]
#[expect(clippy::large_enum_variant, reason = "parsed once, moved once")]
pub(super) enum Command {
    /// Make pictures, points and a video of a person whose causes are known
    Gen(generate::Args),
    /// Make a capture of a person from ZJU-MoCap, MonoCap, PeopleSnapshot, DNA-Rendering and the like
    Import(import::Args),
    /// Check a capture: what it holds, what is missing, skeleton and mask over its pictures
    Inspect(inspect::Args),
}

/// Runs it.
///
/// # Errors
/// Those of the command.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Gen(args) => generate::run(args),
        Command::Import(args) => import::run(args),
        Command::Inspect(args) => inspect::run(args),
    }
}
