//! Results of a comparison of arrays, as a record and as text.

use serde::Serialize;
use std::fmt;

/// One entry in both files.
#[derive(Clone, Debug, Serialize)]
pub struct Worst {
    /// index along each axis
    pub index: Vec<usize>,
    /// user-supplied value
    pub theirs: f64,
    /// value of lastlight
    pub ours: f64,
    /// number of representable values of the narrower element type between them
    pub ulp: u64,
}

/// Counts of entries that are zero.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Zeros {
    /// in both
    pub both: usize,
    /// in theirs only
    pub only_theirs: usize,
    /// in ours only
    pub only_ours: usize,
}

/// Result of comparing one array.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Agreement {
    /// within the tolerance
    Agrees,
    /// beyond the tolerance
    Differs,
    /// zero at different entries, for arrays of which only zeros are compared
    ZerosDiffer,
    /// sizes of the axes differ
    ShapesDiffer,
    /// a NaN in theirs or in ours
    Nan,
}

impl Agreement {
    /// The word shown in reports.
    pub fn text(&self) -> &'static str {
        match self {
            Self::Agrees => "agrees",
            Self::Differs => "DIFFERS",
            Self::ZerosDiffer => "ZEROS DIFFER",
            Self::ShapesDiffer => "SHAPES DIFFER",
            Self::Nan => "NAN",
        }
    }
}

/// One array of both files.
#[derive(Clone, Debug, Serialize)]
pub struct ArrayReport {
    /// name
    pub name: String,
    /// sizes in theirs
    pub shape_theirs: Vec<usize>,
    /// sizes in ours
    pub shape_ours: Vec<usize>,
    /// element types, theirs and ours
    pub dtypes: [&'static str; 2],
    /// the result
    pub agreement: Agreement,
    /// which entries were compared, if not all
    pub note: Option<String>,
    /// largest distance in units of the last place of the narrower element type
    pub worst_ulp: u64,
    /// mean distance in the same units
    pub mean_ulp: f64,
    /// ‖ours − theirs‖ / ‖theirs‖
    pub relative_l2: f64,
    /// cosine between them
    pub cosine: f64,
    /// Σ(ours − theirs) / Σ|theirs|
    pub signed_bias: f64,
    /// pattern of zeros
    pub zeros: Zeros,
    /// the ten entries that differ most
    pub worst: Vec<Worst>,
    /// NaN values, if there are any; nothing else is measured then
    pub nans: Option<Nans>,
}

/// NaN values of an array.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Nans {
    /// how many in theirs
    pub theirs: usize,
    /// how many in ours
    pub ours: usize,
    /// index of the first by axis
    pub first: Vec<usize>,
}

/// The first stage at which two files diverge.
#[derive(Clone, Debug, Serialize)]
pub struct Divergence {
    /// operator inside the composite one
    pub stage: String,
    /// its inputs in both files; they match
    pub inputs: Vec<String>,
    /// its inputs missing in one file; they are assumed to match
    pub unchecked: Vec<String>,
    /// its outputs that differ
    pub outputs: Vec<String>,
}

/// The complete comparison.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// operator, if the names match one
    pub operator: Option<&'static str>,
    /// bound on the relative L2
    pub tol: f64,
    /// arrays of both files
    pub arrays: Vec<ArrayReport>,
    /// names in theirs only
    pub only_theirs: Vec<String>,
    /// names in ours only
    pub only_ours: Vec<String>,
    /// the first operator whose inputs match and whose outputs differ
    pub divergence: Option<Divergence>,
    /// whether no array differs
    pub passed: bool,
}

impl Report {
    /// The array of that name.
    pub fn array(&self, name: &str) -> Option<&ArrayReport> {
        self.arrays.iter().find(|a| a.name == name)
    }
}

impl fmt::Display for Divergence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.stage.strip_suffix(" adjoint") {
            Some(stage) => write!(f, "first diverging stage: {stage}, backward pass.")?,
            None => write!(f, "first diverging stage: {}.", self.stage)?,
        }
        write!(f, " Differs: {}.", self.outputs.join(", "))?;
        if !self.inputs.is_empty() {
            write!(f, " Matches: {}.", self.inputs.join(", "))?;
        }
        if !self.unchecked.is_empty() {
            write!(f, " Not checked (missing in one file): {}.", self.unchecked.join(", "))?;
        }
        Ok(())
    }
}

/// A number of at most ten characters.
fn short(x: f64) -> String {
    if x < 1e6 { format!("{x:.2}") } else { format!("{x:.3e}") }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.operator.unwrap_or("arrays of an unknown operator");
        writeln!(f, "{name}, relative L2 at most {:e}", self.tol)?;
        writeln!(
            f,
            "{:<16} {:<13} {:>10} {:>12} {:>10} {:>10} {:>10} {:>14}",
            "array", "", "rel L2", "worst ulp", "mean ulp", "1-cos", "bias", "zeros differ"
        )?;
        for a in &self.arrays {
            write!(f, "{:<16} {:<13}", a.name, a.agreement.text())?;
            if a.agreement == Agreement::ShapesDiffer {
                write!(f, " theirs {:?}, ours {:?}", a.shape_theirs, a.shape_ours)?;
            } else if a.agreement != Agreement::Nan {
                let zeros = a.zeros.only_theirs + a.zeros.only_ours;
                write!(
                    f,
                    " {:>10.3e} {:>12} {:>10} {:>10.3e} {:>10.2e} {zeros:>14}",
                    a.relative_l2,
                    a.worst_ulp,
                    short(a.mean_ulp),
                    1.0 - a.cosine,
                    a.signed_bias
                )?;
            }
            if let Some(Nans { theirs, ours, first }) = &a.nans {
                write!(f, " {theirs} in theirs, {ours} in ours, first at {first:?}")?;
            }
            match &a.note {
                Some(note) => writeln!(f, "  ({note})")?,
                None => writeln!(f)?,
            }
            if matches!(a.agreement, Agreement::Differs | Agreement::ZerosDiffer) {
                for w in &a.worst {
                    writeln!(
                        f,
                        "    {:?}: theirs {:e}, ours {:e}, {} ulp",
                        w.index, w.theirs, w.ours, w.ulp
                    )?;
                }
            }
        }
        for (whose, names) in [("theirs", &self.only_theirs), ("ours", &self.only_ours)] {
            if !names.is_empty() {
                writeln!(f, "only in {whose}: {}", names.join(", "))?;
            }
        }
        if let Some(divergence) = &self.divergence {
            writeln!(f, "{divergence}")?;
        }
        Ok(())
    }
}
