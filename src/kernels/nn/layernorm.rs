//! `nn.layernorm`: every row is shifted and scaled to mean 0 and variance 1, then scaled and shifted per column.
//!
//! y(i,j) = n(i,j)·γ(j) + b(j),   n = (x − μ)/√(v + ε)        (Ba, Kiros and Hinton 2016)
//! μ(i) = mean of the row,   v(i) = mean of (x − μ)²
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | x | `x` | (M, K) | finite |
//! | γ | `gain` | (K) | finite |
//! | b | `bias` | (K) | finite |
//! | ε | `eps` | () | > 0; LIRM takes 10⁻⁶ |
//! | y | `y` | (M, K) | |
//!
//! # Rounding
//! Two passes in f64: μ is the sum over 16 lanes ([`sum`]) divided by K, v the same of the squares of x − μ. (The difference of
//! mean x² and μ² in one pass can be negative.) r = 1/√(v + ε) in f64; n = (x − μ)·r, rounded once; then n·γ + b, each rounded.
//!
//! # Kinks and domain
//! Smooth, because of ε. A constant row has v = 0 and r = 1/√ε: y = b, and its gradient is 1/√ε times as large as the cotangent,
//! 1 000 times for 10⁻⁶.
//!
//! # Adjoint
//! b̄(j) += Σᵢ ȳ,   γ̄(j) += Σᵢ ȳ·n,   x̄ += r·((g − mean g) − n·mean(g·n)),   g = ȳ·γ
//!
//! The means are sums over 16 lanes in f64 of rounded products, divided by K; x̄ is rounded once before it is added. The sums over rows are
//! left folds from +0. μ and r are saved.
//!
//! Twin: `reference::nn::layernorm`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::layernorm::{In, forward};
//! let x = In { x: &[1.0, 3.0], gain: &[2.0, 2.0], bias: &[0.0, 10.0], eps: 3.0 };
//! let mut y = [0.0; 2];
//! forward(&x, &mut y);
//! assert_eq!(y, [-1.0, 11.0]); // v = 1, √(1 + 3) = 2
//! ```

use super::linear::column_sums;
use crate::num::{par, sum};

/// Rows per task; the number changes no bit.
const ROWS: usize = 32;
/// Columns per task of sums over rows; the number changes no bit.
const COLUMNS: usize = 64;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (M, K).
    pub x: &'a [f32],
    /// Shape (K), not empty.
    pub gain: &'a [f32],
    /// Shape (K).
    pub bias: &'a [f32],
    /// Added to the variance.
    pub eps: f64,
}

/// Mean and 1/√(v + ε) of every row.
pub type Saved = Vec<[f64; 2]>;

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (M, K).
    pub x: Vec<f32>,
    /// Shape (K).
    pub gain: Vec<f32>,
    /// Shape (K).
    pub bias: Vec<f32>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let zeros = |like: &[f32]| vec![0.0; like.len()];
        Self { x: zeros(x.x), gain: zeros(x.gain), bias: zeros(x.bias) }
    }
}

impl In<'_> {
    fn hold_to_shape(&self) {
        let k = self.gain.len();
        assert!(k > 0 && self.bias.len() == k && self.x.len().is_multiple_of(k), "rows of K numbers");
    }
}

/// n of a value.
#[inline(always)]
fn normal(x: f32, [mean, rate]: [f64; 2]) -> f32 {
    ((f64::from(x) - mean) * rate) as f32
}

/// Writes y (M, K) and returns what the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>, y: &mut [f32]) -> Saved {
    x.hold_to_shape();
    assert_eq!(y.len(), x.x.len(), "y has the shape of x");
    let k = x.gain.len();
    let mut saved = vec![[0.0; 2]; x.x.len() / k];
    par::chunks_mut2(y, ROWS * k, &mut saved, ROWS, |c, y, saved| {
        let rows = x.x[c * ROWS * k..].chunks_exact(k);
        for ((y, saved), row) in y.chunks_exact_mut(k).zip(saved).zip(rows) {
            let mean = sum::sum16_wide(row) / k as f64;
            let square = |i: usize| {
                let d = f64::from(row[i]) - mean;
                d * d
            };
            let variance = sum::sum16_f64_by(k, square) / k as f64;
            *saved = [mean, 1.0 / (variance + x.eps).sqrt()];
            for (j, y) in y.iter_mut().enumerate() {
                *y = normal(row[j], *saved) * x.gain[j] + x.bias[j];
            }
        }
    });
    saved
}

/// Adds the gradients for the cotangent `y_bar` (M, K) to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, saved: &[[f64; 2]], y_bar: &[f32], x_bar: &mut InBar) {
    x.hold_to_shape();
    assert!(
        y_bar.len() == x.x.len() && x_bar.x.len() == x.x.len(),
        "cotangent and gradient have the shape of x"
    );
    let k = x.gain.len();
    par::chunks_mut(&mut x_bar.x, ROWS * k, |c, bars| {
        for (r, bar) in bars.chunks_exact_mut(k).enumerate() {
            let row = c * ROWS + r;
            let (x_row, g) = (&x.x[row * k..][..k], &y_bar[row * k..][..k]);
            let (saved, n) = (saved[row], k as f64);
            let of = |j: usize| g[j] * x.gain[j];
            let mean = sum::sum16_f64_by(k, |j| f64::from(of(j))) / n;
            let along = sum::sum16_f64_by(k, |j| f64::from(of(j) * normal(x_row[j], saved))) / n;
            for (j, bar) in bar.iter_mut().enumerate() {
                let own = (f64::from(of(j)) - mean) - f64::from(normal(x_row[j], saved)) * along;
                *bar += (saved[1] * own) as f32;
            }
        }
    });
    x_bar.bias.iter_mut().zip(column_sums(y_bar, k)).for_each(|(bar, sum)| *bar += sum);
    par::chunks_mut(&mut x_bar.gain, COLUMNS, |c, gains| {
        let columns = c * COLUMNS..c * COLUMNS + gains.len();
        let mut sums = [0.0_f32; COLUMNS];
        for (row, saved) in saved.iter().enumerate() {
            let (x_row, g) = (&x.x[row * k..][columns.clone()], &y_bar[row * k..][columns.clone()]);
            for ((sum, x), g) in sums.iter_mut().zip(x_row).zip(g) {
                *sum += g * normal(*x, *saved);
            }
        }
        gains.iter_mut().zip(sums).for_each(|(bar, sum)| *bar += sum);
    });
}
