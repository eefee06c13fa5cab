//! `nn.conv`: a convolution of pictures, channels last.
//!
//! y(b,r,q,o) = β(o) + Σ over i, j, c of W(o,i,j,c)·x(b, s·r+i−p, s·q+j−p, c),   x = 0 beyond the border
//!
//! | symbol | argument | shape | range |
//! |--------|----------|-------|-------|
//! | x | `x`      | (B, H, W, C)        | finite |
//! | W | `weight` | (O, KH, KW, C)      | finite |
//! | β | `bias`   | (O)                 | finite |
//! | s | `stride` | ()                  | ≥ 1, both axes |
//! | p | `pad`    | ()                  | ≥ 0, zeros on all four sides |
//! | y | `y`      | (B, H', W', O)      | H' = ⌊(H + 2p − KH)/s⌋ + 1, W' alike |
//!
//! The kernel is not mirrored (a cross-correlation, as everywhere in networks).
//!
//! # Rounding
//! Each output is one chain of [`gemm`](crate::num::gemm) over (i, j, c) in memory order of the weight, from +0; beyond 4096 terms in
//! chunks joined by the pairwise tree. Terms beyond the border count as products with +0, which change no bit. The bias is added last.
//!
//! # Kinks and domain
//! None: y is linear in each input. Overflow of finite inputs gives ±∞ as IEEE 754 does.
//!
//! # Adjoint
//! W̄(o,i,j,c) += Σ over r, q of ȳ(b,r,q,o)·x(b, s·r+i−p, s·q+j−p, c),   β̄(o) += Σ over r, q of ȳ(b,r,q,o),   for b = 0, 1, …
//!
//! x̄(b,h,w,c) += Σ over i, j, o of W(o,i,j,c)·ȳ(b, (h+p−i)/s, (w+p−j)/s, o)   where both quotients are whole and in range
//!
//! The sum over r, q of one item is one chain (r, then q ascending; chunks of 4096 for W̄, a left fold for β̄), finished before it
//! is added; items are added in index order, so a batch may be split into consecutive parts. The sum of x̄ is one chain over (i, j, o)
//! ascending, finished before it is added; an entry that no output reads is left as it is. Nothing is saved: patches are gathered again.
//!
//! # How it is fast
//! Patches of a few output rows are gathered into a matrix that stays in the cache, one copy per row of the kernel, and multiplied. x̄ is
//! gathered too: pixels that have the same (h + p) mod s and (w + p) mod s see the same taps of the kernel, so each such class is one product
//! without zeros between. None of the block sizes changes a bit.
//!
//! Twin: `reference::nn::conv`.
//!
//! # Example
//! ```
//! use lastlight::nn::conv::{In, Shape, forward};
//! let shape = Shape { batch: 1, height: 2, width: 2, channels: 1, outputs: 1, kernel: [2, 2], stride: 1, pad: 0 };
//! let mut y = [0.0];
//! forward(In { x: &[1.0, 2.0, 3.0, 4.0], weight: &[1.0, 10.0, 100.0, 1000.0], bias: &[0.5], shape }, &mut y);
//! assert_eq!(y, [4321.5]);
//! ```

use crate::num::gemm::{Finish, Packed, View, gemm, gemm_packed};
use crate::num::{order, par};
use std::cell::Cell;
use std::ops::Range;

/// Rows of a gathered matrix.
const STRIP: usize = 96;
/// Kernel entries per task of the weight's gradient: eleven register tiles.
const TAPS: usize = 66;

thread_local! {
    /// Gathered patches, kept between tasks.
    static PATCHES: Cell<Vec<f32>> = const { Cell::new(Vec::new()) };
    /// Products on their way to where they are added.
    static PRODUCTS: Cell<Vec<f32>> = const { Cell::new(Vec::new()) };
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
    /// Output rows and columns H', W'; `None` where the kernel is empty or larger than the padded picture, or s = 0.
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
        self.out().expect("the kernel fits into the padded picture and the stride is positive")
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

/// Position along one axis of tap `i` of output `r`, if it is not beyond the border.
#[inline(always)]
fn place(r: usize, i: usize, size: usize, shape: &Shape) -> Option<usize> {
    (r * shape.stride + i).checked_sub(shape.pad).filter(|&at| at < size)
}

/// Entries `columns` of the (KW, C) of kernel row `i`, as output (r, q) of item `b` sees them.
#[inline(always)]
fn gather(x: &In<'_>, [b, r, q]: [usize; 3], i: usize, columns: &Range<usize>, into: &mut [f32]) {
    let Shape { height, width, channels, stride, pad, .. } = x.shape;
    let Some(row) = place(r, i, height, &x.shape) else {
        into.fill(0.0);
        return;
    };
    // Along the padded row of the picture; what lies in border..end exists.
    let (start, border, end) = (q * stride * channels, pad * channels, (pad + width) * channels);
    let [first, last] = [start + columns.start, start + columns.end];
    let [from, to] = [first, last].map(|at| order::clamp(at, border, end));
    let line = &x.x[(b * height + row) * width * channels..][..width * channels];
    let before = order::min(from.saturating_sub(first), into.len());
    let (zeros, rest) = into.split_at_mut(before);
    let (kept, beyond) = rest.split_at_mut(to - from);
    zeros.fill(0.0);
    kept.copy_from_slice(&line[from - border..to - border]);
    beyond.fill(0.0);
}

/// A buffer of `len` numbers whose contents do not matter.
fn sized(mut buffer: Vec<f32>, len: usize) -> Vec<f32> {
    if buffer.len() < len {
        buffer.resize(len, 0.0);
    }
    buffer
}

/// Writes y (B, H', W', O).
///
/// # Panics
/// When the kernel does not fit, or a buffer does not have the size of its shape.
pub fn forward(x: In<'_>, y: &mut [f32]) {
    let Shape { batch, channels, outputs, kernel: [kh, kw], .. } = x.shape;
    let [rows, columns] = checked(&x);
    assert_eq!(y.len(), batch * rows * columns * outputs, "y has the size of its shape");
    if y.is_empty() {
        return;
    }
    let taps = x.shape.taps();
    let weight = Packed::new(View::new(x.weight, outputs, taps).t());
    let how = if x.bias.is_empty() { Finish::Store } else { Finish::Bias(x.bias) };
    par::chunks_mut(y, STRIP * outputs, |strip, y| {
        let n = y.len() / outputs;
        let mut patches = sized(PATCHES.take(), n * taps);
        for k in 0..n {
            let at = strip * STRIP + k;
            let at = [at / (rows * columns), at / columns % rows, at % columns];
            for i in 0..kh {
                let into = &mut patches[k * taps + i * kw * channels..][..kw * channels];
                gather(&x, at, i, &(0..kw * channels), into);
            }
        }
        gemm_packed(View::new(&patches[..n * taps], n, taps), &weight, how, y);
        PATCHES.set(patches);
    });
}

/// Sizes of the outputs, after the inputs were held to their shapes.
fn checked(x: &In<'_>) -> [usize; 2] {
    let Shape { batch, height, width, channels, outputs, .. } = x.shape;
    assert_eq!(x.x.len(), batch * height * width * channels, "x has the size of its shape");
    assert_eq!(x.weight.len(), outputs * x.shape.taps(), "the weight has the size of its shape");
    assert!(x.bias.is_empty() || x.bias.len() == outputs, "one bias per output");
    x.shape.fitting()
}

/// Adds the gradients for the cotangent `y_bar` (B, H', W', O) to `x_bar`.
///
/// # Panics
/// When the kernel does not fit, or a buffer does not have the size of its shape.
pub fn adjoint(x: In<'_>, y_bar: &[f32], x_bar: &mut InBar) {
    let [rows, columns] = checked(&x);
    let size = x.shape.batch * rows * columns * x.shape.outputs;
    assert_eq!(y_bar.len(), size, "the cotangent has the size of y");
    if size == 0 {
        return;
    }
    if !x_bar.x.is_empty() {
        picture(&x, y_bar, &mut x_bar.x);
    }
    if !x_bar.weight.is_empty() {
        filters(&x, y_bar, &mut x_bar.weight);
    }
    if !x_bar.bias.is_empty() {
        biases(&x, y_bar, &mut x_bar.bias);
    }
}

/// β̄: per item a left fold over its rows, items in index order.
fn biases(x: &In<'_>, y_bar: &[f32], bar: &mut [f32]) {
    let n = x.shape.outputs;
    assert_eq!(bar.len(), n, "one gradient per bias");
    let item = y_bar.len() / x.shape.batch;
    let sums = par::map(x.shape.batch, |b| {
        let mut sums = vec![0.0_f32; n];
        for row in y_bar[b * item..][..item].chunks_exact(n) {
            for (sum, g) in sums.iter_mut().zip(row) {
                *sum += *g;
            }
        }
        sums
    });
    for sums in sums {
        for (bar, sum) in bar.iter_mut().zip(sums) {
            *bar += sum;
        }
    }
}

/// W̄: each task owns some entries (j, c) of one row of the kernel, for all outputs, and goes through the items in order.
fn filters(x: &In<'_>, y_bar: &[f32], bar: &mut [f32]) {
    let Shape { batch, channels, outputs, kernel: [kh, kw], .. } = x.shape;
    let ([rows, columns], taps) = (x.shape.fitting(), x.shape.taps());
    assert_eq!(bar.len(), outputs * taps, "one gradient per weight");
    let (line, pixels) = (kw * channels, rows * columns);
    let mut tasks = Vec::new();
    for i in 0..kh {
        tasks.extend((0..line).step_by(TAPS).map(|from| (i, from..order::min(from + TAPS, line))));
    }
    let start = &*bar;
    let sums = par::map_each(tasks, |_, (i, part)| {
        let (n, first) = (part.len(), i * line + part.start);
        // (part, O): the transpose of what the caller holds
        let mut sums = vec![0.0; n * outputs];
        for (k, row) in sums.chunks_exact_mut(outputs).enumerate() {
            for (o, sum) in row.iter_mut().enumerate() {
                *sum = start[o * taps + first + k];
            }
        }
        let mut patches = sized(PATCHES.take(), pixels * n);
        for b in 0..batch {
            for (pixel, into) in patches[..pixels * n].chunks_exact_mut(n).enumerate() {
                gather(x, [b, pixel / columns, pixel % columns], i, &part, into);
            }
            let cotangent = View::new(&y_bar[b * pixels * outputs..][..pixels * outputs], pixels, outputs);
            gemm(View::new(&patches[..pixels * n], pixels, n).t(), cotangent, Finish::Add, &mut sums);
        }
        PATCHES.set(patches);
        (first, sums)
    });
    for (first, sums) in sums {
        for (k, row) in sums.chunks_exact(outputs).enumerate() {
            for (o, sum) in row.iter().enumerate() {
                bar[o * taps + first + k] = *sum;
            }
        }
    }
}

/// The taps that pixels of one class see: those with i ≡ `phase[0]`, j ≡ `phase[1]` (mod s).
struct Class {
    phase: [usize; 2],
    /// number of such i and j
    count: [usize; 2],
    /// (count·O, C), rows in the order (i, j, o)
    weight: Packed,
}

fn classes(x: &In<'_>) -> Vec<Class> {
    let Shape { channels, outputs, kernel: [kh, kw], stride, .. } = x.shape;
    let mut classes = Vec::new();
    for phase in (0..stride * stride).map(|k| [k / stride, k % stride]) {
        let [is, js] = [(phase[0]..kh).step_by(stride), (phase[1]..kw).step_by(stride)];
        let count = [is.len(), js.len()];
        if count[0] * count[1] == 0 {
            continue; // no output reads these pixels
        }
        let mut rows = Vec::with_capacity(count[0] * count[1] * outputs * channels);
        for i in is {
            for j in js.clone() {
                for o in 0..outputs {
                    rows.extend_from_slice(&x.weight[((o * kh + i) * kw + j) * channels..][..channels]);
                }
            }
        }
        let weight = Packed::new(View::new(&rows, count[0] * count[1] * outputs, channels));
        classes.push(Class { phase, count, weight });
    }
    classes
}

/// x̄: each task owns some rows of pixels, class by class.
fn picture(x: &In<'_>, y_bar: &[f32], bar: &mut [f32]) {
    let Shape { height, width, channels, outputs, stride, pad, .. } = x.shape;
    assert_eq!(bar.len(), x.x.len(), "one gradient per value of x");
    if bar.is_empty() {
        return;
    }
    let [rows, columns] = x.shape.fitting();
    let classes = classes(x);
    let lines = order::max(1, STRIP * stride * stride / width);
    par::chunks_mut(bar, lines * width * channels, |chunk, bar| {
        let (mut patches, mut products) = (PATCHES.take(), PRODUCTS.take());
        for class in &classes {
            let k = class.count[0] * class.count[1] * outputs;
            let mine = |size: usize, phase: usize| (0..size).filter(move |h| (h + pad) % stride == phase);
            // Pixels of this class among the rows of this task.
            let owned = (0..bar.len() / (width * channels))
                .filter(|line| ((chunk * lines + line) % height + pad) % stride == class.phase[0]);
            let mut pixels = 0;
            let owned: Vec<usize> = owned.collect();
            for line in &owned {
                let (b, h) = ((chunk * lines + line) / height, (chunk * lines + line) % height);
                for w in mine(width, class.phase[1]) {
                    patches = sized(patches, (pixels + 1) * k);
                    let patch = &mut patches[pixels * k..][..k];
                    // The output that sees this pixel by the first tap of the class; each further tap is one output back.
                    let [top, left] = [(h + pad) / stride, (w + pad) / stride];
                    for (tap, into) in patch.chunks_exact_mut(outputs).enumerate() {
                        let [i, j] = [tap / class.count[1], tap % class.count[1]];
                        let r = top.checked_sub(i).filter(|&r| r < rows);
                        let q = left.checked_sub(j).filter(|&q| q < columns);
                        match (r, q) {
                            (Some(r), Some(q)) => into.copy_from_slice(
                                &y_bar[((b * rows + r) * columns + q) * outputs..][..outputs],
                            ),
                            _ => into.fill(0.0),
                        }
                    }
                    pixels += 1;
                }
            }
            products = sized(products, pixels * channels);
            let product = &mut products[..pixels * channels];
            gemm_packed(View::new(&patches[..pixels * k], pixels, k), &class.weight, Finish::Store, product);
            let mut from = product.chunks_exact(channels);
            for line in &owned {
                for (w, product) in mine(width, class.phase[1]).zip(&mut from) {
                    let to = &mut bar[(line * width + w) * channels..][..channels];
                    for (to, p) in to.iter_mut().zip(product) {
                        *to += *p;
                    }
                }
            }
        }
        PATCHES.set(patches);
        PRODUCTS.set(products);
    });
}
