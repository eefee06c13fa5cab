//! `nn.unpatch`: every token becomes a square of texels: the transpose of the convolution of [`super::conv`] whose stride is the size
//! of its kernel.
//!
//! y(n, rh+i, rw+j, c) = β(c) + Σ over d of tokens(n,h,w,d)·W(d,i,j,c)        (LIRM)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | tokens | `tokens` | (N, H, W, D) | finite; one grid per plane or panorama |
//! | W | `weight` | (D, r, r, C) | finite |
//! | β | `bias` | (C) | finite |
//! | y | `y` | (N, rH, rW, C) | layout of [`crate::field::fetch`] and [`crate::field::embed`] |
//!
//! All grids share W; LIRM takes r = 8, one W for the planes and one for the panoramas, and applies [`super::weight_norm`] to W as a
//! matrix (D, r²C): a length per token column, because that is the first axis of a transposed convolution in the published code.
//! A model calls that operator first. LIRM starts W at uniform numbers in ±1/√(r²C): r²C is what PyTorch calls the fan-in of a
//! transposed convolution. PyTorch starts β so too; here it starts at 0. In the scaled first values of this project, every token column
//! (d) of W is a sum of cosines over i and j for every c, with smaller coefficients for higher frequencies, and has the length 1/√3.
//!
//! # Rounding
//! Each output is one chain from +0 over d, ascending ([`crate::num::gemm`]; beyond 4096 chunks and the tree); β is added after it.
//!
//! # Kinks and domain
//! y is linear in each input. D, r and C are at least 1.
//!
//! # Adjoint
//! tokens̄(n,h,w,d) += Σ over i, j, c of W(d,i,j,c)·ȳ(n, rh+i, rw+j, c): the convolution of ȳ, one chain in memory order of W
//!
//! W̄(d,i,j,c) += Σ over h, w of tokens(n,h,w,d)·ȳ(n, rh+i, rw+j, c),   β̄(c) += Σ of ȳ(n,·,·,c),   for n = 0, 1, …
//!
//! The sums over h, w and over the texels are completed before they are added, grid by grid in index order: chains of [`super::conv`] and a
//! left fold. So several grids may be split into consecutive calls. Nothing is saved.
//!
//! Twin: `reference::nn::unpatch`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::unpatch::{In, Shape, forward};
//! let shape = Shape { grids: 1, height: 1, width: 2, patch: 2, channels: 1 };
//! let mut y = [0.0; 8];
//! forward(&In { tokens: &[1.0, 2.0], weight: &[1.0, 10.0, 100.0, 1000.0], bias: &[0.5], shape }, &mut y);
//! assert_eq!(y, [1.5, 10.5, 2.5, 20.5, 100.5, 1000.5, 200.5, 2000.5]);
//! ```

use super::conv;
use super::linear::column_sums;
use crate::num::par;
use std::mem::take;

/// Sizes of the grids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Number of grids, N.
    pub grids: usize,
    /// Rows H of tokens.
    pub height: usize,
    /// Columns W of tokens.
    pub width: usize,
    /// Side r of the square of texels of one token.
    pub patch: usize,
    /// Channels C of a texel.
    pub channels: usize,
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (N, H, W, D).
    pub tokens: &'a [f32],
    /// Shape (D, r, r, C), not empty.
    pub weight: &'a [f32],
    /// Shape (C).
    pub bias: &'a [f32],
    /// Sizes of the grids.
    pub shape: Shape,
}

/// Gradients; the adjoint adds to them. A gradient that is not requested is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (N, H, W, D).
    pub tokens: Vec<f32>,
    /// Shape (D, r, r, C).
    pub weight: Vec<f32>,
    /// Shape (C).
    pub bias: Vec<f32>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let zeros = |like: &[f32]| vec![0.0; like.len()];
        Self { tokens: zeros(x.tokens), weight: zeros(x.weight), bias: zeros(x.bias) }
    }
}

impl In<'_> {
    /// The convolution from texels to tokens.
    fn convolution(&self) -> conv::Shape {
        let Shape { grids, height, width, patch, channels } = self.shape;
        let taps = patch * patch * channels;
        assert!(taps > 0 && !self.weight.is_empty(), "there is a weight");
        assert!(self.weight.len().is_multiple_of(taps), "the weight has the size of its shape");
        let outputs = self.weight.len() / taps;
        assert!(height > 0 && width > 0, "a grid has a token");
        assert_eq!(
            self.tokens.len(),
            grids * height * width * outputs,
            "tokens have the size of their shape"
        );
        assert_eq!(self.bias.len(), channels, "one bias per channel");
        conv::Shape {
            batch: grids,
            height: patch * height,
            width: patch * width,
            channels,
            outputs,
            kernel: [patch, patch],
            stride: patch,
            pad: 0,
        }
    }
}

/// Writes y (N, rH, rW, C).
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>, y: &mut [f32]) {
    conv::transposed(x.tokens, x.weight, x.bias, x.convolution(), y);
}

/// Adds the gradients for the cotangent `y_bar` (N, rH, rW, C) to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, y_bar: &[f32], x_bar: &mut InBar) {
    let shape = x.convolution();
    let size = shape.height * shape.width * shape.channels;
    assert_eq!(y_bar.len(), shape.batch * size, "the cotangent has the size of y");
    let texels = conv::In { x: y_bar, weight: x.weight, bias: &[], shape };
    if !x_bar.tokens.is_empty() {
        let mut sums = vec![0.0; x.tokens.len()];
        conv::forward(texels, &mut sums);
        assert_eq!(x_bar.tokens.len(), sums.len(), "one gradient per number of the tokens");
        x_bar.tokens.iter_mut().zip(sums).for_each(|(bar, sum)| *bar += sum);
    }
    if !x_bar.weight.is_empty() {
        // The tokens are the cotangent of that convolution.
        let mut bar = conv::InBar { weight: take(&mut x_bar.weight), ..conv::InBar::default() };
        conv::adjoint(texels, x.tokens, &mut bar);
        x_bar.weight = bar.weight;
    }
    if !x_bar.bias.is_empty() {
        let sums = par::map(shape.batch, |n| column_sums(&y_bar[n * size..][..size], shape.channels));
        for sums in sums {
            x_bar.bias.iter_mut().zip(sums).for_each(|(bar, sum)| *bar += sum);
        }
    }
}
