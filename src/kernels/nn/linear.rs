//! `nn.linear`: an affine map of every row.
//!
//! y = x·Wᵀ + b,   y(i,j) = Σₖ x(i,k)·W(j,k) + b(j);   with a slope s: λ(y), the leaky ReLU of [`mod@super::act`] after it in the same pass
//!
//! | symbol | argument | shape  | range  |
//! |--------|----------|--------|--------|
//! | x      | `x`      | (M, K) | finite |
//! | W      | `weight` | (N, K) | finite |
//! | b      | `bias`   | (N)    | finite |
//! | s      | `slope`  | ()     | ≥ 0; 1 or left out for none |
//! | y      | `y`      | (M, N) |        |
//!
//! # Rounding
//! Each output is one chain of [`gemm`]: from +0, k ascending, product and sum rounded separately; k beyond 4096 in
//! chunks joined by the pairwise tree. The bias is added after the chain.
//!
//! # Kinks and domain
//! y is linear in each input; with a slope the kinks are those of the leaky ReLU. Overflow of finite inputs gives ±∞ as IEEE 754 does.
//!
//! # Adjoint
//! x̄ += z̄·W,   W̄ += z̄ᵀ·x,   b̄(j) += Σᵢ z̄(i,j),   z̄ = ȳ;   with a slope z̄ = ȳ where λ(y) > 0, else s·ȳ (as s ≥ 0, λ(y) > 0 where y > 0)
//!
//! The sums run over N, over M and over M, as chains like the one above; the sum of b̄ is a left fold over the rows from
//! +0. Each is finished before it is added to what the caller accumulates. With a slope its results are read; else nothing is saved.
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
    /// (M, K)
    pub x: &'a [f32],
    /// (N, K)
    pub weight: &'a [f32],
    /// (N); empty for a map without bias
    pub bias: &'a [f32],
    /// rows M
    pub m: usize,
    /// outputs N
    pub n: usize,
    /// inputs K
    pub k: usize,
}

/// Gradients, accumulated into.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// (M, K); empty when it is not wanted
    pub x: Vec<f32>,
    /// (N, K); empty when it is not wanted
    pub weight: Vec<f32>,
    /// (N); empty when there is no bias or it is not wanted
    pub bias: Vec<f32>,
}

impl InBar {
    /// Zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        Self { x: vec![0.0; x.x.len()], weight: vec![0.0; x.weight.len()], bias: vec![0.0; x.bias.len()] }
    }
}

/// Writes y (M, N).
///
/// # Panics
/// When a buffer does not have the size of its shape.
pub fn forward(x: In<'_>, y: &mut [f32]) {
    let In { m, n, k, .. } = x;
    let how = if x.bias.is_empty() { Finish::Store } else { Finish::Bias(x.bias) };
    gemm(View::new(x.x, m, k), View::new(x.weight, n, k).t(), how, y);
}

/// Writes λ(y) for the leaky ReLU λ of that slope: the bits of [`forward`] and [`leaky_relu`](super::act::leaky_relu) in one pass.
///
/// # Panics
/// As [`forward`]; when there is no bias.
pub fn forward_leaky(x: In<'_>, slope: f32, y: &mut [f32]) {
    let In { m, n, k, .. } = x;
    gemm(View::new(x.x, m, k), View::new(x.weight, n, k).t(), Finish::Leaky(x.bias, slope), y);
}

/// Adds the gradients of [`forward_leaky`], of which `y` is the result, to `x_bar`; the cotangent `y_bar` becomes that before the leaky ReLU. The slope is
/// not negative, so that the sign of y tells the side.
///
/// # Panics
/// When a buffer does not have the size of its shape, or the slope is negative.
pub fn adjoint_leaky(x: In<'_>, slope: f32, y: &[f32], y_bar: &mut [f32], x_bar: &mut InBar) {
    assert!(slope >= 0.0, "the sign of the result tells the side");
    leaky_relu_back(y, slope, y_bar);
    adjoint(x, y_bar, x_bar);
}

/// Adds the gradients for the cotangent `y_bar` (M, N) to `x_bar`.
///
/// # Panics
/// When a buffer does not have the size of its shape.
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

/// Sums of the columns of rows (…, n), left folds from +0.
pub(super) fn column_sums(rows: &[f32], n: usize) -> Vec<f32> {
    let mut sums = vec![0.0_f32; n];
    for row in rows.chunks_exact(n) {
        sums.iter_mut().zip(row).for_each(|(s, g)| *s += *g);
    }
    sums
}
