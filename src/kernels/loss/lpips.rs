//! `loss.lpips`: learned perceptual distance of two images, VGG16 with the heads of version 0.1.
//!
//! value = Σ_l (1/(H_l W_l)) Σ_p Σ_c w_lc (f̂_lpc(x) − f̂_lpc(y))²,   f̂ = f/(‖f‖ + 1e-10)        (Zhang et al. 2018, eq. 1)
//!
//! f_l are the outputs of relu1_2, relu2_2, relu3_3, relu4_3, relu5_3 of VGG16 on the normalised image ((2x − 1) − shift)/scale: 3×3
//! convolutions with zeros beyond the border, each followed by max(·, 0), and 2×2 maxima before the second to fifth group.
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `x` | (H, W, 3) | sRGB-encoded, 0..1; at least 16×16 |
//! | y | `y` | (H, W, 3) | the same |
//! | – | `rescale` | () | 2x − 1 first, as published; without it `LPIPS-raw`, as GauHuman and Instant-NVR feed it |
//! | w, filters | [`Weights`] | | the user's file, or the formula |
//! | value | return | () | ≥ 0 for heads without negative weights |
//!
//! No weights are shipped. Without the user's, tools say [`NO_WEIGHTS`].
//!
//! # Rounding
//! Images are normalised in f32, ((2x − 1) − shift)/scale; convolutions are `nn.conv`. ‖f‖², the distance and its sum are in f64: left folds over the
//! channels, per row 16 logical lanes, tree over rows, one division per layer; layers from the first to the last; rounded once.
//!
//! # Kinks and domain
//! An output of a convolution that is not above 0 passes nothing back. Of equal entries under a maximum the first (row, then column) is taken. An odd last
//! row or column has no maximum. Which outputs are active and which entries are taken is the plan. Where all channels are 0, f̂ = 0 and the gradient
//! is 0.
//!
//! # Adjoint
//! With d = f̂(x) − f̂(y), n = ‖f(x)‖, m = n + 1e-10 and g_c = 2 (v̄/(H_l W_l)) w_c d_c,
//!
//! f̄_c(x) = g_c/m − f_c (f·g)/(n m²),
//!
//! and with −g for y; then through the convolutions in reverse, each joined by the cotangent of its tap. Weights have no gradient. The outputs of all
//! convolutions and the entries taken are saved.
//!
//! Twin: `reference::loss::lpips`.

mod weights;

pub use weights::{CONVOLUTIONS, Layer, NO_WEIGHTS, TAPS, Weights, names};

use crate::loss::{CHANNELS, finite, row_sum};
use crate::nn::conv;
use crate::num::bits::Digest;
use crate::num::{order, par, sum};
use crate::{Error, Result};
use std::path::Path;

/// Name with the published input, 2x − 1.
pub const NAME: &str = "LPIPS-vgg";
/// Name without it.
pub const NAME_RAW: &str = "LPIPS-vgg-raw";
/// [`NAME`] of the smallest rectangle around a person's box.
pub const NAME_BOX: &str = "LPIPS-vgg-box";
/// [`NAME_RAW`] of it.
pub const NAME_RAW_BOX: &str = "LPIPS-vgg-raw-box";
/// Added to norms.
pub const EPS: f64 = 1e-10;
/// Subtracted from and divided into normalised images.
pub const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
/// See [`SHIFT`].
pub const SCALE: [f32; 3] = [0.458, 0.448, 0.450];
/// Smallest side of an image: the last group sees a sixteenth.
pub const SMALLEST: usize = 16;
/// Convolutions that see maxima of 2×2 of what is before them.
pub const POOLED: [usize; 4] = [2, 4, 7, 10];

/// Values per task; changes no bit.
const CHUNK: usize = 1 << 14;

/// Two images and what looks at them.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// (H, W, 3), usually the render
    pub x: &'a [f32],
    /// (H, W, 3), usually the photograph
    pub y: &'a [f32],
    /// H
    pub height: usize,
    /// W
    pub width: usize,
    /// 2x − 1 first
    pub rescale: bool,
    /// filters and heads
    pub weights: &'a Weights,
}

/// Every discrete decision, for x, then y.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// per convolution (2, H_l, W_l, C_l): 1 where it passes
    pub active: Vec<Vec<u8>>,
    /// per maximum (2, H_l, W_l, C): 2·row + column of the entry taken
    pub pool: Vec<Vec<u8>>,
}

/// What the adjoint needs.
#[derive(Clone, Debug)]
pub struct Saved {
    /// per convolution (2, H_l, W_l, C_l), after max(·, 0)
    pub relu: Vec<Vec<f32>>,
    /// entries taken by the maxima
    pool: Vec<Vec<u8>>,
    /// what was active, where a plan said so
    active: Option<Vec<Vec<u8>>>,
}

impl Saved {
    /// The decisions.
    pub fn plan(&self) -> Plan {
        let positive = |relu: &Vec<f32>| relu.iter().map(|x| u8::from(*x > 0.0)).collect();
        let active = self.active.clone().unwrap_or_else(|| self.relu.iter().map(positive).collect());
        Plan { active, pool: self.pool.clone() }
    }
}

/// Rows and columns at each convolution.
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

/// (2, H, W, 3): both images, normalised.
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

/// The four places under output pixel (b, r, q) of a maximum over pictures of `columns` × `rows`, channels apart.
fn under(at: usize, [rows, columns]: [usize; 2], channels: usize) -> [usize; 4] {
    let (h, w) = (rows / 2, columns / 2);
    let (b, r, q) = (at / (h * w), at / w % h, at % w);
    let first = ((b * rows + 2 * r) * columns + 2 * q) * channels;
    [first, first + channels, first + columns * channels, first + (columns + 1) * channels]
}

/// Maxima of 2×2 and which entries they are; a plan names the entries instead.
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

/// ‖f‖ in f64.
fn norm(f: &[f32]) -> f64 {
    f.iter().fold(0.0, |s, v| s + f64::from(*v) * f64::from(*v)).sqrt()
}

/// The sum of tap `l` over its pixels.
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

/// The distance, its five terms, and what the adjoint needs. `plan` takes the decisions instead.
///
/// # Errors
/// Images of other sizes, smaller than 16×16, or not finite; a plan of another size.
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

/// The distance as a metric: the render limited to 0..1, pixels that the mask leaves out black in both images; the sum of the terms in f64.
///
/// # Errors
/// As [`forward`]; a mask value other than 0 and 1, nothing kept.
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

/// Weights, and how images are fed to them.
#[derive(Clone, Debug)]
pub struct Metric {
    /// filters and heads
    pub weights: Weights,
    /// 2x − 1 first
    pub rescale: bool,
}

impl Metric {
    /// The user's weights.
    ///
    /// # Errors
    /// As [`Weights::load`].
    pub fn load(path: &Path, rescale: bool) -> Result<Self> {
        Ok(Self { weights: Weights::load(path)?, rescale })
    }

    /// Digest of the weights and of how images are fed to them.
    ///
    /// # Errors
    /// Weights that are NaN.
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

    /// Name of the variant, of whole images and of boxes.
    pub fn names(&self) -> [&'static str; 2] {
        if self.rescale { [NAME, NAME_BOX] } else { [NAME_RAW, NAME_RAW_BOX] }
    }

    /// The distance, as [`score`].
    ///
    /// # Errors
    /// As [`score`].
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
                continue; // nothing is active here
            }
            let m = n + EPS;
            let mut along = 0.0;
            for c in 0..channels {
                let v = f64::from(f[c]);
                cotangent[c] = 2.0 * scale * f64::from(head[c]) * (v / m - f64::from(g[c]) / far);
                along += v * cotangent[c];
            }
            // undo f̂ = f/(‖f‖ + ε)
            let radial = along / (n * (m * m));
            for c in 0..channels {
                bar[c] += (cotangent[c] / m - f64::from(f[c]) * radial) as f32;
            }
        }
    });
}

/// Adds the gradients; `y_bar` only where it is wanted (it costs as much as that of x).
///
/// # Panics
/// When a buffer does not have the size of its image.
pub fn adjoint(x: In<'_>, saved: &Saved, value_bar: f32, x_bar: &mut [f32], y_bar: Option<&mut [f32]>) {
    for (item, bar) in [Some(x_bar), y_bar].into_iter().enumerate() {
        if let Some(bar) = bar {
            assert_eq!(bar.len(), x.x.len(), "a gradient has the shape of its image");
            one(&x, saved, value_bar, item, bar);
        }
    }
}

/// The gradient of one of the two images.
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
        // undo max(·, 0)
        let (own, active) = (half(relu.len()), saved.active.as_ref().map(|a| &a[k][..]));
        par::chunks_mut(&mut bar, CHUNK, |i, bar| {
            let start = own.start + i * CHUNK;
            for (j, bar) in bar.iter_mut().enumerate() {
                let passes = active.map_or(relu[start + j] > 0.0, |a| a[start + j] == 1);
                *bar = if passes { *bar } else { 0.0 };
            }
        });
        // undo the convolution; its input is read for its size alone, since weights have no gradient
        let shape = x.shape(k, 1);
        let size = sizes[k][0] * sizes[k][1] * layer.inputs;
        let zeros = vec![0.0; size];
        let mut through = conv::InBar { x: vec![0.0; size], ..conv::InBar::default() };
        let at = conv::In { x: &zeros, weight: &layer.weight, bias: &[], shape };
        conv::adjoint(at, &bar, &mut through);
        bar = through.x;
        if let Some(p) = POOLED.iter().position(|&pooled| pooled == k) {
            // undo the maximum
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
            // undo ((2x − 1) − shift)/scale
            let inner = bar[c] / SCALE[c];
            pixel[c] += if x.rescale { 2.0 * inner } else { inner };
        }
    }
}
