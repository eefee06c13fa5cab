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

Your program (--exec): IN.npz holds its inputs under their names and, for every output y that is checked, the cotangent y_bar (grad_output in PyTorch), an array with the shape of y such as random numbers. The program writes y, and for every input x the gradient x_bar = d sum(y * y_bar) / dx with the shape of x. A float array of IN.npz without a gradient is a failure, unless --wrt names the inputs that are checked, and so is an unknown name. Integers and arrays setting_KEY are no inputs. If IN.npz is a case of a listed operator, as `oracle mint` writes it, its outputs, its intermediates and the inputs that have no gradient in `oracle show` are not checked. CMD is split at spaces, without a shell.

Inputs are passed in f64. The program is called 35 times, and 4 times more per entry that is checked: 47 times for one input with the default of 3 entries. If it writes f32, an entry takes 14 calls.

Checks:
  R0  the arrays are complete and finite, and no gradient is 0 everywhere
  R1  programs: gradients along random directions, against finite differences, with random numbers as y_bar, so that a gradient that ignores y_bar fails; operators: forward against reverse derivatives of the twin
  R2  operators only: finite differences of the twin with fixed discrete decisions, against its derivatives
  R3  gradients of single entries, against finite differences; programs: with the y_bar of IN.npz, so that the listed values are entries of the x_bar that the program writes for IN.npz; an entry that fails is listed with its index and both values
  R4  operators only: the shipped gradient against the twin

Relative differences of a program in R3 are |yours - finite difference| / |finite difference|, as in `oracle compare`; a finite difference below 1e-6 of the largest one of its input is replaced by this bound in the denominator. In R1, the difference is relative to the norms of direction and gradient.

Kinks: where a function has no derivative (ReLU or |x| at 0, the end of a clamp, equal values under max), a correct gradient fails, because a finite difference across the kink measures neither slope. Move the inputs away from kinks; the largest step is 0.016 * max(1, |x|).

f32: finite differences of f32 results carry rounding noise. The checks allow for it if the program writes f32 arrays, and report it as `largest relative rounding noise`. A program that computes in f32 and writes f64 fails. For a sharp check, compute in f64.

Exit code 1 if a check fails.")]
pub struct Args {
    /// Operators, as listed by `oracle list`
    #[arg(value_name = "OP", value_parser = Operator)]
    op: Vec<String>,
    /// Check every operator
    #[arg(long, conflicts_with = "op")]
    all: bool,
    /// Inputs to check at, instead of the generated cases; with --exec also the cotangents y_bar
    #[arg(long = "in", value_name = "FILE")]
    input: Option<PathBuf>,
    /// Your program, called as CMD IN.npz OUT.npz
    #[arg(long, value_name = "CMD", requires = "input", conflicts_with_all = ["op", "all"])]
    exec: Option<String>,
    /// Override a setting of the operator, with --in, comma-separated or repeated
    #[arg(long, value_name = "KEY=VALUE", value_delimiter = ',', conflicts_with = "exec")]
    set: Vec<String>,
    /// With --exec: inputs whose gradients are checked, comma-separated or repeated [default: every float array that is no cotangent]
    #[arg(long, value_name = "NAME", value_delimiter = ',', requires = "exec")]
    wrt: Vec<String>,
    /// Entries per input that are differentiated one by one, at least 1 [default: 6; 3 with --exec]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    entries: Option<u32>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Runs the command.
///
/// # Errors
/// Bad usage or input, and a check that failed.
pub fn run(args: Args) -> Result<()> {
    let Args { op: ops, all, input, exec, set, wrt, entries, seed } = args;
    let entries = entries.map(|n| n as usize);
    let options = gradcheck::Options { ops, all, input, exec, set, seed, entries, wrt };
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
    let failed = report.checks.iter().filter(|c| !c.passed).count();
    Err(Error::check("gradcheck").expected("every check to pass").got(format!("{failed} that failed")))
}
