//! `nn.window`: a square of an image, resampled to S×S pixels by area averaging.
//!
//! y(r, c) = Σ over pixels of v(r, row) · h(c, column) · x(row, column)
//!
//! h(c, j) = (S/a) · |\[l + c·a/S, l + (c + 1)·a/S\] ∩ \[j, j + 1\]|,   v likewise from t
//!
//! Pixels are squares of constant colour, and the image is surrounded by black; each value of the window is
//! the mean over its cell. LAST crops its input with it (chapter *Learned causes*, "The model").
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `image` | (H, W, 3) | any |
//! | l, t | `corner` | (2) | left and top, pixels; may be outside the image |
//! | a | `length` | () | side of the square, pixels, > 0 |
//! | S | `side` | () | pixels of a side of the window, ≥ 1 |
//! | y | `window` | (S, S, 3) | |
//!
//! # Rounding
//! Weights are computed in f64 and rounded once to f32. The rows come first: a left fold over the rows of
//! v·x, then over the columns of h times the result; the adjoint has the opposite order.
//!
//! # Kinks and domain
//! The function is linear in x; the square is a constant. A square that overlaps no pixel gives zeros.
//!
//! # Adjoint
//! x̄ += vᵀ ȳ h, the transpose ([`Window::spread`]).
//!
//! Twin: `reference::nn::window`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::window::Window;
//! let window = Window::new(1, [1, 2], [0.5, 0.0], 1.0); // half of each of two pixels
//! assert_eq!(window.take(&[1.0, 0.0, 4.0, 3.0, 2.0, 0.0]), [2.0, 1.0, 2.0]);
//! ```

use crate::num::order;

/// A square of an image (H, W, 3), resampled to S×S pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    side: usize,
    width: usize,
    height: usize,
    /// Rows of each cell with their weights, shape (S).
    rows: Vec<Vec<(usize, f32)>>,
    /// Columns of each cell with their weights, shape (S).
    columns: Vec<Vec<(usize, f32)>>,
}

/// Returns, for each of `side` cells of an interval, the overlapping pixels of `count` and the fraction of
/// the cell that they cover.
fn cells(start: f64, length: f64, side: usize, count: usize) -> Vec<Vec<(usize, f32)>> {
    let cell = length / side as f64;
    (0..side)
        .map(|i| {
            let (from, to) = (start + i as f64 * cell, start + (i + 1) as f64 * cell);
            let first = order::max(from.floor(), 0.0) as usize;
            let last = Ord::min(count, order::max(to.ceil(), 0.0) as usize);
            let share = |p: usize| (order::min(to, (p + 1) as f64) - order::max(from, p as f64)) / cell;
            (first..last).map(|p| (p, share(p) as f32)).filter(|(_, w)| *w > 0.0).collect()
        })
        .collect()
}

impl Window {
    /// Creates the window of `side`×`side` pixels for images (H, W) from the square with the corner (left,
    /// top) and a side of `length` pixels.
    pub fn new(side: usize, [height, width]: [usize; 2], [left, top]: [f64; 2], length: f64) -> Self {
        let (rows, columns) = (cells(top, length, side, height), cells(left, length, side, width));
        Self { side, width, height, rows, columns }
    }

    /// Returns the window (S, S, 3) of an image (H, W, 3).
    ///
    /// # Panics
    /// Panics if the image has a different size.
    pub fn take(&self, image: &[f32]) -> Vec<f32> {
        assert_eq!(
            image.len(),
            self.height * self.width * 3,
            "the image has the size for which the window was created"
        );
        let mut out = vec![0.0; self.side * self.side * 3];
        let mut line = vec![0.0; self.width * 3];
        for (row, out) in self.rows.iter().zip(out.chunks_exact_mut(self.side * 3)) {
            line.fill(0.0);
            for &(r, v) in row {
                let image = &image[r * self.width * 3..][..self.width * 3];
                line.iter_mut().zip(image).for_each(|(l, x)| *l += v * x);
            }
            for (column, pixel) in self.columns.iter().zip(out.as_chunks_mut::<3>().0) {
                for &(c, h) in column {
                    (0..3).for_each(|k| pixel[k] += h * line[3 * c + k]);
                }
            }
        }
        out
    }

    /// Adds the gradient for the cotangent `bar` (S, S, 3) of [`Self::take`] to `image_bar` (H, W, 3).
    ///
    /// # Panics
    /// Panics if a buffer does not have the size of its shape.
    pub fn spread(&self, bar: &[f32], image_bar: &mut [f32]) {
        assert_eq!(bar.len(), self.side * self.side * 3, "the cotangent is (S, S, 3)");
        assert_eq!(image_bar.len(), self.height * self.width * 3, "the gradient has the size of the image");
        let mut line = vec![0.0; self.width * 3];
        for (row, bar) in self.rows.iter().zip(bar.chunks_exact(self.side * 3)) {
            line.fill(0.0);
            for (column, pixel) in self.columns.iter().zip(bar.as_chunks::<3>().0) {
                for &(c, h) in column {
                    (0..3).for_each(|k| line[3 * c + k] += h * pixel[k]);
                }
            }
            for &(r, v) in row {
                let out = &mut image_bar[r * self.width * 3..][..self.width * 3];
                out.iter_mut().zip(&line).for_each(|(o, l)| *o += v * l);
            }
        }
    }
}
