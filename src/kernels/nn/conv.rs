//! `nn.conv`: a convolution of images, channels last, and a leaky ReLU after it.
//!
//! z(b,r,q,o) = β(o) + Σ over i, j, c of W(o,i,j,c)·x(b, s·r+i−p, s·q+j−p, c),   x = 0 beyond the border;   y = λ(z)
//!
//! | symbol | argument | shape | range |
//! |--------|----------|-------|-------|
//! | x | `x`      | (B, H, W, C)        | finite, C ≥ 1 |
//! | W | `weight` | (O, KH, KW, C)      | finite |
//! | β | `bias`   | (O)                 | finite |
//! | s | `stride` | ()                  | ≥ 1, both axes |
//! | p | `pad`    | ()                  | ≥ 0, zeros on all four sides |
//! | λ | `slope`  | ()                  | ≥ 0: slope a of the leaky ReLU of [`mod@super::act`]; 1 or left out for none |
//! | y | `y`      | (B, H', W', O)      | H' = ⌊(H + 2p − KH)/s⌋ + 1, W' alike |
//!
//! The kernel is not mirrored (a cross-correlation, as everywhere in networks).
//!
//! # Rounding
//! Each output is one chain of [`gemm`](crate::num::gemm) over (i, j, c) in memory order of the weight, from +0; beyond 4096 terms in
//! chunks joined by the pairwise tree. Terms beyond the border count as products with +0, which change no bit. The bias is added after the chain; λ is one product.
//!
//! # Kinks and domain
//! z is linear in each input. With a slope the kink is that of the leaky ReLU: at z = 0 its slope is a. At least one channel. Overflow of finite inputs gives ±∞ as IEEE 754 does.
//!
//! # Adjoint
//! z̄ = ȳ where y > 0, else a·ȳ (as a ≥ 0, y > 0 where z > 0); without λ z̄ = ȳ
//!
//! W̄(o,i,j,c) += Σ over r, q of z̄(b,r,q,o)·x(b, s·r+i−p, s·q+j−p, c),   β̄(o) += Σ over r, q of z̄(b,r,q,o),   for b = 0, 1, …
//!
//! x̄(b,h,w,c) += Σ over i, j, o of W(o,i,j,c)·z̄(b, (h+p−i)/s, (w+p−j)/s, o)   where both quotients are whole and in range
//!
//! The sum over r, q of one item is one chain (r, then q ascending; chunks of 4096 for W̄, a left fold for β̄), finished before it
//! is added; items are added in index order, so a batch may be split into consecutive parts. The sum of x̄ is one chain over (i, j, o)
//! ascending, finished before it is added; an entry that no output reads is left as it is. With λ its results are read; else nothing is saved: patches are gathered again.
//!
//! # How it is fast
//! A task copies the rows it needs with zeros around them; patches are then runs of that copy, multiplied where they lie
//! ([`crate::num::gemm::runs`]). x̄ is a product too: pixels that have the same (h + p) mod s and (w + p) mod s see the same taps of the
//! kernel, so each such class is one product without zeros between. [`forward_leaky`] and [`gradients_leaky`] spare the passes of a
//! [`leaky_relu`](super::act::leaky_relu) that follows. None of this changes a bit.
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

pub use gradients::{adjoint, gradients_leaky};

use crate::num::gemm::runs::{Runs, gemm_runs};
use crate::num::gemm::{Finish, Packed, View};
use crate::num::{order, par};
use std::cell::Cell;
use std::ops::Range;

/// Pixels of a task of products, at least: whole register tiles.
const PIXELS: usize = 192;
thread_local! {
    /// Padded rows, kept between tasks.
    static PADDED: Cell<Vec<f32>> = const { Cell::new(Vec::new()) };
}

/// Sizes of a convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// B
    pub batch: usize,
    /// H
    pub height: usize,
    /// W
    pub width: usize,
    /// C
    pub channels: usize,
    /// O
    pub outputs: usize,
    /// KH, KW
    pub kernel: [usize; 2],
    /// s
    pub stride: usize,
    /// p
    pub pad: usize,
}

impl Shape {
    /// Output rows and columns H', W'; `None` where the kernel is empty or larger than the padded image, or s = 0.
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

    /// Entries of one filter, KH·KW·C.
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
    /// (B, H, W, C)
    pub x: &'a [f32],
    /// (O, KH, KW, C)
    pub weight: &'a [f32],
    /// (O); empty for a map without bias
    pub bias: &'a [f32],
    /// sizes
    pub shape: Shape,
}

/// Gradients, accumulated into.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// (B, H, W, C); empty when it is not wanted
    pub x: Vec<f32>,
    /// (O, KH, KW, C); empty when it is not wanted
    pub weight: Vec<f32>,
    /// (O); empty when there is no bias or it is not wanted
    pub bias: Vec<f32>,
}

impl InBar {
    /// Zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        Self { x: vec![0.0; x.x.len()], weight: vec![0.0; x.weight.len()], bias: vec![0.0; x.bias.len()] }
    }
}

/// A buffer of `len` numbers whose contents do not matter.
fn sized(mut buffer: Vec<f32>, len: usize) -> Vec<f32> {
    if buffer.len() < len {
        buffer.resize(len, 0.0);
    }
    buffer
}

/// Rows and columns of an image, some of them beyond its border; columns begin at 0 or before.
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

    /// Copies the window of an image (`height`, `width`, `channels`) with zeros beyond the border; `read(first, into)` gives its numbers from `first` on.
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

/// Consecutive rows of a batch of images of `height` rows, item by item: item, rows.
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
/// When the kernel does not fit, there is no channel, or a buffer does not have the size of its shape.
pub fn forward(x: In<'_>, y: &mut [f32]) {
    let how = if x.bias.is_empty() { Finish::Store } else { Finish::Bias(x.bias) };
    products(&x, how, y);
}

/// Writes λ(y) for the leaky ReLU λ of that slope: the bits of [`forward`] and [`leaky_relu`](super::act::leaky_relu) in one pass.
///
/// # Panics
/// As [`forward`]; when there is no bias.
pub fn forward_leaky(x: In<'_>, slope: f32, y: &mut [f32]) {
    assert_eq!(x.bias.len(), x.shape.outputs, "one bias per output");
    products(&x, Finish::Leaky(x.bias, slope), y);
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

/// Sizes of the outputs, after the inputs were held to their shapes.
fn checked(x: &In<'_>) -> [usize; 2] {
    let Shape { batch, height, width, channels, outputs, .. } = x.shape;
    assert_eq!(x.x.len(), batch * height * width * channels, "x has the size of its shape");
    assert_eq!(x.weight.len(), outputs * x.shape.taps(), "the weight has the size of its shape");
    assert!(x.bias.is_empty() || x.bias.len() == outputs, "one bias per output");
    assert!(channels > 0, "an image has a channel");
    x.shape.fitting()
}
