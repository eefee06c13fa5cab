//! The axis of largest variance of a set of points.
//!
//! # Rounding
//! All values are f64. The mean and the covariance C are left folds over the rows; every iteration consists
//! of left folds over the dimensions.

/// Number of power iterations. If the two largest variances have the ratio r, the second axis contributes
/// 1/r^50 to the result.
pub const PASSES: usize = 50;

/// Returns the unit vector along the axis of largest variance of rows (N, k): v ← C v/‖C v‖, iterated
/// [`PASSES`] times, starting from the unit vector of the dimension with the largest variance. If the rows do
/// not vary, the result is that unit vector.
///
/// # Panics
/// Panics if there are no rows, or if a row is shorter than k.
pub fn axis(rows: &[&[f64]], k: usize) -> Vec<f64> {
    assert!(!rows.is_empty() && k > 0, "there is at least one row and one dimension");
    let count = rows.len() as f64;
    let mean: Vec<f64> = (0..k).map(|c| rows.iter().fold(0.0, |s, r| s + r[c]) / count).collect();
    let mut covariance = vec![0.0; k * k];
    for row in rows {
        for a in 0..k {
            for b in 0..k {
                covariance[a * k + b] += (row[a] - mean[a]) * (row[b] - mean[b]);
            }
        }
    }
    let start =
        (0..k).fold(0, |best, c| if covariance[c * k + c] > covariance[best * k + best] { c } else { best });
    let mut v: Vec<f64> = (0..k).map(|c| if c == start { 1.0 } else { 0.0 }).collect();
    for _ in 0..PASSES {
        let next: Vec<f64> =
            (0..k).map(|a| (0..k).fold(0.0, |s, b| s + covariance[a * k + b] * v[b])).collect();
        let length = next.iter().fold(0.0, |s, x| s + x * x).sqrt();
        if !(length > 0.0) {
            break;
        }
        v = next.iter().map(|x| x / length).collect();
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_on_a_line_give_the_line() {
        let rows = [[0.0, 0.0], [3.0, 4.0], [-6.0, -8.0]];
        let found = axis(&rows.each_ref().map(|r| &r[..]), 2);
        assert!((found[0] - 0.6).abs() < 1e-15 && (found[1] - 0.8).abs() < 1e-15, "{found:?}");
        assert_eq!(axis(&[&[7.0], &[9.0]], 1), [1.0], "one dimension is its own axis");
        assert_eq!(axis(&[&[7.0, 1.0]], 2), [1.0, 0.0], "rows that do not vary");
    }
}
