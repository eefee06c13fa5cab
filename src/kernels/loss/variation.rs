//! `loss.variation`: squared differences of neighbouring texels.
//!
//! value = (1/N) Σ [(x[p, i+1, j, c] − x[p, i, j, c])² + (x[p, i, j+1, c] − x[p, i, j, c])²]
//!
//! (the squared total variation of Rudin, Osher and Fatemi 1992, as used for feature planes by K-Planes,
//! Fridovich-Keil et al. 2023)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | x | `planes` | (P, H, W, C) | |
//! | N | number of entries P·H·W·C | () | > 0 |
//! | | `value` | () | |
//!
//! The sum is over pairs of texels inside a plane. With `columns` = `periodic` column W − 1 is also a neighbour of
//! column 0, as in a latitude–longitude map; with `open` it is not.
//!
//! # Rounding
//! Differences in f32, squared in f64; each entry adds the pair below it, then the pair to its right; entries are
//! summed in 16 lanes.
//!
//! # Kinks and domain
//! Smooth. At least one entry. With W = 1, `periodic` adds only zeros.
//!
//! # Adjoint
//! x̄ += (2v̄/N)·(((x − up) + (x − down)) + ((x − left) + (x − right))), each difference in f32 and 0 where there is no
//! neighbour. Nothing is saved.
//!
//! Twin: `reference::loss::variation`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::variation::{Columns, In, forward};
//! let x = In { planes: &[0.0, 1.0, 0.0, 3.0], shape: [1, 2, 2, 1], columns: Columns::Open };
//! assert_eq!(forward(&x), (0.0 + 4.0 + 1.0 + 9.0) / 4.0);
//! ```

use crate::num::{par, sum};

/// Whether the last column is a neighbour of the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Columns {
    /// It is not.
    #[default]
    Open,
    /// It is.
    Periodic,
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (P, H, W, C).
    pub planes: &'a [f32],
    /// P, H, W, C.
    pub shape: [usize; 4],
    /// Neighbours of the outermost columns.
    pub columns: Columns,
}

impl In<'_> {
    fn check(&self) {
        let [p, h, w, c] = self.shape;
        assert!(p * h * w * c == self.planes.len() && !self.planes.is_empty(), "values like the shape");
    }

    /// Returns the entries above, below, left and right of entry `i`; `None` where there is none.
    #[inline(always)]
    fn neighbours(&self, i: usize) -> [Option<usize>; 4] {
        let [_, h, w, c] = self.shape;
        let (column, row) = (i / c % w, i / (c * w) % h);
        let line = (w - 1) * c;
        let wraps = self.columns == Columns::Periodic;
        let left = if column > 0 { Some(i - c) } else { wraps.then_some(i + line) };
        let right = if column + 1 < w { Some(i + c) } else { wraps.then(|| i - line) };
        [(row > 0).then(|| i - w * c), (row + 1 < h).then(|| i + w * c), left, right]
    }
}

/// Returns the value.
///
/// # Panics
/// Panics if the values do not have the shape, or there are none.
pub fn forward(x: &In<'_>) -> f32 {
    x.check();
    let total = sum::sum16_f64_by(x.planes.len(), |i| {
        let [_, down, _, right] = x.neighbours(i);
        let square = |at: Option<usize>| {
            let d = at.map_or(0.0, |at| f64::from(x.planes[at] - x.planes[i]));
            d * d
        };
        square(down) + square(right)
    });
    (total / x.planes.len() as f64) as f32
}

/// Adds the gradient to `planes_bar` (P, H, W, C).
///
/// # Panics
/// Panics under the conditions of [`forward`].
pub fn adjoint(x: &In<'_>, value_bar: f32, planes_bar: &mut [f32]) {
    x.check();
    assert_eq!(planes_bar.len(), x.planes.len(), "the gradient has the shape of the planes");
    let scale = (2.0 * f64::from(value_bar) / x.planes.len() as f64) as f32;
    let row = x.shape[2] * x.shape[3];
    par::chunks_mut(planes_bar, row, |r, bars| {
        for (k, bar) in bars.iter_mut().enumerate() {
            let i = r * row + k;
            let d = x.neighbours(i).map(|at| at.map_or(0.0, |at| x.planes[i] - x.planes[at]));
            *bar += scale * ((d[0] + d[1]) + (d[2] + d[3]));
        }
    });
}
