//! Results of a comparison of arrays, as a record and as text.

use super::names::{Missing, Unknown};
use crate::tape::check::SHIPPED_F32;
use serde::Serialize;
use std::fmt;

/// One entry in both files.
#[derive(Clone, Debug, Serialize)]
pub struct Worst {
    /// index along each axis
    pub index: Vec<usize>,
    /// user-supplied value
    pub yours: f64,
    /// reference value
    pub reference: f64,
    /// number of representable values of the narrower element type between them
    pub ulp: u64,
}

/// Counts of entries that are zero.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Zeros {
    /// in both
    pub both: usize,
    /// in yours only
    pub only_yours: usize,
    /// in the reference only
    pub only_reference: usize,
}

/// Result of comparing one array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Agreement {
    /// within the tolerance
    Matches,
    /// beyond the tolerance
    Differs,
    /// zero at different entries, for arrays of which only zeros are compared
    ZerosDiffer,
    /// sizes of the axes differ
    ShapesDiffer,
    /// a NaN in yours or in the reference
    Nan,
}

impl Agreement {
    /// The word shown in reports.
    pub fn text(self) -> &'static str {
        match self {
            Self::Matches => "matches",
            Self::Differs => "differs",
            Self::ZerosDiffer => "zeros differ",
            Self::ShapesDiffer => "shapes differ",
            Self::Nan => "NaN",
        }
    }
}

/// How far an array is from its reference; errors are yours − reference.
#[derive(Clone, Debug, Serialize)]
pub struct Measures {
    /// largest distance in units of the last place of the narrower element type
    pub worst_ulp: u64,
    /// mean distance in the same units
    pub mean_ulp: f64,
    /// ‖yours − reference‖ / ‖reference‖
    pub relative_l2: f64,
    /// cosine between them
    pub cosine: f64,
    /// Σ(yours − reference) / Σ|reference|
    pub signed_bias: f64,
    /// pattern of zeros
    pub zeros: Zeros,
}

/// One array of both files.
#[derive(Clone, Debug, Serialize)]
pub struct ArrayReport {
    /// name
    pub name: String,
    /// sizes in yours
    pub shape_yours: Vec<usize>,
    /// sizes in the reference
    pub shape_reference: Vec<usize>,
    /// element types, yours and reference
    pub dtypes: [&'static str; 2],
    /// the result
    pub agreement: Agreement,
    /// why nothing, or not everything, could be measured
    pub reason: Option<String>,
    /// which entries were compared, if not all, and a relation that both arrays have
    pub note: Option<String>,
    /// the distances; `None` if shapes differ or a value is NaN
    pub measures: Option<Measures>,
    /// the ten entries that differ most
    pub worst: Vec<Worst>,
    /// NaN values, if there are any; nothing else is measured then
    pub nans: Option<Nans>,
}

/// NaN values of an array.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Nans {
    /// how many in yours
    pub yours: usize,
    /// how many in the reference
    pub reference: usize,
    /// index of the first by axis
    pub first: Vec<usize>,
}

/// The first stage at which two files diverge.
#[derive(Clone, Debug, Serialize)]
pub struct Divergence {
    /// the operator, or an operator inside a composite one
    pub stage: String,
    /// its inputs in both files; they match
    pub inputs: Vec<String>,
    /// its inputs that are not in both files; they are assumed to match
    pub unchecked: Vec<String>,
    /// its outputs that differ
    pub outputs: Vec<String>,
    /// whether the stage is one of several
    #[serde(skip)]
    pub is_part: bool,
}

/// The complete comparison.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// operator, if the names match one
    pub operator: Option<&'static str>,
    /// operators whose names match as well
    pub also_fits: Vec<&'static str>,
    /// bound on the relative L2
    pub tol: f64,
    /// arrays of both files
    pub arrays: Vec<ArrayReport>,
    /// outputs and gradients that only one file has
    pub missing: Missing,
    /// arrays of one file whose names the operator does not have
    pub unknown: Vec<Unknown>,
    /// names in yours only
    pub only_yours: Vec<String>,
    /// names in the reference only
    pub only_reference: Vec<String>,
    /// whether missing and unknown arrays are accepted
    pub present_only: bool,
    /// inputs and cotangents of the operator that differ
    pub differing_inputs: Vec<String>,
    /// the first operator whose inputs match and whose outputs differ
    pub divergence: Option<Divergence>,
    /// whether every array matches and, unless `present_only`, none is missing or unknown
    pub passed: bool,
}

impl ArrayReport {
    /// Whether it matches.
    pub fn matches(&self) -> bool {
        self.agreement == Agreement::Matches
    }

    /// ‖yours − reference‖ / ‖reference‖; NaN if it was not measured.
    pub fn relative_l2(&self) -> f64 {
        self.measures.as_ref().map_or(f64::NAN, |m| m.relative_l2)
    }
}

impl Report {
    /// The array of that name.
    pub fn array(&self, name: &str) -> Option<&ArrayReport> {
        self.arrays.iter().find(|a| a.name == name)
    }

    /// The arrays that do not match.
    pub fn differing(&self) -> impl Iterator<Item = &ArrayReport> {
        self.arrays.iter().filter(|a| !a.matches())
    }

    /// What is wrong, in a few words: `2 of 4 arrays differ, 1 missing, 1 unknown`.
    pub fn summary(&self) -> String {
        let differing = self.differing().count();
        let of = format!("{differing} of {} array{}", self.arrays.len(), plural(self.arrays.len()));
        let mut parts = vec![format!("{of} {}", if differing == 1 { "differs" } else { "differ" })];
        if !self.present_only {
            let (missing, unknown) = (self.missing.len(), self.unknown.len());
            parts.extend((missing > 0).then(|| format!("{missing} missing")));
            parts.extend((unknown > 0).then(|| format!("{unknown} of unknown name")));
        }
        if differing == 0 && parts.len() > 1 {
            parts.remove(0);
        }
        parts.join(", ")
    }

    /// What to try if arrays in f32 exceed the tolerance by little, as a sentence.
    pub fn rounding_note(&self) -> Option<String> {
        let is_close = |a: &&ArrayReport| {
            a.agreement == Agreement::Differs
                && a.dtypes.contains(&"float32")
                && a.relative_l2() < 10.0 * self.tol
        };
        let names: Vec<&str> = self.arrays.iter().filter(is_close).map(|a| a.name.as_str()).collect();
        (!names.is_empty() && self.tol < SHIPPED_F32).then(|| {
            let own = "is what our own adjoints are held to";
            format!("{}: within rounding of f32? --tol {SHIPPED_F32:e} {own}", names.join(", "))
        })
    }

    /// The inputs that differ, as a sentence, if there are any.
    pub fn inputs_note(&self) -> Option<String> {
        if self.differing_inputs.is_empty() {
            return None;
        }
        let start = if self.divergence.is_some() { "" } else { "first diverging stage: unknown. " };
        Some(format!(
            "{start}The inputs differ: {}. Run both programs on the same inputs, so that a difference of the results is one of the programs.",
            self.differing_inputs.join(", ")
        ))
    }
}

/// The `s` of a plural.
pub fn plural(n: usize) -> &'static str {
    if n == 1 { "" } else { "s" }
}

impl fmt::Display for Nans {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { yours, reference, first } = self;
        write!(f, "{yours} in yours, {reference} in reference, first at {first:?}")
    }
}

impl fmt::Display for Divergence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.stage.strip_suffix(" adjoint") {
            Some(stage) => write!(f, "first diverging stage: {stage}, backward pass.")?,
            None if self.is_part => write!(f, "first diverging stage: {}.", self.stage)?,
            None => write!(f, "first diverging stage: {}, forward pass.", self.stage)?,
        }
        if !self.is_part {
            return Ok(()); // the table states what differs
        }
        write!(f, " Differs: {}.", self.outputs.join(", "))?;
        if !self.inputs.is_empty() {
            write!(f, " Matches: {}.", self.inputs.join(", "))?;
        }
        if !self.unchecked.is_empty() {
            write!(f, " Not checked (not in both files): {}.", self.unchecked.join(", "))?;
        }
        Ok(())
    }
}

/// A mean distance, of at most ten characters.
pub fn mean_ulp(x: f64) -> String {
    if x < 1e6 { format!("{x:.2}") } else { format!("{x:.3e}") }
}

/// A distance, of at most ten characters.
pub fn ulp(x: u64) -> String {
    if x < 1_000_000 { x.to_string() } else { format!("{:.3e}", x as f64) }
}

impl fmt::Display for ArrayReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<16} {:<13}", self.name, self.agreement.text())?;
        if let Some(m) = &self.measures {
            write!(
                f,
                " {:>10.3e} {:>10} {:>10} {:>10.3e} {:>10.2e} {:>13}",
                m.relative_l2,
                ulp(m.worst_ulp),
                mean_ulp(m.mean_ulp),
                1.0 - m.cosine,
                m.signed_bias,
                m.zeros.only_yours + m.zeros.only_reference
            )?;
        } else if let Some(reason) = &self.reason {
            write!(f, " {reason}")?;
        }
        // Next to numbers, the reason is a remark.
        let reason = self.reason.as_ref().filter(|_| self.measures.is_some());
        for remark in reason.into_iter().chain(&self.note) {
            write!(f, "  ({remark})")?;
        }
        writeln!(f)?;
        if !self.matches() {
            for w in &self.worst {
                let (index, ulp) = (&w.index, ulp(w.ulp));
                writeln!(f, "    {index:?}: yours {:e}, reference {:e}, {ulp} ulp", w.yours, w.reference)?;
            }
        }
        Ok(())
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.operator.unwrap_or("arrays of an unknown operator"))?;
        if !self.also_fits.is_empty() {
            write!(f, " (the names also fit {}; --op selects)", self.also_fits.join(", "))?;
        }
        writeln!(f, ", relative L2 at most {:e}", self.tol)?;
        writeln!(
            f,
            "{:<16} {:<13} {:>10} {:>10} {:>10} {:>10} {:>10} {:>13}",
            "array", "", "rel L2", "worst ulp", "mean ulp", "1-cos", "bias", "zeros differ"
        )?;
        for a in &self.arrays {
            write!(f, "{a}")?;
        }
        write!(f, "{}", self.missing)?;
        for unknown in &self.unknown {
            writeln!(f, "{unknown}")?;
        }
        // What was stated above is not repeated.
        let stated =
            |name: &&String| !self.missing.has(name) && !self.unknown.iter().any(|u| u.name == **name);
        for (whose, names) in [("yours", &self.only_yours), ("reference", &self.only_reference)] {
            let rest: Vec<&str> = names.iter().filter(stated).map(String::as_str).collect();
            if !rest.is_empty() {
                writeln!(f, "not compared, only in {whose}: {}", rest.join(", "))?;
            }
        }
        if let Some(divergence) = &self.divergence {
            writeln!(f, "{divergence}")?;
        }
        if let Some(note) = self.inputs_note() {
            writeln!(f, "{note}")?;
        }
        if let Some(note) = self.rounding_note() {
            writeln!(f, "{note}")?;
        }
        Ok(())
    }
}
