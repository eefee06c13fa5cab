//! `nn.softmax`: the softmax of every row with optional weights.
//!
//! y(i,j) = w(i,j) e^{x(i,j)} / Σₖ w(i,k) e^{x(i,k)},   w = `base` + `floor`: the softmax of ln w + x
//!
//! Without `base`, w = 1: the plain softmax. With the skinning weights of a body as `base`, a network refines
//! them (GauHuman), and `floor` keeps ln w finite.
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | x | `x` | (M, K) | finite |
//! | | `base` | (M, K), optional | ≥ 0 |
//! | | `floor` | () | ≥ 0; Σ w of every row is in the range of f32 |
//! | y | `y` | (M, K) | 0..1; a row sums to 1, or to 0 if all its w are 0 |
//!
//! # Rounding
//! The largest x of a row among those with w > 0 is subtracted first, so that no exponential overflows and
//! the sum is not 0. Then follow the products w·exp (0 where w = 0), their left fold over the row, and one
//! division per entry.
//!
//! # Kinks and domain
//! There are no kinks. A row whose w are all 0 has no softmax: it is 0 and has no gradient, like O of
//! [`super::attention`] where no token is attended to.
//!
//! # Adjoint
//! x̄ += y ∘ (ȳ − ⟨y, ȳ⟩); the inner product is a left fold over the row. `base` is a constant. The outputs
//! are saved.
//!
//! Twin: `reference::nn::softmax`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::softmax::{In, forward};
//! assert_eq!(forward(&In { x: &[1.0, 1.0], base: &[0.25, 0.75], floor: 0.0, k: 2 }), [0.25, 0.75]);
//! ```

use crate::num::{elem, order, par};

/// Rows per task.
const ROWS: usize = 256;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (M, K).
    pub x: &'a [f32],
    /// Shape (M, K); empty for the plain softmax.
    pub base: &'a [f32],
    /// Value that is added to every entry of `base`.
    pub floor: f32,
    /// Row length K, at least 1.
    pub k: usize,
}

/// Returns the softmax y (M, K).
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>) -> Vec<f32> {
    let k = x.k;
    assert!(x.base.is_empty() || x.base.len() == x.x.len(), "base has the shape of x");
    let mut y = vec![0.0; x.x.len()];
    par::chunks_mut(&mut y, ROWS * k, |c, y| {
        for (r, row) in y.chunks_exact_mut(k).enumerate() {
            let at = (c * ROWS + r) * k;
            let logits = &x.x[at..at + k];
            let weight = |j: usize| if x.base.is_empty() { 1.0 } else { x.base[at + j] + x.floor };
            let mut most = f32::NEG_INFINITY;
            for j in (0..k).filter(|&j| weight(j) > 0.0) {
                most = order::max(most, logits[j]);
            }
            let mut sum = 0.0;
            for j in 0..k {
                let w = weight(j);
                row[j] = if w == 0.0 { 0.0 } else { w * elem::exp(logits[j] - most) };
                sum += row[j];
            }
            if sum == 0.0 {
                continue; // all are 0 already
            }
            for y in row {
                *y = *y / sum;
            }
        }
    });
    y
}

/// Adds the gradient for the cotangent `y_bar` (M, K) of the softmax `y` to `x_bar` (M, K).
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(y: &[f32], k: usize, y_bar: &[f32], x_bar: &mut [f32]) {
    assert!(y_bar.len() == y.len() && x_bar.len() == y.len(), "cotangents have the shape of y");
    par::chunks_mut(x_bar, ROWS * k, |c, x_bar| {
        for (r, row) in x_bar.chunks_exact_mut(k).enumerate() {
            let at = (c * ROWS + r) * k;
            let (y, bar) = (&y[at..at + k], &y_bar[at..at + k]);
            let mean = y.iter().zip(bar).fold(0.0, |s, (y, b)| s + y * b);
            for j in 0..k {
                row[j] += y[j] * (bar[j] - mean);
            }
        }
    });
}
