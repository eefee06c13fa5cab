//! Experiments: cells, each a training or fit with one seed, and the report made from their results.

use super::report::Report;
use super::stats::Summary;
use crate::Result;
use crate::fit::training::Watch;
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

/// Named numbers measured in one cell.
pub type Values = BTreeMap<String, f64>;

/// One training or fit.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cell {
    /// name of the result file: letters, digits, `-`, `_`, `.`
    pub key: String,
    /// row of the table; cells of the same row differ in their seed
    pub row: String,
    /// seed of the repetition; cells of two rows with the same seed form a pair
    pub seed: u64,
}

/// Results of an experiment, in the order of its cells.
pub type Results = Vec<(Cell, Values)>;

/// An experiment.
pub trait Experiment: Sync {
    /// Its name, a word.
    fn id(&self) -> &'static str;
    /// Folder of its results; experiments with the same folder share cells that have the same key.
    fn folder(&self) -> &'static str {
        self.id()
    }
    /// All its cells, in order.
    fn cells(&self) -> Vec<Cell>;
    /// All settings that the result of a cell depends on.
    fn settings(&self, cell: usize) -> Value;
    /// Runs a cell of [`Self::cells`]; a long one polls `stop`.
    ///
    /// # Errors
    /// Errors of the training or fit; [`crate::error::Kind::Interrupted`] when `stop` was set.
    fn run(&self, cell: usize, watch: &mut dyn Watch, stop: &AtomicBool) -> Result<Values>;
    /// Makes the report from the results; missing cells are skipped.
    fn report(&self, results: &[(Cell, Values)]) -> Report;
}

/// Values named `name` of all cells of a row, by seed.
pub fn of(results: &[(Cell, Values)], row: &str, name: &str) -> Vec<f64> {
    results.iter().filter(|(cell, _)| cell.row == row).filter_map(|(_, v)| v.get(name).copied()).collect()
}

/// The rows in the order of their first occurrence.
pub fn rows(results: &[(Cell, Values)]) -> Vec<String> {
    let mut rows: Vec<String> = Vec::new();
    for (cell, _) in results {
        if !rows.contains(&cell.row) {
            rows.push(cell.row.clone());
        }
    }
    rows
}

/// Differences of a value between two rows, for the seeds that both have.
pub fn differences_by_seed(results: &[(Cell, Values)], [a, b]: [&str; 2], name: &str) -> BTreeMap<u64, f64> {
    let of = |row: &str| -> BTreeMap<u64, f64> {
        let cells = results.iter().filter(|(cell, _)| cell.row == row);
        cells.filter_map(|(cell, values)| Some((cell.seed, *values.get(name)?))).collect()
    };
    let b = of(b);
    of(a).into_iter().filter_map(|(seed, x)| Some((seed, x - b.get(&seed)?))).collect()
}

/// The differences without their seeds.
pub fn differences(results: &[(Cell, Values)], rows: [&str; 2], name: &str) -> Vec<f64> {
    differences_by_seed(results, rows, name).into_values().collect()
}

/// Their mean and interval.
pub fn paired(results: &[(Cell, Values)], rows: [&str; 2], name: &str) -> Summary {
    Summary::of(&differences(results, rows, name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_have_the_same_seed() {
        let cell = |row: &str, seed: u64, x: f64| {
            let cell = Cell { key: format!("{row}{seed}"), row: row.into(), seed };
            (cell, Values::from([("x".into(), x)]))
        };
        // Seed 3 has no partner; the order does not matter.
        let results = [
            cell("a", 1, 5.0),
            cell("a", 2, 7.0),
            cell("a", 3, 99.0),
            cell("b", 2, 6.0),
            cell("b", 1, 2.0),
            cell("b", 4, -99.0),
        ];
        let d = paired(&results, ["a", "b"], "x");
        assert_eq!((d.count, d.mean), (2, 2.0), "5 − 2 and 7 − 6");
        assert_eq!(paired(&results, ["b", "a"], "x").mean, -2.0, "the other way round");
        assert_eq!(paired(&results, ["a", "b"], "y").count, 0, "no such value");
        assert!(!paired(&results, ["a", "c"], "x").is_positive(), "no such row");
    }
}
