//! Names of arrays in a comparison: the operator that they fit, what is missing, and what is unknown.

use crate::ops::{self, Op};
use serde::Serialize;
use std::fmt;

/// One of the two files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// the user-supplied one
    Yours,
    /// the reference
    Reference,
}

/// Outputs and gradients that only one file has.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Missing {
    /// names missing in yours
    pub yours: Vec<String>,
    /// names missing in the reference
    pub reference: Vec<String>,
}

impl Missing {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.yours.len() + self.reference.len()
    }

    /// Whether nothing is missing.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether this array is missing in a file.
    pub fn has(&self, name: &str) -> bool {
        self.yours.iter().chain(&self.reference).any(|n| n == name)
    }
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (whose, names) in [("yours", &self.yours), ("reference", &self.reference)] {
            if !names.is_empty() {
                writeln!(f, "missing in {whose}: {}", names.join(", "))?;
            }
        }
        Ok(())
    }
}

/// An array of one file whose name the operator does not have.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Unknown {
    /// its name
    pub name: String,
    /// the file that has it
    pub file: Side,
    /// the array that was probably meant
    pub did_you_mean: Option<String>,
}

impl fmt::Display for Unknown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let whose = if self.file == Side::Yours { "yours" } else { "reference" };
        write!(f, "unknown name in {whose}: {}", self.name)?;
        match &self.did_you_mean {
            Some(name) => write!(f, " (did you mean {name}?)"),
            None if is_unnamed(&self.name) => write!(f, " ({UNNAMED})"),
            None => Ok(()),
        }
    }
}

/// What NumPy does with arrays that have no name.
pub(super) const UNNAMED: &str =
    "np.savez(file, a) stores a as arr_0; give every array its name: np.savez(file, y=a)";

/// Whether NumPy made up this name.
pub(super) fn is_unnamed(name: &str) -> bool {
    name.strip_prefix("arr_").is_some_and(|n| !n.is_empty() && n.chars().all(|c| c.is_ascii_digit()))
}

/// The operators that these names fit.
#[derive(Clone, Debug, Default)]
pub(super) struct Guess {
    /// the best one
    pub(super) op: Option<&'static Op>,
    /// others that fit as well
    pub(super) others: Vec<&'static str>,
}

/// The operator whose names match most of the arrays. Of several: the one that `hints` name, then a composite
/// one, then the one with the fewest outputs and gradients that no file has, then in the order of the list.
pub(super) fn guess(yours: &[String], reference: &[String], hints: &[String]) -> Guess {
    let is_in = |names: &[String], name: &str| names.iter().any(|n| n == name);
    let score = |op: &Op| yours.iter().chain(reference).filter(|n| is_known(op, n)).count();
    let absent = |op: &Op| results(op).iter().filter(|n| !is_in(yours, n) && !is_in(reference, n)).count();
    let produces = |op: &&&Op| op.outputs.iter().any(|p| is_in(reference, p.name) || is_in(yours, p.name));
    let key = |op: &Op| (std::cmp::Reverse(score(op)), !op.is_composite(), absent(op));
    let fitting: Vec<&'static Op> = ops::LIST.iter().filter(produces).copied().collect();
    let Some(best) = fitting.iter().map(|op| key(op)).min() else { return Guess::default() };
    let mut fitting: Vec<&'static Op> = fitting.into_iter().filter(|op| key(op) == best).collect();
    if let Some(op) = fitting.iter().copied().find(|op| hints.iter().any(|h| h == op.name)) {
        return Guess { op: Some(op), others: Vec::new() };
    }
    let op = fitting.remove(0);
    Guess { op: Some(op), others: fitting.iter().map(|op| op.name).collect() }
}

/// Outputs and gradients, by their names in files.
fn results(op: &Op) -> Vec<String> {
    let outputs = op.outputs.iter().map(|p| p.name.to_owned());
    let gradients = if op.adjoint { op.smooth_inputs() } else { Vec::new() };
    let is_cotangent = |x: &&str| op.outputs.iter().any(|p| p.name == *x);
    outputs.chain(gradients.into_iter().filter(|x| !is_cotangent(x)).map(|x| format!("{x}_bar"))).collect()
}

/// Whether a file of the operator may contain an array of this name.
pub(super) fn is_known(op: &Op, name: &str) -> bool {
    let is_setting = |key: &str| op.settings.iter().any(|s| s.key == key);
    op.port(name).is_some()
        || name.strip_suffix("_bar").is_some_and(|x| op.has_array(x))
        || name.strip_prefix("setting_").is_some_and(is_setting)
        || op.companions.contains(&name)
}

/// The names of `a` that `b` does not have.
pub(super) fn only(a: &[String], b: &[String]) -> Vec<String> {
    a.iter().filter(|n| !b.contains(n)).cloned().collect()
}

/// What is missing in one of the files, and the names of one file that the operator does not have. Without an
/// operator, every name of one file is missing in the other.
pub(super) fn missing(op: Option<&Op>, yours: &[String], reference: &[String]) -> (Missing, Vec<Unknown>) {
    let (only_yours, only_reference) = (only(yours, reference), only(reference, yours));
    let Some(op) = op else {
        return (Missing { yours: only_reference, reference: only_yours }, Vec::new());
    };
    let results = results(op);
    let of =
        |names: &[String]| -> Vec<String> { results.iter().filter(|n| names.contains(n)).cloned().collect() };
    let missing = Missing { yours: of(&only_reference), reference: of(&only_yours) };
    let mut unknown = Vec::new();
    for (file, names, absent) in
        [(Side::Yours, &only_yours, &missing.yours), (Side::Reference, &only_reference, &missing.reference)]
    {
        let strangers: Vec<&String> = names.iter().filter(|n| !is_known(op, n)).collect();
        // Names that the other file cannot have either are candidates only where nothing is missing.
        let all: Vec<String> = results.iter().filter(|n| !names.contains(n)).cloned().collect();
        let candidates = if absent.is_empty() { &all } else { absent };
        let is_only_one = strangers.len() == 1 && absent.len() == 1;
        for name in strangers {
            let meant = meant(name, candidates).or_else(|| is_only_one.then(|| absent[0].clone()));
            unknown.push(Unknown { name: name.clone(), file, did_you_mean: meant });
        }
    }
    (missing, unknown)
}

/// The name of `candidates` that was probably meant: one with the same stem, as `weight_bar` for `dW`,
/// `grad_weight` or `w_bar`, or a similar one.
pub(super) fn meant(name: &str, candidates: &[String]) -> Option<String> {
    let lower = name.to_lowercase();
    let stem = |name: &str| name.strip_suffix("_bar").unwrap_or(name).to_owned();
    let own = stem(&lower);
    let fits = |candidate: &&String| {
        let stem = stem(candidate);
        let mut parts = own.split('_').chain(own.strip_prefix('d')).filter(|part| !part.is_empty());
        if stem.len() > 1 {
            return lower.contains(&stem) || parts.any(|part| stem.starts_with(part));
        }
        parts.any(|part| part == stem)
    };
    let same = candidates.iter().find(|c| **c == lower).or_else(|| candidates.iter().find(fits));
    let similar =
        || ops::similar(name, candidates.iter().map(String::as_str)).first().map(|n| (*n).to_owned());
    same.cloned().or_else(similar)
}
