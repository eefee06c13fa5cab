//! Indices by value.

/// Rows in descending order of their values, ties by the lower row.
pub(super) fn ranked(values: &[f64]) -> Vec<usize> {
    let mut rows: Vec<usize> = (0..values.len()).collect();
    rows.sort_by(|&a, &b| values[b].total_cmp(&values[a]).then(a.cmp(&b)));
    rows
}
