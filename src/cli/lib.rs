//! Commands, progress, reports. Level 13: the only place that prints, reads the clock and sets exit codes.
//!
//! ```text
//! main ──► dispatch ──► demo      a built-in person by LAST, a built-in scene
//!                       splat     fit | render | eval on captures and scene files
//!                       last      gen: data with known causes; import, inspect: captures of persons
//!                       mesh      render | compare | view glTF and OBJ
//!                       lirm      gen: rendered objects to learn from
//!                       field     fit | eval | mesh: one object as a field
//!                       oracle    run, list, compare, mint operators        gradcheck   check gradients
//!                       convert   between scene files                       doctor      is this machine set up
//! meter     progress and timing: the `Watch` of every fit        claim     the rule for existing outputs
//! console   stdout, interruption, the command line as typed   units     seconds and bytes for people
//! visible   text from files as a terminal may show it
//! training  the frame of every command that trains        experiments  the study engine with progress and reports
//! tree      headings, short forms, what -h shows           options      the one heading of every option
//! choices   values of options
//! like      --like result.json, --resume       mistakes   what a usage error suggests
//! light     the light of --env
//! generate  completions and manual pages                   topics       help TOPIC         version   what this build is
//! shared    arguments that several commands have             report/   self-contained HTML
//! snapshots renders and PSNR during a training, for its report
//! ```
//!
//! Exit codes: 0 done, 1 the check failed, 2 bad usage or input, 130 interrupted. Errors are one line on stderr;
//! results go to stdout, as text or with `--json` as one JSON document; everything else goes to stderr.
#![forbid(unsafe_code)]
// They panic when a stream is closed; `console` has what does not.
#![warn(clippy::print_stdout, clippy::print_stderr)]

mod choices;
mod claim;
mod console;
mod convert;
mod demo;
mod doctor;
mod experiments;
mod field;
mod generate;
pub mod gradcheck;
mod last;
mod light;
mod like;
mod lirm;
mod mesh;
mod meter;
mod mistakes;
mod options;
pub mod oracle;
mod report;
mod shared;
mod snapshots;
mod splat;
mod topics;
mod training;
mod tree;
mod units;
mod version;
mod visible;

#[doc(hidden)]
pub use clap;

use lastlight_import::{io, scene};
use lastlight_kernels::{geometry, loss, shade};
use lastlight_num::{Error, Result, num};
use lastlight_train::{experiment, fit};

use crate::num::par;
use clap::error::ErrorKind;
use clap::{ArgAction, ColorChoice, CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use lastlight_num::error::Kind;
use std::ffi::OsString;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  lastlight demo                                    a person and a scene end to end, with a report
  lastlight splat fit photos/ --out fox             Gaussians from photos with camera poses
  lastlight splat render fox/scene.ply --cameras orbit:60 --out turntable
  lastlight splat eval fox/scene.ply photos/        PSNR and SSIM on the held-out photos
  lastlight oracle list                             operators that can be run on your arrays
  lastlight convert fox/scene.ply fox.splat
  lastlight help captures                           layouts of input images

Every result is a pure function of the input and the seed: the same bits for any number of threads.

Topics of `lastlight help`: captures, profiles, exit-codes, env.

Exit codes: 0 done, 1 the check failed, 2 bad usage or input, 130 interrupted (continue with --resume).";

/// CPU reference for differentiable rendering with bit-for-bit reproducible results.
#[derive(Parser)]
#[command(name = "lastlight", about = "CPU reference for differentiable rendering with bit-for-bit reproducible results", after_help = EXAMPLES)]
struct Cli {
    /// Number of threads [default: all cores]; results do not depend on it
    #[arg(short = 'j', long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Memory that an input or a result may take, such as 512M or 4G [default: half of the machine's]; more is an error
    #[arg(long, global = true, value_name = "SIZE", value_parser = memory_size)]
    max_memory: Option<u64>,
    /// Print errors and results alone: neither progress nor notes nor next steps
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Also print the number of threads and the time of every part
    #[arg(short, long, global = true, conflicts_with = "quiet")]
    verbose: bool,
    /// Print the result as one JSON document, and an error as one line of JSON
    #[arg(long, global = true)]
    json: bool,
    /// Colours in help and errors; auto: on a terminal, unless NO_COLOR is set
    #[arg(long, global = true, value_enum, value_name = "WHEN", default_value_t = ColorChoice::Auto)]
    color: ColorChoice,
    /// Print help: -h the options used most, --help everything
    #[arg(short, long, global = true, action = ArgAction::Help)]
    help: Option<bool>,
    /// Print the version; with --verbose also commit, compiler, processor, lanes and the digest of the bit table
    #[arg(short = 'V', long)]
    version: bool,
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
enum Command {
    /// Fit a built-in person from a video and a built-in scene from images; one report with images
    Demo(demo::Args),
    /// Gaussian splatting of a static capture: fit, render, evaluate
    #[command(
        subcommand,
        after_help = "Examples:
  lastlight splat fit photos/ --out fox
  lastlight splat render fox/ --cameras orbit:60 --out turntable
  lastlight splat eval fox/scene.ply photos/"
    )]
    Splat(splat::Command),
    /// Animatable people from one video (LAST)
    #[command(
        subcommand,
        after_help = "Examples:
  lastlight last gen --scale smoke --out person
  lastlight last fit person/video --out fit
  lastlight last render fit --cameras orbit:36 --pose 5 --out around
  lastlight last eval fit person/video"
    )]
    Last(last::Command),
    /// One object as a field, from posed images: fit, evaluate, textured mesh
    #[command(
        subcommand,
        after_help = "Examples:
  lastlight field fit object/uniform --out fit
  lastlight field eval fit object/uniform
  lastlight field mesh fit --out object.glb"
    )]
    Field(field::Command),
    /// Triangle meshes: render glTF or OBJ under an environment map, compare two surfaces
    #[command(
        subcommand,
        after_help = "Examples:
  lastlight mesh render model.glb --env studio --out images
  lastlight mesh compare truth.obj reconstruction.glb"
    )]
    Mesh(mesh::Command),
    /// Relightable objects from a few photos (LIRM): reconstruct one, improve it with more, train the model
    #[command(
        subcommand,
        after_help = "Examples:
  lastlight lirm gen --cameras test --size 128 --seed 2 --out unseen
  lastlight lirm reconstruct unseen/object_00000/uniform --inputs 0017,0025,0035,0043 --out r1
  lastlight lirm update r1 unseen/object_00000/uniform --inputs 0020,0029,0038,0046 --out r2
  lastlight field mesh r2 --out mesh.glb"
    )]
    Lirm(lirm::Command),
    /// Run operators on your arrays, compare arrays, write reference arrays
    Oracle(oracle::Args),
    /// Check gradients of the operators or of your program
    Gradcheck(gradcheck::Args),
    /// Convert a scene of Gaussians between .ply, .splat and .npz
    Convert(convert::Args),
    /// Describe this build and this machine, and check that they compute the reference bits
    Doctor(doctor::Args),
    /// Generate shell completions or manual pages
    Generate(generate::Args),
    /// Print the help of a command or a topic
    Help(topics::Args),
}

/// The tree of commands with all options, as it is parsed and shown.
pub fn command() -> clap::Command {
    tree::refined(Cli::command())
        .version(version::VERSION)
        .max_term_width(110)
        .disable_help_flag(true)
        .disable_help_subcommand(true)
        .disable_version_flag(true)
}

/// Parses the command line, runs the command, prints an error if there is one.
pub fn main() -> ExitCode {
    console::fail_at_file_size_limit();
    let arguments: Vec<OsString> = std::env::args_os().collect();
    let before = console::before_parsing(&arguments);
    let cli = match parse(&arguments, before) {
        Ok(cli) => cli,
        Err(e) => return refused(&e, before),
    };
    let Cli { quiet, verbose, json, color, .. } = cli;
    console::set_output(console::Output { quiet, verbose, json, color });
    if let Some(bytes) = cli.max_memory {
        io::memory::set_limit(bytes);
    }
    if let Err(e) = console::stop_on_interrupt() {
        console::note(&format!("note: Ctrl-C stops at once, without a checkpoint: {e}"));
    }
    let threads =
        cli.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
    let clock = meter::Meter::new();
    let is_timed = verbose && !cli.version;
    let outcome = par::with_threads(threads, || dispatch(cli)).and_then(|outcome| outcome);
    claim::release();
    if is_timed {
        let threads = units::counted(threads, "thread");
        console::note(&format!("{} with {threads}", units::seconds(clock.seconds())));
    }
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            let kind = match e.kind() {
                Kind::Check => "check",
                Kind::Interrupted => "interrupted",
                _ => "input",
            };
            console::error(
                console::Output { quiet, verbose, json, color },
                kind,
                &e.to_string(),
                e.exit_code(),
            );
            ExitCode::from(e.exit_code())
        }
    }
}

/// A size on the command line.
fn memory_size(text: &str) -> std::result::Result<u64, String> {
    io::memory::parse_size(text).map_err(|e| e.to_string())
}

fn parse(arguments: &[OsString], before: console::Output) -> std::result::Result<Cli, clap::Error> {
    let mut tree = command().color(before.color);
    let arguments = like::expanded(arguments, &tree)?;
    let matches = tree
        .try_get_matches_from_mut(&arguments)
        .map_err(|e| mistakes::explained(e, &tree, &topics::TOPICS))?;
    console::set_arguments(&arguments);
    console::set_kept(like::kept(console::arguments(), &tree));
    let cli = Cli::from_arg_matches(&matches).map_err(|e| e.format(&mut tree))?;
    if cli.command.is_none() && !cli.version {
        return Err(tree.error(ErrorKind::MissingSubcommand, "a command is needed, such as demo"));
    }
    Ok(cli)
}

/// Prints help to stdout, a usage error to stderr.
fn refused(e: &clap::Error, before: console::Output) -> ExitCode {
    let code = u8::try_from(e.exit_code()).unwrap_or(2);
    if before.json && e.use_stderr() {
        let text = e.render().to_string();
        let ends = ["\n\nUsage:", "\n\nFor more information"].map(|end| text.find(end).unwrap_or(text.len()));
        let text = &text[..Ord::min(ends[0], ends[1])];
        console::error(before, "usage", text.trim_start_matches("error: "), code);
        return ExitCode::from(code);
    }
    let failed = e.print().err().filter(|e| e.kind() != std::io::ErrorKind::BrokenPipe);
    ExitCode::from(if failed.is_some() { 2 } else { code })
}

fn dispatch(cli: Cli) -> Result<()> {
    let Some(chosen) = cli.command else { return version(cli.verbose) };
    match chosen {
        Command::Demo(args) => demo::run(&args),
        Command::Splat(command) => splat::run(&command),
        Command::Last(command) => last::run(&command),
        Command::Field(command) => field::run(&command),
        Command::Mesh(command) => mesh::run(&command),
        Command::Lirm(command) => lirm::run(&command),
        Command::Oracle(args) => oracle::run(args),
        Command::Gradcheck(args) => gradcheck::run(args),
        Command::Convert(args) => convert::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Generate(args) => generate::run(&args, command()),
        Command::Help(args) => topics::run(&args, command()),
    }
}

fn version(verbose: bool) -> Result<()> {
    if !console::is_json() {
        return console::say(&version::text(verbose));
    }
    let mut record = serde_json::Map::from_iter([("lastlight".to_owned(), version::VERSION.into())]);
    record.extend(version::record());
    console::say_json(&record.into())
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_command_line_is_well_formed() {
        super::command().debug_assert();
    }
}
