//! Structural similarity as a metric, `SSIM-g`, in f64: the definition of [`crate::loss::ssim`] with the
//! render clamped.
//!
//! # Rounding
//! The five filtered images of the textbook form, x, y, x², y², xy, are each filtered down the columns and
//! then along the rows, and every filter is a left fold of its taps; terms outside the image are +0 and are
//! included. One line of sums per row (16 logical lanes), tree over rows, one division.

use crate::Result;
use crate::loss::{
    CHANNELS, In, finite,
    metric::clamped,
    row_sum,
    ssim::{C1, C2, WINDOW},
};
use crate::num::{par, sum};

/// Name of the variant over the full image.
pub const NAME: &str = "SSIM-g";
/// Name of [`forward`] on a [`super::Crop`].
pub const NAME_BOX: &str = "SSIM-g-box";

const TAPS: usize = 11;
const PAD: usize = TAPS / 2 * CHANNELS;

/// Returns D-SSIM × 1000 = 500 (1 − SSIM-g).
pub fn d_ssim_1000(ssim: f64) -> f64 {
    500.0 * (1.0 - ssim)
}

/// Returns the mean structural similarity.
///
/// # Errors
/// Returns an error for wrong sizes, a mask value other than 0 and 1, a mask that keeps no pixel, or images
/// that are not finite.
pub fn forward(x: &In<'_>) -> Result<f64> {
    let count = CHANNELS * x.check("metric.ssim")?;
    let (n, width) = (x.row(), x.width);
    let taps: [f64; TAPS] = std::array::from_fn(|k| WINDOW[if k < 6 { k } else { 10 - k }]);
    let keep = |r: usize, i: usize| x.mask.map_or(1.0, |m| f64::from(m[r * width + i / CHANNELS]));
    let rows = par::map_batched(x.height, 4, |row| {
        let mut lines = vec![[0.0f64; 5]; n + 2 * PAD];
        for (k, &w) in taps.iter().enumerate() {
            let Some(r) = (row + k).checked_sub(TAPS / 2).filter(|&r| r < x.height) else { continue };
            for (i, e) in lines[PAD..PAD + n].iter_mut().enumerate() {
                let m = keep(r, i);
                let (a, b) = (clamped(x.x[r * n + i]) * m, f64::from(x.y[r * n + i]) * m);
                let terms = [a, b, a * a, b * b, a * b];
                for q in 0..5 {
                    e[q] += w * terms[q];
                }
            }
        }
        row_sum(n, |i| {
            if keep(row, i) == 0.0 {
                return 0.0;
            }
            let mut e = [0.0f64; 5];
            for (k, &w) in taps.iter().enumerate() {
                for q in 0..5 {
                    e[q] += w * lines[i + CHANNELS * k][q];
                }
            }
            let [a, b, aa, bb, ab] = e;
            let (var_a, var_b, cov) = (aa - a * a, bb - b * b, ab - a * b);
            let l = (2.0 * (a * b) + C1) / ((a * a + b * b) + C1);
            let c = (2.0 * cov + C2) / ((var_a + var_b) + C2);
            l * c
        })
    });
    Ok(finite("metric.ssim", sum::tree_f64(&rows))? / count as f64)
}
