//! `oracle compare`: compares two files array by array and finds the first operator at which they diverge.

pub use super::differences::{Agreement, ArrayReport, Divergence, Nans, Report, Worst, Zeros};
use crate::io::{memory, npz};
use crate::num::array::{Array, Arrays};
use crate::num::bits::{ulp_f32, ulp_f64};
use crate::ops::{self, Compare, Op};
use crate::tape::probe::distance;
use crate::{Error, Result};
use std::path::PathBuf;

/// Default bound on the relative L2 of an array.
pub const TOLERANCE: f64 = 1e-5;

/// Number of entries that a report lists.
const WORST: usize = 10;

/// Options of a comparison.
#[derive(Clone, Debug)]
pub struct Options {
    /// user-supplied arrays
    pub theirs: PathBuf,
    /// arrays of lastlight
    pub ours: PathBuf,
    /// operator; found by the names of the arrays when `None`
    pub op: Option<String>,
    /// bound on the relative L2 of an array
    pub tol: f64,
}

/// The operator whose names match most of the arrays; of several, composite ones first, then in the order of
/// the list.
fn guess(theirs: &[String], ours: &[String]) -> Option<&'static Op> {
    let known = |op: &Op, name: &str| {
        op.has_array(name) || name.strip_suffix("_bar").is_some_and(|x| op.has_array(x))
    };
    let score = |op: &Op| theirs.iter().chain(ours).filter(|n| known(op, n)).count();
    let has = |names: &[String], name: &str| names.iter().any(|n| n == name);
    let produces = |op: &Op| op.outputs.iter().any(|p| has(ours, p.name) && has(theirs, p.name));
    let mut best: Option<(&'static Op, usize)> = None;
    let ordered = ops::LIST
        .iter()
        .filter(|op| op.is_composite())
        .chain(ops::LIST.iter().filter(|op| !op.is_composite()));
    for op in ordered.filter(|op| produces(op)) {
        let s = score(op);
        if best.is_none_or(|(_, b)| s > b) {
            best = Some((op, s));
        }
    }
    best.map(|(op, _)| op)
}

fn unravel(mut i: usize, shape: &[usize]) -> Vec<usize> {
    let mut index = vec![0; shape.len()];
    for (slot, &size) in index.iter_mut().zip(shape).rev() {
        *slot = i % size;
        i /= size;
    }
    index
}

/// The entries to compare: all, or those in rows where `mask` is nonzero in both files.
fn selected(
    name: &str,
    op: Option<&Op>,
    theirs: &Arrays,
    ours: &Arrays,
    len: usize,
) -> (Vec<bool>, Option<String>, bool) {
    let all = vec![true; len];
    let Some(port) = op.and_then(|op| op.port(name)) else { return (all, None, false) };
    match port.compare {
        Compare::Values => (all, None, false),
        Compare::ZeroPattern => (all, Some("zero pattern only".to_owned()), true),
        Compare::RowsOf(by) => {
            let (Some(a), Some(b)) = (theirs.get(by), ours.get(by)) else { return (all, None, false) };
            let rows = match a.shape() {
                [cameras, n, ..] => cameras * n,
                _ => 0,
            };
            if a.shape() != b.shape()
                || rows == 0
                || !a.len().is_multiple_of(rows)
                || !len.is_multiple_of(rows)
            {
                return (all, None, false);
            }
            let (wide, per_row) = (a.len() / rows, len / rows);
            let (a, b) = (a.to_f64(), b.to_f64());
            let there = |v: &[f64], r: usize| v[r * wide..(r + 1) * wide].iter().any(|x| *x != 0.0);
            let keep: Vec<bool> = (0..rows).map(|r| there(&a, r) && there(&b, r)).collect();
            let dropped = keep.iter().filter(|k| !**k).count();
            let note = (dropped > 0).then(|| format!("{dropped} rows with {by} = 0 not compared"));
            ((0..len).map(|i| keep[i / per_row]).collect(), note, false)
        }
    }
}

fn one(name: &str, op: Option<&Op>, theirs_all: &Arrays, ours_all: &Arrays, tol: f64) -> Result<ArrayReport> {
    let (theirs, ours) = (theirs_all.need(name)?, ours_all.need(name)?);
    let mut report = ArrayReport {
        name: name.to_owned(),
        shape_theirs: theirs.shape().to_vec(),
        shape_ours: ours.shape().to_vec(),
        dtypes: [theirs.dtype(), ours.dtype()],
        agreement: Agreement::ShapesDiffer,
        note: None,
        worst_ulp: 0,
        mean_ulp: 0.0,
        relative_l2: 0.0,
        cosine: 1.0,
        signed_bias: 0.0,
        zeros: Zeros::default(),
        worst: Vec::new(),
        nans: None,
    };
    if theirs.shape() != ours.shape() {
        return Ok(report);
    }
    // Both arrays in f64, the rows to compare, and copies of them if some are left out.
    memory::check(&format!("oracle compare, array '{name}'"), 33 * ours.len() as u64)?;
    let (keep, note, pattern) = selected(name, op, theirs_all, ours_all, ours.len());
    report.note = note;
    let single = [theirs, ours].iter().any(|a| matches!(a, Array::F32(_)));
    let (a, b) = (theirs.to_f64(), ours.to_f64());
    let is_nan = |i: &usize| a[*i].is_nan() || b[*i].is_nan();
    if let Some(first) = (0..a.len()).find(is_nan) {
        let count = |v: &[f64]| v.iter().filter(|x| x.is_nan()).count();
        let first = unravel(first, ours.shape());
        report.nans = Some(Nans { theirs: count(&a), ours: count(&b), first });
        report.agreement = Agreement::Nan;
        return Ok(report);
    }
    let whole = !theirs.is_float() && !ours.is_float();
    let ulp = |i: usize| match (whole, single) {
        (true, _) => (a[i] - b[i]).abs() as u64, // integers: their difference
        (false, true) => ulp_f32(a[i] as f32, b[i] as f32),
        (false, false) => ulp_f64(a[i], b[i]),
    };
    let kept = || (0..keep.len()).filter(|&i| keep[i]);
    let d = if kept().count() == keep.len() {
        distance(&b, &a)
    } else {
        let (x, y): (Vec<f64>, Vec<f64>) = kept().map(|i| (b[i], a[i])).unzip();
        distance(&x, &y)
    };
    report.relative_l2 = d.relative_l2;
    report.cosine = 1.0 - d.one_minus_cosine;
    report.signed_bias = d.signed_bias;
    let (mut total, mut count, mut worst) = (0.0, 0_usize, Vec::with_capacity(WORST + 1));
    for i in kept() {
        count += 1;
        if a[i] != b[i] {
            let larger = |j: &usize| (b[*j] - a[*j]).abs().total_cmp(&(b[i] - a[i]).abs()).is_ge();
            worst.insert(worst.partition_point(larger), i);
            worst.truncate(WORST);
        }
        let u = ulp(i);
        report.worst_ulp = Ord::max(report.worst_ulp, u);
        total += u as f64;
        match (a[i] == 0.0, b[i] == 0.0) {
            (true, true) => report.zeros.both += 1,
            (true, false) => report.zeros.only_theirs += 1,
            (false, true) => report.zeros.only_ours += 1,
            (false, false) => {}
        }
    }
    if count > 0 {
        report.mean_ulp = total / count as f64;
    }
    let entry = |&i: &usize| Worst { index: unravel(i, ours.shape()), theirs: a[i], ours: b[i], ulp: ulp(i) };
    report.worst = worst.iter().map(entry).collect();
    report.agreement = if pattern {
        if report.zeros.only_theirs + report.zeros.only_ours == 0 {
            Agreement::Agrees
        } else {
            Agreement::ZerosDiffer
        }
    } else if report.relative_l2 <= tol {
        Agreement::Agrees
    } else {
        Agreement::Differs
    };
    Ok(report)
}

fn divergence(op: &Op, arrays: &[ArrayReport]) -> Option<Divergence> {
    let find = |name: &str| arrays.iter().find(|a| a.name == name);
    let differs = |name: &str| find(name).is_some_and(|a| a.agreement != Agreement::Agrees);
    let at = |stage: &str, inputs: &[&str], outputs: &[&str]| {
        let parts = !inputs.iter().any(|n| differs(n)) && outputs.iter().any(|n| differs(n));
        parts.then(|| {
            let (checked, unchecked): (Vec<&str>, Vec<&str>) = inputs.iter().partition(|n| find(n).is_some());
            let outputs = outputs.iter().copied().filter(|n| differs(n)).collect();
            let stage = stage.to_owned();
            Divergence { stage, inputs: owned(checked), unchecked: owned(unchecked), outputs: owned(outputs) }
        })
    };
    if op.is_composite() {
        return op.stages.iter().find_map(|s| at(s.operator, s.inputs, s.outputs));
    }
    let names = |ports: &'static [ops::Port]| ports.iter().map(|p| p.name).collect::<Vec<_>>();
    let (inputs, outputs) = (names(op.inputs), names(op.outputs));
    at(op.name, &inputs, &outputs).or_else(|| {
        // The gradients depend on the inputs and on the cotangents.
        let barred = |names: &[&str]| names.iter().map(|name| format!("{name}_bar")).collect::<Vec<_>>();
        let (cotangents, gradients) = (barred(&outputs), barred(&inputs));
        let given: Vec<&str> = inputs.iter().copied().chain(cotangents.iter().map(String::as_str)).collect();
        let gradients: Vec<&str> = gradients.iter().map(String::as_str).collect();
        at(&format!("{} adjoint", op.name), &given, &gradients)
    })
}

fn owned(names: Vec<&str>) -> Vec<String> {
    names.into_iter().map(str::to_owned).collect()
}

/// Compares arrays in memory.
///
/// # Errors
/// When the files have no array in common, or the operator is unknown.
pub fn arrays(theirs: &Arrays, ours: &Arrays, op: Option<&str>, tol: f64) -> Result<Report> {
    let names = [theirs, ours].map(|a| a.0.keys().cloned().collect::<Vec<_>>());
    named(theirs, ours, &names, op, tol)
}

/// Compares the arrays that both files contain; `names` are those of all arrays of the files, in order.
fn named(
    theirs: &Arrays,
    ours: &Arrays,
    names: &[Vec<String>; 2],
    op: Option<&str>,
    tol: f64,
) -> Result<Report> {
    let op = match op {
        Some(name) => Some(ops::find(name)?),
        None => guess(&names[0], &names[1]),
    };
    let mut reports = Vec::new();
    for name in ours.0.keys().filter(|n| theirs.get(n).is_some()) {
        reports.push(one(name, op, theirs, ours, tol)?);
    }
    if reports.is_empty() {
        return Err(Error::input("oracle compare")
            .expected("at least one array name in both files")
            .got(format!("[{}] and [{}]", names[0].join(", "), names[1].join(", "))));
    }
    let only = |a: &[String], b: &[String]| a.iter().filter(|n| !b.contains(n)).cloned().collect();
    let passed = reports.iter().all(|a| a.agreement == Agreement::Agrees);
    Ok(Report {
        operator: op.map(|op| op.name),
        tol,
        only_theirs: only(&names[0], &names[1]),
        only_ours: only(&names[1], &names[0]),
        divergence: op.and_then(|op| divergence(op, &reports)),
        arrays: reports,
        passed,
    })
}

/// Two files and how they differ.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// the result
    pub report: Report,
    /// user-supplied arrays
    pub theirs: Arrays,
    /// reference arrays
    pub ours: Arrays,
}

/// Compares two files. The report states whether any array differs.
///
/// # Errors
/// Files that cannot be read, or have no array in common.
pub fn compare(options: &Options) -> Result<Comparison> {
    if !(options.tol >= 0.0) {
        return Err(Error::input("--tol").expected("0 or more").got(options.tol.to_string()));
    }
    // Arrays that only one file contains are listed but not read.
    let mut files = [npz::Archive::open(&options.theirs)?, npz::Archive::open(&options.ours)?];
    let mut names = [files[0].names(), files[1].names()];
    names.iter_mut().for_each(|names| names.sort());
    let [theirs, ours] = &mut files;
    let theirs = theirs.read(&|name| names[1].iter().any(|n| n == name))?;
    let ours = ours.read(&|name| names[0].iter().any(|n| n == name))?;
    drop(files);
    let report = named(&theirs, &ours, &names, options.op.as_deref(), options.tol)?;
    Ok(Comparison { report, theirs, ours })
}
