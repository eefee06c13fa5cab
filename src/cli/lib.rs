//! Commands, progress, reports. Level 13: the only place that prints, reads the clock, and knows exit codes.
//!
//! ```text
//! main ──► dispatch ──► demo      a built-in person by LAST, a built-in scene
//!                       splat     fit | render | eval on captures and scene files
//!                       last      gen: data with known causes; import, inspect: captures of persons
//!                       mesh      render | compare glTF and OBJ
//!                       lirm      gen: rendered objects to learn from
//!                       oracle    run, list, compare, mint operators        gradcheck   check gradients
//!                       convert   between scene files                       doctor      is this machine set up
//! meter     progress and timing: the `Watch` of every fit        claim     the rule for existing outputs
//! console   stdout, interruption, the command line as typed   units     seconds and bytes for people
//! training  the frame of every command that trains        experiments  the study engine with progress and reports
//! shared    arguments that several commands have             report/   self-contained HTML
//! ```
//!
//! Exit codes: 0 done, 1 the check failed, 2 bad usage or input, 130 interrupted. Errors are one line on stderr;
//! results go to stdout, as text or with `--json` as one JSON document; everything else goes to stderr.
#![forbid(unsafe_code)]
// They panic when a stream is closed; `console` has what does not.
#![warn(clippy::print_stdout, clippy::print_stderr)]

mod claim;
mod console;
mod convert;
mod demo;
mod doctor;
mod experiments;
pub mod gradcheck;
mod last;
mod lirm;
mod mesh;
mod meter;
pub mod oracle;
mod report;
mod shared;
mod splat;
mod training;
mod units;

use lastlight_import::{io, scene};
use lastlight_kernels::{geometry, loss, shade};
use lastlight_num::{Error, Result, num};
use lastlight_train::{experiment, fit};

use crate::num::par;
use clap::{Parser, Subcommand};
use std::io::ErrorKind;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  lastlight demo                                    a person and a scene end to end, with a report
  lastlight splat fit photos/ --out fox             Gaussians from posed photographs
  lastlight splat render fox/scene.ply --cameras orbit:60 --out turntable
  lastlight splat eval fox/scene.ply photos/        PSNR and SSIM on the held-out photographs
  lastlight oracle list                             operators that can be run on your arrays
  lastlight convert fox/scene.ply fox.splat
  lastlight doctor

Every result is a pure function of the input and the seed: the same bits for any number of threads.
Exit codes: 0 done, 1 the check failed, 2 bad usage or input, 130 interrupted (continue with --resume).";

/// CPU reference for differentiable rendering with bit-for-bit reproducible results.
#[derive(Parser)]
#[command(name = "lastlight", version, about = "Bit-reproducible CPU reference of two differentiable-rendering systems, LAST and LIRM", after_help = EXAMPLES, max_term_width = 110, propagate_version = true)]
struct Cli {
    /// Number of threads [default: all cores]; results do not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
#[expect(clippy::large_enum_variant, reason = "parsed once, moved once")]
enum Command {
    /// Fit a built-in person from a video and a built-in scene from photographs; one report with images
    Demo(demo::Args),
    /// Gaussian splatting of a static capture: fit, render, evaluate
    #[command(subcommand)]
    Splat(splat::Command),
    /// Animatable people from one video (LAST)
    #[command(subcommand)]
    Last(last::Command),
    /// Triangle meshes: render glTF or OBJ under an environment map, compare two surfaces
    #[command(subcommand)]
    Mesh(mesh::Command),
    /// Relightable objects from photographs (LIRM); so far its training data
    #[command(subcommand)]
    Lirm(lirm::Command),
    /// Run operators on your arrays, compare arrays, write reference arrays
    Oracle(oracle::Args),
    /// Check gradients of the operators or of your program
    Gradcheck(gradcheck::Args),
    /// Convert a scene of Gaussians between .ply, .splat and .npz
    Convert(convert::Args),
    /// Describe this build and this machine, and check that they compute the reference bits
    Doctor(doctor::Args),
}

/// Parses the command line, runs the command, prints an error if there is one.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) => {
            // Help goes to stdout, usage errors to stderr.
            let failed = e.print().err().filter(|e| e.kind() != ErrorKind::BrokenPipe);
            let code = if failed.is_some() { 2 } else { e.exit_code() };
            return ExitCode::from(u8::try_from(code).unwrap_or(2));
        }
    };
    if let Err(e) = console::stop_on_interrupt() {
        console::note(&format!("note: Ctrl-C stops at once, without a checkpoint: {e}"));
    }
    let threads =
        cli.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
    let outcome = par::with_threads(threads, || dispatch(cli.command)).and_then(|outcome| outcome);
    claim::release();
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            console::note(&format!("error: {}", console::one_line(&e.to_string())));
            ExitCode::from(e.exit_code())
        }
    }
}

fn dispatch(command: Command) -> Result<()> {
    match command {
        Command::Demo(args) => demo::run(&args),
        Command::Splat(command) => splat::run(&command),
        Command::Last(command) => last::run(&command),
        Command::Mesh(command) => mesh::run(&command),
        Command::Lirm(command) => lirm::run(&command),
        Command::Oracle(args) => oracle::run(args),
        Command::Gradcheck(args) => gradcheck::run(args),
        Command::Convert(args) => convert::run(&args),
        Command::Doctor(args) => doctor::run(&args),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }
}
