//! `lastlight oracle list | run | compare | mint`.

use crate::console::{command_line, is_json, note, say, say_json};
use crate::report::compare as report;
use crate::{Error, Result};
use clap::{Subcommand, ValueEnum};
use lastlight_oracle::ops;
use lastlight_oracle::oracle::{compare, list, mint, run as runner};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Run operators on your arrays, compare arrays, make golden files.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Clone, Copy, ValueEnum)]
enum Precision {
    /// the shipped operator
    F32,
    /// the independent twin
    F64,
}

#[derive(Subcommand)]
enum Command {
    /// List operators with their inputs, outputs, shapes, types and settings
    List {},
    /// Run an operator on arrays; writes OUT.npz, OUT.plan.npz, OUT.digest.json
    #[command(after_help = "\
IN.npz holds the inputs under the operator's argument names, floats and integers of any width. For every output y for
which it also holds y_bar (the cotangent, grad_output in PyTorch), OUT.npz holds x_bar for every differentiable input x.
Arrays named setting_KEY are settings; a setting with named values may be given by its index in the list.

Example: lastlight oracle run splat.render --in scene.npz --out ours.npz --precision f64 --profile gsplat --dump")]
    Run {
        /// Operator, as listed by `oracle list`
        op: String,
        /// Input arrays
        #[arg(long = "in", value_name = "IN.npz")]
        input: PathBuf,
        /// Output arrays
        #[arg(long, value_name = "OUT.npz")]
        out: PathBuf,
        /// Precision: the f32 operator or its f64 twin
        #[arg(long, value_enum, default_value = "f32")]
        precision: Precision,
        /// Splatting semantics: exact, gsplat or inria [default: exact]
        #[arg(long)]
        profile: Option<String>,
        /// Override a setting, e.g. --set alpha_max=0.999 (repeatable; takes precedence over setting_KEY in IN.npz)
        #[arg(long, value_name = "KEY=VALUE")]
        set: Vec<String>,
        /// Reuse the discrete decisions (visibility, order, cut-offs) stored in PLAN.npz
        #[arg(long, value_name = "PLAN.npz")]
        plan: Option<PathBuf>,
        /// Also write every intermediate
        #[arg(long)]
        dump: bool,
    },
    /// Compare user-supplied arrays with reference arrays; exit code 1 if they differ
    Compare {
        /// User-supplied arrays
        theirs: PathBuf,
        /// Reference arrays, written by `oracle run`
        ours: PathBuf,
        /// Operator; needed only when the names of the arrays are ambiguous
        #[arg(long)]
        op: Option<String>,
        /// Largest accepted relative L2 error of an array
        #[arg(long, default_value_t = compare::TOLERANCE)]
        tol: f64,
        /// Also write a self-contained HTML page
        #[arg(long, value_name = "REPORT.html")]
        html: Option<PathBuf>,
    },
    /// Write reference arrays computed by the f64 twin: OP_CASE.npz
    Mint {
        /// Operators [default: all]
        op: Vec<String>,
        /// Output folder
        #[arg(long, value_name = "DIR", default_value = "golden")]
        out: PathBuf,
    },
}

fn print<T: Serialize + std::fmt::Display>(record: &T) -> Result<()> {
    if !is_json() {
        return say(record.to_string().trim_end());
    }
    let value = serde_json::to_value(record).map_err(|e| Error::input("--json").got(e.to_string()))?;
    say_json(&value)
}

/// Writes the page of a comparison.
fn page(options: &compare::Options, comparison: &compare::Comparison, path: &Path) -> Result<()> {
    let operator = comparison.report.operator.map(ops::find).transpose()?;
    let stages = operator.into_iter().flat_map(|op| op.stages);
    let input = report::Input {
        report: &comparison.report,
        their_file: &options.theirs,
        our_file: &options.ours,
        theirs: &comparison.theirs,
        ours: &comparison.ours,
        stages: stages.map(|s| report::Stage { name: s.operator, outputs: s.outputs.to_vec() }).collect(),
        command: command_line(),
    };
    report::page(&input)?.write_file(path)
}

/// Runs the command.
///
/// # Errors
/// Bad usage or input, and a comparison that found a difference.
pub fn run(args: Args) -> Result<()> {
    let mut progress = |text: &str| note(text);
    match args.command {
        Command::List {} => print(&list::list()),
        Command::Run { op, input, out, precision, profile, set, plan, dump } => {
            let precision = match precision {
                Precision::F32 => runner::Precision::F32,
                Precision::F64 => runner::Precision::F64,
            };
            let options = runner::Options { op, input, out, precision, profile, set, plan, dump };
            print(&runner::run(&options, &mut progress)?)
        }
        Command::Compare { theirs, ours, op, tol, html } => {
            let options = compare::Options { theirs, ours, op, tol };
            let comparison = compare::compare(&options)?;
            if let Some(path) = html {
                page(&options, &comparison, &path)?;
            }
            let report = comparison.report;
            print(&report)?;
            if report.passed {
                return Ok(());
            }
            let differing =
                report.arrays.iter().filter(|a| a.agreement != compare::Agreement::Agrees).count();
            Err(Error::check("oracle compare")
                .expected("every array to agree")
                .got(format!("{differing} that do not")))
        }
        Command::Mint { op, out } => {
            let report = mint::mint(&op, &out, &mut |_| {})?;
            print(&report)
        }
    }
}
