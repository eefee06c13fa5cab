//! `field.composite`: values along rays, composited over a background.
//!
//! τᵢ = σᵢδᵢ,   wᵢ = Tᵢ(1 − e^(−τᵢ)),   Tᵢ₊₁ = Tᵢ e^(−τᵢ),   T₀ = 1,   O = Σ wᵢ,   value = Σ wᵢvᵢ + T·background
//! with the last T, which is 1 − O (Max 1995; NeRF, Mildenhall et al. 2020)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | σ | `sigma` | (N, S) | ≥ 0, per scene unit |
//! | δ | `delta` | (N, S) | ≥ 0, scene units |
//! | v | `values` | (N, S, C) | any |
//! | | `background` | (C) | any |
//! | | `value` | (N, C) | |
//! | O | `opacity` | (N) | 0 to 1 |
//! | w | `weights` | (N, S) | no cotangent |
//!
//! # Rounding
//! 1 − e^(−τ) is −expm1(−τ). T is a left product, O and Σ wv are left folds from +0 over the samples. The
//! weight of the background is T: 1 − O would be a difference of nearly equal numbers behind opaque samples.
//!
//! # Kinks and domain
//! The function is smooth. It is not evaluated beyond the given samples: no early stop.
//!
//! # Adjoint
//! w̄ᵢ = Σ_c value̅_c (vᵢ_c − background_c) + O̅,   τ̄ᵢ = w̄ᵢTᵢ₊₁ − Σ_{j>i} w̄ⱼwⱼ,   σ̄ = τ̄δ,   δ̄ = τ̄σ,   v̄ᵢ = wᵢ·value̅,
//! background̅ = Σ T·value̅ over rays
//!
//! The sum over channels is a left fold, to which O̅ is added; that over later samples a left fold from the last
//! one; that over rays has 16 lanes in f64 ([`sum`]) and is rounded once. T after every sample and w are saved.
//!
//! Twin: `reference::field::composite`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::field::composite::{In, forward};
//! // two samples that each pass half of the light
//! let half = std::f32::consts::LN_2;
//! let x = In { sigma: &[half; 2], delta: &[1.0; 2], values: &[4.0, 8.0], background: &[16.0], samples: 2 };
//! let out = forward(&x);
//! assert_eq!(out.weights, [0.5, 0.25]);
//! assert_eq!((out.value[0], out.opacity[0]), (8.0, 0.75)); // 2 + 2 + 4
//! ```

use crate::num::{elem, par, sum};

/// Rays per task.
const ROWS: usize = 16;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (N, S).
    pub sigma: &'a [f32],
    /// Shape (N, S).
    pub delta: &'a [f32],
    /// Shape (N, S, C).
    pub values: &'a [f32],
    /// Shape (C).
    pub background: &'a [f32],
    /// Samples per ray S, at least 1.
    pub samples: usize,
}

/// Outputs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Out {
    /// Shape (N, C).
    pub value: Vec<f32>,
    /// Shape (N).
    pub opacity: Vec<f32>,
    /// Shape (N, S).
    pub weights: Vec<f32>,
    /// Transmittance after every sample, shape (N, S).
    pub transmittance: Vec<f32>,
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (N, S).
    pub sigma: Vec<f32>,
    /// Shape (N, S).
    pub delta: Vec<f32>,
    /// Shape (N, S, C).
    pub values: Vec<f32>,
    /// Shape (C).
    pub background: Vec<f32>,
}

impl In<'_> {
    /// Returns the numbers of rays and of channels.
    fn sizes(&self) -> [usize; 2] {
        let (n, channels) = (self.sigma.len() / self.samples, self.background.len());
        assert!(self.samples > 0 && self.sigma.len() == n * self.samples, "complete rays");
        assert_eq!(self.delta.len(), self.sigma.len(), "one length per sample");
        assert_eq!(self.values.len(), self.sigma.len() * channels, "C values per sample");
        [n, channels]
    }
}

/// Writes weights and the transmittance after every sample of one ray; returns the opacity.
pub fn weigh(sigma: &[f32], delta: &[f32], weights: &mut [f32], transmittance: &mut [f32]) -> f32 {
    let depth: Vec<f32> = sigma.iter().zip(delta).map(|(s, d)| -(s * d)).collect();
    elem::expm1_slice(&depth, weights);
    elem::exp_slice(&depth, transmittance);
    let (mut t, mut opacity) = (1.0, 0.0);
    for (w, e) in weights.iter_mut().zip(transmittance) {
        *w = t * -*w;
        t *= *e;
        *e = t;
        opacity += *w;
    }
    opacity
}

/// Writes Σ wv + T·background of one ray with the last transmittance T; `values` is (S, C).
pub fn blend(weights: &[f32], transmittance: f32, values: &[f32], background: &[f32], value: &mut [f32]) {
    value.fill(0.0);
    for (w, row) in weights.iter().zip(values.chunks_exact(Ord::max(background.len(), 1))) {
        value.iter_mut().zip(row).for_each(|(sum, v)| *sum += w * v);
    }
    value.iter_mut().zip(background).for_each(|(sum, b)| *sum += transmittance * b);
}

/// Returns w̄ of one sample with the values `row`.
#[inline(always)]
pub fn weight_bar(row: &[f32], background: &[f32], value_bar: &[f32], opacity_bar: f32) -> f32 {
    let terms = row.iter().zip(background).zip(value_bar);
    terms.fold(0.0, |sum, ((v, b), g)| sum + g * (v - b)) + opacity_bar
}

/// Replaces w̄ of the samples of one ray by τ̄.
pub fn depth_bar(weights: &[f32], transmittance: &[f32], bar: &mut [f32]) {
    let mut later = 0.0;
    for ((bar, w), t) in bar.iter_mut().zip(weights).zip(transmittance).rev() {
        let of_weight = *bar;
        *bar = of_weight * t - later;
        later += of_weight * w;
    }
}

/// Returns values, opacities, weights and transmittances.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>) -> Out {
    let ([n, channels], s) = (x.sizes(), x.samples);
    let mut out = Out {
        value: vec![0.0; n * channels],
        opacity: vec![0.0; n],
        weights: vec![0.0; n * s],
        transmittance: vec![0.0; n * s],
    };
    let (weights, transmittance) = (out.weights.chunks_mut(ROWS * s), out.transmittance.chunks_mut(ROWS * s));
    let tasks: Vec<_> = weights.zip(transmittance).zip(out.opacity.chunks_mut(ROWS)).collect();
    par::each(tasks, |c, ((weights, transmittance), opacity)| {
        for (r, opacity) in opacity.iter_mut().enumerate() {
            let (at, own) = ((c * ROWS + r) * s, r * s..(r + 1) * s);
            let (sigma, delta) = (&x.sigma[at..at + s], &x.delta[at..at + s]);
            *opacity = weigh(sigma, delta, &mut weights[own.clone()], &mut transmittance[own]);
        }
    });
    if channels > 0 {
        let Out { value, weights, transmittance, .. } = &mut out;
        par::chunks_mut(value, ROWS * channels, |c, value| {
            for (r, value) in value.chunks_exact_mut(channels).enumerate() {
                let ray = c * ROWS + r;
                let (own, values) = (&weights[ray * s..][..s], &x.values[ray * s * channels..]);
                blend(own, transmittance[ray * s + s - 1], &values[..s * channels], x.background, value);
            }
        });
    }
    out
}

/// Adds the gradients for the cotangents `value_bar` (N, C) and `opacity_bar` (N) to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, out: &Out, value_bar: &[f32], opacity_bar: &[f32], x_bar: &mut InBar) {
    let ([n, channels], s) = (x.sizes(), x.samples);
    assert!(value_bar.len() == n * channels && opacity_bar.len() == n, "cotangents of every ray");
    let mut depth = vec![0.0; n * s];
    par::chunks_mut(&mut depth, s, |ray, bar| {
        let (span, g) = (ray * s..(ray + 1) * s, &value_bar[ray * channels..][..channels]);
        for (i, bar) in bar.iter_mut().enumerate() {
            let row = &x.values[(ray * s + i) * channels..][..channels];
            *bar = weight_bar(row, x.background, g, opacity_bar[ray]);
        }
        depth_bar(&out.weights[span.clone()], &out.transmittance[span], bar);
    });
    let add = |bar: &mut [f32], factor: &[f32]| {
        bar.iter_mut().zip(&depth).zip(factor).for_each(|((bar, g), x)| *bar += g * x);
    };
    add(&mut x_bar.sigma, x.delta);
    add(&mut x_bar.delta, x.sigma);
    if channels > 0 {
        par::chunks_mut(&mut x_bar.values, s * channels, |ray, bar| {
            let g = &value_bar[ray * channels..][..channels];
            for (bar, w) in bar.chunks_exact_mut(channels).zip(&out.weights[ray * s..]) {
                bar.iter_mut().zip(g).for_each(|(bar, g)| *bar += w * g);
            }
        });
    }
    for (c, bar) in x_bar.background.iter_mut().enumerate() {
        let term =
            |ray: usize| f64::from(out.transmittance[(ray + 1) * s - 1] * value_bar[ray * channels + c]);
        *bar += sum::sum16_f64_by(n, term) as f32;
    }
}
