//! `nn.linear`: an affine map of every row.
//!
//! y = x·Wᵀ + b,   y(i,j) = Σₖ x(i,k)·W(j,k) + b(j);   with a slope s the result is λ(y), where λ is the
//! leaky ReLU of [`mod@super::act`], computed in the same pass
//!
//! | symbol | argument | shape  | range  |
//! |--------|----------|--------|--------|
//! | x      | `x`      | (M, K) | finite |
//! | W      | `weight` | (N, K) | finite |
//! | b      | `bias`   | (N)    | finite |
//! | s      | `slope`  | ()     | ≥ 0; 1 or absent for none |
//! | y      | `y`      | (M, N) |        |
//!
//! # Rounding
//! Each output is one chain of [`gemm`]: from +0, k ascending, with product and sum rounded separately; k
//! beyond 4096 is split into chunks joined by the pairwise tree. The bias is added after the chain.
//!
//! # Kinks and domain
//! y is linear in each input; with a slope the kinks are those of the leaky ReLU. Overflow of finite inputs
//! gives ±∞ as in IEEE 754.
//!
//! # Adjoint
//! x̄ += z̄·W,   W̄ += z̄ᵀ·x,   b̄(j) += Σᵢ z̄(i,j),   z̄ = ȳ;   with a slope z̄ = ȳ where λ(y) > 0, else s·ȳ
//! (for s ≥ 0, λ(y) > 0 exactly where y > 0)
//!
//! The sums run over N, over M and over M, as chains like the one above; the sum of b̄ is a left fold over
//! the rows from +0. Each sum is completed before it is added to the caller's gradient. With a slope the
//! results are saved; otherwise nothing is saved.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::linear;
//! let x = linear::In { x: &[1.0, 2.0], weight: &[3.0, 4.0, 5.0, 6.0], bias: &[0.5, -0.5], m: 1, n: 2, k: 2 };
//! let mut y = [0.0; 2];
//! linear::forward(x, &mut y);
//! assert_eq!(y, [11.5, 16.5]);
//! ```

use super::act::leaky_relu_back;
use crate::num::gemm::{Finish, View, gemm};

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (M, K).
    pub x: &'a [f32],
    /// Shape (N, K).
    pub weight: &'a [f32],
    /// Shape (N); empty for a map without bias.
    pub bias: &'a [f32],
    /// Number of rows M.
    pub m: usize,
    /// Number of outputs N.
    pub n: usize,
    /// Number of inputs K.
    pub k: usize,
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (M, K); empty if not requested.
    pub x: Vec<f32>,
    /// Shape (N, K); empty if not requested.
    pub weight: Vec<f32>,
    /// Shape (N); empty if there is no bias or if not requested.
    pub bias: Vec<f32>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        Self { x: vec![0.0; x.x.len()], weight: vec![0.0; x.weight.len()], bias: vec![0.0; x.bias.len()] }
    }
}

/// Writes y (M, N).
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: In<'_>, y: &mut [f32]) {
    let In { m, n, k, .. } = x;
    let how = if x.bias.is_empty() { Finish::Store } else { Finish::Bias(x.bias) };
    gemm(View::new(x.x, m, k), View::new(x.weight, n, k).t(), how, y);
}

/// Writes λ(y) for the leaky ReLU λ with this slope; the bits equal those of [`forward`] followed by
/// [`leaky_relu`](super::act::leaky_relu).
///
/// # Panics
/// Panics under the conditions of [`forward`]; also panics if there is no bias.
pub fn forward_leaky(x: In<'_>, slope: f32, y: &mut [f32]) {
    let In { m, n, k, .. } = x;
    gemm(View::new(x.x, m, k), View::new(x.weight, n, k).t(), Finish::Leaky(x.bias, slope), y);
}

/// Adds the gradients of [`forward_leaky`] with result `y` to `x_bar`; the cotangent `y_bar` is replaced by
/// that before the leaky ReLU. The slope is ≥ 0, so that the sign of y determines the branch.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape, or the slope is negative.
pub fn adjoint_leaky(x: In<'_>, slope: f32, y: &[f32], y_bar: &mut [f32], x_bar: &mut InBar) {
    assert!(slope >= 0.0, "the slope is not negative");
    leaky_relu_back(y, slope, y_bar);
    adjoint(x, y_bar, x_bar);
}

/// Adds the gradients for the cotangent `y_bar` (M, N) to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: In<'_>, y_bar: &[f32], x_bar: &mut InBar) {
    let In { m, n, k, .. } = x;
    let cotangent = View::new(y_bar, m, n);
    if !x_bar.x.is_empty() {
        gemm(cotangent, View::new(x.weight, n, k), Finish::Add, &mut x_bar.x);
    }
    if !x_bar.weight.is_empty() {
        gemm(cotangent.t(), View::new(x.x, m, k), Finish::Add, &mut x_bar.weight);
    }
    if !x_bar.bias.is_empty() {
        assert_eq!(x_bar.bias.len(), n, "one gradient per bias");
        x_bar.bias.iter_mut().zip(column_sums(y_bar, n)).for_each(|(bar, sum)| *bar += sum);
    }
}

/// Returns the sums of the columns of rows (…, n), left folds from +0.
pub(super) fn column_sums(rows: &[f32], n: usize) -> Vec<f32> {
    let mut sums = vec![0.0_f32; n];
    for row in rows.chunks_exact(n) {
        sums.iter_mut().zip(row).for_each(|(s, g)| *s += *g);
    }
    sums
}
