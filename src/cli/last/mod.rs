//! Commands of LAST. Arguments are turned into records, results into files; nothing is computed here.
//!
//! ```text
//! gen       data with known causes        import, inspect  captures of persons
//! pretrain  the image-to-point model      tune             its structure on one subject
//! intervene counterfactual images       fit              a person of Gaussians from a capture
//! render    a fitted person, any view     eval             its score on held-out images
//! graph_note  that the graph of a model has no edges
//! ```

mod eval;
pub(super) mod fit;
mod generate;
mod graph_note;
mod import;
mod inspect;
pub(super) mod intervene;
pub(super) mod pretrain;
mod render;
mod scoring;
mod study;
pub(super) mod tune;

use crate::Result;
use clap::Subcommand;

/// A person from a video, guided by a learned causal structure.
#[derive(Subcommand)]
pub(super) enum Command {
    /// Make images, points and a video of a person whose causes are known
    Gen(generate::Args),
    /// Train the image-to-point model on images of known causes
    Pretrain(pretrain::Args),
    /// Fine-tune a model's structure on the training images of one person
    Tune(tune::Args),
    /// Set one factor and see what changes and what does not
    Intervene(intervene::Args),
    /// Make a capture of a person from ZJU-MoCap, MonoCap, PeopleSnapshot, DNA-Rendering and the like
    Import(import::Args),
    /// Check a capture: what it holds, what is missing, skeleton and mask over its images
    Inspect(inspect::Args),
    /// Fit an animatable person to a monocular capture
    Fit(fit::Args),
    /// Render a fitted person in any pose from any camera
    Render(render::Args),
    /// Score a fitted person on the images of a capture
    Eval(eval::Args),
    /// Run the experiments: what the paper claims, what is found
    Study(study::Args),
}

/// Runs it.
///
/// # Errors
/// Those of the command.
pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Gen(args) => generate::run(args),
        Command::Pretrain(args) => pretrain::run(args),
        Command::Tune(args) => tune::run(args),
        Command::Intervene(args) => intervene::run(args),
        Command::Import(args) => import::run(args),
        Command::Inspect(args) => inspect::run(args),
        Command::Fit(args) => fit::run(args),
        Command::Render(args) => render::run(args),
        Command::Eval(args) => eval::run(args),
        Command::Study(args) => study::run(args),
    }
}
