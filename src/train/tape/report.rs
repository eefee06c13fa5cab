//! What a gradient check found.

use serde::Serialize;
use std::fmt;

/// One entry of an array, ours and the reference's.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Entry {
    /// array
    pub array: String,
    /// row-major index
    pub index: usize,
    /// the value under test
    pub ours: f64,
    /// what it is held against
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
    /// what it compares with what
    pub title: &'static str,
    /// numbers with bounds
    pub measures: Vec<Measure>,
    /// findings that are not numbers
    pub failures: Vec<String>,
    /// entries that contributed most to the difference
    pub worst: Vec<Entry>,
}

impl Rung {
    /// A rung with nothing measured yet.
    pub fn new(name: &'static str, title: &'static str) -> Self {
        Self { name, title, measures: Vec::new(), failures: Vec::new(), worst: Vec::new() }
    }

    /// Notes a number that has a bound.
    pub fn hold(&mut self, what: impl Into<String>, value: f64, bound: f64) {
        self.measures.push(Measure { what: what.into(), value, bound: Some(bound) });
    }

    /// Notes a number.
    pub fn note(&mut self, what: impl Into<String>, value: f64) {
        self.measures.push(Measure { what: what.into(), value, bound: None });
    }

    /// Notes a failure.
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
    /// Whether every rung passed; a report without rungs has checked nothing and does not pass.
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
        let verdict = if self.passed() { "passed" } else { "FAILED" };
        writeln!(f, "{}: {verdict}", self.subject)?;
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
                        writeln!(f, "   {mark}  {:<48} {:>10.3e}  (at most {bound:.1e})", m.what, m.value)?
                    }
                    None => writeln!(f, "   {mark}  {:<48} {:>10.3e}", m.what, m.value)?,
                }
            }
            for failure in &rung.failures {
                writeln!(f, "   !  {failure}")?;
            }
            if !rung.passed() {
                for e in &rung.worst {
                    let d = e.ours - e.reference;
                    writeln!(
                        f,
                        "      {}[{}]: {:e}, reference {:e}, difference {d:e}",
                        e.array, e.index, e.ours, e.reference
                    )?;
                }
            }
        }
        Ok(())
    }
}
