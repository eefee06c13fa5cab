//! The comparison made by an experiment with persons, and the values that it uses.

use crate::experiment::{Cell, Summary, Values, of as values_of};

/// The comparison of an experiment.
pub(super) enum Comparison {
    /// LAST against its host, for each graph
    Better { graphs: Vec<String> },
    /// the order of Table 2
    Ablation,
    /// learned, true, empty, random, reversed
    Structures,
    /// these values of τ_rec
    Thresholds(Vec<f64>),
    /// whether the first row is better than the second
    Pair([&'static str; 2]),
    /// these values of λ
    Bounds(Vec<f64>),
    /// tuned against not tuned
    Tuning,
    /// errors of child factors after an iteration
    Factors { children: Vec<usize>, begin: usize },
    /// the computational cost
    Cost,
    /// these rows against that with weight 0
    Weights(Vec<String>),
}

pub(super) type Rows<'a> = &'a [(Cell, Values)];

/// The value that pairs are compared by.
pub(super) const VALUE: &str = "PSNR-box";
/// The same at equal renders.
pub(super) const FAIR: &str = "PSNR-box@renders";
/// Name of the row of a τ_rec.
pub(super) fn threshold(tau: f64) -> String {
    format!("τ_rec {tau}")
}

/// Iterations of the evaluations, and mean and standard deviation at each.
pub(super) fn curve(results: Rows<'_>, row: &str, prefix: &str) -> Vec<(f64, f64, f64)> {
    let mut at: Vec<u64> = results
        .iter()
        .filter(|(c, _)| c.row == row)
        .flat_map(|(_, v)| v.keys())
        .filter_map(|name| name.strip_prefix(prefix)?.parse().ok())
        .collect();
    at.sort_unstable();
    at.dedup();
    at.iter()
        .map(|i| {
            let s = Summary::of(&values_of(results, row, &format!("{prefix}{i}")));
            (*i as f64, s.mean, s.deviation)
        })
        .collect()
}

/// A mean difference with its interval.
pub(super) fn delta(s: &Summary) -> String {
    match s.count {
        0 => "–".into(),
        1 => format!("{:+.2}", s.mean),
        _ => format!("{:+.2} ± {:.2}", s.mean, s.half_width),
    }
}

pub(super) fn mean(results: Rows<'_>, row: &str, name: &str) -> f64 {
    Summary::of(&values_of(results, row, name)).mean
}
