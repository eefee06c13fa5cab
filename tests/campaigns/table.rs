//! Counts per row, and what was found.

use std::collections::BTreeMap;
use std::fmt::{Display, Formatter, Result};

/// One fault, with what repeats it.
#[derive(Clone, Debug)]
pub struct Finding {
    /// format or command
    pub row: String,
    /// number of the case
    pub case: u64,
    /// what is wrong
    pub what: String,
    /// the case and what the program printed
    pub detail: String,
}

/// The table of a campaign.
#[derive(Clone, Debug)]
pub struct Report {
    columns: Vec<&'static str>,
    faults: usize,
    rows: BTreeMap<String, Vec<u64>>,
    /// what was found, in no order
    pub findings: Vec<Finding>,
}

impl Report {
    /// An empty table; columns from `faults` on count faults.
    pub fn new(columns: &[&'static str], faults: usize) -> Self {
        Self { columns: columns.to_vec(), faults, rows: BTreeMap::new(), findings: Vec::new() }
    }

    /// Adds one to a cell.
    pub fn count(&mut self, row: &str, column: usize) {
        self.rows.entry(row.into()).or_insert_with(|| vec![0; self.columns.len()])[column] += 1;
    }

    /// Adds a fault to the list.
    pub fn add(&mut self, finding: Finding) {
        self.findings.push(finding);
    }

    /// The sum of a column.
    pub fn total(&self, column: usize) -> u64 {
        self.rows.values().fold(0, |s, row| s + row[column])
    }

    /// Number of faults.
    pub fn faults(&self) -> u64 {
        (self.faults..self.columns.len()).fold(0, |s, c| s + self.total(c))
    }
}

/// A table in Markdown, then the faults, at most five of each kind and row.
impl Display for Report {
    fn fmt(&self, f: &mut Formatter) -> Result {
        let line = |f: &mut Formatter, name: &str, cells: Vec<String>| {
            writeln!(f, "| {name} | {} |", cells.join(" | "))
        };
        line(f, "", self.columns.iter().map(|c| (*c).to_owned()).collect())?;
        line(f, "---", vec!["---:".to_owned(); self.columns.len()])?;
        for (name, row) in &self.rows {
            line(f, name, row.iter().map(u64::to_string).collect())?;
        }
        line(f, "all", (0..self.columns.len()).map(|c| self.total(c).to_string()).collect())?;
        let mut shown: BTreeMap<(&str, &str), usize> = BTreeMap::new();
        let mut sorted: Vec<&Finding> = self.findings.iter().collect();
        sorted.sort_by(|a, b| (&a.row, &a.what, a.case).cmp(&(&b.row, &b.what, b.case)));
        for x in sorted {
            let n = shown.entry((&x.row, &x.what)).or_insert(0);
            *n += 1;
            if *n <= 5 {
                writeln!(f, "\nfault: {}, case {}: {}\n  {}", x.row, x.case, x.what, x.detail)?;
            }
        }
        for ((row, what), n) in shown.into_iter().filter(|(_, n)| *n > 5) {
            writeln!(f, "{row}: {what}: {n} in all")?;
        }
        Ok(())
    }
}
