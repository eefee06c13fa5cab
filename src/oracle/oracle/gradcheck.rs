//! `gradcheck`: checks operators of the list at generated cases or user-supplied inputs, or a user-supplied
//! program.

use super::run::{SortedArrays, add_settings, read};
use crate::io::npz;
use crate::num::array::{Array, Arrays};
use crate::ops::{self, OpSubject};
use crate::tape::check::{self, Evaluation, UNIT, Values};
use crate::{Error, Result};
use serde::Serialize;
use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

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
    /// number of entries per input that are checked one by one; `None`: the default
    pub entries: Option<usize>,
}

/// What happens next, for whoever shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// a line of text
    Note(&'a str),
    /// a call of the user-supplied program has ended
    Call {
        /// calls so far
        done: usize,
        /// calls of the whole check, estimated
        total: usize,
    },
}

/// Results of all checks.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// one report per case
    pub checks: Vec<check::Report>,
    /// whether all of them passed
    pub passed: bool,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for check in &self.checks {
            write!(f, "{check}")?;
        }
        let good = self.checks.iter().filter(|c| c.passed()).count();
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
        rules.entries = entries;
    }
    let checks = match (&options.exec, &options.input) {
        (Some(command), Some(input)) => vec![program(command, input, options, &rules, progress)?],
        (Some(_), None) => {
            return Err(
                Error::input("gradcheck --exec").expected("--in IN.npz with the inputs of the program")
            );
        }
        (None, Some(input)) => vec![at_inputs(input, options, &rules, progress)?],
        (None, None) => {
            if options.ops.is_empty() && !options.all {
                return Err(Error::input("gradcheck")
                    .expected("--all or names of operators")
                    .hint("`oracle list` prints the names"));
            }
            let names = if options.all { &[][..] } else { &options.ops };
            let mut checks = Vec::new();
            for op in ops::choose(names)? {
                for case in 0..op.cases {
                    progress(Event::Note(&format!("{} case {case}", op.name)));
                    checks.push(check::run(&OpSubject::case(op, case)?, &rules)?);
                }
            }
            checks
        }
    };
    Ok(Report { passed: !checks.is_empty() && checks.iter().all(check::Report::passed), checks })
}

fn at_inputs(
    input: &Path,
    options: &Options,
    rules: &check::Options,
    progress: &mut dyn FnMut(Event<'_>),
) -> Result<check::Report> {
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
    let subject = OpSubject::new(op, label, call.inputs, call.settings, call.cotangents)
        .map_err(|e| e.within(input.display().to_string()))?;
    check::run(&subject, rules)
}

/// A user-supplied program with a temporary folder.
struct Program<'a> {
    command: &'a str,
    folder: tempfile::TempDir,
    arrays: Arrays,
    calls: Cell<usize>,
    /// calls of the whole check; 0 while this is unknown
    planned: Cell<usize>,
    progress: RefCell<&'a mut dyn FnMut(Event<'_>)>,
}

impl Program<'_> {
    /// One call with some inputs and cotangents replaced.
    fn call(&self, inputs: &Values, bars: &Values) -> Result<Arrays> {
        let what = || Error::input(format!("program '{}'", self.command));
        let mut arrays = self.arrays.clone();
        let mut replace = |name: String, values: &[f64]| {
            let shape = arrays.get(&name).map(|a| a.shape().to_vec()).unwrap_or_default();
            arrays.put(&name, &shape, values.to_vec());
        };
        for (name, values) in inputs {
            replace(name.clone(), values);
        }
        for (name, values) in bars {
            replace(format!("{name}_bar"), values);
        }
        let (input, output) = (self.folder.path().join("in.npz"), self.folder.path().join("out.npz"));
        npz::write(&input, &arrays)?;
        // so that an old result is not taken for a new one
        if output.exists() {
            std::fs::remove_file(&output).map_err(|e| Error::os(&output, &e))?;
        }
        let mut words = self.command.split_whitespace();
        let program = words.next().ok_or_else(|| what().expected("a command"))?;
        let done = Command::new(program)
            .args(words)
            .args([&input, &output])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .output()
            .map_err(|e| what().expected("a program that starts").got(e.to_string()))?;
        self.calls.set(self.calls.get() + 1);
        if self.planned.get() > 0 {
            let done = self.calls.get();
            (*self.progress.borrow_mut())(Event::Call { done, total: Ord::max(done, self.planned.get()) });
        }
        if !done.status.success() {
            let text = String::from_utf8_lossy(&done.stderr);
            let last = text.lines().rev().find(|l| !l.trim().is_empty()).unwrap_or("").trim();
            return Err(what().expected("exit code 0").got(format!("{}: {last}", done.status)));
        }
        npz::read(&output).map_err(|e| e.within(what().to_string()))
    }
}

fn values(arrays: &Arrays, name: &str, like: &Array, unit: &Cell<f64>) -> Result<Vec<f64>> {
    let array = arrays.need(name)?;
    if array.shape() != like.shape() {
        return Err(Error::input(format!("array '{name}'"))
            .expected(format!("shape {:?}", like.shape()))
            .got(format!("{:?}", array.shape())));
    }
    if matches!(array, Array::F32(_)) {
        unit.set(ops::Width::F32.unit());
    }
    arrays.finite([name])?;
    Ok(array.to_f64())
}

/// Evaluations that a check needs: those of a function that always gives these outputs and gradients.
fn calls_of(outputs: &Values, gradients: &Values, inputs: &Values, rules: &check::Options) -> Result<usize> {
    let count = Cell::new(0);
    let value = |_: &Values| {
        count.set(count.get() + 1);
        Ok(Evaluation { outputs: outputs.clone(), log: 0 })
    };
    let vjp = |_: &Values, _: &Values| {
        count.set(count.get() + 1);
        Ok(gradients.clone())
    };
    check::function_with_log("", value, vjp, inputs, rules)?;
    Ok(count.get())
}

/// Checks a program: outputs are the arrays `y` for which `IN.npz` holds `y_bar`, variables the float inputs
/// `x` for which the program returns `x_bar`. If it returns f32, differences have the rounding noise of f32,
/// which the report states.
fn program(
    command: &str,
    input: &Path,
    options: &Options,
    rules: &check::Options,
    progress: &mut dyn FnMut(Event<'_>),
) -> Result<check::Report> {
    let arrays = npz::read(input)?;
    let folder = tempfile::tempdir().map_err(|e| Error::input("temporary folder").got(e.to_string()))?;
    let (calls, planned) = (Cell::new(0), Cell::new(0));
    let program = Program { command, folder, arrays, calls, planned, progress: RefCell::new(progress) };
    let first = program.call(&Values::new(), &Values::new())?;
    let bars: BTreeMap<String, Array> = program
        .arrays
        .0
        .iter()
        .filter_map(|(name, a)| Some((name.strip_suffix("_bar")?.to_owned(), a.clone())))
        .filter(|(name, _)| first.get(name).is_some())
        .collect();
    if bars.is_empty() {
        return Err(Error::input(input.display().to_string())
            .expected("a cotangent <output>_bar for at least one output of the program")
            .got("none"));
    }
    let inputs: Values = program
        .arrays
        .0
        .iter()
        .filter(|(name, a)| a.is_float() && first.get(&format!("{name}_bar")).is_some())
        .map(|(name, a)| (name.clone(), a.to_f64()))
        .collect();
    let unit = Cell::new(UNIT);
    let value = |x: &Values| {
        let out = program.call(x, &Values::new())?;
        let outputs: Result<Values> =
            bars.iter().map(|(n, like)| Ok((n.clone(), values(&out, n, like, &unit)?))).collect();
        Ok(Evaluation { outputs: outputs?, log: 0 })
    };
    let vjp = |x: &Values, y_bar: &Values| {
        let out = program.call(x, y_bar)?;
        let gradient = |name: &String| {
            let like = program.arrays.need(name)?;
            Ok((name.clone(), values(&out, &format!("{name}_bar"), like, &unit)?))
        };
        inputs.keys().map(gradient).collect::<Result<Values>>()
    };
    let (outputs, gradients) = (value(&inputs)?.outputs, vjp(&inputs, &Values::new())?);
    // every derivative costs calls of the program: use fewer of them than for operators
    let rules = check::Options {
        unit: unit.get(),
        directions: Ord::min(rules.directions, 2),
        entries: options.entries.unwrap_or(3),
        ..rules.clone()
    };
    let names: Vec<_> = inputs.keys().map(String::as_str).collect();
    let text =
        format!("{command}: gradients of {} by finite differences of the program itself", names.join(", "));
    (*program.progress.borrow_mut())(Event::Note(&text));
    program.planned.set(program.calls.get() + calls_of(&outputs, &gradients, &inputs, &rules)?);
    let report = check::function_with_log(command, value, vjp, &inputs, &rules)?;
    let text = format!("{command}: called {} times", program.calls.get());
    (*program.progress.borrow_mut())(Event::Note(&text));
    Ok(report)
}
