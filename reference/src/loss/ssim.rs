//! `loss.ssim`: mean structural similarity.
//!
//! SSIM = (2 μx μy + C1)(2 σxy + C2) / ((μx² + μy² + C1)(σx² + σy² + C2)),   σxy = mean(x·y) − μx μy
//!
//! with means over an 11×11 Gaussian window of deviation 1.5 px (the outer product of the normalised 1-D
//! one), zero padding, C1 = 0.01², C2 = 0.03², per channel (Wang et al. 2004). The value is the mean of the
//! map over the kept values: 1 for equal images.
//!
//! | argument | shape | range |
//! |---|---|---|
//! | `x`, `y` | (H, W, 3) | 0..1, sRGB-encoded |
//! | `mask` | (H, W) | optional; 1: kept, 0: not; both images are first multiplied by it |
//! | `value` | () | at most 1 |
//!
//! # Rounding
//! Window sums are left folds over rows, then columns; kept map entries are added in memory order, then one
//! division. For equal images, every map entry and the value are exactly 1.
//!
//! # Kinks and domain
//! Smooth. A mask that keeps no pixel is an error.

use crate::array::Out;
use crate::loss::{In, PAIR, Pair};
use crate::ports::Signature;
use crate::scalar::Scalar;
use crate::twins::Call;

/// `loss.ssim`
pub static SIGNATURE: Signature = Signature {
    name: "loss.ssim",
    summary: "mean structural similarity, 11×11 Gaussian window, 1 for equal images",
    ..PAIR
};

/// Half-width of the window.
const HALF: usize = 5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// The normalised 1-D window.
pub fn window() -> [f64; 2 * HALF + 1] {
    let raw: [f64; 2 * HALF + 1] = std::array::from_fn(|i| {
        let d = i as f64 - HALF as f64;
        libm::exp(-(d * d) / (2.0 * 1.5 * 1.5))
    });
    let sum = raw.iter().fold(0.0, |sum, x| sum + x);
    raw.map(|x| x / sum)
}

/// The entry of the map at one pixel and channel.
pub fn map_at<S: Scalar>(
    pair: &Pair<'_, S>,
    window: &[f64; 2 * HALF + 1],
    [row, column, channel]: [usize; 3],
) -> S {
    let [h, w] = pair.size_px;
    let [mut mx, mut my, mut xx, mut yy, mut xy] = [S::zero(); 5];
    for (i, wi) in window.iter().enumerate() {
        for (j, wj) in window.iter().enumerate() {
            let (r, c) = (row + i, column + j);
            if r < HALF || c < HALF || r - HALF >= h || c - HALF >= w {
                continue;
            }
            let pixel = (r - HALF) * w + c - HALF;
            if !pair.kept[pixel] {
                continue;
            }
            let (x, y, weight) =
                (pair.x.data[3 * pixel + channel], pair.y.data[3 * pixel + channel], wi * wj);
            mx = mx + x * weight;
            my = my + y * weight;
            xx = xx + x * x * weight;
            yy = yy + y * y * weight;
            xy = xy + x * y * weight;
        }
    }
    let (sx, sy, sxy) = (xx - mx * mx, yy - my * my, xy - mx * my);
    (mx * my * 2.0 + C1) * (sxy * 2.0 + C2) / ((mx * mx + my * my + C1) * (sx + sy + C2))
}

/// The twin of `loss.ssim`.
///
/// # Errors
/// When a mask entry is neither 0 nor 1, or no pixel is kept.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let pair = Pair::of(input)?;
    let window = window();
    let value = out.array("value", &[]);
    for pixel in 0..pair.kept.len() {
        if pair.kept[pixel] {
            let [row, column] = [pixel / pair.size_px[1], pixel % pair.size_px[1]];
            for channel in 0..3 {
                out.add(value, 0, map_at(&pair, &window, [row, column, channel]), pair.values);
            }
        }
        out.flush();
    }
    out.divide(value, 0, pair.values);
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or no pixel is kept.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}

/// Number of products with the window.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    Ok(121 * In::of(call.arrays)?.x.data.len() as u64)
}
