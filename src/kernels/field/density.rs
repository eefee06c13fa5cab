//! `field.density`: density of a volume whose surface is the zero set of a signed distance.
//!
//! e = exp(−|s|/β),   σ = ½e/β for s > 0,   (1 − ½e)/β for s ≤ 0                 (VolSDF, Yariv et al. 2021)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | s | `sdf` | (N) | scene units, negative inside |
//! | β | `beta` | () | scene units, > 0 |
//! | σ | `sigma` | (N) | per scene unit, 0 to 1/β |
//!
//! # Rounding
//! |s|/β is one division; e is rounded once; then the products and quotients as written. No branch overflows.
//!
//! # Kinks and domain
//! σ is continuously differentiable; at s = 0, of either sign, σ = ½/β and its slope is that of the formula.
//!
//! # Adjoint
//! ∂σ/∂s = −e/(2β²) everywhere;   s̄ = σ̄·∂σ/∂s;   β̄ = −Σ σ̄ (σ + s·∂σ/∂s)/β
//!
//! The sum has 16 lanes in f64 ([`sum`]) and is rounded once. Nothing is saved.
//!
//! Twin: `reference::field::density`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::field::density::forward;
//! let mut sigma = [0.0; 3];
//! forward(&[0.0, -100.0, 100.0], 0.25, &mut sigma);
//! assert_eq!(sigma, [2.0, 4.0, 0.0]);
//! ```

use crate::num::lanes::{Real, f32x8};
use crate::num::{elem, par, sum};

/// Values per task; a multiple of the lane count.
const CHUNK: usize = 4096;

/// Returns σ and ∂σ/∂s.
#[inline(always)]
pub fn density<L: Real>(s: L, beta: L) -> [L; 2] {
    let (one, half) = (L::splat(1.0), L::splat(0.5));
    let e = elem::exp(-(s.abs() / beta));
    let sigma = L::select(s.gt(L::splat(0.0)), half * e, one - half * e) / beta;
    [sigma, -(half * e) / (beta * beta)]
}

/// Writes `sigma` (N).
///
/// # Panics
/// Panics if the lengths differ.
pub fn forward(sdf: &[f32], beta: f32, sigma: &mut [f32]) {
    assert_eq!(sdf.len(), sigma.len(), "sdf and sigma have the same length");
    par::chunks_mut(sigma, CHUNK, |c, out| {
        let from = &sdf[c * CHUNK..][..out.len()];
        let ((s8, s1), (o8, o1)) = (from.as_chunks::<8>(), out.as_chunks_mut::<8>());
        for (s, o) in s8.iter().zip(o8) {
            *o = density(f32x8::new(*s), f32x8::splat(beta))[0].to_array();
        }
        for (s, o) in s1.iter().zip(o1) {
            *o = density(*s, beta)[0];
        }
    });
}

/// Adds the gradients for the cotangent `sigma_bar` (N) to `sdf_bar` (N); returns that of β.
///
/// # Panics
/// Panics if the lengths differ.
pub fn adjoint(sdf: &[f32], beta: f32, sigma_bar: &[f32], sdf_bar: &mut [f32]) -> f32 {
    assert!(sdf.len() == sigma_bar.len() && sdf.len() == sdf_bar.len(), "the same lengths");
    let mut terms = vec![0.0; sdf.len()];
    par::chunks_mut2(sdf_bar, CHUNK, &mut terms, CHUNK, |c, bars, terms| {
        for (at, (bar, term)) in bars.chunks_mut(8).zip(terms.chunks_mut(8)).enumerate() {
            let from = c * CHUNK + 8 * at;
            let load = |x: &[f32]| f32x8::from_fn(|l| x[Ord::min(from + l, x.len() - 1)]);
            let (s, g, beta) = (load(sdf), load(sigma_bar), f32x8::splat(beta));
            let [sigma, by_s] = density(s, beta);
            let (s_bar, by_beta) = ((g * by_s).to_array(), (-(g * ((sigma + s * by_s) / beta))).to_array());
            bar.iter_mut().zip(s_bar).for_each(|(bar, g)| *bar += g);
            term.copy_from_slice(&by_beta[..term.len()]);
        }
    });
    sum::sum16_wide(&terms) as f32
}
