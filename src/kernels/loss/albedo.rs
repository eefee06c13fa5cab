//! `loss.albedo`: mean squared difference of albedo, which is known up to a scale.
//!
//! adjusted = clamp(s·p^2.2 + (1 − O), 10⁻⁴, 1)^(1/2.2),   value = Σ (adjusted − truth)² / 3N
//!
//! The scale multiplies linear values; the background is white with the predicted opacity, as in
//! [`crate::field::composite`]. Light and albedo share a scale, so that one number per object is free
//! ([`scale`]).
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | p | `prediction` | (N, 3) or (H, W, 3) | sRGB-encoded, composited over black (Σ wᵢvᵢ); ≥ 0 |
//! | | `truth` | the same | sRGB-encoded, over white; no gradient |
//! | O | `opacity` | (N) or (H, W) | predicted, 0 to 1 |
//! | s | `scale` | () | > 0; no gradient |
//! | value | return | () | ≥ 0 |
//! | | `adjusted` | as `prediction` | for further losses, such as `loss.lpips` |
//!
//! # Rounding
//! Both powers are rounded once; s·p^2.2 + (1 − O) as written. d = adjusted − truth in f32, d² in f64, added with
//! 16 lanes ([`sum`]); one division, rounded once.
//!
//! # Kinks and domain
//! Where the linear value is below 10⁻⁴ or above 1 the gradient is 0; at both ends it is that of the power.
//!
//! # Adjoint
//! With a = adjusted and the linear value l: ā = adjusted̅ + (2v̄/3N)·d,   l̄ = ā·a/(2.2 l),
//! p̄ = l̄·s·2.2·p^1.2,   O̅ = −Σ l̄ over the channels, in order. Linear and adjusted values are saved.
//!
//! Twin: `reference::loss::albedo`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::albedo::{In, forward};
//! let x = In { prediction: &[0.5, 0.0, 1.0], truth: &[0.5, 1.0, 0.5], opacity: &[1.0], scale: 1.0 };
//! let (value, saved) = forward(&x);
//! assert_eq!((saved.adjusted[0], saved.adjusted[2]), (0.5, 1.0));
//! assert!((saved.adjusted[1] - 0.0152).abs() < 1e-4); // 10⁻⁴ to the power of 1/2.2
//! assert!((value - (0.9848_f32 * 0.9848 + 0.25) / 3.0).abs() < 1e-4);
//! ```

use crate::num::lanes::{Real, f32x8};
use crate::num::{elem, order, par, sum};

/// Exponent from encoded to linear values.
const GAMMA: f32 = 2.2;
/// Bounds of the linear value.
const BOUNDS: [f32; 2] = [1e-4, 1.0];
/// Bounds of the scale.
const SCALES: [f64; 2] = [0.1, 5.0];
/// Pixels per task; a multiple of the lane count.
const PIXELS: usize = 1024;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (N, 3).
    pub prediction: &'a [f32],
    /// Shape (N, 3).
    pub truth: &'a [f32],
    /// Shape (N).
    pub opacity: &'a [f32],
    /// Scale s of linear values.
    pub scale: f32,
}

/// Results that the adjoint needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saved {
    /// Adjusted prediction, shape (N, 3).
    pub adjusted: Vec<f32>,
    /// Linear value before it is limited, shape (N, 3).
    pub linear: Vec<f32>,
}

impl In<'_> {
    fn check(&self) {
        let n = self.opacity.len();
        assert!(
            n > 0 && self.prediction.len() == 3 * n && self.truth.len() == 3 * n,
            "three values per pixel"
        );
    }
}

/// Returns xʸ of every entry.
fn powers(x: &[f32], y: f32) -> Vec<f32> {
    let mut out = vec![0.0; x.len()];
    par::chunks_mut(&mut out, 3 * PIXELS, |c, out| {
        for (at, out) in out.chunks_mut(8).enumerate() {
            let from = 3 * PIXELS * c + 8 * at;
            let x = f32x8::from_fn(|l| x[Ord::min(from + l, x.len() - 1)]);
            out.copy_from_slice(&elem::pow(x, f32x8::splat(y)).to_array()[..out.len()]);
        }
    });
    out
}

/// Returns the scale s = clamp(mean of truth / mean of prediction, 0.1, 5) over the kept pixels, both linear; 1 if
/// no pixel is kept. `kept` (N) is 0 or 1. The sums have 16 lanes in f64.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn scale(prediction: &[f32], truth: &[f32], kept: &[f32]) -> f32 {
    let n = prediction.len();
    assert!(n == truth.len() && n == 3 * kept.len(), "three values per pixel");
    let mean = |x: &[f32]| {
        let linear = powers(x, GAMMA);
        sum::sum16_f64_by(n, |i| if kept[i / 3] == 0.0 { 0.0 } else { f64::from(linear[i]) })
    };
    if kept.iter().all(|k| *k == 0.0) {
        return 1.0;
    }
    let (of_truth, of_prediction) = (mean(truth), mean(prediction));
    if of_prediction > 0.0 {
        order::clamp(of_truth / of_prediction, SCALES[0], SCALES[1]) as f32
    } else {
        SCALES[1] as f32
    }
}

/// Returns the value and the results that the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape, or there is no pixel.
pub fn forward(x: &In<'_>) -> (f32, Saved) {
    x.check();
    let mut linear = powers(x.prediction, GAMMA);
    for (l, o) in linear.as_chunks_mut::<3>().0.iter_mut().zip(x.opacity) {
        *l = l.map(|l| x.scale * l + (1.0 - o));
    }
    let limited: Vec<f32> = linear.iter().map(|l| order::clamp(*l, BOUNDS[0], BOUNDS[1])).collect();
    let adjusted = powers(&limited, 1.0 / GAMMA);
    let n = adjusted.len();
    let total = sum::sum16_f64_by(n, |i| {
        let d = f64::from(adjusted[i] - x.truth[i]);
        d * d
    });
    ((total / n as f64) as f32, Saved { adjusted, linear })
}

/// Adds the gradients for the cotangents of the value and of `adjusted` (N, 3; empty for 0) to `prediction_bar`
/// (N, 3) and `opacity_bar` (N).
///
/// # Panics
/// Panics under the conditions of [`forward`].
pub fn adjoint(
    x: &In<'_>,
    saved: &Saved,
    value_bar: f32,
    adjusted_bar: &[f32],
    prediction_bar: &mut [f32],
    opacity_bar: &mut [f32],
) {
    x.check();
    let n = x.prediction.len();
    assert!(adjusted_bar.is_empty() || adjusted_bar.len() == n, "one cotangent per value");
    assert!(prediction_bar.len() == n && opacity_bar.len() == x.opacity.len(), "gradients like the inputs");
    let by_square = (2.0 * f64::from(value_bar) / n as f64) as f32;
    let slopes = powers(x.prediction, GAMMA - 1.0);
    let linear_bar = |i: usize| {
        let (a, l) = (saved.adjusted[i], saved.linear[i]);
        let given = adjusted_bar.get(i).copied().unwrap_or(0.0);
        if !(BOUNDS[0]..=BOUNDS[1]).contains(&l) {
            return 0.0;
        }
        (given + by_square * (a - x.truth[i])) * (a / (GAMMA * l))
    };
    par::chunks_mut2(prediction_bar, 3 * PIXELS, opacity_bar, PIXELS, |c, prediction, opacity| {
        for (r, (prediction, opacity)) in prediction.chunks_exact_mut(3).zip(opacity).enumerate() {
            let at = 3 * (c * PIXELS + r);
            let g: [f32; 3] = std::array::from_fn(|k| linear_bar(at + k));
            for k in 0..3 {
                prediction[k] += g[k] * (x.scale * (GAMMA * slopes[at + k]));
            }
            *opacity -= (g[0] + g[1]) + g[2];
        }
    });
}
