//! `shade.envmap`: radiance of a surface point under a complete environment map, with direct light only and
//! without shadows.
//!
//! L = Σᵢⱼ Eᵢⱼ · f(n, v, lᵢⱼ) · max(n·lᵢⱼ, 0) · Δωᵢ          Δωᵢ = (2π/W)(cos θ_top − cos θ_bottom)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | n | `normal` | (P, 3) | any length; normalised here; 0 reflects nothing |
//! | v | `view` | (P, 3) | unit, towards the eye; no gradient |
//! | a, r, m | `albedo`, `roughness`, `metallic` | (P, 3), (P), (P) | as in [`super::ggx`] |
//! | E | `env` | (H, W, 3) | linear radiance |
//! | l | texel centre | (3) | u = (j+½)/W, v = (i+½)/H in the orientation of [`crate::scene::light`] |
//! | L | `radiance` | (P, 3) | linear |
//!
//! The sum is a midpoint rule with exact solid angles: a lobe narrower than a texel (α below about π/H) can
//! fall between the centres. Use path tracing ([`super::render`]) or a finer map for smooth metals.
//!
//! # Rounding
//! Directions and Δω are computed in f64 and rounded once. A term is (f·(n·l·Δω))·E per channel; the sum is a
//! left fold over texels in row-major order, in f64 and rounded once (in f32 a map of a million texels would
//! drift by 3e-4); terms of texels behind the surface are +0 and skipped. Ē: per texel a left fold over each
//! block of 64 points, the blocks by the pairwise tree. Gradients of points: in f32 over 32 texels in that
//! order, in f64 over those sums and in later steps (in f32 throughout, half a million texels would cost 7e-3
//! of m̄, a difference of sums), rounded once.
//!
//! # Kinks and domain
//! As in [`super::ggx`]; at n·l = 0 a term is continuous with a kink, and has gradient 0.
//!
//! # Adjoint
//! f̄ = L̄·E·n·l·Δω and n̄·l = Σ L̄·E·f·Δω per texel through [`super::ggx::PointBar`], summed over texels in
//! row-major order; Ē = Σ_p L̄·f·n·l·Δω. Nothing is saved. All inputs except `view` have gradients.
//!
//! Twin: `reference::shade::envmap`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::shade::envmap::{In, forward};
//! // a rough white metal that faces +z under a constant map of 2×4 texels
//! let (up, white, env) = ([[0.0, 0.0, 1.0]], [[1.0; 3]], [[1.0; 3]; 8]);
//! let x = In {
//!     normal: &up,
//!     view: &up,
//!     albedo: &white,
//!     roughness: &[1.0],
//!     metallic: &[1.0],
//!     env: &env,
//!     height: 2,
//!     width: 4,
//! };
//! let mut radiance = [[0.0; 3]];
//! forward(x, &mut radiance);
//! // four texels at 45°: Δω = π/2, f = D·V·F = (1/π)·(½/(√½ + 1))·1, L = 4·f·√½·π/2 = √2 − 1
//! assert!((radiance[0][0] - (2.0_f32.sqrt() - 1.0)).abs() < 2e-6);
//! ```

use super::environment::{solid_angles, texel_centers};
use super::ggx::{Bar8, InBar, Material, Point, PointBar, Sums, materials8, rows8, scatter_bar};
use super::vector::{dot, mul, scale, unit};
use crate::num::lanes::{Real, f32x8};
use crate::num::{par, sum};

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (P, 3).
    pub normal: &'a [[f32; 3]],
    /// Shape (P, 3).
    pub view: &'a [[f32; 3]],
    /// Shape (P, 3).
    pub albedo: &'a [[f32; 3]],
    /// Shape (P).
    pub roughness: &'a [f32],
    /// Shape (P).
    pub metallic: &'a [f32],
    /// Shape (H, W, 3).
    pub env: &'a [[f32; 3]],
    /// Height of the map, H.
    pub height: usize,
    /// Width of the map, W.
    pub width: usize,
}

impl In<'_> {
    fn check(&self) {
        let p = self.normal.len();
        let rows = [self.view.len(), self.albedo.len(), self.roughness.len(), self.metallic.len()];
        assert!(rows.iter().all(|n| *n == p), "every per-point argument has P rows");
        assert_eq!(self.env.len(), self.width * self.height, "the map has H·W texels");
    }

    /// Returns the centre and the solid angle of every texel.
    fn texels(&self) -> Vec<([f32; 3], f32)> {
        let omega = solid_angles(self.width, self.height).0;
        let centers = texel_centers(self.width, self.height);
        centers.into_iter().enumerate().map(|(t, d)| (d, omega[t / self.width] as f32)).collect()
    }

    /// Returns eight points: unit normal, ‖N‖, material, and the values that do not depend on the light.
    #[inline(always)]
    fn points8(&self, at: usize) -> (Point<f32x8>, Material<f32x8>, f32x8) {
        let m = materials8(self.albedo, self.roughness, self.metallic, at);
        let (n, length) = unit(rows8(self.normal, at));
        (Point::new(n, rows8(self.view, at), &m), m, length)
    }
}

/// Points per task and per left fold of Ē, where the value is part of the definition; a multiple of the lane
/// count.
const BLOCK: usize = 64;

/// Number of texels whose gradients are added in single precision; the value is part of the definition.
const FEW: usize = 32;

/// Computes `radiance` (P, 3).
pub fn forward(x: In<'_>, radiance: &mut [[f32; 3]]) {
    x.check();
    assert_eq!(radiance.len(), x.normal.len(), "radiance has P rows");
    let texels = x.texels();
    par::chunks_mut(radiance, BLOCK, |c, out| {
        for at in (0..out.len()).step_by(8) {
            let (point, _, _) = x.points8(c * BLOCK + at);
            let mut sum = [[0.0_f64; 8]; 3];
            for ((light, omega), e) in texels.iter().zip(x.env) {
                let light = light.map(f32x8::splat);
                if !lit(&point, light) {
                    continue;
                }
                let facet = point.facet(light);
                let weight = facet.nl * f32x8::splat(*omega);
                let term = mul(scale(point.brdf(&facet), weight), e.map(f32x8::splat));
                for k in 0..3 {
                    let term = Real::select(facet.on, term[k], f32x8::splat(0.0)).to_array();
                    for l in 0..8 {
                        sum[k][l] += f64::from(term[l]);
                    }
                }
            }
            for (l, o) in out[at..].iter_mut().take(8).enumerate() {
                *o = [sum[0][l] as f32, sum[1][l] as f32, sum[2][l] as f32];
            }
        }
    });
}

/// Whether any lane is lit from a direction.
#[inline(always)]
fn lit(point: &Point<f32x8>, light: [f32x8; 3]) -> bool {
    f32x8::bits(Real::gt(dot(point.normal, light), f32x8::splat(0.0))) != 0
}

/// Adds the gradients to `x_bar` and `env_bar` (H, W, 3).
pub fn adjoint(x: In<'_>, radiance_bar: &[[f32; 3]], x_bar: &mut InBar, env_bar: &mut [[f32; 3]]) {
    x.check();
    let p = x.normal.len();
    assert!(
        radiance_bar.len() == p && x_bar.normal.len() == p,
        "the cotangent and the gradients have P rows"
    );
    assert_eq!(env_bar.len(), x.env.len(), "the gradient of the map has H·W texels");
    let texels = x.texels();
    let bars = par::map(p.div_ceil(8), |g| points_bar(x, &texels, radiance_bar, 8 * g));
    for (g, bar) in bars.into_iter().enumerate() {
        scatter_bar(&bar, 8 * g, x_bar);
    }
    map_bar(x, &texels, radiance_bar, env_bar);
}

/// Returns the gradients of eight points: single precision over a few texels, double precision over those
/// sums.
fn points_bar(x: In<'_>, texels: &[([f32; 3], f32)], radiance_bar: &[[f32; 3]], at: usize) -> Bar8 {
    let (point, m, length) = x.points8(at);
    let g = rows8(radiance_bar, at);
    let mut sums = Sums::default();
    for (texels, env) in texels.chunks(FEW).zip(x.env.chunks(FEW)) {
        let mut bar = PointBar::zeros(f32x8::splat(0.0));
        let mut any = false;
        for ((light, omega), e) in texels.iter().zip(env) {
            let light = light.map(f32x8::splat);
            if !lit(&point, light) {
                continue;
            }
            any = true;
            let facet = point.facet(light);
            let omega = f32x8::splat(*omega);
            // Adjoint of term = (f·(n·l·Δω))·E.
            let ge = mul(g, e.map(f32x8::splat));
            let nl_bar = dot(ge, point.brdf(&facet)) * omega;
            bar.add(&point, &m, light, &facet, scale(ge, facet.nl * omega), nl_bar);
        }
        if any {
            sums.add(&bar);
        }
    }
    sums.finish(&point, &m, length)
}

/// Computes the gradient of the map, eight texels at a time.
fn map_bar(x: In<'_>, texels: &[([f32; 3], f32)], radiance_bar: &[[f32; 3]], env_bar: &mut [[f32; 3]]) {
    let points: Vec<Point<f32>> = (0..x.normal.len())
        .map(|p| {
            let m = Material { albedo: x.albedo[p], roughness: x.roughness[p], metallic: x.metallic[p] };
            Point::new(unit(x.normal[p]).0, x.view[p], &m)
        })
        .collect();
    par::chunks_mut(env_bar, 8, |c, out| {
        let pick = |l: usize| &texels[Ord::min(8 * c + l, texels.len() - 1)];
        let light: [f32x8; 3] = std::array::from_fn(|k| f32x8::from_fn(|l| pick(l).0[k]));
        let omega = f32x8::from_fn(|l| pick(l).1);
        let zero = f32x8::splat(0.0);
        let mut blocks: [Vec<f32x8>; 3] = Default::default();
        for (points, bars) in points.chunks(BLOCK).zip(radiance_bar.chunks(BLOCK)) {
            let mut sum = [zero; 3];
            for (point, g) in points.iter().zip(bars) {
                let point = point.wide();
                if !lit(&point, light) {
                    continue;
                }
                let facet = point.facet(light);
                let term = mul(scale(point.brdf(&facet), facet.nl * omega), g.map(f32x8::splat));
                for k in 0..3 {
                    sum[k] = sum[k] + Real::select(facet.on, term[k], zero);
                }
            }
            for k in 0..3 {
                blocks[k].push(sum[k]);
            }
        }
        let total = blocks.map(|b| sum::tree(b).to_array());
        for (l, o) in out.iter_mut().enumerate() {
            for k in 0..3 {
                o[k] += total[k][l];
            }
        }
    });
}
