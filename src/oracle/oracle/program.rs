//! A user-supplied program, called as `CMD IN.npz OUT.npz`: its arrays, and the check of its gradients.

use super::checks::{Check, Rung, Shapes, shapes};
use super::compare::writer;
use super::entries::{Entries, entries};
use super::roles::{Roles, fault, operator, wrt_hint};
use crate::io::npz;
use crate::num::array::{Array, Arrays};
use crate::ops;
use crate::tape::check::{self, Evaluation, LIVE, UNIT, Values};
use crate::{Error, Result};
use std::cell::{Cell, RefCell};
use std::path::Path;
use std::process::{Command, Stdio};

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

/// Entries per input that are checked one by one by default: every derivative takes several calls.
const ENTRIES: usize = 3;

/// What is checked of a program.
pub(super) struct Request<'a> {
    /// the command
    pub(super) command: &'a str,
    /// file with inputs and cotangents
    pub(super) input: &'a Path,
    /// inputs that it differentiates; all float arrays if empty
    pub(super) wrt: &'a [String],
    /// entries per input that are checked one by one
    pub(super) entries: Option<usize>,
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
    fn error(&self) -> Error {
        Error::input(format!("program '{}'", self.command))
    }

    /// One call with some inputs and cotangents replaced.
    fn call(&self, inputs: &Values, bars: &Values) -> Result<Arrays> {
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
        let program = words.next().ok_or_else(|| Error::input("gradcheck --exec").expected("a command"))?;
        let done = Command::new(program)
            .args(words)
            .args([&input, &output])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .output()
            .map_err(|e| self.not_started(program, &e))?;
        self.calls.set(self.calls.get() + 1);
        if self.planned.get() > 0 {
            let done = self.calls.get();
            (*self.progress.borrow_mut())(Event::Call { done, total: Ord::max(done, self.planned.get()) });
        }
        if !done.status.success() {
            let text = String::from_utf8_lossy(&done.stderr);
            let last = text.lines().rev().find(|l| !l.trim().is_empty());
            let last = last.map_or("it printed no error", str::trim);
            // The names of the protocol mean more than those of a folder that is removed.
            let last = last.replace(&*input.to_string_lossy(), "IN.npz");
            let last = last.replace(&*output.to_string_lossy(), "OUT.npz");
            return Err(self.error().expected("exit code 0").got(format!("{}: {last}", done.status)));
        }
        if !output.exists() {
            return Err(self
                .error()
                .expected("a file OUT.npz")
                .got("none")
                .hint("it is called as CMD IN.npz OUT.npz and writes its arrays to the second path"));
        }
        npz::read(&output).map_err(|e| e.within(self.error().to_string()))
    }

    fn not_started(&self, program: &str, e: &std::io::Error) -> Error {
        let e = Error::os(Path::new(program), e).within(self.error().to_string());
        e.hint("the command is split at spaces, without a shell")
    }

    /// One array as f64, where it has the expected shape and finite values; an f32 array sets `unit`.
    fn values(&self, arrays: &Arrays, name: &str, like: &Array, unit: &Cell<f64>) -> Result<Vec<f64>> {
        let Some(array) = arrays.get(name) else {
            return Err(self.error().expected(format!("array '{name}' in OUT.npz of every call")));
        };
        if let Some(fault) = fault(name, array, ("that of the first call", like.shape())) {
            return Err(self.error().got(format!("call {}: {fault}", self.calls.get())));
        }
        if matches!(array, Array::F32(_)) {
            unit.set(ops::Width::F32.unit());
        }
        Ok(array.to_f64())
    }
}

/// Evaluations that a check needs: those of a function that always gives these outputs and gradients, and
/// those of the entries.
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
    check::function_with_log("", value, vjp, inputs, &check::Options { entries: 0, ..rules.clone() })?;
    entries(&mut |x| value(x), inputs, outputs, gradients, rules)?;
    Ok(count.get())
}

/// Title of R0 of a program.
const SANITY: &str = "arrays: none missing, known names, shapes, finite; gradients not 0 everywhere";

/// The report of a check that ended with the names, shapes and values of the arrays.
fn incomplete(command: &str, roles: Roles) -> Check {
    let mut rung = check::Rung::new("R0", SANITY);
    roles.failures.into_iter().for_each(|f| rung.fail(f));
    let report = check::Report { subject: command.to_owned(), rungs: vec![rung] };
    Check { hints: roles.hint.into_iter().collect(), ..Check::new(report, &Shapes::new()) }
}

/// What the hints depend on.
struct Findings {
    /// rounding unit of the arrays that the program writes
    unit: f64,
    /// entries of the largest input
    most: usize,
    /// whether every entry of the outputs is a number of f32
    is_single: bool,
    /// how to check only gradients that are not 0 everywhere
    nonzero: Option<String>,
    /// the entries that were checked, if the arrays were complete
    entries: Option<Entries>,
}

/// The report in the terms of a program, with hints if it did not pass.
fn with_hints(mut check: Check, found: &Findings) -> Check {
    for rung in &mut check.rungs {
        rung.title = match rung.name {
            "R0" => SANITY,
            "R1" => {
                "gradient along random directions of all inputs, with random y_bar, against finite differences"
            }
            _ => "gradient of single entries, with y_bar of IN.npz, against finite differences",
        };
        // A program reports no decisions and predicts no zeros.
        rung.measures.retain(|_| rung.name != "R0");
    }
    let failed = |name: &str| check.rung(name).is_some_and(|r: &Rung| !r.passed);
    let has = |part: &str| check.rung("R0").is_some_and(|r| r.failures.iter().any(|f| f.contains(part)));
    let mut hints = Vec::new();
    if has("is zero everywhere") {
        hints.extend(found.nonzero.clone());
    }
    if failed("R1") && !failed("R3") {
        let most = found.most;
        hints.push(format!(
            "R3 checked some entries only; --entries {most} checks all and names the wrong ones"
        ));
    }
    let entries = found.entries.as_ref();
    hints.extend(entries.into_iter().flat_map(|e| &e.factors).cloned());
    if (failed("R1") || failed("R3")) && entries.is_none_or(|e| e.factors.is_empty() || !e.is_explained) {
        hints.push("an input at a kink (ReLU or |x| at 0, the end of a clamp, a threshold of visibility) has no derivative: move it away from the kink by 0.02 or more".to_owned());
        if found.unit > UNIT {
            hints.push("the program writes f32, whose rounding limits finite differences; the check is sharper in f64".to_owned());
        } else if found.is_single || entries.is_some_and(|e| ROUNDING.contains(&e.difference)) {
            hints.push("a program that computes in f32 should write f32 arrays: the check then allows for their rounding".to_owned());
        }
    }
    check.hints = hints;
    check
}

/// Relative differences of R3 that can be the rounding of f32.
const ROUNDING: std::ops::Range<f64> = LIVE..0.1;

/// Checks a program: outputs are the arrays `y` for which `IN.npz` holds `y_bar`, variables the float inputs
/// `x`, or those of `wrt`. If it returns f32, differences have the rounding noise of f32, which the report
/// states.
pub(super) fn program(
    request: &Request<'_>,
    rules: &check::Options,
    progress: &mut dyn FnMut(Event<'_>),
) -> Result<Check> {
    let Request { command, input, wrt, .. } = *request;
    if command.trim().is_empty() {
        return Err(Error::input("gradcheck --exec").expected("a command").got("an empty text"));
    }
    let (arrays, file) = (npz::read(input)?, input.display().to_string());
    arrays.finite(arrays.0.keys().map(String::as_str)).map_err(|e| e.within(&*file))?;
    let no_cotangent = || {
        Error::input(&*file)
            .expected("the cotangent y_bar of at least one output y of the program")
            .hint("add an array with the shape of y, such as random numbers")
    };
    if !arrays.0.keys().any(|n| n.ends_with("_bar")) {
        let names: Vec<_> = arrays.0.keys().map(String::as_str).collect();
        return Err(no_cotangent().got(format!("only {}", names.join(", "))));
    }
    if let Some(name) = wrt.iter().find(|n| !arrays.get(n).is_some_and(Array::is_float)) {
        let known: Vec<_> = arrays
            .0
            .iter()
            .filter(|(n, a)| a.is_float() && !n.ends_with("_bar"))
            .map(|(n, _)| n.as_str())
            .collect();
        let e =
            Error::input("gradcheck --wrt").expected(format!("float arrays of {file}: {}", known.join(", ")));
        return Err(e.got(format!("'{name}'")));
    }
    let folder = tempfile::tempdir().map_err(|e| Error::input("temporary folder").got(e.to_string()))?;
    let (calls, planned) = (Cell::new(0), Cell::new(0));
    let program = Program { command, folder, arrays, calls, planned, progress: RefCell::new(progress) };
    let first = program.call(&Values::new(), &Values::new())?;
    let op = operator(&program.arrays, &first, writer(input));
    let roles = Roles::new(&program.arrays, &first, wrt, op);
    for note in &roles.notes {
        (*program.progress.borrow_mut())(Event::Note(note));
    }
    if roles.outputs.is_empty() && !roles.failures.iter().any(|f| f.starts_with("no output")) {
        let written: Vec<_> = first.0.keys().map(String::as_str).collect();
        return Err(no_cotangent().got(format!("none of its outputs {}", written.join(", "))));
    }
    if !roles.unchecked.is_empty() {
        let names = roles.unchecked.join(", ");
        let text = format!("not checked, because {file} contains no cotangent of them: {names}");
        (*program.progress.borrow_mut())(Event::Note(&text));
    }
    if !roles.failures.is_empty() {
        return Ok(incomplete(command, roles));
    }
    if roles.inputs.is_empty() {
        return Err(Error::input(&*file).expected("at least one float array that is an input of the program"));
    }
    let entries = request.entries.unwrap_or(ENTRIES);
    check_program(&program, &roles, &check::Options { entries, ..rules.clone() })
}

fn check_program(program: &Program<'_>, roles: &Roles, rules: &check::Options) -> Result<Check> {
    let command = program.command;
    let flat = |name: &String| Ok((name.clone(), program.arrays.need(name)?.to_f64()));
    let inputs: Values = roles.inputs.iter().map(flat).collect::<Result<_>>()?;
    let unit = Cell::new(UNIT);
    let value = |x: &Values| {
        let out = program.call(x, &Values::new())?;
        let output = |(n, like): (&String, &Array)| Ok((n.clone(), program.values(&out, n, like, &unit)?));
        Ok(Evaluation { outputs: roles.outputs.iter().map(output).collect::<Result<_>>()?, log: 0 })
    };
    let vjp = |x: &Values, y_bar: &Values| {
        let out = program.call(x, y_bar)?;
        let gradient = |name: &String| {
            let like = program.arrays.need(name)?;
            Ok((name.clone(), program.values(&out, &format!("{name}_bar"), like, &unit)?))
        };
        inputs.keys().map(gradient).collect::<Result<Values>>()
    };
    let (outputs, gradients) = (value(&inputs)?.outputs, vjp(&inputs, &Values::new())?);
    // every derivative costs calls of the program: use fewer of them than for operators
    let rules =
        check::Options { unit: unit.get(), directions: Ord::min(rules.directions, 2), ..rules.clone() };
    let names: Vec<_> = inputs.keys().map(String::as_str).collect();
    let text =
        format!("{command}: gradients of {} by finite differences of the program itself", names.join(", "));
    (*program.progress.borrow_mut())(Event::Note(&text));
    program.planned.set(program.calls.get() + calls_of(&outputs, &gradients, &inputs, &rules)?);
    let by_function = check::Options { entries: 0, ..rules.clone() };
    let mut report = check::function_with_log(command, value, vjp, &inputs, &by_function)?;
    let mut checked = None;
    if let Some(rung) = report.rungs.iter_mut().find(|r| r.name == "R3") {
        let y_bar = roles.outputs.iter().map(|(y, bar)| (y.clone(), bar.to_f64())).collect();
        let mut found = entries(&mut |x| value(x), &inputs, &y_bar, &gradients, &rules)?;
        *rung = std::mem::replace(&mut found.rung, check::Rung::new("R3", ""));
        checked = Some(found);
    }
    let text = format!("{command}: called {} times", program.calls.get());
    (*program.progress.borrow_mut())(Event::Note(&text));
    let nonzero = |x: &&String| gradients[*x].iter().any(|g| *g != 0.0);
    let found = Findings {
        unit: unit.get(),
        most: inputs.values().map(Vec::len).max().unwrap_or_default(),
        is_single: outputs.values().flatten().all(|y| f64::from(*y as f32) == *y),
        nonzero: wrt_hint(gradients.keys().filter(nonzero)),
        entries: checked,
    };
    Ok(with_hints(Check::new(report, &shapes(&program.arrays)), &found))
}
