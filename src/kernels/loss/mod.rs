//! Losses between two images or two point sets, one file per loss, and metrics without adjoints. Level 6.
//!
//! ```text
//! l1      mean |x − y|            mse     mean (x − y)²
//! ssim    mean structural similarity, 11×11 Gaussian window
//! points  weighted squared distances of points, in order or to the nearest
//! groups  losses of image groups that share an intervention
//! latent  distance between the factors of two images
//! prior   regularisation of Gaussians that no camera observes
//! presence  mean opacity and mean size of Gaussians
//! eikonal deviation of gradients of a signed distance from unit length
//! variation  squared differences of neighbouring texels
//! albedo  squared differences of albedo after a scale of the linear values
//! lpips   learned perceptual distance, with user-supplied weights
//! metric  PSNR, SSIM and MAE in f64, every variant named; evaluation of causal structures
//! ```
//!
//! Image losses expect sRGB-encoded images (H, W, 3) and an optional mask (H, W) of zeros and ones; `mse`
//! accepts any number of channels.
//!
//! `fit` records `l1` and `ssim` on the tape: their inputs are the render and the input image, the output is
//! one number, and the adjoint returns one gradient per pixel. `fit::evaluate` calls `metric` with renders
//! clamped to 0..1.
//!
//! # Rounding
//! Sums over pixels: per row, logical lane l of 16 adds the terms i ≡ l (mod 16) in f64 with i ascending, the
//! lanes fold 16→8→4→2→1 (l += l + w), and the rows are added by the pairwise tree. One division follows. A
//! value therefore depends neither on the number of threads nor on the vector width.

use crate::num::{par, sum};
use crate::{Error, Result};

pub mod albedo;
pub mod eikonal;
pub mod groups;
pub mod l1;
pub mod latent;
pub mod lpips;
pub mod metric;
pub mod mse;
pub mod points;
pub mod presence;
pub mod prior;
pub mod ssim;
pub mod variation;

/// Two images and an optional mask of the pixels that count.
///
/// | field | shape | range |
/// |---|---|---|
/// | `x` | (H, W, 3); (H, W, C) for `mse` | sRGB-encoded; 0..1 is usual, not required |
/// | `y` | as `x` | the same |
/// | `mask` | (H, W) | exactly 0 (excluded) or 1 (kept) |
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Image x, shape (H, W, 3), usually the render.
    pub x: &'a [f32],
    /// Image y, shape (H, W, 3), usually the input image.
    pub y: &'a [f32],
    /// Mask of the kept pixels, shape (H, W); `None` keeps every pixel.
    pub mask: Option<&'a [f32]>,
    /// Height H in pixels.
    pub height: usize,
    /// Width W in pixels.
    pub width: usize,
}

/// Number of channels of an image.
pub(crate) const CHANNELS: usize = 3;

impl In<'_> {
    /// Returns the number of channels of the first image.
    pub(crate) fn channels(&self) -> usize {
        self.x.len().checked_div(self.height * self.width).unwrap_or(CHANNELS)
    }

    /// Returns the number of values in one row.
    pub(crate) fn row(&self) -> usize {
        self.channels() * self.width
    }

    /// Checks the sizes and the mask of three-channel images; returns the number of kept pixels, at least 1.
    pub(crate) fn check(&self, what: &str) -> Result<usize> {
        self.check_channels(what, CHANNELS)
    }

    /// Like [`Self::check`], for another number of channels.
    pub(crate) fn check_channels(&self, what: &str, channels: usize) -> Result<usize> {
        match self.count_kept(what, channels)? {
            0 => Err(Error::input(what)
                .expected("at least one kept pixel")
                .got("none")
                .hint("the mean over zero pixels is undefined")),
            kept => Ok(kept),
        }
    }

    /// Checks the sizes and the mask; returns the number of kept pixels.
    pub(crate) fn count_kept(&self, what: &str, channels: usize) -> Result<usize> {
        let pixels = self.height * self.width;
        for (name, len) in [("x", self.x.len()), ("y", self.y.len())] {
            if channels == 0 || len != channels * pixels {
                return Err(Error::input(what)
                    .at(format!("array '{name}'"))
                    .expected(format!("{}x{}x{channels} values", self.height, self.width))
                    .got(len.to_string()));
            }
        }
        let kept = match self.mask {
            None => pixels,
            Some(mask) => {
                if mask.len() != pixels {
                    return Err(Error::input(what)
                        .at("array 'mask'")
                        .expected(format!("{}x{} values", self.height, self.width))
                        .got(mask.len().to_string()));
                }
                let mut kept = 0;
                for (i, &m) in mask.iter().enumerate() {
                    if !(m == 0.0 || m == 1.0) {
                        return Err(Error::input(what)
                            .at(format!("array 'mask', index [{}, {}]", i / self.width, i % self.width))
                            .expected("0 or 1")
                            .got(m.to_string())
                            .hint("convert a soft mask to 0 and 1 with a threshold"));
                    }
                    kept += usize::from(m == 1.0);
                }
                kept
            }
        };
        Ok(kept)
    }

    /// Returns row `r` of the mask, if there is one.
    pub(crate) fn mask_row(&self, r: usize) -> Option<&[f32]> {
        self.mask.map(|m| &m[r * self.width..][..self.width])
    }
}

/// Checks that a gradient buffer has the size of its image.
pub(crate) fn assert_like(bar: &[f32], image: &[f32]) {
    assert_eq!(bar.len(), image.len(), "a gradient has the shape of its input");
}

/// Refuses a value that is not finite, which means that the images contain NaN, infinities or extreme
/// magnitudes.
pub(crate) fn finite(what: &str, value: f64) -> Result<f64> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Error::input(what).expected("finite images").got(format!("value {value}")))
    }
}

/// Returns the sum of one row of terms: 16 logical lanes in f64, folded 16→8→4→2→1.
#[inline]
pub(crate) fn row_sum(n: usize, term: impl Fn(usize) -> f64) -> f64 {
    let mut lanes = [0.0f64; 16];
    let whole = n / 16 * 16;
    for i in (0..whole).step_by(16) {
        for (l, lane) in lanes.iter_mut().enumerate() {
            *lane += term(i + l);
        }
    }
    for i in whole..n {
        lanes[i - whole] += term(i);
    }
    fold_lanes(lanes)
}

/// Returns [`row_sum`] of `term(a, b)` over two rows, in a form that compiles to vector code.
#[inline]
fn pair_sum(a: &[f32], b: &[f32], term: impl Fn(f32, f32) -> f64) -> f64 {
    let mut lanes = [0.0f64; 16];
    let (a, b) = (a.chunks_exact(16), b.chunks_exact(16));
    let (tail_a, tail_b) = (a.remainder(), b.remainder());
    for (a, b) in a.zip(b) {
        for l in 0..16 {
            lanes[l] += term(a[l], b[l]);
        }
    }
    for (lane, (&a, &b)) in lanes.iter_mut().zip(tail_a.iter().zip(tail_b)) {
        *lane += term(a, b);
    }
    fold_lanes(lanes)
}

/// Folds lanes 16→8→4→2→1, l += l + w.
fn fold_lanes(mut lanes: [f64; 16]) -> f64 {
    let mut width = 8;
    while width > 0 {
        for l in 0..width {
            lanes[l] += lanes[l + width];
        }
        width /= 2;
    }
    lanes[0]
}

/// Returns the sum of `term(x, y)` over all kept values; excluded values count as +0.
pub(crate) fn image_sum(x: &In<'_>, term: impl Fn(f32, f32) -> f64 + Sync + Send) -> f64 {
    let (n, channels) = (x.row(), x.channels());
    let rows = par::map_batched(x.height, 8, |r| {
        let (a, b) = (&x.x[r * n..][..n], &x.y[r * n..][..n]);
        match x.mask_row(r) {
            None => pair_sum(a, b, &term),
            Some(mask) => row_sum(n, |i| if mask[i / channels] == 0.0 { 0.0 } else { term(a[i], b[i]) }),
        }
    });
    sum::tree_f64(&rows)
}

/// Computes `bar += term(x, y)` on kept values, row by row.
pub(crate) fn add_rows(x: &In<'_>, bar: &mut [f32], term: impl Fn(f32, f32) -> f32 + Sync + Send) {
    let (n, channels) = (x.row(), x.channels());
    par::chunks_mut(bar, Ord::max(n, 1), |r, row| {
        let (a, b) = (&x.x[r * n..][..n], &x.y[r * n..][..n]);
        match x.mask_row(r) {
            None => {
                for (bar, (&a, &b)) in row.iter_mut().zip(a.iter().zip(b)) {
                    *bar += term(a, b);
                }
            }
            Some(mask) => {
                for i in 0..n {
                    row[i] += if mask[i / channels] == 0.0 { 0.0 } else { term(a[i], b[i]) };
                }
            }
        }
    });
}
