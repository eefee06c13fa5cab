//! Results of gradient checks, with the index of every entry along its axes.

use super::compare::unravel;
use crate::num::array::Arrays;
use crate::tape::check::{self, Measure};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// One entry of an array with its reference value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Entry {
    /// array
    pub array: String,
    /// index along each axis
    pub index: Vec<usize>,
    /// the value under test
    pub value: f64,
    /// the reference value
    pub reference: f64,
}

/// One rung of a check.
#[derive(Clone, Debug, Serialize)]
pub struct Rung {
    /// `R0` … `R4`
    pub name: &'static str,
    /// description of the comparison
    pub title: &'static str,
    /// whether everything holds
    pub passed: bool,
    /// numbers with bounds
    pub measures: Vec<Measure>,
    /// findings that are not numbers
    pub failures: Vec<String>,
    /// entries that contributed most to the difference
    pub worst: Vec<Entry>,
    /// what the value and the reference value of an entry of `worst` are
    pub labels: [&'static str; 2],
}

/// A gradient check of one case.
#[derive(Clone, Debug, Serialize)]
pub struct Check {
    /// operator or program
    pub subject: String,
    /// whether every rung passed
    pub passed: bool,
    /// in the order in which they ran
    pub rungs: Vec<Rung>,
    /// what to try, if it did not pass
    pub hints: Vec<String>,
}

/// Sizes of the axes of every array, by name.
pub(super) type Shapes = BTreeMap<String, Vec<usize>>;

/// The shapes of named arrays.
pub(super) fn shapes(arrays: &Arrays) -> Shapes {
    arrays.0.iter().map(|(name, a)| (name.clone(), a.shape().to_vec())).collect()
}

impl Check {
    /// A report with the indices of these shapes.
    pub(super) fn new(report: check::Report, shapes: &Shapes) -> Self {
        let index = |e: &check::Entry| match shapes.get(&e.array) {
            Some(shape) => unravel(e.index, shape),
            None => vec![e.index],
        };
        let entry = |e: &check::Entry| Entry {
            array: e.array.clone(),
            index: index(e),
            value: e.ours,
            reference: e.reference,
        };
        let rung = |r: check::Rung| Rung {
            name: r.name,
            title: r.title,
            passed: r.passed(),
            worst: r.worst.iter().map(entry).collect(),
            labels: r.labels,
            measures: r.measures,
            failures: r.failures,
        };
        let passed = report.passed();
        Self {
            subject: report.subject,
            passed,
            rungs: report.rungs.into_iter().map(rung).collect(),
            hints: Vec::new(),
        }
    }

    /// The rung of that name.
    pub fn rung(&self, name: &str) -> Option<&Rung> {
        self.rungs.iter().find(|r| r.name == name)
    }
}

/// A count without decimals, any other number with four digits.
fn number(x: f64) -> String {
    if x.fract() == 0.0 && x.abs() < 1e6 { format!("{x:.0}") } else { format!("{x:.3e}") }
}

impl fmt::Display for Rung {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "  {} {} {}", self.name, if self.passed { "ok    " } else { "FAILED" }, self.title)?;
        for m in &self.measures {
            let mark = if m.holds() { ' ' } else { '!' };
            write!(f, "   {mark}  {:<56} {:>10}", m.what, number(m.value))?;
            match m.bound {
                Some(bound) if bound == 0.0 || bound >= 1.0 => writeln!(f, "  (at most {bound:.0})")?,
                Some(bound) => writeln!(f, "  (at most {bound:.1e})")?,
                None => writeln!(f)?,
            }
        }
        for failure in &self.failures {
            writeln!(f, "   !  {failure}")?;
        }
        if self.passed {
            return Ok(());
        }
        let [value, reference] = self.labels;
        for e in &self.worst {
            let (name, index, d) = (&e.array, &e.index, e.value - e.reference);
            let values = format!("{value} {:e}, {reference} {:e}", e.value, e.reference);
            writeln!(f, "      {name}{index:?}: {values}, difference {d:.3e}")?;
        }
        Ok(())
    }
}

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {}", self.subject, if self.passed { "passed" } else { "FAILED" })?;
        for rung in &self.rungs {
            write!(f, "{rung}")?;
        }
        for hint in &self.hints {
            writeln!(f, "  hint: {hint}")?;
        }
        Ok(())
    }
}
