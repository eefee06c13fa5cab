//! Long campaigns against the built program:
//!
//! ```text
//! cargo run --release -p lastlight-tests-campaigns -- mutate --runs 100000 --seed 1
//! cargo run --release -p lastlight-tests-campaigns -- mutate --seed 1 --format HDF5 --case 17 --keep folder
//! ```
//!
//! A campaign prints a table in Markdown and the faults, and exits with 1 if there are any.

#![expect(clippy::disallowed_types, reason = "executions per second, for people")]

use clap::{Parser, Subcommand};
use lastlight_tests_campaigns::{
    bases, disk, kill, mutation, pipes, program::Program, table::Report, tree, writers,
};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// The repository, from this package.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

#[derive(Parser)]
struct Args {
    /// Program under test [default: the release build of this repository, built first]
    #[arg(long, global = true)]
    program: Option<PathBuf>,
    /// Folder for files that are used meanwhile; a file system in memory is fastest [default: /dev/shm where there is one]
    #[arg(long, global = true)]
    work: Option<PathBuf>,
    #[command(subcommand)]
    campaign: Campaign,
}

#[derive(Subcommand)]
enum Campaign {
    /// Damage the files that commands read
    Mutate(Mutate),
    /// Send signals at random moments
    Kill(Trials),
    /// Fill the disk
    Disk(Trials),
    /// Close the streams: all commands, all streams
    Pipes,
    /// Start two programs with the same output
    Writers(Trials),
}

#[derive(clap::Args)]
struct Trials {
    /// Number of trials
    #[arg(long, default_value_t = 100)]
    runs: u64,
    /// Number of the first trial
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl Trials {
    fn range(&self) -> std::ops::Range<u64> {
        self.first..self.first + self.runs
    }
}

#[derive(clap::Args)]
struct Mutate {
    /// Number of executions
    #[arg(long, default_value_t = 2000)]
    runs: u64,
    /// Number of the first execution: a campaign may be run in parts
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Executions at the same time
    #[arg(long, default_value_t = 2)]
    jobs: usize,
    /// Only these formats
    #[arg(long)]
    format: Vec<String>,
    /// Run this case of the one format of --format, print what the program prints, and keep its folder
    #[arg(long, requires = "keep")]
    case: Option<u64>,
    /// Where to keep the folder of --case
    #[arg(long)]
    keep: Option<PathBuf>,
}

/// The release build of the program.
fn build() -> PathBuf {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let status = Command::new(cargo)
        .args(["build", "--release", "--quiet", "--bin", "lastlight"])
        .current_dir(ROOT)
        .status()
        .expect("cargo starts");
    assert!(status.success(), "the program is built");
    let own = std::env::current_exe().expect("this program has a path");
    own.with_file_name("lastlight")
}

fn main() -> ExitCode {
    let args = Args::parse();
    let program = Program::new(&args.program.unwrap_or_else(build));
    let memory = Path::new("/dev/shm");
    let work =
        args.work.unwrap_or_else(|| if memory.is_dir() { memory.into() } else { std::env::temp_dir() });
    let scratch = tempfile::tempdir_in(work).expect("a temporary folder");
    let start = Instant::now();
    let report = match args.campaign {
        Campaign::Mutate(m) => mutate(&program, &m, scratch.path()),
        other => Some(disturb(&program, &other, scratch.path()).expect("files and processes")),
    };
    let Some(report) = report else { return ExitCode::SUCCESS };
    print!("{report}");
    println!(
        "\n{} faults in {} executions, {:.0} s",
        report.faults(),
        report.total(0),
        start.elapsed().as_secs_f64()
    );
    if report.faults() == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// The other campaigns.
fn disturb(program: &Program, campaign: &Campaign, scratch: &Path) -> std::io::Result<Report> {
    match campaign {
        Campaign::Kill(t) => kill::run(program, t.seed, t.range(), true, scratch),
        Campaign::Disk(t) => {
            let mount = disk::can_mount(scratch);
            if !mount {
                eprintln!("no right to mount: every trial has a limit of file size");
            }
            disk::run(program, t.seed, t.range(), mount, scratch)
        }
        Campaign::Writers(t) => writers::run(program, t.seed, t.range(), scratch),
        Campaign::Pipes | Campaign::Mutate(_) => pipes::run(program, 1, scratch),
    }
}

/// The campaign of damaged files, or one of its cases.
fn mutate(program: &Program, args: &Mutate, scratch: &Path) -> Option<Report> {
    let shop = scratch.join("shop");
    std::fs::create_dir(&shop).expect("made");
    let mut all = bases::all(program, &shop);
    let named = |format: &str| args.format.is_empty() || args.format.iter().any(|f| f == format);
    all.retain(|b| named(b.format));
    assert!(!all.is_empty(), "--format is one of the formats of the table");
    if let (Some(n), Some(keep)) = (args.case, &args.keep) {
        let case = mutation::case(&all[0], args.seed, n);
        tree::write(keep, &all[0].files).expect("written");
        mutation::place(&case, keep).expect("written");
        println!("{}: {}\nlastlight {}", case.file, case.what, case.words.join(" "));
        let e = program.run(&case.words, keep).expect("the program starts");
        println!("{}\n{}", e.ended(), e.text());
        return None;
    }
    let settings =
        mutation::Settings { seed: args.seed, first: args.first, runs: args.runs, jobs: args.jobs };
    let (start, last) = (Instant::now(), AtomicU64::new(0));
    let progress = |n: u64| {
        let seconds = start.elapsed().as_secs();
        if last.fetch_max(seconds / 10, Ordering::Relaxed) < seconds / 10 {
            eprintln!(
                "{n} of {} executions, {:.0} per second",
                args.runs,
                n as f64 / start.elapsed().as_secs_f64()
            );
        }
    };
    Some(mutation::run(program, &mut all, &settings, scratch, &progress).expect("files and processes"))
}
