//! Means, deviations, and intervals of paired differences.

use crate::num::order;

/// Two-sided 95 % quantiles of Student's t with 1 … 30 degrees of freedom.
const T95: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
    2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
];
/// The same for more than 30 degrees of freedom.
const NORMAL95: f64 = 1.96;

/// A mean with the standard deviation of the values and the half-width of its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// number of values
    pub count: usize,
    /// mean
    pub mean: f64,
    /// standard deviation with divisor n − 1
    pub deviation: f64,
    /// half-width of the interval of the mean; infinite for one value
    pub half_width: f64,
}

impl Summary {
    /// Summary of values; without values zeros with an infinite interval.
    pub fn of(values: &[f64]) -> Self {
        let count = values.len();
        let n = Ord::max(1, count) as f64;
        let mean = values.iter().fold(0.0, |s, x| s + x) / n;
        let squares = values.iter().fold(0.0, |s, x| s + (x - mean) * (x - mean));
        if count < 2 {
            return Self { count, mean, deviation: 0.0, half_width: f64::INFINITY };
        }
        let deviation = (squares / (n - 1.0)).sqrt();
        let t = T95.get(count - 2).copied().unwrap_or(NORMAL95);
        Self { count, mean, deviation, half_width: t * deviation / n.sqrt() }
    }

    /// Summary of the differences a − b of pairs.
    ///
    /// # Panics
    /// When the numbers of values differ.
    pub fn of_pairs(a: &[f64], b: &[f64]) -> Self {
        assert_eq!(a.len(), b.len(), "values come in pairs");
        Self::of(&a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<_>>())
    }

    /// Whether the whole interval lies above 0.
    pub fn is_positive(&self) -> bool {
        self.mean - self.half_width > 0.0
    }
}

impl std::fmt::Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let digits = f.precision().unwrap_or(2);
        write!(f, "{:.digits$} ± {:.digits$}", self.mean, self.deviation)
    }
}

/// The median; for an even number of values the lower of the middle two.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1);
    sorted.get(order::min(last, last / 2)).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_students() {
        let s = Summary::of(&[1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!((s.mean, s.count), (3.0, 5), "mean");
        assert!((s.deviation - 2.5_f64.sqrt()).abs() < 1e-15, "deviation {}", s.deviation);
        assert!((s.half_width - 2.776 * (2.5_f64 / 5.0).sqrt()).abs() < 1e-12, "four degrees of freedom");
        assert!(s.is_positive() && !Summary::of(&[-1.0, 1.0]).is_positive(), "0 is outside, or not");
        assert!(Summary::of(&[7.0]).half_width.is_infinite(), "one value has no interval");
        let p = Summary::of_pairs(&[2.0, 3.0], &[1.0, 2.0]);
        assert_eq!((p.mean, p.deviation, p.half_width), (1.0, 0.0, 0.0), "pairs that differ alike");
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0, "odd");
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.0, "the lower of two");
    }
}
