//! `RFD`, a distance of responses to random filters, in f64. **It is not LPIPS**: nothing in it is trained on
//! images or human judgements.
//!
//! It serves as a surrogate for a perceptual distance if no trained weights are available: it responds to
//! edges, orientation and texture at three scales, and tolerates a change of contrast, which a mean squared
//! error does not.
//!
//! RFD = 1000 · (1/3) Σ_s (1/|P_s|) Σ_{p ∈ P_s} ‖ρ(r_s(x, p)) − ρ(r_s(y, p))‖²,   ρ(r) = r / √(‖r‖² + ε²)
//!
//! | symbol | meaning |
//! |---|---|
//! | r_s(x, p) | (32) responses at pixel p of scale s: the sum of 7×7×3 products around p; pixels outside are 0 |
//! | s | 0: the image; 1, 2: halved by the mean of 2×2 pixels; an odd last row or column is omitted |
//! | weights | normal numbers divided by √147, one set for all scales: seed 7, item (filter·49 + tap)·3 + channel, tap = 7·row + column |
//! | ε | [`FLOOR`]: responses as small as those to sensor noise in black have little influence |
//! | P_s | the kept pixels; at a coarser scale, pixels with at least one kept pixel among their four |
//!
//! With a mask, both images are multiplied by it first. The value is 0 for equal images and at most 4000.
//!
//! # Rounding
//! A response is a left fold over the taps in the order row, column, channel, from +0; the norm and the
//! distance are left folds over the filters. Per row 16 logical lanes, tree over rows, one division per
//! scale; scales from fine to coarse.

use crate::loss::{CHANNELS, In, finite, metric::clamped, row_sum};
use crate::num::rng::Rng;
use crate::num::{par, sum};
use crate::{Error, Result};

/// Name of the metric, which states what it is not.
pub const NAME: &str = "RFD (not LPIPS)";
/// ε: responses to white have a norm of about √32 ≈ 5.7, those to one step of an 8-bit image about 0.02.
pub const FLOOR: f64 = 0.1;
/// Filters per scale.
pub const FILTERS: usize = 32;
/// Number of scales.
pub const SCALES: usize = 3;

const SIDE: usize = 7;
const TAPS: usize = SIDE * SIDE * CHANNELS;
const SEED: u64 = 7;
/// Purpose of the draws of the filters; item: (filter·49 + tap)·3 + channel.
const FILTER: u16 = 0x0900;

/// Returns the filters as (tap, channel, filter): filters are innermost, so that the fold over taps processes
/// all of them at once.
fn filters() -> Vec<[f64; FILTERS]> {
    let rng = Rng::new(SEED);
    let scale = (TAPS as f64).sqrt();
    let weight = |at: usize, filter: usize| rng.normal_f64((filter * TAPS + at) as u64, 0, FILTER, 0) / scale;
    (0..TAPS).map(|at| std::array::from_fn(|filter| weight(at, filter))).collect()
}

/// One image at one scale.
struct Level {
    /// Shape (H, W, 3).
    values: Vec<f64>,
    height: usize,
    width: usize,
}

impl Level {
    fn halved(&self) -> Self {
        let (height, width) = (self.height / 2, self.width / 2);
        let at = |r: usize, c: usize, ch: usize| self.values[(r * self.width + c) * CHANNELS + ch];
        let mut values = Vec::with_capacity(height * width * CHANNELS);
        for r in 0..height {
            for c in 0..width {
                for ch in 0..CHANNELS {
                    let [top, bottom] =
                        [2 * r, 2 * r + 1].map(|row| at(row, 2 * c, ch) + at(row, 2 * c + 1, ch));
                    values.push(0.25 * (top + bottom));
                }
            }
        }
        Self { values, height, width }
    }

    /// Returns ρ of the responses at a pixel.
    fn response(&self, weights: &[[f64; FILTERS]], r: usize, c: usize) -> [f64; FILTERS] {
        let mut sums = [0.0; FILTERS];
        for i in 0..SIDE {
            let Some(row) = (r + i).checked_sub(SIDE / 2).filter(|&row| row < self.height) else { continue };
            for j in 0..SIDE {
                let Some(column) = (c + j).checked_sub(SIDE / 2).filter(|&column| column < self.width) else {
                    continue;
                };
                let pixel = &self.values[(row * self.width + column) * CHANNELS..][..CHANNELS];
                for (value, weights) in pixel.iter().zip(&weights[(i * SIDE + j) * CHANNELS..][..CHANNELS]) {
                    for (sum, weight) in sums.iter_mut().zip(weights) {
                        *sum += value * weight;
                    }
                }
            }
        }
        let norm = (sums.iter().fold(0.0, |n, s| n + s * s) + FLOOR * FLOOR).sqrt();
        sums.map(|s| s / norm)
    }
}

/// Returns the distance, times 1000.
///
/// # Errors
/// Returns an error for wrong sizes, a mask value other than 0 and 1, a scale without kept pixels, or images
/// smaller than 4×4 or not finite.
pub fn forward(x: &In<'_>) -> Result<f64> {
    const WHAT: &str = "metric.rfd";
    x.check(WHAT)?;
    if x.height < 4 || x.width < 4 {
        return Err(Error::input(WHAT)
            .expected("images of at least 4x4 pixels")
            .got(format!("{}x{}", x.height, x.width)));
    }
    let weights = filters();
    let mut kept: Vec<bool> = match x.mask {
        Some(mask) => mask.iter().map(|&m| m == 1.0).collect(),
        None => vec![true; x.height * x.width],
    };
    let image = |value: &dyn Fn(usize) -> f64| Level {
        values: (0..x.row() * x.height).map(|i| if kept[i / CHANNELS] { value(i) } else { 0.0 }).collect(),
        height: x.height,
        width: x.width,
    };
    let [mut a, mut b] = [image(&|i| clamped(x.x[i])), image(&|i| f64::from(x.y[i]))];
    let mut total = 0.0;
    for scale in 0..SCALES {
        if scale > 0 {
            let wide = a.width;
            (a, b) = (a.halved(), b.halved());
            let any = |p: usize| {
                let first = 2 * (p / a.width) * wide + 2 * (p % a.width);
                kept[first] || kept[first + 1] || kept[first + wide] || kept[first + wide + 1]
            };
            kept = (0..a.height * a.width).map(any).collect();
        }
        let count = kept.iter().filter(|&&k| k).count();
        if count == 0 {
            return Err(Error::input(WHAT).expected("at least one kept pixel at every scale").got("none"));
        }
        let rows = par::map_batched(a.height, 2, |r| {
            row_sum(a.width, |c| {
                if !kept[r * a.width + c] {
                    return 0.0;
                }
                let (u, v) = (a.response(&weights, r, c), b.response(&weights, r, c));
                u.iter().zip(&v).fold(0.0, |sum, (u, v)| sum + (u - v) * (u - v))
            })
        });
        total += finite(WHAT, sum::tree_f64(&rows))? / count as f64;
    }
    Ok(1000.0 * total / SCALES as f64)
}
