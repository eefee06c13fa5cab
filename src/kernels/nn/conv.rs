//! `nn.conv`: a convolution of images in channels-last layout, optionally followed by a leaky ReLU.
//!
//! z(b,r,q,o) = β(o) + Σ over i, j, c of W(o,i,j,c)·x(b, s·r+i−p, s·q+j−p, c),   x = 0 beyond the border;
//! y = λ(z)
//!
//! | symbol | argument | shape | range |
//! |--------|----------|-------|-------|
//! | x | `x`      | (B, H, W, C)        | finite, C ≥ 1 |
//! | W | `weight` | (O, KH, KW, C)      | finite |
//! | β | `bias`   | (O)                 | finite |
//! | s | `stride` | ()                  | ≥ 1, both axes |
//! | p | `pad`    | ()                  | ≥ 0, zeros on all four sides |
//! | λ | `slope`  | ()                  | ≥ 0: slope a of the leaky ReLU of [`mod@super::act`]; 1 or absent for none |
//! | y | `y`      | (B, H', W', O)      | H' = ⌊(H + 2p − KH)/s⌋ + 1, W' alike |
//!
//! The kernel is not mirrored: the operator is a cross-correlation, as is usual in neural networks.
//!
//! # Rounding
//! Each output is one chain of [`gemm`](crate::num::gemm) over (i, j, c) in memory order of the weight, from
//! +0; more than 4096 terms are split into chunks joined by the pairwise tree. Terms beyond the border are
//! products with +0, which change no bit. The bias is added after the chain; λ is one product.
//!
//! # Kinks and domain
//! z is linear in each input. With a slope the kink is that of the leaky ReLU: at z = 0 its slope is a. There
//! is at least one channel. Overflow of finite inputs gives ±∞ as in IEEE 754.
//!
//! # Adjoint
//! z̄ = ȳ where y > 0, else a·ȳ (as a ≥ 0, y > 0 where z > 0); without λ z̄ = ȳ
//!
//! W̄(o,i,j,c) += Σ over r, q of z̄(b,r,q,o)·x(b, s·r+i−p, s·q+j−p, c),
//! β̄(o) += Σ over r, q of z̄(b,r,q,o),   for b = 0, 1, …
//!
//! x̄(b,h,w,c) += Σ over i, j, o of W(o,i,j,c)·z̄(b, (h+p−i)/s, (w+p−j)/s, o)   where both quotients are
//! integers in range
//!
//! The sum over r, q of one item is one chain (r, then q ascending; chunks of 4096 for W̄, a left fold for
//! β̄), completed before it is added; items are added in index order, so a batch may be split into
//! consecutive parts. The sum of x̄ is one chain over (i, j, o) ascending, completed before it is added; an
//! entry that no output reads is not changed. With λ, its results are saved; otherwise nothing is saved, and
//! patches are gathered again.
//!
//! # Implementation
//! A task copies the rows it needs and surrounds them with zeros; patches are then runs of that copy and are
//! multiplied in place ([`crate::num::gemm::runs`]). x̄ is also a product: pixels with the same (h + p) mod s
//! and (w + p) mod s use the same taps of the kernel, so each such class is one product without zeros in
//! between. [`forward_leaky`] and [`gradients_leaky`] fuse the passes of a subsequent
//! [`leaky_relu`](super::act::leaky_relu). None of this changes a bit.
//!
//! Twin: `reference::nn::conv`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::conv::{In, Shape, forward};
//! let shape = Shape { batch: 1, height: 2, width: 2, channels: 1, outputs: 1, kernel: [2, 2], stride: 1, pad: 0 };
//! let mut y = [0.0];
//! forward(In { x: &[1.0, 2.0, 3.0, 4.0], weight: &[1.0, 10.0, 100.0, 1000.0], bias: &[0.5], shape }, &mut y);
//! assert_eq!(y, [4321.5]);
//! ```

mod gradients;
#[cfg(test)]
mod tests;

pub(super) use gradients::transposed;
pub use gradients::{adjoint, gradients_leaky};

use crate::num::gemm::runs::{Runs, gemm_runs};
use crate::num::gemm::{Finish, Packed, View};
use crate::num::{order, par};
use std::cell::Cell;
use std::ops::Range;

/// Smallest number of pixels per product task: complete register tiles.
const PIXELS: usize = 192;
thread_local! {
    /// Padded rows, kept between tasks.
    static PADDED: Cell<Vec<f32>> = const { Cell::new(Vec::new()) };
}

/// Sizes of a convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Number of images, B.
    pub batch: usize,
    /// Height H in pixels.
    pub height: usize,
    /// Width W in pixels.
    pub width: usize,
    /// Number of input channels, C.
    pub channels: usize,
    /// Number of output channels, O.
    pub outputs: usize,
    /// Kernel height KH and width KW.
    pub kernel: [usize; 2],
    /// Stride s.
    pub stride: usize,
    /// Padding p.
    pub pad: usize,
}

impl Shape {
    /// Returns the number of output rows and columns H', W', or `None` if the kernel is empty or larger than
    /// the padded image, or if s = 0.
    pub fn out(&self) -> Option<[usize; 2]> {
        let along = |size: usize, kernel: usize| {
            let room = (size + 2 * self.pad).checked_sub(kernel)?;
            Some(room.checked_div(self.stride)? + 1)
        };
        let [kh, kw] = self.kernel;
        if kh == 0 || kw == 0 {
            return None;
        }
        Some([along(self.height, kh)?, along(self.width, kw)?])
    }

    /// Returns the number of entries of one filter, KH·KW·C.
    pub fn taps(&self) -> usize {
        self.kernel[0] * self.kernel[1] * self.channels
    }

    fn fitting(&self) -> [usize; 2] {
        self.out().expect("the kernel fits into the padded image and the stride is positive")
    }
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (B, H, W, C).
    pub x: &'a [f32],
    /// Shape (O, KH, KW, C).
    pub weight: &'a [f32],
    /// Shape (O); empty for a map without bias.
    pub bias: &'a [f32],
    /// Sizes of the convolution.
    pub shape: Shape,
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (B, H, W, C); empty if not requested.
    pub x: Vec<f32>,
    /// Shape (O, KH, KW, C); empty if not requested.
    pub weight: Vec<f32>,
    /// Shape (O); empty if there is no bias or if not requested.
    pub bias: Vec<f32>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        Self { x: vec![0.0; x.x.len()], weight: vec![0.0; x.weight.len()], bias: vec![0.0; x.bias.len()] }
    }
}

/// Returns a buffer of `len` numbers with unspecified contents.
fn sized(mut buffer: Vec<f32>, len: usize) -> Vec<f32> {
    if buffer.len() < len {
        buffer.resize(len, 0.0);
    }
    buffer
}

/// A range of rows and columns of an image, some of them beyond its border; columns begin at 0 or below.
#[derive(Clone, Debug)]
struct Window {
    rows: Range<isize>,
    columns: Range<isize>,
}

impl Window {
    fn width(&self) -> usize {
        self.columns.len()
    }

    fn pixels(&self) -> usize {
        self.rows.len() * self.width()
    }

    /// Copies the window of an image (`height`, `width`, `channels`) with zeros beyond the border;
    /// `read(first, into)` copies its numbers from index `first` on.
    fn copy(
        &self,
        [height, width, channels]: [usize; 3],
        into: &mut [f32],
        read: impl Fn(usize, &mut [f32]),
    ) {
        let inside = |at: isize| usize::try_from(at).unwrap_or_default();
        let before = order::min(inside(-self.columns.start), self.width()) * channels;
        let kept = order::min(inside(self.columns.end), width) * channels;
        for (row, line) in self.rows.clone().zip(into.chunks_exact_mut(self.width() * channels)) {
            match usize::try_from(row) {
                Ok(row) if row < height => {
                    line[..before].fill(0.0);
                    read(row * width * channels, &mut line[before..before + kept]);
                    line[before + kept..].fill(0.0);
                }
                _ => line.fill(0.0),
            }
        }
    }
}

/// Splits consecutive rows of a batch of images of `height` rows into (item, rows).
fn items(rows: Range<usize>, height: usize) -> impl Iterator<Item = (usize, Range<usize>)> {
    let first = rows.start / height;
    let last = rows.end.div_ceil(height);
    (first..last).map(move |b| {
        let top = b * height;
        (b, order::max(rows.start, top) - top..order::min(rows.end, top + height) - top)
    })
}

/// Writes y (B, H', W', O).
///
/// # Panics
/// Panics if the kernel does not fit, there is no channel, or a buffer does not have the size of its shape.
pub fn forward(x: In<'_>, y: &mut [f32]) {
    let how = if x.bias.is_empty() { Finish::Store } else { Finish::Bias(x.bias) };
    products(&x, how, y);
}

/// Writes λ(y) for the leaky ReLU λ with this slope; the bits equal those of [`forward`] followed by
/// [`leaky_relu`](super::act::leaky_relu).
///
/// # Panics
/// Panics under the conditions of [`forward`]; also panics if there is no bias.
pub fn forward_leaky(x: In<'_>, slope: f32, y: &mut [f32]) {
    assert_eq!(x.bias.len(), x.shape.outputs, "one bias per output");
    products(&x, Finish::Leaky(x.bias, slope), y);
}

/// Continues the chain of every entry of y (B, H', W', O) over the patches of x, without a bias: convolutions of
/// several images with one result.
///
/// # Panics
/// Panics under the conditions of [`forward`]; also panics if a filter has more than 4096 entries.
pub(super) fn resume(x: In<'_>, y: &mut [f32]) {
    products(&x, Finish::Resume, y);
}

fn products(x: &In<'_>, how: Finish<'_>, y: &mut [f32]) {
    let Shape { batch, height, width, channels, outputs, kernel: [kh, kw], stride, pad } = x.shape;
    let [rows, columns] = checked(x);
    assert_eq!(y.len(), batch * rows * columns * outputs, "y has the size of its shape");
    if y.is_empty() {
        return;
    }
    let weight = Packed::new(View::new(x.weight, outputs, x.shape.taps()).t());
    let lines = order::max(1, PIXELS / columns);
    let wide = -(pad as isize)..((columns - 1) * stride + kw) as isize - pad as isize;
    let line = wide.len() * channels;
    let offsets: Vec<usize> = (0..kh).map(|i| i * line).collect();
    par::chunks_mut(y, lines * columns * outputs, |strip, y| {
        let mut padded = PADDED.take();
        let (mut starts, mut used) = (Vec::with_capacity(y.len() / outputs), 0);
        let mine = strip * lines..strip * lines + y.len() / (columns * outputs);
        for (b, mine) in items(mine, rows) {
            let top = (mine.start * stride) as isize - pad as isize;
            let window =
                Window { rows: top..top + ((mine.len() - 1) * stride + kh) as isize, columns: wide.clone() };
            padded = sized(padded, used + window.pixels() * channels);
            let item = &x.x[b * height * width * channels..][..height * width * channels];
            window.copy([height, width, channels], &mut padded[used..], |first, into| {
                into.copy_from_slice(&item[first..][..into.len()]);
            });
            for r in 0..mine.len() {
                starts.extend((0..columns).map(|q| used + r * stride * line + q * stride * channels));
            }
            used += window.pixels() * channels;
        }
        let patches =
            Runs { values: &padded[..used], starts: &starts, offsets: &offsets, len: kw * channels };
        gemm_runs(patches, &weight, how, y.chunks_exact_mut(outputs).collect());
        PADDED.set(padded);
    });
}

/// Checks the shapes of the inputs and returns the size of the outputs.
fn checked(x: &In<'_>) -> [usize; 2] {
    let Shape { batch, height, width, channels, outputs, .. } = x.shape;
    assert_eq!(x.x.len(), batch * height * width * channels, "x has the size of its shape");
    assert_eq!(x.weight.len(), outputs * x.shape.taps(), "the weight has the size of its shape");
    assert!(x.bias.is_empty() || x.bias.len() == outputs, "one bias per output");
    assert!(channels > 0, "an image has a channel");
    x.shape.fitting()
}
