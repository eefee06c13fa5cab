//! What a comparison of arrays found, as a record and as text.

use serde::Serialize;
use std::fmt;

/// One entry in both files.
#[derive(Clone, Debug, Serialize)]
pub struct Worst {
    /// by axis
    pub index: Vec<usize>,
    /// somebody's
    pub theirs: f64,
    /// ours
    pub ours: f64,
    /// steps of the narrower element type between them
    pub ulp: u64,
}

/// Entries that are zero.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Zeros {
    /// in both
    pub both: usize,
    /// in theirs only
    pub only_theirs: usize,
    /// in ours only
    pub only_ours: usize,
}

/// What became of one array.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Agreement {
    /// within the tolerance
    Agrees,
    /// beyond it
    Differs,
    /// zero in different places, for arrays compared in that only
    ZerosDiffer,
    /// sizes of the axes differ
    ShapesDiffer,
    /// a NaN in theirs or in ours
    Nan,
}

impl Agreement {
    /// As reports show it.
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
    /// the finding
    pub verdict: Agreement,
    /// how it was compared, if not in all entries
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
}

/// Where two files part.
#[derive(Clone, Debug, Serialize)]
pub struct Parting {
    /// operator inside the composite one
    pub stage: &'static str,
    /// its inputs that both files hold; they agree
    pub inputs: Vec<String>,
    /// its inputs that not both files hold; they are taken to agree
    pub unseen: Vec<String>,
    /// its outputs that do not agree
    pub outputs: Vec<String>,
}

/// The whole comparison.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// operator, if the names are those of one
    pub operator: Option<&'static str>,
    /// bound on the relative L2
    pub tol: f64,
    /// arrays of both files
    pub arrays: Vec<ArrayReport>,
    /// names in theirs only
    pub only_theirs: Vec<String>,
    /// names in ours only
    pub only_ours: Vec<String>,
    /// the first operator whose inputs agree and whose outputs do not
    pub parting: Option<Parting>,
    /// whether nothing differs
    pub passed: bool,
}

impl Report {
    /// The array of that name.
    pub fn array(&self, name: &str) -> Option<&ArrayReport> {
        self.arrays.iter().find(|a| a.name == name)
    }
}

impl fmt::Display for Parting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "first difference in {}: {} differ", self.stage, self.outputs.join(", "))?;
        if !self.inputs.is_empty() {
            write!(f, "; {} agree", self.inputs.join(", "))?;
        }
        if !self.unseen.is_empty() {
            write!(f, "; {} not in both files, taken to agree", self.unseen.join(", "))?;
        }
        Ok(())
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.operator.unwrap_or("arrays of no known operator");
        writeln!(f, "{name}, relative L2 at most {:e}", self.tol)?;
        writeln!(
            f,
            "{:<16} {:<13} {:>10} {:>12} {:>10} {:>10} {:>10} {:>14}",
            "array", "", "rel L2", "worst ulp", "mean ulp", "1-cos", "bias", "zeros differ"
        )?;
        for a in &self.arrays {
            write!(f, "{:<16} {:<13}", a.name, a.verdict.text())?;
            if a.verdict == Agreement::ShapesDiffer {
                write!(f, " theirs {:?}, ours {:?}", a.shape_theirs, a.shape_ours)?;
            } else if a.verdict != Agreement::Nan {
                let zeros = a.zeros.only_theirs + a.zeros.only_ours;
                write!(
                    f,
                    " {:>10.3e} {:>12} {:>10.2} {:>10.3e} {:>10.2e} {zeros:>14}",
                    a.relative_l2,
                    a.worst_ulp,
                    a.mean_ulp,
                    1.0 - a.cosine,
                    a.signed_bias
                )?;
            }
            match &a.note {
                Some(note) => writeln!(f, "  ({note})")?,
                None => writeln!(f)?,
            }
            if matches!(a.verdict, Agreement::Differs | Agreement::ZerosDiffer) {
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
        if let Some(parting) = &self.parting {
            writeln!(f, "{parting}")?;
        }
        Ok(())
    }
}
