//! `loss.lpips`: learned perceptual distance of two images, with VGG16 and the linear heads of version 0.1.
//!
//! value = Σ_l (1/(H_l W_l)) Σ_p Σ_c w_lc (f̂_lpc(x) − f̂_lpc(y))²,   f̂ = f/(‖f‖ + 1e-10)
//! (Zhang et al. 2018, eq. 1)
//!
//! f_l are the outputs of relu1_2, relu2_2, relu3_3, relu4_3, relu5_3 of VGG16 on the normalised image
//! ((2x − 1) − shift)/scale: 3×3 convolutions with zeros beyond the border, each followed by max(·, 0), and
//! 2×2 maxima before the second to fifth group.
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `x` | (H, W, 3) | sRGB-encoded, 0..1; at least 16×16 |
//! | y | `y` | (H, W, 3) | the same |
//! | – | `rescale` | () | apply 2x − 1 first, as published; without it the variant is `LPIPS-raw`, as used by GauHuman and Instant-NVR |
//! | w, filters | [`Weights`] | | from a user-supplied file, or by formula |
//! | value | return | () | ≥ 0 for heads without negative weights |
//!
//! No weights are shipped. Tools print [`NO_WEIGHTS`] if the user supplies none.
//!
//! # Rounding
//! Images are normalised in f32, ((2x − 1) − shift)/scale; convolutions are `nn.conv`. ‖f‖², the distance and
//! its sum are in f64: left folds over the channels, per row 16 logical lanes, tree over rows, one division
//! per layer; layers from the first to the last; the result is rounded once.
//!
//! # Kinks and domain
//! An output of a convolution that is not above 0 gets no gradient. Of equal entries in a maximum, the first
//! (by row, then column) is selected. An odd last row or column is not part of any maximum. The plan stores
//! which outputs are active and which entries are selected. If all channels are 0, f̂ = 0 and the gradient is
//! 0.
//!
//! # Adjoint
//! With d = f̂(x) − f̂(y), n = ‖f(x)‖, m = n + 1e-10 and g_c = 2 (v̄/(H_l W_l)) w_c d_c,
//!
//! f̄_c(x) = g_c/m − f_c (f·g)/(n m²),
//!
//! and with −g for y; then the convolutions are traversed in reverse, where the cotangent of each tap is
//! added. Weights have no gradient. The outputs of all convolutions and the selected entries are saved.
//!
//! Twin: `reference::loss::lpips`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::lpips::{In, Layer, Weights, forward};
//! // a network with one channel: the first convolution selects the red channel, the others are the identity
//! let layer = |inputs: usize| {
//!     let mut weight = vec![0.0; 3 * 3 * inputs];
//!     weight[4 * inputs] = 1.0;
//!     Layer { weight, bias: vec![0.0], inputs, outputs: 1 }
//! };
//! let layers = (0..13).map(|k| layer(if k == 0 { 3 } else { 1 })).collect();
//! let weights = Weights { layers, heads: vec![vec![0.5]; 5] };
//! let (white, black) = ([1.0; 16 * 16 * 3], [0.0; 16 * 16 * 3]);
//! let x = In { x: &white, y: &black, height: 16, width: 16, rescale: true, weights: &weights };
//! // f̂ is 1 for white and 0 for black (max(·, 0) of a negative value), so every tap adds its head's weight
//! assert!((forward(x, None)?.0 - 2.5).abs() < 1e-6);
//! # Ok::<(), lastlight::Error>(())
//! ```

mod weights;

pub use weights::{CONVOLUTIONS, Layer, NO_WEIGHTS, TAPS, Weights, names};

use crate::loss::{CHANNELS, finite, row_sum};
use crate::nn::conv;
use crate::num::bits::Digest;
use crate::num::{order, par, sum};
use crate::{Error, Result};
use std::path::Path;

/// Name of the variant with the published input, 2x − 1.
pub const NAME: &str = "LPIPS-vgg";
/// Name of the variant without rescaling.
pub const NAME_RAW: &str = "LPIPS-vgg-raw";
/// Name of [`NAME`] on the smallest rectangle around a person's box.
pub const NAME_BOX: &str = "LPIPS-vgg-box";
/// Name of [`NAME_RAW`] on that rectangle.
pub const NAME_RAW_BOX: &str = "LPIPS-vgg-raw-box";
/// Constant that is added to norms.
pub const EPS: f64 = 1e-10;
/// Offset that is subtracted from images before the division by [`SCALE`].
pub const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
/// Divisor of the normalisation, see [`SHIFT`].
pub const SCALE: [f32; 3] = [0.458, 0.448, 0.450];
/// Smallest side of an image in pixels: the last group has a sixteenth of the resolution.
pub const SMALLEST: usize = 16;
/// Convolutions whose inputs are 2×2 maxima of the outputs before them.
pub const POOLED: [usize; 4] = [2, 4, 7, 10];

/// Values per task; the number changes no bit.
const CHUNK: usize = 1 << 14;

/// Two images and the network that compares them.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// First image, shape (H, W, 3), usually the render.
    pub x: &'a [f32],
    /// Second image, shape (H, W, 3), usually the input image.
    pub y: &'a [f32],
    /// Height H in pixels.
    pub height: usize,
    /// Width W in pixels.
    pub width: usize,
    /// Whether 2x − 1 is applied first.
    pub rescale: bool,
    /// Filters and heads.
    pub weights: &'a Weights,
}

/// All discrete decisions, for x, then y.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Active outputs per convolution, shape (2, H_l, W_l, C_l): 1 where the output is positive.
    pub active: Vec<Vec<u8>>,
    /// Selected entries per maximum, shape (2, H_l, W_l, C): 2·row + column.
    pub pool: Vec<Vec<u8>>,
}

/// Intermediate values that the adjoint needs.
#[derive(Clone, Debug)]
pub struct Saved {
    /// Outputs per convolution after max(·, 0), shape (2, H_l, W_l, C_l).
    pub relu: Vec<Vec<f32>>,
    /// Entries selected by the maxima.
    pool: Vec<Vec<u8>>,
    /// Active outputs, if given by a plan.
    active: Option<Vec<Vec<u8>>>,
}

impl Saved {
    /// Returns the discrete decisions.
    pub fn plan(&self) -> Plan {
        let positive = |relu: &Vec<f32>| relu.iter().map(|x| u8::from(*x > 0.0)).collect();
        let active = self.active.clone().unwrap_or_else(|| self.relu.iter().map(positive).collect());
        Plan { active, pool: self.pool.clone() }
    }
}

/// Returns the numbers of rows and columns at each convolution.
pub fn sizes(height: usize, width: usize) -> [[usize; 2]; 13] {
    let group = |k: usize| POOLED.iter().filter(|&&p| p <= k).count();
    std::array::from_fn(|k| [height >> group(k), width >> group(k)])
}

impl In<'_> {
    fn check(&self) -> Result<()> {
        const WHAT: &str = "loss.lpips";
        for (name, image) in [("x", self.x), ("y", self.y)] {
            if image.len() != CHANNELS * self.height * self.width {
                return Err(Error::input(WHAT)
                    .at(format!("array '{name}'"))
                    .expected(format!("{}x{}x3 values", self.height, self.width))
                    .got(image.len().to_string()));
            }
            if !image.iter().all(|v| v.is_finite()) {
                return Err(Error::input(WHAT).at(format!("array '{name}'")).expected("finite images"));
            }
        }
        if self.height < SMALLEST || self.width < SMALLEST {
            return Err(Error::input(WHAT)
                .expected(format!("images of at least {SMALLEST}x{SMALLEST} pixels"))
                .got(format!("{}x{}", self.height, self.width)));
        }
        Ok(())
    }

    fn shape(&self, k: usize, batch: usize) -> conv::Shape {
        let [height, width] = sizes(self.height, self.width)[k];
        let layer = &self.weights.layers[k];
        let (channels, outputs) = (layer.inputs, layer.outputs);
        conv::Shape { batch, height, width, channels, outputs, kernel: [3, 3], stride: 1, pad: 1 }
    }
}

/// Returns both normalised images, shape (2, H, W, 3).
fn normalised(x: &In<'_>) -> Vec<f32> {
    let mut out = [x.x, x.y].concat();
    for pixel in out.chunks_exact_mut(CHANNELS) {
        for (c, v) in pixel.iter_mut().enumerate() {
            let centred = if x.rescale { 2.0 * *v - 1.0 } else { *v };
            *v = (centred - SHIFT[c]) / SCALE[c];
        }
    }
    out
}

/// Returns the four indices below output pixel (b, r, q) of a maximum over images of `columns` × `rows`, with
/// separate channels.
fn under(at: usize, [rows, columns]: [usize; 2], channels: usize) -> [usize; 4] {
    let (h, w) = (rows / 2, columns / 2);
    let (b, r, q) = (at / (h * w), at / w % h, at % w);
    let first = ((b * rows + 2 * r) * columns + 2 * q) * channels;
    [first, first + channels, first + columns * channels, first + (columns + 1) * channels]
}

/// Returns the 2×2 maxima and the selected entries; a plan gives the entries instead.
fn pooled(x: &[f32], size: [usize; 2], channels: usize, given: Option<&[u8]>) -> (Vec<f32>, Vec<u8>) {
    let pixels = 2 * (size[0] / 2) * (size[1] / 2);
    let (mut y, mut taken) = (vec![0.0; pixels * channels], vec![0u8; pixels * channels]);
    if let Some(given) = given {
        taken.copy_from_slice(given);
    }
    let columns = size[1] / 2;
    let line = columns * channels;
    par::chunks_mut2(&mut y, line, &mut taken, line, |row, y, taken| {
        for (q, (y, taken)) in y.chunks_exact_mut(channels).zip(taken.chunks_exact_mut(channels)).enumerate()
        {
            let places = under(row * columns + q, size, channels);
            for c in 0..channels {
                if given.is_none() {
                    for k in 1..4u8 {
                        if x[places[usize::from(k)] + c] > x[places[usize::from(taken[c])] + c] {
                            taken[c] = k;
                        }
                    }
                }
                y[c] = x[places[usize::from(taken[c])] + c];
            }
        }
    });
    (y, taken)
}

/// Returns ‖f‖ in f64.
fn norm(f: &[f32]) -> f64 {
    f.iter().fold(0.0, |s, v| s + f64::from(*v) * f64::from(*v)).sqrt()
}

/// Returns the sum of tap `l` over its pixels.
fn tap_sum(relu: &[f32], [rows, columns]: [usize; 2], head: &[f32]) -> f64 {
    let channels = head.len();
    let (a, b) = relu.split_at(relu.len() / 2);
    let sums = par::map_batched(rows, 4, |r| {
        row_sum(columns, |q| {
            let at = (r * columns + q) * channels;
            let (f, g) = (&a[at..at + channels], &b[at..at + channels]);
            let (m, n) = (norm(f) + EPS, norm(g) + EPS);
            let mut sum = 0.0;
            for c in 0..channels {
                let d = f64::from(f[c]) / m - f64::from(g[c]) / n;
                sum += f64::from(head[c]) * (d * d);
            }
            sum
        })
    });
    sum::tree_f64(&sums)
}

/// Returns the distance, its five terms, and the intermediate values that the adjoint needs. `plan` replaces
/// the decisions.
///
/// # Errors
/// Returns an error for images of different sizes, smaller than 16×16 or not finite, and for a plan of a
/// different size.
pub fn forward(x: In<'_>, plan: Option<&Plan>) -> Result<(f32, [f64; 5], Saved)> {
    x.check()?;
    let sizes = sizes(x.height, x.width);
    let mut saved = Saved { relu: Vec::new(), pool: Vec::new(), active: plan.map(|p| p.active.clone()) };
    let mut input = normalised(&x);
    for (k, layer) in x.weights.layers.iter().enumerate() {
        if POOLED.contains(&k) {
            let given = plan.map(|p| &p.pool[saved.pool.len()][..]);
            let (y, taken) = pooled(&saved.relu[k - 1], sizes[k - 1], layer.inputs, given);
            saved.pool.push(taken);
            input = y;
        }
        let shape = x.shape(k, 2);
        let mut y = vec![0.0; 2 * sizes[k][0] * sizes[k][1] * layer.outputs];
        let before = if k == 0 || POOLED.contains(&k) { &input } else { &saved.relu[k - 1] };
        conv::forward(conv::In { x: before, weight: &layer.weight, bias: &layer.bias, shape }, &mut y);
        let active = plan.map(|p| &p.active[k][..]);
        par::chunks_mut(&mut y, CHUNK, |i, y| match active {
            None => y.iter_mut().for_each(|v| *v = if *v > 0.0 { *v } else { 0.0 }),
            Some(active) => {
                for (v, on) in y.iter_mut().zip(&active[i * CHUNK..]) {
                    *v = if *on == 1 { *v } else { 0.0 };
                }
            }
        });
        saved.relu.push(y);
    }
    let layers: [f64; 5] = std::array::from_fn(|l| {
        let size = sizes[TAPS[l]];
        tap_sum(&saved.relu[TAPS[l]], size, &x.weights.heads[l]) / (size[0] * size[1]) as f64
    });
    let value = finite("loss.lpips", layers.iter().fold(0.0, |s, t| s + t))?;
    Ok((value as f32, layers, saved))
}

/// Returns the distance as a metric: the render is clamped to 0..1, pixels that the mask excludes are black
/// in both images, and the sum of the terms is f64.
///
/// # Errors
/// Returns an error under the conditions of [`forward`], for a mask value other than 0 and 1, or if no pixel
/// is kept.
pub fn score(x: &super::In<'_>, rescale: bool, weights: &Weights) -> Result<f64> {
    x.check("loss.lpips")?;
    let kept = |i: usize| x.mask.is_none_or(|m| m[i / CHANNELS] == 1.0);
    let limited = |(i, v): (usize, &f32)| if kept(i) { order::clamp(*v, 0.0, 1.0) } else { 0.0 };
    let black = |(i, v): (usize, &f32)| if kept(i) { *v } else { 0.0 };
    let render: Vec<f32> = x.x.iter().enumerate().map(limited).collect();
    let photo: Vec<f32> = x.y.iter().enumerate().map(black).collect();
    let images = In { x: &render, y: &photo, height: x.height, width: x.width, rescale, weights };
    let (_, layers, _) = forward(images, None)?;
    Ok(layers.iter().fold(0.0, |s, t| s + t))
}

/// Weights, and the normalisation of the images.
#[derive(Clone, Debug)]
pub struct Metric {
    /// Filters and heads.
    pub weights: Weights,
    /// Whether 2x − 1 is applied first.
    pub rescale: bool,
}

impl Metric {
    /// Loads the user's weights.
    ///
    /// # Errors
    /// Returns an error under the conditions of [`Weights::load`].
    pub fn load(path: &Path, rescale: bool) -> Result<Self> {
        Ok(Self { weights: Weights::load(path)?, rescale })
    }

    /// Returns the digest of the weights and of the normalisation of the images.
    ///
    /// # Errors
    /// Returns an error if a weight is NaN.
    pub fn digest(&self) -> Result<u64> {
        let mut d = Digest::new();
        for layer in &self.weights.layers {
            d.f32(&[layer.weight.len()], &layer.weight)?;
            d.f32(&[layer.bias.len()], &layer.bias)?;
        }
        self.weights.heads.iter().try_for_each(|head| d.f32(&[head.len()], head))?;
        d.bytes(&[u8::from(self.rescale)]);
        Ok(d.value())
    }

    /// Returns the names of the variant on complete images and on boxes.
    pub fn names(&self) -> [&'static str; 2] {
        if self.rescale { [NAME, NAME_BOX] } else { [NAME_RAW, NAME_RAW_BOX] }
    }

    /// Returns the distance as [`score`].
    ///
    /// # Errors
    /// Returns an error under the conditions of [`score`].
    pub fn score(&self, x: &super::In<'_>) -> Result<f64> {
        score(x, self.rescale, &self.weights)
    }
}

/// Adds the cotangent of tap `l` for item `item` (0: x, 1: y) to `bar`, (H_l, W_l, C_l).
fn tap_adjoint(
    relu: &[f32],
    item: usize,
    [rows, columns]: [usize; 2],
    head: &[f32],
    scale: f64,
    bar: &mut [f32],
) {
    let channels = head.len();
    let (a, b) = relu.split_at(relu.len() / 2);
    let (own, other) = if item == 0 { (a, b) } else { (b, a) };
    debug_assert_eq!(bar.len(), rows * columns * channels, "one cotangent per output");
    par::chunks_mut(bar, columns * channels, |r, bar| {
        let mut cotangent = vec![0.0; channels];
        for (q, bar) in bar.chunks_exact_mut(channels).enumerate() {
            let at = (r * columns + q) * channels;
            let (f, g) = (&own[at..at + channels], &other[at..at + channels]);
            let (n, far) = (norm(f), norm(g) + EPS);
            if n == 0.0 {
                continue; // no channel is active here
            }
            let m = n + EPS;
            let mut along = 0.0;
            for c in 0..channels {
                let v = f64::from(f[c]);
                cotangent[c] = 2.0 * scale * f64::from(head[c]) * (v / m - f64::from(g[c]) / far);
                along += v * cotangent[c];
            }
            // Adjoint of f̂ = f/(‖f‖ + ε).
            let radial = along / (n * (m * m));
            for c in 0..channels {
                bar[c] += (cotangent[c] / m - f64::from(f[c]) * radial) as f32;
            }
        }
    });
}

/// Adds the gradients; `y_bar` is `None` if not requested (it costs as much as that of x).
///
/// # Panics
/// Panics if a buffer does not have the size of its image.
pub fn adjoint(x: In<'_>, saved: &Saved, value_bar: f32, x_bar: &mut [f32], y_bar: Option<&mut [f32]>) {
    for (item, bar) in [Some(x_bar), y_bar].into_iter().enumerate() {
        if let Some(bar) = bar {
            assert_eq!(bar.len(), x.x.len(), "a gradient has the shape of its image");
            one(&x, saved, value_bar, item, bar);
        }
    }
}

/// Adds the gradient of one of the two images.
fn one(x: &In<'_>, saved: &Saved, value_bar: f32, item: usize, image_bar: &mut [f32]) {
    let sizes = sizes(x.height, x.width);
    let half = |values: usize| item * values / 2..(item + 1) * values / 2;
    let mut bar = vec![0.0; saved.relu[12].len() / 2];
    for k in (0..x.weights.layers.len()).rev() {
        let (layer, relu) = (&x.weights.layers[k], &saved.relu[k]);
        if let Some(l) = TAPS.iter().position(|&tap| tap == k) {
            let scale = f64::from(value_bar) / (sizes[k][0] * sizes[k][1]) as f64;
            tap_adjoint(relu, item, sizes[k], &x.weights.heads[l], scale, &mut bar);
        }
        // Adjoint of max(·, 0).
        let (own, active) = (half(relu.len()), saved.active.as_ref().map(|a| &a[k][..]));
        par::chunks_mut(&mut bar, CHUNK, |i, bar| {
            let start = own.start + i * CHUNK;
            for (j, bar) in bar.iter_mut().enumerate() {
                let passes = active.map_or(relu[start + j] > 0.0, |a| a[start + j] == 1);
                *bar = if passes { *bar } else { 0.0 };
            }
        });
        // Adjoint of the convolution; only the size of its input is used, because weights have no gradient.
        let shape = x.shape(k, 1);
        let size = sizes[k][0] * sizes[k][1] * layer.inputs;
        let zeros = vec![0.0; size];
        let mut through = conv::InBar { x: vec![0.0; size], ..conv::InBar::default() };
        let at = conv::In { x: &zeros, weight: &layer.weight, bias: &[], shape };
        conv::adjoint(at, &bar, &mut through);
        bar = through.x;
        if let Some(p) = POOLED.iter().position(|&pooled| pooled == k) {
            // Adjoint of the maximum.
            let taken = &saved.pool[p][half(saved.pool[p].len())];
            let mut wide = vec![0.0; saved.relu[k - 1].len() / 2];
            for (at, (bar, taken)) in
                bar.chunks_exact(layer.inputs).zip(taken.chunks_exact(layer.inputs)).enumerate()
            {
                let places = under(at, sizes[k - 1], layer.inputs);
                for c in 0..layer.inputs {
                    wide[places[usize::from(taken[c])] + c] = bar[c];
                }
            }
            bar = wide;
        }
    }
    for (pixel, bar) in image_bar.chunks_exact_mut(CHANNELS).zip(bar.chunks_exact(CHANNELS)) {
        for c in 0..CHANNELS {
            // Adjoint of ((2x − 1) − shift)/scale.
            let inner = bar[c] / SCALE[c];
            pixel[c] += if x.rescale { 2.0 * inner } else { inner };
        }
    }
}
