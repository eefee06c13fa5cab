//! Scores of Stanford-ORB, in f64: images in linear values with their foreground, normals, depth, albedo.
//!
//! The definitions are those of the benchmark's published code. All start from the **eroded mask** M ([`erode`]): pixels whose
//! foreground is above ½, and whose 5×5 neighbours are too; pixels beyond the image do not erode it.
//!
//! With render x and truth y, both linear and multiplied by M, and the per-channel **scale**
//! s_c = Σ_M x_c y_c / Σ_M x_c² ([`scales`]):
//!
//! | name | definition |
//! |---|---|
//! | `PSNR-H` | with k = mean e(clip(y, 0, 1)) / mean clip(y, 0, 1): MSE of clip(k s x, 0, 4) and clip(k y, 0, 4) over **all** values of the image |
//! | `PSNR-L` | MSE of e(clip(s x, 0, 1)) and e(clip(y, 0, 1)) over all values of the image |
//! | `PSNR-A` (albedo) | MSE of clip(s x, 0, 1) and clip(y, 0, 1), linear, over all values of the image |
//! | `PSNR-mask` | as `PSNR-L`, but the mean is over the pixels of the mask before its erosion, and s is fitted on them |
//! | `PSNR-eroded` | as `PSNR-L`, but the mean is over the pixels of M |
//! | `SSIM-3` | of the images of `PSNR-L`: Gaussian window of 3×3, σ = 1.5, reflected border, range 1, mean over all values |
//! | `LPIPS` | of the images of `PSNR-L`, **encoded once more** ([`Aligned::encoded_twice`]), as the published code does; with user-supplied weights |
//! | normals | mean over M of 1 − cos |
//! | depth | one scale per scene, s = Σ_views Σ_M z y / Σ_views Σ_M z²; mean over views of Σ_M (s z − y)² / (number of **all** pixels) |
//!
//! e is the sRGB encoding. `PSNR-H`, `PSNR-L` and `PSNR-A` are at least that of a constant foreground of 0.5 over black: a render that
//! is worse gets the value of the constant. Since the mean includes the background, which is 0 in both images, a small object
//! has a higher value than a large one at the same error; `PSNR-mask` and `PSNR-eroded` do not have this property and no bound.
//!
//! # Rounding
//! Sums over pixels: per row 16 logical lanes, tree over rows; over views a pairwise tree. Channels are scaled one by one.
//!
//! # Domain
//! A channel whose Σ_M x² is at most 1e-6 gets the scale mean_M y, as in the published code, which replaces x by 1 there.

use crate::loss::CHANNELS;
use crate::loss::metric::psnr::Decibel;
use crate::num::elem::f64 as elem;
use crate::num::{order, par, sum};
use crate::{Error, Result};

/// Side of the square that erodes masks, in pixels.
pub const EROSION: usize = 5;
/// Largest value of `PSNR-H`.
const HIGH: f64 = 4.0;
/// Value of the constant foreground that bounds the benchmark's PSNR from below.
const CONSTANT: f64 = 0.5;
/// Sum of squares up to which a channel has no scale of its own.
const NOTHING: f64 = 1e-6;
/// Standard deviation of the window of `SSIM-3`, in pixels.
const SIGMA: f64 = 1.5;

/// Two images of linear values and their foreground.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Render x, linear, at least 0, shape (H, W, 3).
    pub x: &'a [f32],
    /// Truth y, linear, shape (H, W, 3); negative values count as 0.
    pub y: &'a [f32],
    /// Foreground, 0..1, shape (H, W).
    pub foreground: &'a [f32],
    /// Height H in pixels.
    pub height: usize,
    /// Width W in pixels.
    pub width: usize,
}

impl In<'_> {
    fn check(&self, what: &str) -> Result<()> {
        let pixels = self.height * self.width;
        let sizes =
            [("x", self.x.len(), 3), ("y", self.y.len(), 3), ("foreground", self.foreground.len(), 1)];
        for (name, len, channels) in sizes {
            if len != channels * pixels || pixels == 0 {
                return Err(Error::input(what)
                    .at(format!("array '{name}'"))
                    .expected(format!("{}x{}x{channels} values", self.height, self.width))
                    .got(len.to_string()));
            }
        }
        if let Some(i) = self.x.iter().position(|x| !(*x >= 0.0 && x.is_finite())) {
            return Err(Error::input(what)
                .at(format!("array 'x', value {i}"))
                .expected("a finite value of at least 0")
                .got(self.x[i].to_string()));
        }
        match self.y.iter().position(|y| !y.is_finite()) {
            None => Ok(()),
            Some(i) => Err(Error::input(what)
                .at(format!("array 'y', value {i}"))
                .expected("a finite value")
                .got(self.y[i].to_string())),
        }
    }
}

/// Returns the mask of a foreground: 1 where it is above ½.
pub fn mask(foreground: &[f32]) -> Vec<bool> {
    foreground.iter().map(|m| *m > 0.5).collect()
}

/// Returns the mask eroded by a square of [`EROSION`] pixels.
pub fn erode(foreground: &[f32], [height, width]: [usize; 2]) -> Vec<bool> {
    let (inside, reach) = (mask(foreground), EROSION / 2);
    let around = |at: usize, size: usize| at.saturating_sub(reach)..Ord::min(at + reach + 1, size);
    (0..height * width)
        .map(|i| {
            let (r, c) = (i / width, i % width);
            around(r, height).all(|r| around(c, width).all(|c| inside[r * width + c]))
        })
        .collect()
}

/// Sums a value of every pixel: rows of 16 lanes, tree over rows.
fn over_pixels(height: usize, width: usize, value: impl Fn(usize) -> f64 + Sync) -> f64 {
    let rows = par::map_batched(height, 8, |r| crate::loss::row_sum(width, |c| value(r * width + c)));
    sum::tree_f64(&rows)
}

/// Returns the sRGB-encoded value of a linear one.
pub fn encode(x: f64) -> f64 {
    if x > 0.003_130_8 { elem::pow(x, 1.0 / 2.4) * 1.055 - 0.055 } else { 12.92 * x }
}

/// Returns the linear value of an sRGB-encoded one.
pub fn decode(x: f64) -> f64 {
    if x <= 0.040_45 { x / 12.92 } else { elem::pow((x + 0.055) / 1.055, 2.4) }
}

/// Returns the least-squares scale of every channel of x to y on the pixels of a mask, 1 for an empty one.
///
/// # Errors
/// Returns an error for wrong sizes, or values that are not finite or, in x, negative.
pub fn scales(x: &In<'_>, mask: &[bool]) -> Result<[f64; CHANNELS]> {
    x.check("metric.orb")?;
    let (h, w) = (x.height, x.width);
    let at = |mask: bool, f: f64| if mask { f } else { 0.0 };
    let count = over_pixels(h, w, |i| at(mask[i], 1.0));
    if count == 0.0 {
        return Ok([1.0; CHANNELS]);
    }
    Ok(std::array::from_fn(|c| {
        let a = |i: usize| f64::from(x.x[CHANNELS * i + c]);
        let b = |i: usize| order::max(f64::from(x.y[CHANNELS * i + c]), 0.0);
        let squares = over_pixels(h, w, |i| at(mask[i], a(i) * a(i)));
        if squares <= NOTHING {
            return over_pixels(h, w, |i| at(mask[i], b(i))) / count;
        }
        over_pixels(h, w, |i| at(mask[i], a(i) * b(i))) / squares
    }))
}

/// Two images as `PSNR-L` compares them: scaled, limited to 0..1, sRGB-encoded, 0 outside of the eroded mask.
#[derive(Clone, Debug)]
pub struct Aligned {
    /// Scales of the channels of the render.
    pub scales: [f64; CHANNELS],
    /// Render, shape (H, W, 3).
    pub x: Vec<f64>,
    /// Truth, shape (H, W, 3).
    pub y: Vec<f64>,
    /// Eroded mask, shape (H, W).
    pub mask: Vec<bool>,
    height: usize,
    width: usize,
}

impl Aligned {
    /// Returns both images encoded once more: the input of LPIPS.
    pub fn encoded_twice(&self) -> [Vec<f32>; 2] {
        [&self.x, &self.y].map(|image| image.iter().map(|v| encode(*v) as f32).collect())
    }

    /// Returns the mean squared error over all values.
    fn mse(&self) -> f64 {
        over_values(self.height, self.width, |i| self.x[i] - self.y[i]) / (CHANNELS * self.mask.len()) as f64
    }

    /// Returns the mean squared error of a constant foreground of 0.5.
    fn bound(&self) -> f64 {
        bound(&self.y, &self.mask, [self.height, self.width])
    }
}

/// Sums the squares of a difference of every value.
fn over_values(height: usize, width: usize, difference: impl Fn(usize) -> f64 + Sync) -> f64 {
    over_pixels(height, CHANNELS * width, |i| {
        let d = difference(i);
        d * d
    })
}

/// Returns the mean squared error of a constant foreground of 0.5 over all values.
fn bound(truth: &[f64], mask: &[bool], [height, width]: [usize; 2]) -> f64 {
    let constant = |i: usize| if mask[i / CHANNELS] { CONSTANT } else { 0.0 };
    over_values(height, width, |i| constant(i) - truth[i]) / truth.len() as f64
}

/// Returns the smaller error in decibels.
fn bounded(mse: f64, bound: f64) -> Decibel {
    Decibel::from_mse(order::min(mse, bound))
}

/// Returns both images multiplied by the mask, x with its scales, limited to 0..`most` after a factor, and encoded if `encoded`.
fn prepared(
    x: &In<'_>,
    mask: &[bool],
    scales: [f64; CHANNELS],
    factor: f64,
    most: f64,
    encoded: bool,
) -> [Vec<f64>; 2] {
    let value = |i: usize, v: f64| {
        let v = order::clamp(factor * v, 0.0, most);
        if !mask[i / CHANNELS] {
            0.0
        } else if encoded {
            encode(v)
        } else {
            v
        }
    };
    let n = x.x.len();
    [
        (0..n).map(|i| value(i, scales[i % CHANNELS] * f64::from(x.x[i]))).collect(),
        (0..n).map(|i| value(i, f64::from(x.y[i]))).collect(),
    ]
}

fn aligned_on(x: &In<'_>, eroded: Vec<bool>, scales: [f64; CHANNELS], encoded: bool) -> Aligned {
    let [a, b] = prepared(x, &eroded, scales, 1.0, 1.0, encoded);
    Aligned { scales, x: a, y: b, mask: eroded, height: x.height, width: x.width }
}

/// Returns the images of `PSNR-L`.
///
/// # Errors
/// Returns an error for wrong sizes, or values that are not finite or, in x, negative.
pub fn aligned(x: &In<'_>) -> Result<Aligned> {
    let eroded = erode(x.foreground, [x.height, x.width]);
    let scales = scales(x, &eroded)?;
    Ok(aligned_on(x, eroded, scales, true))
}

/// Returns `PSNR-L`.
pub fn psnr_l(x: &Aligned) -> Decibel {
    bounded(x.mse(), x.bound())
}

/// Returns `PSNR-H`.
///
/// # Errors
/// Returns an error under the conditions of [`aligned`].
pub fn psnr_h(x: &In<'_>) -> Result<Decibel> {
    let (h, w) = (x.height, x.width);
    let eroded = erode(x.foreground, [h, w]);
    let scales = scales(x, &eroded)?;
    let [_, low] = prepared(x, &eroded, scales, 1.0, 1.0, false);
    let total = over_pixels(h, CHANNELS * w, |i| low[i]);
    let k = if total / low.len() as f64 > 1e-8 {
        over_pixels(h, CHANNELS * w, |i| encode(low[i])) / total
    } else {
        1.0
    };
    let [a, b] = prepared(x, &eroded, scales, k, HIGH, false);
    let mse = over_values(h, w, |i| a[i] - b[i]) / a.len() as f64;
    Ok(bounded(mse, bound(&b, &eroded, [h, w])))
}

/// Returns `PSNR-A`, of linear albedo.
///
/// # Errors
/// Returns an error under the conditions of [`aligned`].
pub fn psnr_albedo(x: &In<'_>) -> Result<Decibel> {
    let eroded = erode(x.foreground, [x.height, x.width]);
    let scales = scales(x, &eroded)?;
    let images = aligned_on(x, eroded, scales, false);
    Ok(bounded(images.mse(), images.bound()))
}

/// Returns `PSNR-mask`, or `PSNR-eroded` for `eroded`; `None` if the mask is empty.
///
/// # Errors
/// Returns an error under the conditions of [`aligned`].
pub fn psnr_inside(x: &In<'_>, eroded: bool) -> Result<Option<Decibel>> {
    let kept = if eroded { erode(x.foreground, [x.height, x.width]) } else { mask(x.foreground) };
    let scales = scales(x, &kept)?;
    let count = kept.iter().filter(|k| **k).count();
    let images = aligned_on(x, kept, scales, true);
    let total = over_values(x.height, x.width, |i| images.x[i] - images.y[i]);
    Ok((count > 0).then(|| Decibel::from_mse(total / (CHANNELS * count) as f64)))
}

/// Returns `SSIM-3`, which is in −1..1.
///
/// With moments under the window, SSIM = (2μ_xμ_y + C₁)(2σ_xy + C₂) / ((μ_x² + μ_y² + C₁)(σ_x² + σ_y² + C₂) + 10⁻¹²), C₁ = 10⁻⁴,
/// C₂ = 9·10⁻⁴, σ² = E(x²) − μ²; ½(1 − SSIM) is limited to 0..1 before the mean.
///
/// # Errors
/// Returns an error for images of less than 2×2 pixels, which a border cannot be reflected in.
pub fn ssim3(x: &Aligned) -> Result<f64> {
    let (h, w) = (x.height, x.width);
    if h < 2 || w < 2 {
        return Err(Error::input("metric.orb")
            .expected("images of at least 2x2 pixels")
            .got(format!("{h}x{w}")));
    }
    let side = elem::exp(-1.0 / (2.0 * SIGMA * SIGMA));
    let all = (side + 1.0) + side;
    let window = [side / all, 1.0 / all, side / all];
    let reflected = |at: usize, step: usize, size: usize| match (at + step).checked_sub(1) {
        None => 1,
        Some(i) if i == size => size - 2,
        Some(i) => i,
    };
    let total = over_pixels(h, CHANNELS * w, |i| {
        let (r, c, channel) = (i / (CHANNELS * w), i / CHANNELS % w, i % CHANNELS);
        let mut e = [0.0f64; 5];
        for (dr, wr) in window.iter().enumerate() {
            let row = reflected(r, dr, h);
            for (dc, wc) in window.iter().enumerate() {
                let at = (row * w + reflected(c, dc, w)) * CHANNELS + channel;
                let (a, b) = (x.x[at], x.y[at]);
                let weight = wr * wc;
                for (e, term) in e.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                    *e += weight * term;
                }
            }
        }
        let [a, b, aa, bb, ab] = e;
        let [c1, c2] = [1e-4, 9e-4];
        let top = (2.0 * (a * b) + c1) * (2.0 * (ab - a * b) + c2);
        let bottom = ((a * a + b * b) + c1) * (((aa - a * a) + (bb - b * b)) + c2);
        order::clamp(0.5 * (1.0 - top / (bottom + 1e-12)), 0.0, 1.0)
    });
    Ok(1.0 - 2.0 * (total / (CHANNELS * h * w) as f64))
}

/// Returns the error of normals: the mean of 1 − cos over the eroded mask, `None` if that is empty. Where x is 0, the term is 1.
///
/// # Errors
/// Returns an error for wrong sizes.
pub fn normals(x: &[[f32; 3]], y: &[[f32; 3]], foreground: &[f32], size: [usize; 2]) -> Result<Option<f64>> {
    let pixels = size[0] * size[1];
    if [x.len(), y.len(), foreground.len()] != [pixels; 3] {
        return Err(Error::input("metric.orb")
            .at("normals")
            .expected(format!("{pixels} pixels"))
            .got(format!("{}, {} and {}", x.len(), y.len(), foreground.len())));
    }
    let eroded = erode(foreground, size);
    let count = eroded.iter().filter(|k| **k).count();
    let unit = |v: [f32; 3]| {
        let v = v.map(f64::from);
        let length = ((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]).sqrt() + 1e-6;
        v.map(|x| x / length)
    };
    let term = |i: usize| {
        let (a, b) = (unit(x[i]), unit(y[i]));
        1.0 - ((a[0] * b[0] + a[1] * b[1]) + a[2] * b[2])
    };
    let total = over_pixels(size[0], size[1], |i| if eroded[i] { term(i) } else { 0.0 });
    Ok((count > 0).then(|| total / count as f64))
}

/// Depth of one view: the render's and the true one.
#[derive(Clone, Copy, Debug)]
pub struct Depth<'a> {
    /// Render, shape (H, W); 0 where nothing is seen.
    pub x: &'a [f32],
    /// Truth, shape (H, W).
    pub y: &'a [f32],
    /// Foreground, 0..1, shape (H, W).
    pub foreground: &'a [f32],
    /// Height and width in pixels.
    pub size: [usize; 2],
}

/// Returns the scale of depth and its error over the views of a scene; `None` without a view or with empty masks.
///
/// # Errors
/// Returns an error for wrong sizes.
pub fn depth(views: &[Depth<'_>]) -> Result<Option<[f64; 2]>> {
    let mut sums = Vec::with_capacity(views.len());
    for v in views {
        let pixels = v.size[0] * v.size[1];
        if [v.x.len(), v.y.len(), v.foreground.len()] != [pixels; 3] {
            return Err(Error::input("metric.orb")
                .at("depth")
                .expected(format!("{pixels} pixels"))
                .got(format!("{}, {} and {}", v.x.len(), v.y.len(), v.foreground.len())));
        }
        let eroded = erode(v.foreground, v.size);
        let inside = |value: &(dyn Fn(usize) -> f64 + Sync)| {
            over_pixels(v.size[0], v.size[1], |i| if eroded[i] { value(i) } else { 0.0 })
        };
        let (a, b) = (|i: usize| f64::from(v.x[i]), |i: usize| f64::from(v.y[i]));
        // A view in which nothing is seen has depth 1.
        let is_empty = inside(&|i| a(i) * a(i)) <= NOTHING;
        let a = move |i: usize| if is_empty { 1.0 } else { a(i) };
        sums.push((inside(&|i| a(i) * b(i)), inside(&|i| a(i) * a(i)), is_empty, eroded));
    }
    let all = |part: &dyn Fn(usize) -> f64| sum::tree_f64(&(0..sums.len()).map(part).collect::<Vec<f64>>());
    let (top, bottom) = (all(&|i| sums[i].0), all(&|i| sums[i].1));
    if views.is_empty() || bottom == 0.0 {
        return Ok(None);
    }
    let scale = top / bottom;
    let errors: Vec<f64> = views
        .iter()
        .zip(&sums)
        .map(|(v, (_, _, is_empty, eroded))| {
            let squares = over_pixels(v.size[0], v.size[1], |i| {
                let x = if *is_empty { 1.0 } else { f64::from(v.x[i]) };
                let d = scale * x - f64::from(v.y[i]);
                if eroded[i] { d * d } else { 0.0 }
            });
            squares / (v.size[0] * v.size[1]) as f64
        })
        .collect();
    Ok(Some([scale, sum::tree_f64(&errors) / errors.len() as f64]))
}
