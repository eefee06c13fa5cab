//! `lastlight oracle list | show | run | compare | mint`.

use crate::choices::{Operator, PROFILES, choices};
use crate::console::{command_line, is_json, is_quiet, note, say, say_json};
use crate::report::compare as report;
use crate::{Error, Result};
use clap::{Subcommand, ValueEnum};
use lastlight_oracle::ops;
use lastlight_oracle::oracle::{compare, list, mint, run as runner};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Run operators on your arrays, compare arrays, make golden files.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight oracle list splat
  lastlight oracle mint splat.render --out cases
  lastlight oracle run splat.render --in cases/splat.render_0.npz --out ours.npz
  lastlight oracle compare mine.npz ours.npz")]
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
    /// List operators, one line each; with --json everything about them
    #[command(after_help = "Examples:
  lastlight oracle list
  lastlight oracle list splat loss.ssim")]
    List {
        /// Operators, or groups of them such as splat [default: all]
        #[arg(value_name = "OP")]
        op: Vec<String>,
    },
    /// Show an operator's arrays, plan and settings with shapes and types, its equation, symbols, kinks and domain
    #[command(after_help = "Examples:
  lastlight oracle show splat.render
  lastlight oracle show nn.linear loss.ssim --json

JSON: `text` of an operator holds its equation, table of symbols, kinks and domain.")]
    Show {
        /// Operators, as listed by `oracle list`
        #[arg(value_name = "OP", required = true, value_parser = Operator)]
        op: Vec<String>,
    },
    /// Run an operator on arrays; writes OUT.npz, OUT.digest.json, and OUT.plan.npz if the operator has a plan
    #[command(after_help = "Examples:
  lastlight oracle run nn.linear --in case.npz --out ours.npz
  lastlight oracle run splat.render --in scene.npz --out ours.npz --precision f64 --profile gsplat --dump

The input file holds the inputs under the operator's argument names, floats and integers of any width. For every output y for which it also holds y_bar (the cotangent, grad_output in PyTorch), the output file holds x_bar for every differentiable input x. Arrays named setting_KEY are settings; a setting with named values may be given by its index in the list.")]
    Run {
        /// Operator, as listed by `oracle list`
        #[arg(value_name = "OP", value_parser = Operator)]
        op: String,
        /// Input arrays (.npz)
        #[arg(long = "in", value_name = "FILE")]
        input: PathBuf,
        /// Output arrays (.npz)
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Precision: the f32 operator or its f64 twin
        #[arg(long, value_enum, value_name = "NAME", default_value = "f32")]
        precision: Precision,
        /// Semantics of the renderer [default: exact]
        #[arg(long, value_name = "NAME", value_parser = choices(PROFILES))]
        profile: Option<String>,
        /// Override a setting, e.g. --set alpha_max=0.999, comma-separated or repeated; takes precedence over setting_KEY in the input file
        #[arg(long, value_name = "KEY=VALUE", value_delimiter = ',')]
        set: Vec<String>,
        /// Reuse the discrete decisions (visibility, order, cut-offs) of an earlier run, its OUT.plan.npz
        #[arg(long, value_name = "FILE")]
        plan: Option<PathBuf>,
        /// Also write every intermediate
        #[arg(long)]
        dump: bool,
    },
    /// Compare your arrays with reference arrays; exit code 1 if they differ or one is missing
    #[command(after_help = "Examples:
  lastlight oracle compare mine.npz ours.npz
  lastlight oracle compare mine.npz cases/splat.render_0.npz --tol 1e-4 --html report.html
  lastlight oracle compare mine.npz ours.npz --present-only
  lastlight oracle compare mine.npz ours.npz --tol 2e-5          gradients computed in f32

The operator is found by the names of the arrays. An output or gradient that only one of the files contains is missing, and the exit code is 1, as for a name that the operator does not have; --present-only compares what both files contain. Inputs, cotangents, settings and intermediates may be in one file only.

The error is yours - reference. For every array: rel L2 is |yours - reference| / |reference|, which --tol bounds; ulp are units in the last place of the narrower type; 1-cos is 1 - cosine; bias is sum(yours - reference) / sum|reference|; then the number of entries that are zero in one file only, and the ten entries that differ most. The first diverging stage is the first one whose inputs match and whose outputs differ. Arrays with NaN values never match.

--tol: the default suits outputs of f32 kernels. Use `--tol 2e-5` for f32 gradients, the bound of check R4 of `gradcheck` for our own, and 1e-12 for kernels in f64.

JSON: `measures` of an array is null where nothing could be measured, and `reason` states why. Inside `measures` and `worst`, a number that is infinite is null: `relative_l2` where the reference is all zero and yours is not, and it and `signed_bias` where infinite values differ. `operator`, `divergence`, `note`, `reason`, `nans` and `did_you_mean` are null where there is none.")]
    Compare {
        /// Your arrays (.npz)
        #[arg(value_name = "MINE", display_order = 1)]
        yours: PathBuf,
        /// Reference arrays (.npz), written by `oracle run` or `oracle mint`
        #[arg(value_name = "REFERENCE", display_order = 2)]
        reference: PathBuf,
        /// Operator; needed only when the names of the arrays are ambiguous
        #[arg(long, value_name = "OP", value_parser = Operator)]
        op: Option<String>,
        /// Largest accepted relative L2 error of an array
        #[arg(long, value_name = "X", default_value_t = compare::TOLERANCE)]
        tol: f64,
        /// Compare only the arrays that both files contain; missing and unknown ones are listed
        #[arg(long)]
        present_only: bool,
        /// Also write a self-contained HTML page
        #[arg(long, value_name = "FILE")]
        html: Option<PathBuf>,
    },
    /// Write reference arrays computed by the f64 twin: OP_CASE.npz
    #[command(after_help = "Examples:
  lastlight oracle mint
  lastlight oracle mint splat.render --profile gsplat --out cases
  lastlight oracle mint nn.leaky_relu --set slope=0.2")]
    Mint {
        /// Operators, as listed by `oracle list` [default: all]
        #[arg(value_name = "OP", value_parser = Operator)]
        op: Vec<String>,
        /// Output folder
        #[arg(long, value_name = "DIR", default_value = "golden")]
        out: PathBuf,
        /// Semantics of the renderer [default: exact]
        #[arg(long, value_name = "NAME", value_parser = choices(PROFILES))]
        profile: Option<String>,
        /// Override a setting of the cases, e.g. --set alpha_max=0.999, comma-separated or repeated
        #[arg(long, value_name = "KEY=VALUE", value_delimiter = ',', requires = "op")]
        set: Vec<String>,
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
        your_file: &options.yours,
        reference_file: &options.reference,
        yours: &comparison.yours,
        reference: &comparison.reference,
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
    let mut progress = |text: &str| {
        if !is_quiet() {
            note(text);
        }
    };
    match args.command {
        Command::List { op } => print(&list::list(&op)?),
        Command::Show { op } => print(&list::show(&op)?),
        Command::Run { op, input, out, precision, profile, set, plan, dump } => {
            let precision = match precision {
                Precision::F32 => runner::Precision::F32,
                Precision::F64 => runner::Precision::F64,
            };
            let options = runner::Options { op, input, out, precision, profile, set, plan, dump };
            print(&runner::run(&options, &mut progress)?)
        }
        Command::Compare { yours, reference, op, tol, present_only, html } => {
            let options = compare::Options { yours, reference, op, tol, present_only };
            if let Some(path) = &html {
                let inputs = [&options.yours, &options.reference].into_iter().map(PathBuf::as_path);
                runner::check_output("--html", path, inputs)?;
            }
            let comparison = compare::compare(&options)?;
            if let Some(path) = html {
                page(&options, &comparison, &path)?;
            }
            let report = comparison.report;
            print(&report)?;
            if report.passed {
                return Ok(());
            }
            let e = Error::check("oracle compare").expected("every array to match").got(report.summary());
            let is_incomplete = report.arrays.iter().all(compare::ArrayReport::matches);
            Err(if is_incomplete { e.hint("--present-only compares the others only") } else { e })
        }
        Command::Mint { op: ops, out, profile, set } => {
            print(&mint::mint(&mint::Options { ops, out, profile, set }, &mut |_| {})?)
        }
    }
}
