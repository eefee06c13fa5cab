//! Commands of LIRM: data (`gen`), first values (`init`), the stages of a training (`train`), a field from images
//! (`reconstruct`, `update`), images of it under new light (`relight`), scores of a model (`eval`), experiments (`study`). Arguments are turned into records of `lirm`; nothing is computed here.

mod eval;
mod r#gen;
mod init;
pub(super) mod job;
mod reconstruct;
mod relight;
mod study;
mod train;
pub(super) mod weights;

use crate::Result;
use clap::Subcommand;

/// The LIRM system.
#[derive(Subcommand)]
pub(super) enum Command {
    /// Render training, test or egocentric data with known shape, materials and light
    Gen(Box<r#gen::Args>),
    /// Write a model with first values
    Init(init::Args),
    /// Train one stage of a model on built-in objects
    Train(Box<train::Args>),
    /// Reconstruct an object from a few images
    Reconstruct(Box<reconstruct::Args>),
    /// Improve a reconstruction with more images
    Update(Box<reconstruct::UpdateArgs>),
    /// Render a reconstruction under new light
    Relight(Box<relight::Args>),
    /// Score a model on built-in objects, after every set of images
    Eval(Box<eval::Args>),
    /// Run the experiments: the paper's claims against measurements
    Study(Box<study::Args>),
}

/// Runs one of them.
///
/// # Errors
/// Those of the command.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Gen(args) => r#gen::run(args),
        Command::Init(args) => init::run(args),
        Command::Train(args) => train::run(args),
        Command::Reconstruct(args) => reconstruct::run(args),
        Command::Update(args) => reconstruct::update(args),
        Command::Relight(args) => relight::run(args),
        Command::Eval(args) => eval::run(args),
        Command::Study(args) => study::run(args),
    }
}
