//! A user-supplied program, called as `CMD IN.npz OUT.npz`: its arrays, and the check of its gradients.

use super::checks::{Check, Rung, Shapes, shapes};
use super::compare::unravel;
use super::names::{UNNAMED, is_unnamed, meant};
use crate::io::npz;
use crate::num::array::{Array, Arrays};
use crate::ops;
use crate::tape::check::{self, Evaluation, UNIT, Values};
use crate::{Error, Result};
use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
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

/// What is wrong with the shape or the values of an array, which has the shape of `like`.
fn fault(name: &str, array: &Array, like: (&str, &[usize])) -> Option<String> {
    let (of, shape) = like;
    if array.shape() != shape {
        return Some(format!("{name} has shape {:?}, but {of} has {shape:?}", array.shape()));
    }
    let values = array.to_f64();
    let i = values.iter().position(|x| !x.is_finite())?;
    Some(format!("{name}{:?} is {}", unravel(i, shape), values[i]))
}

/// The arrays of a program, by what they are.
struct Roles {
    /// outputs with a cotangent in `IN.npz`, by name; the array is the cotangent
    outputs: BTreeMap<String, Array>,
    /// inputs that it differentiates
    inputs: Vec<String>,
    /// what is missing, unknown or malformed
    failures: Vec<String>,
    /// outputs without a cotangent
    unchecked: Vec<String>,
}

impl Roles {
    /// Sorts the arrays of `IN.npz` and of the first `OUT.npz`.
    fn new(input: &Arrays, out: &Arrays, wrt: &[String]) -> Self {
        let bar_of = |name: &str| name.strip_suffix("_bar").map(str::to_owned);
        let has = |name: &str| input.get(name).is_some();
        let mut failures = Vec::new();
        // x_bar next to an input x is a gradient, as in files of `oracle mint`.
        let cotangents: Vec<String> =
            input.0.keys().filter_map(|n| bar_of(n)).filter(|y| out.get(y).is_some() || !has(y)).collect();
        let is_input = |name: &String| {
            input.get(name).is_some_and(Array::is_float)
                && bar_of(name).is_none()
                && !name.starts_with("setting_")
                && out.get(name).is_none()
        };
        let inputs: Vec<String> = match wrt {
            [] => input.0.keys().filter(|n| is_input(n)).cloned().collect(),
            names => names.to_vec(),
        };
        let (lacking, written): (Vec<_>, Vec<_>) = cotangents.into_iter().partition(|y| out.get(y).is_none());
        let gradients = inputs.iter().map(|x| format!("{x}_bar"));
        let absent: Vec<String> = gradients.filter(|g| out.get(g).is_none()).collect();
        let stray: Vec<&String> = (out.0.keys())
            .filter(|n| !written.contains(n) && !has(n) && !bar_of(n).is_some_and(|x| has(&x)))
            .collect();
        for name in &lacking {
            failures.push(format!("no output {name}: IN.npz contains {name}_bar, but OUT.npz no {name}"));
        }
        for name in &absent {
            let x = name.strip_suffix("_bar").unwrap_or(name);
            failures.push(format!("no gradient of {x}: OUT.npz contains no {name}"));
        }
        let wanted: Vec<String> = lacking.into_iter().chain(absent).collect();
        let mut unchecked = Vec::new();
        for name in stray {
            match meant(name, &wanted) {
                Some(close) => {
                    failures.push(format!("unknown name {name} in OUT.npz: did you mean {close}?"))
                }
                None if is_unnamed(name) => {
                    failures.push(format!("unknown name {name} in OUT.npz: {UNNAMED}"))
                }
                None if bar_of(name).is_some() => failures.push(format!(
                    "unknown name {name} in OUT.npz: IN.npz contains no {}",
                    name.strip_suffix("_bar").unwrap_or(name)
                )),
                None => unchecked.push(name.clone()),
            }
        }
        let outputs: BTreeMap<String, Array> = written
            .into_iter()
            .filter_map(|y| Some((y.clone(), input.get(&format!("{y}_bar"))?.clone())))
            .collect();
        for (y, bar) in &outputs {
            let like = format!("{y}_bar");
            failures.extend(out.get(y).and_then(|a| fault(y, a, (&like, bar.shape()))));
        }
        for x in &inputs {
            let name = format!("{x}_bar");
            let (Some(g), Some(like)) = (out.get(&name), input.get(x)) else { continue };
            failures.extend(fault(&name, g, (x, like.shape())));
        }
        Self { outputs, inputs, failures, unchecked }
    }
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

/// Title of R0 of a program.
const SANITY: &str = "arrays: none missing, known names, shapes, finite; gradients not 0 everywhere";

/// The report of a check that ended with the names, shapes and values of the arrays.
fn incomplete(command: &str, failures: Vec<String>) -> Check {
    let mut rung = check::Rung::new("R0", SANITY);
    failures.into_iter().for_each(|f| rung.fail(f));
    let report = check::Report { subject: command.to_owned(), rungs: vec![rung] };
    with_hints(Check::new(report, &Shapes::new()), UNIT, 0)
}

/// The report in the terms of a program, with hints if it did not pass.
fn with_hints(mut check: Check, unit: f64, entries: usize) -> Check {
    for rung in &mut check.rungs {
        rung.title = match rung.name {
            "R0" => SANITY,
            "R1" => "gradient along random directions of all inputs, against finite differences",
            _ => "gradient of single entries, against finite differences",
        };
        // A program reports no decisions and predicts no zeros.
        rung.measures.retain(|m| rung.name != "R0" && !m.what.starts_with("skipped because"));
    }
    let failed = |name: &str| check.rung(name).is_some_and(|r: &Rung| !r.passed);
    let has = |part: &str| check.rung("R0").is_some_and(|r| r.failures.iter().any(|f| f.contains(part)));
    let mut hints = Vec::new();
    if has("no gradient of") || has("is zero everywhere") {
        hints.push("--wrt x,w checks the gradients of these inputs only".to_owned());
    }
    if failed("R1") && !failed("R3") {
        hints.push(format!(
            "R3 checked some entries only; --entries {entries} checks all and names the wrong ones"
        ));
    }
    if failed("R1") || failed("R3") {
        let kink = "an input at a kink (ReLU or |x| at 0, the end of a clamp) has no derivative: move it away from the kink by 0.02 or more";
        let noise = match unit > UNIT {
            true => {
                "the program writes f32, whose rounding limits finite differences; the check is sharper in f64"
            }
            false => {
                "a program that computes in f32 should write f32 arrays: the check then allows for their rounding"
            }
        };
        hints.extend([kink.to_owned(), noise.to_owned()]);
    }
    check.hints = hints;
    check
}

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
    let roles = Roles::new(&program.arrays, &first, wrt);
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
        return Ok(incomplete(command, roles.failures));
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
    let report = check::function_with_log(command, value, vjp, &inputs, &rules)?;
    let text = format!("{command}: called {} times", program.calls.get());
    (*program.progress.borrow_mut())(Event::Note(&text));
    let most = inputs.values().map(Vec::len).max().unwrap_or_default();
    Ok(with_hints(Check::new(report, &shapes(&program.arrays)), unit.get(), most))
}
