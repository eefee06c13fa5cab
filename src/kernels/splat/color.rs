//! `splat.color`: view-dependent colour of a Gaussian from spherical harmonics.
//!
//! c = max(0, ½ + Σₖ Yₖ(d) shₖ),   d = (μ − o) / ‖μ − o‖,   o = −Rᵀt           (3DGS 2023, §4)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | μ | `means` | (N, 3) | scene units |
//! | sh | `sh` | (N, K, 3) | K ≥ (degree+1)²; bands above `degree` are not read |
//! | o | `camera.center()` | (3) | scene units |
//! | c | `colors` | (N, 3) | sRGB-encoded, ≥ 0, not capped |
//!
//! # Rounding
//! ‖μ−o‖² is a left fold; d is computed by division; the sum is a left fold over k ascending from k = 0,
//! product then sum; ½ is added last.
//!
//! # Kinks and domain
//! Where ½ + Σ < 0, the colour and its gradient are 0; at equality the unclamped branch is taken (the mask in
//! the plan stores the decision). μ = o has no direction: d = 0 there, with zero gradient, so only band 0
//! contributes. Coefficients above `degree` have exactly zero gradient.
//!
//! # Adjoint
//! sh̄ₖ = Yₖ c̄; d̄ = Σₖ ∂Yₖ/∂d (shₖ·c̄); μ̄ = (d̄ − d (d·d̄)) / ‖μ − o‖. d and Y are recomputed; the clamp
//! is in the plan.
//!
//! Twin: `reference::splat::color`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::math::sh::C0;
//! use lastlight::splat::color::{Sh, forward};
//! let sh = Sh { values: &[1.0, 0.0, -2.0], coefficients: 1, degree: 0 };
//! let (mut colors, mut mask) = ([[0.0; 3]], [[0; 3]]);
//! forward(&[[0.0, 0.0, 4.0]], sh, [0.0; 3], None, &mut colors, &mut mask);
//! assert_eq!(colors, [[C0 + 0.5, 0.5, 0.0]]); // ½ + Y₀, ½, and ½ − 2·Y₀ < 0, which is clamped
//! assert_eq!(mask, [[1, 1, 0]]);
//! ```

use super::covariance::{gather, scatter, scatter_add};
use crate::math::sh::{basis, basis_adjoint};
use crate::num::lanes::{Real, f32x8};

/// Spherical-harmonics coefficients of N Gaussians.
#[derive(Clone, Copy, Debug)]
pub struct Sh<'a> {
    /// Coefficients, shape (N, K, 3), row-major.
    pub values: &'a [f32],
    /// Number of coefficients, K.
    pub coefficients: usize,
    /// Degree of the expansion; bands 0..=degree are used.
    pub degree: usize,
}

impl<'a> Sh<'a> {
    /// Returns the rows `from..to`.
    #[must_use]
    pub fn rows(self, from: usize, to: usize) -> Self {
        let w = 3 * self.coefficients;
        Self { values: &self.values[from * w..to * w], ..self }
    }

    fn used(self) -> usize {
        (self.degree + 1) * (self.degree + 1)
    }

    /// Returns coefficient `k`, channel `c` of eight consecutive rows; rows past the end repeat the last one.
    #[inline(always)]
    fn gather(self, at: usize, n: usize, k: usize, c: usize) -> f32x8 {
        f32x8::from_fn(|l| {
            self.values[(crate::num::order::min(at + l, n - 1) * self.coefficients + k) * 3 + c]
        })
    }
}

/// Returns the unit direction from the camera centre and 1/‖μ−o‖ (both 0 at the centre itself).
#[inline(always)]
fn direction(mean: [f32x8; 3], center: [f32; 3]) -> ([f32x8; 3], f32x8) {
    let v: [f32x8; 3] = std::array::from_fn(|i| mean[i] - f32x8::splat(center[i]));
    let len = ((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]).sqrt();
    let zero = f32x8::splat(0.0);
    let there = Real::gt(len, zero);
    let safe = Real::select(there, len, f32x8::splat(1.0));
    (v.map(|x| x / safe), Real::select(there, f32x8::splat(1.0) / safe, zero))
}

/// Computes `colors` (N, 3) and the clamp mask (N, 3; 1 = unclamped). `frozen` replaces the comparison by a
/// stored mask.
pub fn forward(
    means: &[[f32; 3]],
    sh: Sh<'_>,
    center: [f32; 3],
    frozen: Option<&[[u8; 3]]>,
    colors: &mut [[f32; 3]],
    mask: &mut [[u8; 3]],
) {
    let n = means.len();
    let zero = f32x8::splat(0.0);
    for at in (0..n).step_by(8) {
        let (d, _) = direction(gather(means, at), center);
        let y = basis(sh.degree, d);
        let raw: [f32x8; 3] = std::array::from_fn(|c| {
            let mut sum = y[0] * sh.gather(at, n, 0, c);
            for k in 1..sh.used() {
                sum = sum + y[k] * sh.gather(at, n, k, c);
            }
            sum + f32x8::splat(0.5)
        });
        for l in 0..Ord::min(8, n - at) {
            mask[at + l] = match frozen {
                Some(m) => m[at + l],
                None => std::array::from_fn(|c| u8::from(raw[c].lane(l) >= 0.0)),
            };
        }
        let keep: [f32x8; 3] =
            std::array::from_fn(|c| f32x8::from_fn(|l| f32::from(mask[Ord::min(at + l, n - 1)][c])));
        scatter(colors, at, std::array::from_fn(|c| Real::select(Real::gt(keep[c], zero), raw[c], zero)));
    }
}

/// Adds the gradients to `means_bar` (N, 3) and `sh_bar` (N, K, 3).
pub fn adjoint(
    means: &[[f32; 3]],
    sh: Sh<'_>,
    center: [f32; 3],
    mask: &[[u8; 3]],
    colors_bar: &[[f32; 3]],
    means_bar: &mut [[f32; 3]],
    sh_bar: &mut [f32],
) {
    let n = means.len();
    let used = sh.used();
    let zero = f32x8::splat(0.0);
    for at in (0..n).step_by(8) {
        let (d, inv_len) = direction(gather(means, at), center);
        let y = basis(sh.degree, d);
        // Adjoint of c = max(0, raw).
        let g: [f32x8; 3] = std::array::from_fn(|c| {
            f32x8::from_fn(|l| {
                let r = Ord::min(at + l, n - 1);
                if mask[r][c] == 1 { colors_bar[r][c] } else { 0.0 }
            })
        });
        // Adjoint of raw = ½ + Σ y_k sh_k.
        let mut y_bar = [zero; 16];
        for k in 0..used {
            let s: [f32x8; 3] = std::array::from_fn(|c| sh.gather(at, n, k, c));
            y_bar[k] = (s[0] * g[0] + s[1] * g[1]) + s[2] * g[2];
        }
        let (ya, ga) = (y.map(f32x8::to_array), g.map(f32x8::to_array));
        let width = 3 * sh.coefficients;
        for (l, row) in sh_bar[at * width..].chunks_mut(width).take(8).enumerate() {
            let gl = [ga[0][l], ga[1][l], ga[2][l]];
            for (k, out) in row.as_chunks_mut::<3>().0.iter_mut().take(used).enumerate() {
                for c in 0..3 {
                    out[c] += ya[k][l] * gl[c];
                }
            }
        }
        // Adjoint of d = v / ‖v‖.
        let d_bar = basis_adjoint(sh.degree, d, &y_bar);
        let radial = (d[0] * d_bar[0] + d[1] * d_bar[1]) + d[2] * d_bar[2];
        scatter_add(means_bar, at, std::array::from_fn(|i| (d_bar[i] - d[i] * radial) * inv_len));
    }
}
