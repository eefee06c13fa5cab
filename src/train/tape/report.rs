//! Results of a gradient check.

use serde::Serialize;
use std::fmt;

/// One entry of an array with its reference value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Entry {
    /// array
    pub array: String,
    /// row-major index
    pub index: usize,
    /// the value under test
    pub ours: f64,
    /// the reference value
    pub reference: f64,
}

/// One measured quantity and its bound.
#[derive(Clone, Debug, Serialize)]
pub struct Measure {
    /// what was measured, e.g. `relative L2 of means`
    pub what: String,
    /// the value
    pub value: f64,
    /// the largest allowed one; `None` when the number is only reported
    pub bound: Option<f64>,
}

impl Measure {
    /// Whether the value is within its bound; NaN is not.
    pub fn holds(&self) -> bool {
        self.bound.is_none_or(|bound| self.value <= bound)
    }
}

/// One rung of the ladder of checks.
#[derive(Clone, Debug, Serialize)]
pub struct Rung {
    /// `R0` … `R4`
    pub name: &'static str,
    /// description of the comparison
    pub title: &'static str,
    /// numbers with bounds
    pub measures: Vec<Measure>,
    /// findings that are not numbers
    pub failures: Vec<String>,
    /// entries that contributed most to the difference
    pub worst: Vec<Entry>,
    /// what the two values of an entry of `worst` are
    #[serde(skip)]
    pub labels: [&'static str; 2],
}

impl Rung {
    /// Makes an empty rung.
    pub fn new(name: &'static str, title: &'static str) -> Self {
        let labels = ["value", "reference"];
        Self { name, title, measures: Vec::new(), failures: Vec::new(), worst: Vec::new(), labels }
    }

    /// Sets the names of the two values of the worst entries.
    #[must_use]
    pub fn labelled(self, labels: [&'static str; 2]) -> Self {
        Self { labels, ..self }
    }

    /// Adds a number with a bound.
    pub fn hold(&mut self, what: impl Into<String>, value: f64, bound: f64) {
        self.measures.push(Measure { what: what.into(), value, bound: Some(bound) });
    }

    /// Adds a number without a bound.
    pub fn note(&mut self, what: impl Into<String>, value: f64) {
        self.measures.push(Measure { what: what.into(), value, bound: None });
    }

    /// Adds a failure.
    pub fn fail(&mut self, what: impl Into<String>) {
        self.failures.push(what.into());
    }

    /// Whether everything holds.
    pub fn passed(&self) -> bool {
        self.failures.is_empty() && self.measures.iter().all(Measure::holds)
    }
}

/// All rungs of one case.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// operator or function
    pub subject: String,
    /// in the order in which they ran
    pub rungs: Vec<Rung>,
}

impl Report {
    /// Whether every rung passed; a report without rungs does not pass.
    pub fn passed(&self) -> bool {
        !self.rungs.is_empty() && self.rungs.iter().all(Rung::passed)
    }

    /// The rung of that name.
    pub fn rung(&self, name: &str) -> Option<&Rung> {
        self.rungs.iter().find(|r| r.name == name)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let result = if self.passed() { "passed" } else { "FAILED" };
        writeln!(f, "{}: {result}", self.subject)?;
        for rung in &self.rungs {
            writeln!(
                f,
                "  {} {} {}",
                rung.name,
                if rung.passed() { "ok    " } else { "FAILED" },
                rung.title
            )?;
            for m in &rung.measures {
                let mark = if m.holds() { ' ' } else { '!' };
                match m.bound {
                    Some(bound) => {
                        writeln!(f, "   {mark}  {:<56} {:>10.3e}  (at most {bound:.1e})", m.what, m.value)?
                    }
                    None => writeln!(f, "   {mark}  {:<56} {:>10.3e}", m.what, m.value)?,
                }
            }
            for failure in &rung.failures {
                writeln!(f, "   !  {failure}")?;
            }
            if !rung.passed() {
                for e in &rung.worst {
                    let (d, [ours, reference]) = (e.ours - e.reference, rung.labels);
                    writeln!(
                        f,
                        "      {}[{}]: {ours} {:e}, {reference} {:e}, difference {d:e}",
                        e.array, e.index, e.ours, e.reference
                    )?;
                }
            }
        }
        Ok(())
    }
}
