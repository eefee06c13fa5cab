//! What an experiment is.

use crate::Result;
use std::collections::BTreeMap;

/// Numbers of one cell by name.
pub type Values = BTreeMap<String, f64>;

/// One training or fit.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cell {
    /// name of its file: letters, digits, `-`, `_`, `.`
    pub key: String,
    /// what it belongs to in the table; cells of one row differ in their seed
    pub row: String,
    /// which repetition
    pub seed: u64,
}

/// A curve of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// in the legend
    pub name: String,
    /// (x, mean, deviation)
    pub points: Vec<(f64, f64, f64)>,
}

/// What an experiment found.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// E1 … E15
    pub id: &'static str,
    /// what the paper says, or what is asked
    pub claim: &'static str,
    /// heads of the table; numbers begin with `>`
    pub head: Vec<&'static str>,
    /// its rows
    pub rows: Vec<Vec<String>>,
    /// title and label of the chart
    pub chart: [&'static str; 2],
    /// its curves, or one bar per row
    pub curves: Vec<Curve>,
    /// (row, value)
    pub bars: Vec<(String, f64)>,
    /// whether what counts as reproduced came out; none where there is only a report
    pub holds: Option<bool>,
    /// the finding in words
    pub verdict: String,
}

/// An experiment.
pub trait Experiment: Sync {
    /// E1 … E15
    fn id(&self) -> &'static str;
    /// Everything it runs, in order.
    fn cells(&self) -> Vec<Cell>;
    /// Runs a cell of [`Self::cells`].
    ///
    /// # Errors
    /// What the training or fit reports.
    fn run(&self, cell: usize) -> Result<Values>;
    /// What the results say; cells that are missing are left out.
    fn report(&self, results: &[(Cell, Values)]) -> Report;
}

/// Values named `name` of all cells of a row, by seed.
pub fn of(results: &[(Cell, Values)], row: &str, name: &str) -> Vec<f64> {
    results.iter().filter(|(cell, _)| cell.row == row).filter_map(|(_, v)| v.get(name).copied()).collect()
}

/// The rows in the order in which they first come.
pub fn rows(results: &[(Cell, Values)]) -> Vec<String> {
    let mut rows: Vec<String> = Vec::new();
    for (cell, _) in results {
        if !rows.contains(&cell.row) {
            rows.push(cell.row.clone());
        }
    }
    rows
}
