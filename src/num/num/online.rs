//! Rows of a softmax that is computed block by block with a running maximum, and of its adjoint.
//!
//! Per row, with the maximum m and the sum l of the blocks so far, a block of logits x gives
//!
//! m' = max(m, x),   c = e^(m − m'),   p = e^(x − m'),   l' = l·c + Σp
//!
//! # Rounding
//! A logit is a number times a factor, e is [`exp_lanes`], Σ the sum over 16 lanes of [`mod@super::sum`]; each operation is rounded. A block
//! has at most 4096 columns.
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::num::online::Rows;
//! let mut rows = Rows::new(1);
//! let (mut first, mut second) = ([1.0, 1.0], [1.0, 1.0]);
//! rows.block(&mut first, 2, 1.0);
//! rows.block(&mut second, 2, 1.0);
//! assert_eq!((second, rows.most[0], rows.total[0]), ([1.0, 1.0], 1.0, 4.0)); // e^(1 − 1) each
//! ```

use super::elem::exp_lanes;
use super::lanes::{Real, f32x8};
use super::order;
use super::registers::{Loops, widest};

const LANES: usize = 16;

/// Replaces the first of two numbers, for each of sixteen pairs, or changes both.
trait Step {
    fn at<L: Real>(x: L, y: L, with: [L; 4]) -> [L; 2];
}

/// One by one where the compiler has registers for sixteen numbers, else eight at a time.
#[inline(always)]
fn each<const WIDE: bool, S: Step>(x: &mut [f32; LANES], y: &mut [f32; LANES], with: [f32; 4]) {
    if WIDE {
        for (x, y) in x.iter_mut().zip(y) {
            [*x, *y] = S::at(*x, *y, with);
        }
        return;
    }
    let ((x8, _), (y8, _)) = (x.as_chunks_mut::<8>(), y.as_chunks_mut::<8>());
    for (x, y) in x8.iter_mut().zip(y8) {
        [*x, *y] = S::at(f32x8::new(*x), f32x8::new(*y), with.map(f32x8::splat)).map(f32x8::to_array);
    }
}

/// Folds 16 lanes → 8 → 4 → 2 → 1.
#[inline(always)]
fn folded(mut lanes: [f32; LANES], f: impl Fn(f32, f32) -> f32) -> f32 {
    let mut w = LANES / 2;
    while w > 0 {
        for l in 0..w {
            lanes[l] = f(lanes[l], lanes[l + w]);
        }
        w /= 2;
    }
    lanes[0]
}

/// e^(x − m), added to a sum.
struct Exponential;

impl Step for Exponential {
    #[inline(always)]
    fn at<L: Real>(x: L, sum: L, [most, ..]: [L; 4]) -> [L; 2] {
        let p = exp_lanes(x - most);
        [p, sum + p]
    }
}

/// The rows of a softmax after some blocks.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    /// m of every row.
    pub most: Vec<f32>,
    /// l of every row.
    pub total: Vec<f32>,
    /// c of every row: what was added up before the last block counts this many times.
    pub factor: Vec<f32>,
    /// Sums of the last block, by lanes.
    sums: Vec<[f32; LANES]>,
}

impl Rows {
    /// Returns n rows before the first block: m = −∞, l = 0.
    pub fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self {
            most: vec![f32::NEG_INFINITY; n],
            total: zeros(),
            factor: zeros(),
            sums: vec![[0.0; LANES]; n],
        }
    }

    /// Replaces the numbers x (rows, width) by p, where x·factor are the logits; updates m, l and c.
    ///
    /// # Panics
    /// Panics if x does not have `width` numbers per row, or more than 4096.
    pub fn block(&mut self, x: &mut [f32], width: usize, factor: f32) {
        assert!(
            x.len() == self.most.len() * width && width <= super::sum::CHUNK,
            "rows of at most 4096 numbers"
        );
        widest(Block { x, width, factor, rows: self });
    }
}

struct Block<'a> {
    x: &'a mut [f32],
    width: usize,
    factor: f32,
    rows: &'a mut Rows,
}

impl Loops for Block<'_> {
    #[inline(always)]
    fn run<const WIDE: bool>(self) {
        let Self { x, width, factor, rows } = self;
        // Three loops over the rows, so that those of several rows run at the same time: what folds lanes waits for its own row alone.
        for ((x, most), before) in x.chunks_exact_mut(width).zip(&mut rows.most).zip(&mut rows.factor) {
            let (x16, x1) = x.as_chunks_mut::<LANES>();
            let mut wide = [*most; LANES];
            for x in x16 {
                for (x, most) in x.iter_mut().zip(&mut wide) {
                    *x *= factor;
                    *most = order::max(*most, *x);
                }
            }
            let mut new = folded(wide, order::max);
            for x in x1 {
                *x *= factor;
                new = order::max(new, *x);
            }
            *before = *most - new;
            *most = new;
        }
        for ((x, most), sums) in x.chunks_exact_mut(width).zip(&rows.most).zip(&mut rows.sums) {
            let (x16, x1) = x.as_chunks_mut::<LANES>();
            let mut lanes = [0.0; LANES];
            for x in x16 {
                each::<WIDE, Exponential>(x, &mut lanes, [*most; 4]);
            }
            for (x, sum) in x1.iter_mut().zip(&mut lanes) {
                [*x, *sum] = Exponential::at(*x, *sum, [*most; 4]);
            }
            *sums = lanes;
        }
        let (c16, c1) = rows.factor.as_chunks_mut::<LANES>();
        for c in c16 {
            each::<WIDE, Exponential>(c, &mut [0.0; LANES], [0.0; 4]);
        }
        for c in c1 {
            [*c, _] = Exponential::at(*c, 0.0, [0.0; 4]);
        }
        for ((total, c), sum) in rows.total.iter_mut().zip(&rows.factor).zip(&rows.sums) {
            *total = *total * c + folded(*sum, |a, b| a + b);
        }
    }
}

/// P = e^(x·factor − m)/l, and factor·P·(cotangent of P − their mean).
struct Weight;

impl Step for Weight {
    #[inline(always)]
    fn at<L: Real>(x: L, bar: L, [factor, most, total, mean]: [L; 4]) -> [L; 2] {
        let p = exp_lanes(x * factor - most) / total;
        [p, (p * (bar - mean)) * factor]
    }
}

/// Replaces the numbers x (rows, width) by the weights P = e^(x·factor − m)/l, and their cotangents by those of x: factor·P·(P̄ − μ), with m, l and μ
/// of every row.
///
/// # Panics
/// Panics if the sizes do not fit.
pub fn weights(x: &mut [f32], bars: &mut [f32], width: usize, factor: f32, rows: &[[f32; 3]]) {
    assert!(x.len() == rows.len() * width && bars.len() == x.len(), "as many rows");
    widest(Weights { x, bars, width, factor, rows });
}

struct Weights<'a> {
    x: &'a mut [f32],
    bars: &'a mut [f32],
    width: usize,
    factor: f32,
    rows: &'a [[f32; 3]],
}

impl Loops for Weights<'_> {
    #[inline(always)]
    fn run<const WIDE: bool>(self) {
        let rows = self.x.chunks_exact_mut(self.width).zip(self.bars.chunks_exact_mut(self.width));
        for ((x, bars), [most, total, mean]) in rows.zip(self.rows) {
            let with = [self.factor, *most, *total, *mean];
            let ((x16, x1), (b16, b1)) = (x.as_chunks_mut::<LANES>(), bars.as_chunks_mut::<LANES>());
            for (x, bar) in x16.iter_mut().zip(b16) {
                each::<WIDE, Weight>(x, bar, with);
            }
            for (x, bar) in x1.iter_mut().zip(b1) {
                [*x, *bar] = Weight::at(*x, *bar, with);
            }
        }
    }
}
