//! `field.interval`: mean density over an interval in which the signed distance is linear.
//!
//! σ = ∫₀¹ D(s₀ + t(s₁ − s₀)) dt   with the density D of [`super::density`]
//!
//! With φ(d) = (1 − e⁻ᵈ)/d, lo ≤ hi the two distances and d = (hi − lo)/β:
//!
//! | lo, hi | σ·β |
//! |---|---|
//! | both ≥ 0 | ½ e^(−lo/β) φ(d) |
//! | both < 0 | 1 − ½ e^(hi/β) φ(d) |
//! | lo < 0 ≤ hi | u (1 − ½φ(p)) + v·½φ(q),   p = −lo/β, q = hi/β, u = p/(p+q), v = q/(p+q) |
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | s₀, s₁ | `sdf0`, `sdf1` | (N) | scene units, negative inside |
//! | β | `beta` | () | scene units, > 0 |
//! | σ | `sigma` | (N) | per scene unit, 0 to 1/β |
//!
//! # Rounding
//! No difference of nearly equal numbers is taken. φ and χ(d) = (1 − (1+d)e⁻ᵈ)/d² (a series below 1) are in
//! single precision; the errors, in units of the last place, are at most:
//!
//! | function | range | error |
//! |---|---|---|
//! | φ | 0 ≤ d ≤ 80 | 1.6 |
//! | χ | 0 ≤ d < 1 | 2 |
//! | χ | 1 ≤ d ≤ 80 | 6 |
//! | φ − χ | 0 ≤ d ≤ 80 | 6 |
//!
//! # Kinks and domain
//! σ is continuous and once differentiable across s = 0 and s₀ = s₁. A zero of either sign counts as outside.
//!
//! # Adjoint
//! On one side of the surface, for the near end (smaller |s|) and the far end:
//! ∂σ/∂near = −e(φ − χ)/(2β²), ∂σ/∂far = −eχ/(2β²), e = exp(−|near|/β), φ and χ of d. Across it:
//!
//! ∂σ/∂lo = −(u²χ(p) + uvφ(p) + v²(φ−χ)(q))/(2β²),   ∂σ/∂hi = −(v²χ(q) + uvφ(q) + u²(φ−χ)(p))/(2β²)
//!
//! β̄ = −Σ σ̄ (σ + s₀·∂σ/∂s₀ + s₁·∂σ/∂s₁)/β; the sum has 16 lanes in f64 ([`sum`]) and is rounded once. Nothing
//! is saved.
//!
//! Twin: `reference::field::interval`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::field::interval::forward;
//! let mut sigma = [0.0; 2];
//! forward(&[0.0, -1.0], &[0.0, 1.0], 0.5, &mut sigma);
//! assert_eq!(sigma, [1.0, 1.0]); // ½/β at the surface, and by symmetry across it
//! ```

use crate::num::lanes::{Real, f32x8};
use crate::num::{elem, par, sum};

/// Values per task; a multiple of the lane count.
const CHUNK: usize = 4096;

/// (−1)ᵏ/(k!(k+2)), the series of χ.
const CHI: [f32; 11] = [
    0.5,
    -1.0 / 3.0,
    0.125,
    -1.0 / 30.0,
    1.0 / 144.0,
    -1.0 / 840.0,
    1.0 / 5760.0,
    -1.0 / 45_360.0,
    1.0 / 403_200.0,
    -1.0 / 3_991_680.0,
    1.0 / 43_545_600.0,
];

/// Returns φ(d) = (1 − e⁻ᵈ)/d and χ(d) = (1 − (1+d)e⁻ᵈ)/d² for d ≥ 0; 1 and ½ at 0.
#[inline(always)]
pub fn moments<L: Real>(d: L) -> [L; 2] {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let rest = -elem::expm1(-d);
    let safe = L::select(d.gt(zero), d, one);
    let phi = L::select(d.gt(zero), rest / safe, one);
    let mut series = L::splat(CHI[10]);
    for k in (0..10).rev() {
        series = series * d + L::splat(CHI[k]);
    }
    let far = ((rest - d * elem::exp(-d)) / safe) / safe;
    [phi, L::select(d.lt(one), series, far)]
}

/// Returns σ, ∂σ/∂s₀ and ∂σ/∂s₁.
#[inline(always)]
pub fn interval<L: Real>(s0: L, s1: L, beta: L) -> [L; 3] {
    let (zero, half, one) = (L::splat(0.0), L::splat(0.5), L::splat(1.0));
    let is_swapped = s0.gt(s1);
    let (lo, hi) = (L::select(is_swapped, s1, s0), L::select(is_swapped, s0, s1));
    let is_outside = lo.ge(zero);
    let is_one_sided = L::or(is_outside, hi.lt(zero));
    let length = hi - lo;
    // One side: φ and χ of d, in `p`. Both sides: of p and of q.
    let near = L::select(is_one_sided, L::select(is_outside, lo, -hi), zero);
    let e = elem::exp(-(near / beta));
    let [phi_p, chi_p] = moments(L::select(is_one_sided, length, -lo) / beta);
    let [phi_q, chi_q] = moments(L::select(is_one_sided, zero, hi) / beta);
    let g = half * (e * phi_p);
    let (by_near, by_far) = (e * (phi_p - chi_p), e * chi_p);
    let safe = L::select(is_one_sided, one, length);
    let (u, v) = (-lo / safe, hi / safe);
    let across = u * (one - half * phi_p) + v * (half * phi_q);
    let by_lo = (u * u * chi_p + u * v * phi_p) + v * v * (phi_q - chi_q);
    let by_hi = (v * v * chi_q + u * v * phi_q) + u * u * (phi_p - chi_p);
    let pick = |outside: L, inside: L, across: L| {
        L::select(is_one_sided, L::select(is_outside, outside, inside), across)
    };
    let scale = -half / (beta * beta);
    let (by_lo, by_hi) = (scale * pick(by_near, by_far, by_lo), scale * pick(by_far, by_near, by_hi));
    [
        pick(g, one - g, across) / beta,
        L::select(is_swapped, by_hi, by_lo),
        L::select(is_swapped, by_lo, by_hi),
    ]
}

/// Returns eight values from `from` on; past the end the last one is repeated.
#[inline(always)]
fn load(x: &[f32], from: usize) -> f32x8 {
    match x.get(from..from + 8) {
        Some(x) => f32x8::from_fn(|l| x[l]),
        None => f32x8::from_fn(|l| x[Ord::min(from + l, x.len() - 1)]),
    }
}

/// Writes `sigma` (N).
///
/// # Panics
/// Panics if the lengths differ.
pub fn forward(sdf0: &[f32], sdf1: &[f32], beta: f32, sigma: &mut [f32]) {
    assert!(sdf0.len() == sigma.len() && sdf1.len() == sigma.len(), "the same lengths");
    par::chunks_mut(sigma, CHUNK, |c, out| {
        for (at, out) in out.chunks_mut(8).enumerate() {
            let from = c * CHUNK + 8 * at;
            let value = interval(load(sdf0, from), load(sdf1, from), f32x8::splat(beta))[0].to_array();
            out.copy_from_slice(&value[..out.len()]);
        }
    });
}

/// Adds the gradients for the cotangent `sigma_bar` (N) to those of both distances (N); returns that of β.
///
/// # Panics
/// Panics if the lengths differ.
pub fn adjoint(sdf: [&[f32]; 2], beta: f32, sigma_bar: &[f32], sdf_bar: [&mut [f32]; 2]) -> f32 {
    let n = sigma_bar.len();
    assert!(sdf.iter().all(|s| s.len() == n) && sdf_bar.iter().all(|s| s.len() == n), "the same lengths");
    let mut terms = vec![0.0; n];
    let [bar0, bar1] = sdf_bar;
    let chunks = bar0.chunks_mut(CHUNK).zip(bar1.chunks_mut(CHUNK)).zip(terms.chunks_mut(CHUNK));
    par::each(chunks.collect(), |c, ((bar0, bar1), terms)| {
        let eights = bar0.chunks_mut(8).zip(bar1.chunks_mut(8)).zip(terms.chunks_mut(8));
        for (at, ((bar0, bar1), term)) in eights.enumerate() {
            let from = c * CHUNK + 8 * at;
            let (s0, s1, g) = (load(sdf[0], from), load(sdf[1], from), load(sigma_bar, from));
            let beta = f32x8::splat(beta);
            let [sigma, by0, by1] = interval(s0, s1, beta);
            let by_beta = -(g * ((sigma + (s0 * by0 + s1 * by1)) / beta));
            bar0.iter_mut().zip((g * by0).to_array()).for_each(|(bar, g)| *bar += g);
            bar1.iter_mut().zip((g * by1).to_array()).for_each(|(bar, g)| *bar += g);
            term.copy_from_slice(&by_beta.to_array()[..term.len()]);
        }
    });
    sum::sum16_wide(&terms) as f32
}
