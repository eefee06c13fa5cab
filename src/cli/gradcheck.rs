//! `lastlight gradcheck`.

use crate::choices::Operator;
use crate::console::{is_json, say, say_json};
use crate::meter::Meter;
use crate::{Error, Result};
use lastlight_oracle::oracle::gradcheck::{self, Event};
use std::path::PathBuf;

/// Check gradients: of our operators, or of your program.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  lastlight gradcheck --all                                      every operator on its generated cases
  lastlight gradcheck splat.render --in scene.npz                one operator at your inputs
  lastlight gradcheck --exec 'python3 mine.py' --in mine.npz     your program, called as CMD IN.npz OUT.npz

The program reads its inputs by name and a cotangent y_bar for every output y; it writes y, and x_bar for every input x that it differentiates. Exit code 1 if a check fails.")]
pub struct Args {
    /// Operators, as listed by `oracle list`
    #[arg(value_name = "OP", value_parser = Operator)]
    op: Vec<String>,
    /// Check every operator
    #[arg(long, conflicts_with = "op")]
    all: bool,
    /// Check at these inputs instead of the generated cases
    #[arg(long = "in", value_name = "FILE")]
    input: Option<PathBuf>,
    /// Your program
    #[arg(long, value_name = "CMD", requires = "input", conflicts_with_all = ["op", "all"])]
    exec: Option<String>,
    /// Override a setting of the operator, with --in, comma-separated or repeated
    #[arg(long, value_name = "KEY=VALUE", value_delimiter = ',')]
    set: Vec<String>,
    /// Entries per input that are differentiated one by one
    #[arg(long, value_name = "N")]
    entries: Option<usize>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Runs the command.
///
/// # Errors
/// Bad usage or input, and a check that failed.
pub fn run(args: Args) -> Result<()> {
    let Args { op: ops, all, input, exec, set, entries, seed } = args;
    let options = gradcheck::Options { ops, all, input, exec, set, seed, entries };
    let mut meter = Meter::new();
    let report = gradcheck::run(&options, &mut |event| match event {
        Event::Note(text) => meter.note(text),
        Event::Call { done, total } => meter.count(done, total, "calling the program"),
    })?;
    meter.done();
    if is_json() {
        say_json(&serde_json::to_value(&report).map_err(|e| Error::input("--json").got(e.to_string()))?)?;
    } else {
        say(report.to_string().trim_end())?;
    }
    if report.passed {
        return Ok(());
    }
    let failed = report.checks.iter().filter(|c| !c.passed()).count();
    Err(Error::check("gradcheck").expected("every check to pass").got(format!("{failed} that failed")))
}
