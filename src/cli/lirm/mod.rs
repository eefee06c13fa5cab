//! `lirm gen`: data for the LIRM system. Arguments are turned into records of `lirm`; nothing is computed here.

mod r#gen;

use crate::Result;
use clap::Subcommand;

/// The LIRM system.
#[derive(Subcommand)]
pub(super) enum Command {
    /// Render training, test or egocentric data with known shape, materials and light
    Gen(Box<r#gen::Args>),
}

/// Runs one of them.
///
/// # Errors
/// Those of the command.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Gen(args) => r#gen::run(args),
    }
}
