//! `loss.presence`: mean opacity and mean standard deviation of Gaussians, the two regularisers of MCMC
//! density control.
//!
//! L = w_o · mean σ(l) + w_s · mean e^s
//!
//! Source: Kheradmand et al. 2024, eq. 10, with means instead of sums, as in gsplat.
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | l | `opacity_logits` | (N) | any |
//! | s | `scales_log` | (N, 3) | ln of scene units, ≤ 88; the mean is over 3N numbers |
//! | w_o, w_s | `opacity_weight`, `scale_weight` | () | ≥ 0 |
//! | L | return | () | 0 if there are no Gaussians |
//!
//! # Rounding
//! σ and exp are those of `num::elem` in f32; the sums those of `num::sum::sum16_f64`; gradients are f32,
//! evaluated left to right, with the weight over the count rounded once.
//!
//! # Kinks and domain
//! There are no kinks. Above s = 88.72, e^s is ∞ in f32, and so are L and s̄.
//!
//! # Adjoint
//! l̄ += (w_o L̄/N) σ(l) (1 − σ(l)),   s̄ += (w_s L̄/(3N)) e^s. The opacities and scales are saved.
//!
//! Twin: `reference::loss::presence`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::presence::{Weights, forward};
//! let (value, _) = forward(&Weights { opacity: 1.0, scale: 1.0 }, &[0.0], &[[0.0; 3]]);
//! assert_eq!(value, 1.5);
//! ```

use crate::num::{elem, sum};

/// Weights of the two terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Weight w_o of the opacities.
    pub opacity: f64,
    /// Weight w_s of the scales.
    pub scale: f64,
}

/// Intermediate values that the adjoint needs.
#[derive(Clone, Debug, Default)]
pub struct Saved {
    /// Shape (N).
    opacities: Vec<f32>,
    /// Shape (N, 3).
    scales: Vec<f32>,
}

/// Returns L and the intermediate values that the adjoint needs.
pub fn forward(w: &Weights, opacity_logits: &[f32], scales_log: &[[f32; 3]]) -> (f64, Saved) {
    let n = opacity_logits.len();
    assert_eq!(scales_log.len(), n, "all arrays have N rows");
    if n == 0 {
        return (0.0, Saved::default());
    }
    let mut saved = Saved { opacities: vec![0.0; n], scales: vec![0.0; 3 * n] };
    elem::sigmoid_slice(opacity_logits, &mut saved.opacities);
    elem::exp_slice(scales_log.as_flattened(), &mut saved.scales);
    let mean = |x: &[f32]| sum::sum16_f64_by(x.len(), |i| f64::from(x[i])) / x.len() as f64;
    (w.opacity * mean(&saved.opacities) + w.scale * mean(&saved.scales), saved)
}

/// Adds the gradients for the cotangent `value_bar` to `logits_bar` (N) and `scales_log_bar` (N, 3).
pub fn adjoint(
    w: &Weights,
    saved: &Saved,
    value_bar: f64,
    logits_bar: &mut [f32],
    scales_log_bar: &mut [[f32; 3]],
) {
    let n = saved.opacities.len();
    let weight = (value_bar * w.opacity / n as f64) as f32;
    for (bar, &o) in logits_bar.iter_mut().zip(&saved.opacities) {
        *bar += weight * o * (1.0 - o);
    }
    let weight = (value_bar * w.scale / (3 * n) as f64) as f32;
    for (bar, &s) in scales_log_bar.as_flattened_mut().iter_mut().zip(&saved.scales) {
        *bar += weight * s;
    }
}
