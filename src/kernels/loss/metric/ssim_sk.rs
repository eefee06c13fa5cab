//! Structural similarity under a uniform window, `SSIM-sk`, in f64: scikit-image's `structural_similarity`
//! with its defaults.
//!
//! SSIM = (2μ_xμ_y + C₁)(2σ_xy + C₂) / ((μ_x² + μ_y² + C₁)(σ_x² + σ_y² + C₂)),
//! C₁ = (0.01 R)²,  C₂ = (0.03 R)²
//!
//! with moments over windows of 7×7 pixels of equal weight, and σ² and σ_xy divided by 48 instead of 49 (the
//! sample covariance). The map is averaged over the pixels whose complete window is inside the image, and
//! over the channels.
//!
//! R is the range of values. It is 1 for images in 0..1. Versions of scikit-image before 0.20 assume 2 for
//! arrays of floats by default, which multiplies C₁ and C₂ by four and increases the value: published numbers
//! may be `SSIM-sk-range2`. Both variants exist here, under separate names.
//!
//! With a mask, both images are multiplied by it, and the map is averaged over the kept pixels only.
//!
//! # Rounding
//! Sums of the five products x, y, x², y², xy over a window: down the columns a left fold of seven rows from
//! the top, then along the row a left fold of seven columns, then a division by 49. Per row 16 logical lanes,
//! tree over rows, one division.

use crate::loss::{CHANNELS, In, finite, metric::clamped, row_sum};
use crate::num::{par, sum};
use crate::{Error, Result};

/// Name of the variant with range 1.
pub const NAME: &str = "SSIM-sk";
/// Name of the variant with range 1 on a [`super::Crop`].
pub const NAME_BOX: &str = "SSIM-sk-box";
/// Name of the variant with range 2.
pub const NAME_RANGE_2: &str = "SSIM-sk-range2";

/// Side of the window.
pub const SIDE: usize = 7;
/// Pixels of the window.
const AREA: f64 = (SIDE * SIDE) as f64;
/// Number of pixels at each border whose window extends beyond the image.
const BORDER: usize = SIDE / 2;

/// Returns the mean structural similarity for a range of values of 1 (or 2, see above).
///
/// # Errors
/// Returns an error for wrong sizes, a mask value other than 0 and 1, images smaller than the window, a mask
/// that keeps no pixel at least 3 from the border, images that are not finite, or a range that is not
/// positive.
pub fn forward(x: &In<'_>, range: f64) -> Result<f64> {
    const WHAT: &str = "metric.ssim_sk";
    x.check(WHAT)?;
    if !(range > 0.0 && range.is_finite()) {
        return Err(Error::input(WHAT).at("range").expected("a positive number").got(range.to_string()));
    }
    let (width, height, n) = (x.width, x.height, x.row());
    if width < SIDE || height < SIDE {
        return Err(Error::input(WHAT)
            .expected(format!("images of at least {SIDE}x{SIDE} pixels"))
            .got(format!("{height}x{width}")));
    }
    let keep = |r: usize, c: usize| x.mask.is_none_or(|m| m[r * width + c] == 1.0);
    let inner = |size: usize| BORDER..size - BORDER;
    let kept = inner(height).flat_map(|r| inner(width).map(move |c| (r, c))).filter(|&(r, c)| keep(r, c));
    let kept = kept.count();
    if kept == 0 {
        return Err(Error::input(WHAT)
            .expected(format!("a kept pixel at least {BORDER} pixels from the border"))
            .got("none"));
    }
    let [c1, c2] = [0.01, 0.03].map(|k: f64| (k * range) * (k * range));
    let rows = par::map_batched(height - 2 * BORDER, 4, |row| {
        let mut lines = vec![[0.0f64; 5]; n];
        for r in row..row + SIDE {
            for (i, e) in lines.iter_mut().enumerate() {
                let m = if keep(r, i / CHANNELS) { 1.0 } else { 0.0 };
                let (a, b) = (clamped(x.x[r * n + i]) * m, f64::from(x.y[r * n + i]) * m);
                for (e, term) in e.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                    *e += term;
                }
            }
        }
        row_sum((width - 2 * BORDER) * CHANNELS, |i| {
            if !keep(row + BORDER, i / CHANNELS + BORDER) {
                return 0.0;
            }
            let mut e = [0.0f64; 5];
            for k in 0..SIDE {
                for (e, line) in e.iter_mut().zip(&lines[i + CHANNELS * k]) {
                    *e += line;
                }
            }
            let [a, b, aa, bb, ab] = e.map(|e| e / AREA);
            let unbiased = AREA / (AREA - 1.0);
            let var_a = unbiased * (aa - a * a);
            let var_b = unbiased * (bb - b * b);
            let cov = unbiased * (ab - a * b);
            let l = (2.0 * (a * b) + c1) / ((a * a + b * b) + c1);
            let c = (2.0 * cov + c2) / ((var_a + var_b) + c2);
            l * c
        })
    });
    Ok(finite(WHAT, sum::tree_f64(&rows))? / (CHANNELS * kept) as f64)
}
