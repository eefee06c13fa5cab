//! `oracle run`.

use super::names::{UNNAMED, is_unnamed, meant};
use crate::io::npz;
use crate::num::array::{Array, Arrays};
use crate::num::bits::{self, Digest};
use crate::ops::{self, Call, Op, RunResult, Setting, Settings, Width};
use crate::{Error, Result};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

/// Arithmetic of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// the shipped operator
    #[default]
    F32,
    /// the twin
    F64,
}

/// Options of a run.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// operator
    pub op: String,
    /// input file
    pub input: PathBuf,
    /// output file
    pub out: PathBuf,
    /// arithmetic
    pub precision: Precision,
    /// splatting profile, a shorthand for the setting of that name
    pub profile: Option<String>,
    /// `KEY=VALUE`; takes precedence over arrays `setting_KEY`
    pub set: Vec<String>,
    /// file with the plan to use
    pub plan: Option<PathBuf>,
    /// whether to write the intermediates
    pub dump: bool,
}

/// Description of one array without its values.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ArrayDigest {
    /// sizes of the axes
    pub shape: Vec<usize>,
    /// element type as NumPy writes it
    pub dtype: &'static str,
    /// FNV-1a 64 of type, shape and bits
    pub digest: String,
}

/// Report of a run; also the content of `OUT.digest.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// operator
    pub operator: &'static str,
    /// arithmetic
    pub precision: Precision,
    /// explicitly given settings
    pub settings: BTreeMap<String, String>,
    /// arrays of `OUT.npz`
    pub arrays: BTreeMap<String, ArrayDigest>,
    /// arrays of `OUT.plan.npz`
    pub plan: BTreeMap<String, ArrayDigest>,
    /// digest over names and digests of all arrays of `OUT.npz`, then of the plan
    pub digest: String,
    /// digest over names and digests of the plan only: the decision log
    pub plan_digest: String,
    /// arrays that were not used, and why
    #[serde(skip)]
    pub notes: Vec<String>,
    /// files written
    #[serde(skip)]
    pub files: Vec<PathBuf>,
}

/// The arrays of a file, sorted into the parts of a call.
#[derive(Clone, Debug, Default)]
pub struct SortedArrays {
    /// the call: inputs, settings, cotangents
    pub call: Call,
    /// one line about the arrays that were ignored, if there are any
    pub notes: Vec<String>,
}

/// What an array of a file is to an operator.
enum Role<'a> {
    Input,
    /// The cotangent of this output.
    Cotangent(&'a str),
    /// The value of this setting.
    Setting(&'a str),
    /// Not used: what it is, in the plural.
    Ignored(&'static str),
}

impl<'a> Role<'a> {
    /// The role of an array by its name.
    ///
    /// # Errors
    /// An unknown name.
    fn of(op: &Op, name: &'a str) -> Result<Self> {
        let has = |ports: &[ops::Port], name: &str| ports.iter().any(|p| p.name == name);
        let bar_of = name.strip_suffix("_bar");
        if has(op.inputs, name) {
            return Ok(Self::Input);
        }
        if let Some(output) = bar_of.filter(|y| has(op.outputs, y)) {
            return Ok(if op.adjoint {
                Self::Cotangent(output)
            } else {
                Self::Ignored("cotangents (the operator has no adjoint)")
            });
        }
        if let Some(key) = name.strip_prefix("setting_") {
            return Ok(Self::Setting(key));
        }
        let reason = if has(op.outputs, name) {
            "outputs"
        } else if has(op.intermediates, name) {
            "intermediates"
        } else if bar_of.is_some_and(|x| has(op.inputs, x)) {
            "gradients"
        } else if op.companions.contains(&name) {
            "companions of this operator's files"
        } else {
            let inputs: Vec<_> = op.inputs.iter().map(|p| p.name).collect();
            let e = Error::input(format!("array '{name}'"))
                .expected(format!("an input ({}), <output>_bar or setting_KEY", inputs.join(", ")))
                .got("an unknown name");
            let bars: Vec<String> = op.outputs.iter().map(|p| format!("{}_bar", p.name)).collect();
            let known: Vec<String> = inputs.iter().map(|n| (*n).to_owned()).chain(bars).collect();
            return Err(match meant(name, &known) {
                Some(close) => e.hint(format!("did you mean {close}?")),
                None if is_unnamed(name) => e.hint(UNNAMED),
                None => e.hint(format!("`oracle show {}` prints its arrays and settings", op.name)),
            });
        };
        Ok(Self::Ignored(reason))
    }
}

/// Sorts the arrays of a file by the rules of `oracle run`: inputs by name, `<output>_bar`, `setting_KEY`;
/// outputs, intermediates, `<input>_bar` and companions are ignored, with one note; anything else is an error.
///
/// # Errors
/// An unknown name, or a setting that is not one number.
pub fn sort(op: &'static Op, arrays: Arrays) -> Result<SortedArrays> {
    let (mut sorted, mut unused) = (SortedArrays::default(), Unused::new());
    for (name, array) in arrays.0 {
        match Role::of(op, &name)? {
            Role::Cotangent(output) => {
                sorted.call.cotangents.0.insert(output.to_owned(), array);
            }
            Role::Setting(_) if array.len() != 1 => {
                return Err(Error::input(format!("array '{name}'"))
                    .expected("one number")
                    .got(format!("shape {:?}", array.shape())));
            }
            Role::Setting(key) => {
                sorted.call.settings.insert(key.to_owned(), Setting::Number(array.to_f64()[0]));
            }
            Role::Ignored(kind) => unused.entry(kind).or_default().push(name),
            Role::Input => {
                sorted.call.inputs.0.insert(name, array);
            }
        }
    }
    sorted.notes = ignored(&unused).into_iter().collect();
    Ok(sorted)
}

/// Names of arrays that are not used, by what they are.
type Unused = BTreeMap<&'static str, Vec<String>>;

/// Most names of one kind that a note lists.
const LISTED: usize = 6;

/// `ignored: gradients x_bar; outputs y`.
fn ignored(unused: &Unused) -> Option<String> {
    let kind = |(kind, names): (&&str, &Vec<String>)| match names.len() {
        n if n > LISTED => format!("{n} {kind}"),
        _ => format!("{kind} {}", names.join(", ")),
    };
    let kinds: Vec<String> = unused.iter().map(kind).collect();
    (!kinds.is_empty()).then(|| format!("ignored, not needed for a run: {}", kinds.join("; ")))
}

/// Reads what an operator uses from a file, as [`sort`] does with arrays in memory; other arrays are not read.
///
/// # Errors
/// As [`sort`], and for a file that cannot be read.
pub fn read(op: &'static Op, path: &Path) -> Result<SortedArrays> {
    let in_file = |e: Error| e.within(path.display().to_string());
    let mut file = npz::Archive::open(path)?;
    let mut names = file.names();
    names.sort();
    let mut unused = Unused::new();
    for name in &names {
        if let Role::Ignored(kind) = Role::of(op, name).map_err(in_file)? {
            unused.entry(kind).or_default().push(name.clone());
        }
    }
    let arrays = file.read(&|name| !matches!(Role::of(op, name), Ok(Role::Ignored(_)) | Err(_)))?;
    drop(file);
    let notes = ignored(&unused).into_iter().collect();
    Ok(SortedArrays { notes, ..sort(op, arrays).map_err(in_file)? })
}

/// Adds `--profile` and `--set` to the settings of a file.
///
/// # Errors
/// When a `--set` has no `=`.
pub fn add_settings(op: &Op, settings: &mut Settings, profile: Option<&str>, set: &[String]) -> Result<()> {
    if let Some(profile) = profile {
        if !op.settings.iter().any(|s| s.key == "profile") {
            return Err(Error::input("--profile").expected("an operator with profiles").got(op.name));
        }
        settings.insert("profile".to_owned(), Setting::Text(profile.to_owned()));
    }
    for text in set {
        let Some((key, value)) = text.split_once('=') else {
            return Err(Error::input("--set").expected("KEY=VALUE").got(text));
        };
        settings.insert(key.trim().to_owned(), Setting::Text(value.trim().to_owned()));
    }
    Ok(())
}

/// One call in one precision, as in every run. A run in f32 returns f32 arrays, also for an operator that
/// computes in f64.
///
/// # Errors
/// Bad input; a result out of the range of f32.
pub fn call(op: &'static Op, call: &Call, precision: Precision) -> Result<RunResult> {
    match (precision, op.width) {
        (Precision::F32, Width::F32) => ops::run(op, call),
        (Precision::F32, Width::F64) => ops::run(op, call)?.stored_in_f32(op),
        (Precision::F64, _) => ops::run_f64(op, call),
    }
}

/// The arrays of `OUT.npz`: outputs, gradients as `<input>_bar`, intermediates.
pub fn gather(ran: &RunResult) -> Arrays {
    let mut out = ran.outputs.clone();
    out.0.extend(ran.intermediates.0.iter().map(|(n, a)| (n.clone(), a.clone())));
    out.0.extend(ran.gradients.0.iter().map(|(n, a)| (format!("{n}_bar"), a.clone())));
    out
}

/// Refuses an output that is one of the inputs, under this or another path.
///
/// # Errors
/// When it is.
pub fn check_output<'a>(option: &str, out: &Path, mut inputs: impl Iterator<Item = &'a Path>) -> Result<()> {
    let Ok(out) = out.canonicalize() else { return Ok(()) };
    if inputs.any(|input| input.canonicalize().is_ok_and(|input| input == out)) {
        let e = Error::input(option).expected("a file other than the inputs");
        return Err(e.got(out.display().to_string()));
    }
    Ok(())
}

/// Runs an operator on a file. Before an f64 run, `progress` is called with its amount of work and expected
/// time.
///
/// # Errors
/// Bad input, or files that cannot be read or written.
pub fn run(options: &Options, progress: &mut dyn FnMut(&str)) -> Result<Report> {
    let op = ops::find(&options.op)?;
    let inputs = [Some(options.input.as_path()), options.plan.as_deref()];
    check_output("--out", &options.out, inputs.into_iter().flatten())?;
    let in_file = |e: Error| e.within(options.input.display().to_string());
    let SortedArrays { call: mut request, notes } = read(op, &options.input)?;
    add_settings(op, &mut request.settings, options.profile.as_deref(), &options.set)?;
    request.plan = options.plan.as_deref().map(npz::read).transpose()?;
    request.dump = options.dump;
    for note in &notes {
        progress(note);
    }
    if options.precision == Precision::F64 {
        let work = ops::work(op, &request).map_err(in_file)?;
        progress(&estimate(op, work, !request.cotangents.0.is_empty()));
    }
    let ran = call(op, &request, options.precision).map_err(in_file)?;
    let arrays = gather(&ran);
    let mut report = report(op, options.precision, &request.settings, &arrays, &ran.plan)?;
    report.notes = notes;
    let plan_file = sibling(&options.out, "plan.npz");
    let digest_file = sibling(&options.out, "digest.json");
    npz::write(&options.out, &arrays)?;
    let has_plan = !op.plan.is_empty();
    if has_plan {
        npz::write(&plan_file, &ran.plan)?;
    }
    let json = serde_json::to_string_pretty(&report).expect("a record of strings and numbers is valid JSON");
    crate::io::atomic::write_bytes(&digest_file, format!("{json}\n").as_bytes())?;
    report.files = vec![options.out.clone()];
    report.files.extend(has_plan.then_some(plan_file));
    report.files.push(digest_file);
    Ok(report)
}

/// `OUT.npz` → `OUT.<extension>`.
fn sibling(out: &Path, extension: &str) -> PathBuf {
    out.with_extension(extension)
}

fn estimate(op: &Op, work: f64, gradients: bool) -> String {
    let seconds = work * if gradients { op.work_ns[1] } else { op.work_ns[0] } * 1e-9;
    let time = if seconds < 1.0 { "less than a second".to_owned() } else { format!("about {seconds:.0} s") };
    format!("{}: {work:.0} {}, {time} in f64", op.name, op.work_unit)
}

fn digests(arrays: &Arrays, all: &mut Digest) -> Result<BTreeMap<String, ArrayDigest>> {
    let mut out = BTreeMap::new();
    for (name, a) in &arrays.0 {
        let digest = bits::digest(a).map_err(|e| e.at(format!("array '{name}'")))?;
        all.bytes(name.as_bytes());
        all.u64(digest);
        let shown = ArrayDigest {
            shape: a.shape().to_vec(),
            dtype: Array::dtype(a),
            digest: format!("{digest:016x}"),
        };
        out.insert(name.clone(), shown);
    }
    Ok(out)
}

/// Digests of a run.
///
/// # Errors
/// When a result is NaN.
pub fn report(
    op: &Op,
    precision: Precision,
    settings: &Settings,
    arrays: &Arrays,
    plan: &Arrays,
) -> Result<Report> {
    let (mut all, mut log) = (Digest::new(), Digest::new());
    let shown = |s: &Setting| match s {
        Setting::Number(x) => x.to_string(),
        Setting::Text(text) => text.clone(),
    };
    let arrays = digests(arrays, &mut all)?;
    let plan_arrays = digests(plan, &mut log)?;
    digests(plan, &mut all)?;
    Ok(Report {
        operator: op.name,
        precision,
        settings: settings.iter().map(|(k, s)| (k.clone(), shown(s))).collect(),
        arrays,
        plan: plan_arrays,
        digest: format!("{:016x}", all.value()),
        plan_digest: format!("{:016x}", log.value()),
        notes: Vec::new(),
        files: Vec::new(),
    })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = if self.precision == Precision::F32 { "f32" } else { "f64" };
        write!(f, "{} in {width}: digest {}", self.operator, self.digest)?;
        match self.plan.is_empty() {
            true => writeln!(f)?,
            false => writeln!(f, ", plan {}", self.plan_digest)?,
        }
        for (name, a) in &self.arrays {
            writeln!(f, "  {name:<16} {:<18} {:<8} {}", format!("{:?}", a.shape), a.dtype, a.digest)?;
        }
        for file in &self.files {
            writeln!(f, "wrote {}", file.display())?;
        }
        Ok(())
    }
}
