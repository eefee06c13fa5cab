//! `causal.acyclic`: a measure of the cycles of a weighted graph, which is 0 exactly for acyclic graphs.
//!
//! h = tr((I + αH)ⁿ) − n,   H = A∘A
//!
//! Source: LAST, eq. 6; DAG-GNN (Yu et al. 2019), eq. 13, with α free. For every α > 0, h is exactly 0 on
//! acyclic graphs and positive on all others.
//!
//! | symbol | argument | shape  | range  |
//! |--------|----------|--------|--------|
//! | A      | `a`      | (n, n) | finite |
//! | α      | `alpha`  | ()     | > 0    |
//! | h      | `value`  | ()     | ≥ 0    |
//!
//! # Rounding
//! The identity matrix is never formed: with B = αH, Eₜ = (I + B)ᵗ − I obeys E₁ = B, Eₜ₊₁ = (Eₜ + B) + EₜB,
//! and h = tr Eₙ. No term is negative, so nothing cancels, and weak cycles keep their relative accuracy. On
//! an acyclic graph every term of the trace has a factor 0, so h is exactly 0. Products are left folds over
//! the inner index from +0.
//!
//! # Kinks and domain
//! There are no kinks. The operator list refuses α ≤ 0.
//!
//! # Adjoint
//! Ā += h̄·2nα (I + Eₙ₋₁)ᵀ ∘ A
//!
//! On an acyclic graph the gradient is 0 at every entry.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::causal::acyclic;
//! assert_eq!(acyclic::forward(&[0.0, 1.0, 0.0, 0.0], 2, 1.0).0, 0.0);
//! assert_eq!(acyclic::forward(&[0.0, 1.0, 0.5, 0.0], 2, 1.0).0, 0.5); // 2αα·1²·0.5²
//! ```

/// Intermediate values that the adjoint needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Saved {
    /// Eₙ₋₁ (n, n); zeros for n ≤ 1.
    pub power: Vec<f64>,
}

/// Returns h and the intermediate values that the adjoint needs.
///
/// # Panics
/// Panics if `a` is not (n, n).
pub fn forward(a: &[f64], n: usize, alpha: f64) -> (f64, Saved) {
    assert_eq!(a.len(), n * n, "a is (n, n)");
    let b: Vec<f64> = a.iter().map(|a| alpha * (a * a)).collect();
    let mut last = vec![0.0; n * n];
    let mut power = b.clone();
    for _ in 1..n {
        let next = (0..n * n).map(|at| {
            let (i, j) = (at / n, at % n);
            let product = (0..n).fold(0.0, |sum, l| sum + power[i * n + l] * b[l * n + j]);
            (power[at] + b[at]) + product
        });
        let next = next.collect();
        last = std::mem::replace(&mut power, next);
    }
    let value = (0..n).fold(0.0, |sum, i| sum + power[i * n + i]);
    (value, Saved { power: last })
}

/// Adds the gradient for the cotangent `value_bar` to `a_bar`.
///
/// # Panics
/// Panics if a buffer is not (n, n).
pub fn adjoint(a: &[f64], n: usize, alpha: f64, saved: &Saved, value_bar: f64, a_bar: &mut [f64]) {
    assert!(a.len() == n * n && a_bar.len() == n * n, "arrays are (n, n)");
    let scale = value_bar * (2.0 * n as f64 * alpha);
    for i in 0..n {
        for j in 0..n {
            let power = saved.power[j * n + i] + if i == j { 1.0 } else { 0.0 };
            a_bar[i * n + j] += scale * (power * a[i * n + j]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_forms() {
        let full: Vec<f64> = (0..16).map(|at| f64::from(u8::from(at / 4 != at % 4))).collect();
        assert_eq!(forward(&full, 4, 1.0).0, 252.0, "4⁴ − 4");
        let mut ring = vec![0.0; 16];
        for at in [1, 6, 11, 12] {
            ring[at] = 1e-3;
        }
        let h = forward(&ring, 4, 1.0).0;
        assert!((h / 4e-24 - 1.0).abs() < 1e-14, "a cycle of four weak edges is 4·(10⁻³)⁸, got {h:e}");
    }
}
