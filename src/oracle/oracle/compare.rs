//! `oracle compare`: compares two files array by array and finds the first operator at which they diverge.

pub use super::differences::{
    Agreement, ArrayReport, Divergence, Measures, Nans, Report, Worst, Zeros, mean_ulp, plural, ulp,
};
use super::names::{self, UNNAMED, guess, is_unnamed, only};
pub use super::names::{Missing, Side, Unknown};
use crate::io::{memory, npz};
use crate::num::array::{Array, Arrays};
use crate::num::bits::{ulp_f32, ulp_f64};
use crate::ops::{self, Compare, Op};
use crate::tape::probe::distance;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Default bound on the relative L2 of an array.
pub const TOLERANCE: f64 = 1e-5;

/// Number of entries that a report lists.
const WORST: usize = 10;

/// Most bytes of a file of digests.
const DIGESTS_BYTES: u64 = 1 << 20;

/// Options of a comparison.
#[derive(Clone, Debug)]
pub struct Options {
    /// user-supplied arrays
    pub yours: PathBuf,
    /// reference arrays
    pub reference: PathBuf,
    /// operator; found by the names of the arrays when `None`
    pub op: Option<String>,
    /// bound on the relative L2 of an array
    pub tol: f64,
    /// whether outputs and gradients may be missing in a file, and unknown names be present
    pub present_only: bool,
}

/// The index along each axis of entry `i`.
pub(super) fn unravel(mut i: usize, shape: &[usize]) -> Vec<usize> {
    let mut index = vec![0; shape.len()];
    for (slot, &size) in index.iter_mut().zip(shape).rev() {
        *slot = i % size;
        i /= size;
    }
    index
}

/// The entries to compare.
struct Selection {
    /// whether an entry is compared
    keep: Vec<bool>,
    /// which entries are compared, if not all
    note: Option<String>,
    /// whether only zeros are compared
    is_pattern: bool,
}

/// All entries, or those in rows where the mask of the port is nonzero in both files.
fn selected(name: &str, op: Option<&Op>, [yours, reference]: [&Arrays; 2], len: usize) -> Selection {
    let all = |note: Option<&str>| Selection {
        keep: vec![true; len],
        note: note.map(str::to_owned),
        is_pattern: note.is_some(),
    };
    match op.and_then(|op| op.port(name)).map(|port| port.compare) {
        None | Some(Compare::Values) => all(None),
        Some(Compare::ZeroPattern) => all(Some("zero pattern only")),
        Some(Compare::RowsOf(by)) => {
            let (Some(a), Some(b)) = (yours.get(by), reference.get(by)) else { return all(None) };
            let rows = match a.shape() {
                [cameras, n, ..] => cameras * n,
                _ => 0,
            };
            if a.shape() != b.shape()
                || rows == 0
                || !a.len().is_multiple_of(rows)
                || !len.is_multiple_of(rows)
            {
                return all(None);
            }
            let (wide, per_row) = (a.len() / rows, len / rows);
            let (a, b) = (a.to_f64(), b.to_f64());
            let there = |v: &[f64], r: usize| v[r * wide..(r + 1) * wide].iter().any(|x| *x != 0.0);
            let keep: Vec<bool> = (0..rows).map(|r| there(&a, r) && there(&b, r)).collect();
            let dropped = keep.iter().filter(|k| !**k).count();
            let note = (dropped > 0).then(|| format!("{dropped} rows with {by} = 0 not compared"));
            Selection { keep: (0..len).map(|i| keep[i / per_row]).collect(), note, is_pattern: false }
        }
    }
}

/// Compares one array of both files.
fn one(name: &str, op: Option<&Op>, files: [&Arrays; 2], tol: f64) -> Result<ArrayReport> {
    let (yours, reference) = (files[0].need(name)?, files[1].need(name)?);
    let mut report = ArrayReport {
        name: name.to_owned(),
        shape_yours: yours.shape().to_vec(),
        shape_reference: reference.shape().to_vec(),
        dtypes: [yours.dtype(), reference.dtype()],
        agreement: Agreement::ShapesDiffer,
        reason: None,
        note: None,
        measures: None,
        worst: Vec::new(),
        nans: None,
    };
    // Both arrays in f64, the rows to compare, and copies of them if some are left out.
    memory::check(&format!("oracle compare, array '{name}'"), 33 * reference.len() as u64)?;
    let (a, b) = (yours.to_f64(), reference.to_f64());
    if yours.shape() != reference.shape() {
        let (yours, reference) = (yours.shape(), reference.shape());
        report.reason = Some(format!("yours {yours:?}, reference {reference:?}"));
        report.note = relation_of_shapes([&a, &b], [yours, reference], tol);
        return Ok(report);
    }
    if let Some(first) = (0..a.len()).find(|&i| a[i].is_nan() || b[i].is_nan()) {
        let count = |v: &[f64]| v.iter().filter(|x| x.is_nan()).count();
        let first = unravel(first, reference.shape());
        let nans = Nans { yours: count(&a), reference: count(&b), first };
        report.reason = Some(nans.to_string());
        report.nans = Some(nans);
        report.agreement = Agreement::Nan;
        return Ok(report);
    }
    let Selection { keep, note, is_pattern } = selected(name, op, files, reference.len());
    let (m, worst) = measured([yours, reference], [&a, &b], &keep);
    report.agreement = match is_pattern {
        true if m.zeros.only_yours + m.zeros.only_reference == 0 => Agreement::Matches,
        true => Agreement::ZerosDiffer,
        false if m.relative_l2 <= tol => Agreement::Matches,
        false => Agreement::Differs,
    };
    if m.relative_l2.is_infinite() {
        let infinite = a.iter().chain(&b).any(|x| x.is_infinite());
        let reason = if infinite { "infinite at different entries" } else { "the reference is all zero" };
        report.reason = Some(reason.to_owned());
    }
    let related = || relation_of_values([&a, &b], reference.shape(), &m, tol);
    report.note = note;
    if report.agreement == Agreement::Differs && report.note.is_none() && report.reason.is_none() {
        report.note = related();
    }
    report.measures = Some(m);
    report.worst = worst;
    Ok(report)
}

/// Measures of the entries that are kept, and those that differ most.
fn measured(arrays: [&Array; 2], [a, b]: [&[f64]; 2], keep: &[bool]) -> (Measures, Vec<Worst>) {
    let are_integers = arrays.iter().all(|a| !a.is_float());
    let is_single = arrays.iter().any(|a| matches!(a, Array::F32(_)));
    let ulp = |i: usize| match (are_integers, is_single) {
        (true, _) => (a[i] - b[i]).abs() as u64, // integers: their difference
        (false, true) => ulp_f32(a[i] as f32, b[i] as f32),
        (false, false) => ulp_f64(a[i], b[i]),
    };
    let kept = || (0..keep.len()).filter(|&i| keep[i]);
    let d = if kept().count() == keep.len() {
        distance(a, b)
    } else {
        let (x, y): (Vec<f64>, Vec<f64>) = kept().map(|i| (a[i], b[i])).unzip();
        distance(&x, &y)
    };
    let mut m = Measures {
        worst_ulp: 0,
        mean_ulp: 0.0,
        relative_l2: d.relative_l2,
        cosine: 1.0 - d.one_minus_cosine,
        signed_bias: d.signed_bias,
        zeros: Zeros::default(),
    };
    let (mut total, mut count, mut worst) = (0.0, 0_usize, Vec::with_capacity(WORST + 1));
    for i in kept() {
        count += 1;
        if a[i] != b[i] {
            let larger = |j: &usize| (a[*j] - b[*j]).abs().total_cmp(&(a[i] - b[i]).abs()).is_ge();
            worst.insert(worst.partition_point(larger), i);
            worst.truncate(WORST);
        }
        let u = ulp(i);
        m.worst_ulp = Ord::max(m.worst_ulp, u);
        total += u as f64;
        match (a[i] == 0.0, b[i] == 0.0) {
            (true, true) => m.zeros.both += 1,
            (true, false) => m.zeros.only_yours += 1,
            (false, true) => m.zeros.only_reference += 1,
            (false, false) => {}
        }
    }
    if count > 0 {
        m.mean_ulp = total / count as f64;
    }
    let shape = arrays[1].shape();
    let entry = |&i: &usize| Worst { index: unravel(i, shape), yours: a[i], reference: b[i], ulp: ulp(i) };
    (m, worst.iter().map(entry).collect())
}

/// The transpose of a matrix.
fn transposed(values: &[f64], [rows, columns]: [usize; 2]) -> Vec<f64> {
    (0..columns).flat_map(|c| (0..rows).map(move |r| values[r * columns + c])).collect()
}

/// Whether two arrays differ by their shape only, or are transposes of each other.
fn relation_of_shapes([a, b]: [&[f64]; 2], shapes: [&[usize]; 2], tol: f64) -> Option<String> {
    let is_close = |a: &[f64]| a.len() == b.len() && distance(a, b).relative_l2 <= tol;
    if let ([r, c], [p, q]) = (shapes[0], shapes[1])
        && (r, c) == (q, p)
        && is_close(&transposed(a, [*r, *c]))
    {
        return Some("yours is the transpose of the reference".to_owned());
    }
    is_close(a).then(|| "the values match in order".to_owned())
}

/// Whether an array that differs is all zero, the transpose of the reference, or a multiple of it.
fn relation_of_values([a, b]: [&[f64]; 2], shape: &[usize], m: &Measures, tol: f64) -> Option<String> {
    if a.iter().all(|x| *x == 0.0) {
        return Some("yours is all zero".to_owned());
    }
    if let [r, c] = *shape
        && r > 1
        && r == c
        && distance(&transposed(a, [r, c]), b).relative_l2 <= tol
    {
        return Some("yours is the transpose of the reference".to_owned());
    }
    let (mut ab, mut bb) = (0.0, 0.0);
    for (a, b) in a.iter().zip(b) {
        ab += a * b;
        bb += b * b;
    }
    let (factor, mut rest) = (ab / bb, 0.0);
    for (a, b) in a.iter().zip(b) {
        rest += (a - factor * b) * (a - factor * b);
    }
    // A factor within the tolerance of 1, or one that leaves most of the difference, explains nothing.
    let off = (factor - 1.0).abs();
    let is_explained = off > tol && rest <= 0.01 * off * off * bb;
    let is_parallel = a.len() > 2 && (1.0 - m.cosine.abs()).abs() < 1e-9 && factor.is_finite();
    (is_parallel && is_explained).then(|| format!("yours = {} × reference", factor_text(factor)))
}

/// A factor with four digits, or its distance from 1 where these are those of 1.
pub(super) fn factor_text(x: f64) -> String {
    let text = format!("{x:.4}");
    if text == "1.0000" && x != 1.0 {
        return format!("(1 {} {:.1e})", if x < 1.0 { '-' } else { '+' }, (x - 1.0).abs());
    }
    if x.abs() < 0.01 || x.abs() >= 1e4 {
        return format!("{x:.3e}");
    }
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn divergence(op: &Op, arrays: &[ArrayReport]) -> Option<Divergence> {
    let find = |name: &str| arrays.iter().find(|a| a.name == name);
    let differs = |name: &str| find(name).is_some_and(|a| !a.matches());
    let at = |stage: &str, inputs: &[&str], outputs: &[&str]| {
        let parts = !inputs.iter().any(|n| differs(n)) && outputs.iter().any(|n| differs(n));
        parts.then(|| {
            let (checked, unchecked): (Vec<&str>, Vec<&str>) = inputs.iter().partition(|n| find(n).is_some());
            let outputs = outputs.iter().copied().filter(|n| differs(n)).collect();
            let stage = stage.to_owned();
            let is_part = op.is_composite();
            let [inputs, unchecked, outputs] = [checked, unchecked, outputs].map(owned);
            Divergence { stage, inputs, unchecked, outputs, is_part }
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

/// Inputs and cotangents of an operator that differ.
fn differing_inputs(op: &Op, arrays: &[ArrayReport]) -> Vec<String> {
    let is_input = |name: &str| {
        let bar_of = name.strip_suffix("_bar");
        let is = |ports: &[ops::Port], name: &str| ports.iter().any(|p| p.name == name);
        is(op.inputs, name) || bar_of.is_some_and(|y| is(op.outputs, y))
    };
    arrays.iter().filter(|a| !a.matches() && is_input(&a.name)).map(|a| a.name.clone()).collect()
}

/// Compares arrays in memory. An output or gradient that one of them lacks is a difference.
///
/// # Errors
/// When the files have no array in common, or the operator is unknown.
pub fn arrays(yours: &Arrays, reference: &Arrays, op: Option<&str>, tol: f64) -> Result<Report> {
    let names = [yours, reference].map(|a| a.0.keys().cloned().collect::<Vec<_>>());
    named([yours, reference], &names, &Rules { op, hints: &[], tol, present_only: false })
}

/// Rules of a comparison.
struct Rules<'a> {
    op: Option<&'a str>,
    /// operators that probably wrote the files
    hints: &'a [String],
    tol: f64,
    present_only: bool,
}

/// Compares the arrays that both files contain; `names` are those of all arrays of the files, in order.
fn named(files: [&Arrays; 2], names: &[Vec<String>; 2], rules: &Rules<'_>) -> Result<Report> {
    let [yours, reference] = names;
    let found = match rules.op {
        Some(name) => names::Guess { op: Some(ops::find(name)?), others: Vec::new() },
        None => guess(yours, reference, rules.hints),
    };
    let op = found.op;
    let mut arrays = Vec::new();
    for name in files[1].0.keys().filter(|n| files[0].get(n).is_some()) {
        arrays.push(one(name, op, files, rules.tol)?);
    }
    if arrays.is_empty() {
        let e = Error::input("oracle compare")
            .expected("at least one array name in both files")
            .got(format!("[{}] in yours, [{}] in the reference", yours.join(", "), reference.join(", ")));
        return Err(if yours.iter().any(|n| is_unnamed(n)) { e.hint(UNNAMED) } else { e });
    }
    let (missing, unknown) = names::missing(op, yours, reference);
    let is_complete = rules.present_only || (missing.is_empty() && unknown.is_empty());
    Ok(Report {
        operator: op.map(|op| op.name),
        also_fits: found.others,
        tol: rules.tol,
        missing,
        unknown,
        only_yours: only(yours, reference),
        only_reference: only(reference, yours),
        present_only: rules.present_only,
        differing_inputs: op.map(|op| differing_inputs(op, &arrays)).unwrap_or_default(),
        divergence: op.and_then(|op| divergence(op, &arrays)),
        passed: is_complete && arrays.iter().all(ArrayReport::matches),
        arrays,
    })
}

/// Two files and how they differ.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// the result
    pub report: Report,
    /// user-supplied arrays
    pub yours: Arrays,
    /// reference arrays
    pub reference: Arrays,
}

/// The operator that wrote a file, by the digests that `oracle run` writes next to it, or by the name that
/// `oracle mint` gives it.
pub(super) fn writer(path: &Path) -> Option<String> {
    let operator = || {
        let bytes = crate::io::read_bytes(&path.with_extension("digest.json"), DIGESTS_BYTES).ok()?;
        let json: serde_json::Value = serde_json::from_slice(&bytes).ok()?;
        Some(json.get("operator")?.as_str()?.to_owned())
    };
    operator().or_else(|| Some(path.file_stem()?.to_str()?.rsplit_once('_')?.0.to_owned()))
}

/// Compares two files. The report states whether any array differs or is missing.
///
/// # Errors
/// Files that cannot be read, or have no array in common.
pub fn compare(options: &Options) -> Result<Comparison> {
    if !(options.tol >= 0.0) {
        return Err(Error::input("--tol").expected("0 or more").got(options.tol.to_string()));
    }
    // Arrays that only one file contains are listed but not read.
    let mut files = [npz::Archive::open(&options.yours)?, npz::Archive::open(&options.reference)?];
    let mut names = [files[0].names(), files[1].names()];
    names.iter_mut().for_each(|names| names.sort());
    let [yours, reference] = &mut files;
    let yours = yours.read(&|name| names[1].iter().any(|n| n == name))?;
    let reference = reference.read(&|name| names[0].iter().any(|n| n == name))?;
    drop(files);
    let hints: Vec<String> =
        [&options.reference, &options.yours].into_iter().filter_map(|p| writer(p)).collect();
    let Options { tol, present_only, .. } = *options;
    let rules = Rules { op: options.op.as_deref(), hints: &hints, tol, present_only };
    let report = named([&yours, &reference], &names, &rules)?;
    Ok(Comparison { report, yours, reference })
}
