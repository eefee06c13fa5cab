//! `gradcheck`: checks operators of the list at generated cases or user-supplied inputs, or a user-supplied
//! program.

use super::checks::shapes;
pub use super::checks::{Check, Entry, Rung};
pub use super::program::Event;
use super::program::{Request, program};
use super::run::{SortedArrays, add_settings, read};
use crate::ops::{self, OpSubject};
use crate::tape::check;
use crate::{Error, Result};
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// Options of a gradient check.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// operators to check
    pub ops: Vec<String>,
    /// check every operator of the list
    pub all: bool,
    /// inputs to use instead of the generated cases
    pub input: Option<PathBuf>,
    /// user-supplied program, called as `CMD IN.npz OUT.npz`
    pub exec: Option<String>,
    /// `KEY=VALUE` settings, with `input`
    pub set: Vec<String>,
    /// seed of directions and samples
    pub seed: u64,
    /// number of entries per input that are checked one by one; `None`: 6, or 3 with `exec`
    pub entries: Option<usize>,
    /// with `exec`: the inputs that the program differentiates with respect to; all float arrays if empty
    pub wrt: Vec<String>,
}

/// Results of all checks.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// one report per case
    pub checks: Vec<Check>,
    /// whether all of them passed
    pub passed: bool,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for check in &self.checks {
            write!(f, "{check}")?;
        }
        let good = self.checks.iter().filter(|c| c.passed).count();
        writeln!(f, "{good} of {} checks passed", self.checks.len())
    }
}

/// Runs the checks; `progress` is called with a description of the next one.
///
/// # Errors
/// Invalid options or input. A failed check is not an error; it is in the report.
pub fn run(options: &Options, progress: &mut dyn FnMut(Event<'_>)) -> Result<Report> {
    let mut rules = check::Options { seed: options.seed, ..check::Options::default() };
    if let Some(entries) = options.entries {
        if entries == 0 {
            return Err(Error::input("gradcheck --entries").expected("1 or more").got("0"));
        }
        rules.entries = entries;
    }
    let checks = match (&options.exec, &options.input) {
        (Some(command), Some(input)) => {
            let Options { wrt, entries, .. } = options;
            vec![program(&Request { command, input, wrt, entries: *entries }, &rules, progress)?]
        }
        (Some(_), None) => {
            return Err(
                Error::input("gradcheck --exec").expected("--in IN.npz with the inputs of the program")
            );
        }
        (None, Some(input)) => vec![at_inputs(input, options, &rules, progress)?],
        (None, None) => {
            if options.ops.is_empty() && !options.all {
                return Err(Error::input("gradcheck")
                    .expected("names of operators, --all, or --exec CMD --in IN.npz")
                    .hint("`oracle list` prints the names"));
            }
            let names = if options.all { &[][..] } else { &options.ops };
            let mut checks = Vec::new();
            for op in ops::choose(names)? {
                for case in 0..op.cases {
                    progress(Event::Note(&format!("{} case {case}", op.name)));
                    let shapes = shapes(&(op.case)(case).inputs);
                    checks.push(Check::new(check::run(&OpSubject::case(op, case)?, &rules)?, &shapes));
                }
            }
            checks
        }
    };
    Ok(Report { passed: !checks.is_empty() && checks.iter().all(|c| c.passed), checks })
}

fn at_inputs(
    input: &Path,
    options: &Options,
    rules: &check::Options,
    progress: &mut dyn FnMut(Event<'_>),
) -> Result<Check> {
    let [name] = options.ops.as_slice() else {
        return Err(Error::input("gradcheck --in")
            .expected("the name of one operator")
            .got(format!("{}", options.ops.len())));
    };
    let op = ops::find(name)?;
    let SortedArrays { mut call, notes } = read(op, input)?;
    add_settings(op, &mut call.settings, None, &options.set)?;
    for note in notes {
        progress(Event::Note(&note));
    }
    let label = format!("{} at {}", op.name, input.display());
    let shapes = shapes(&call.inputs);
    let subject = OpSubject::new(op, label, call.inputs, call.settings, call.cotangents)
        .map_err(|e| e.within(input.display().to_string()))?;
    Ok(Check::new(check::run(&subject, rules)?, &shapes))
}
