//! The camera's map t → u from camera space to pixels, and its Jacobian J = ∂u/∂t, forward and adjoint.
//!
//! The equations are in the documentation of [`project`](super). ũ = t_x/z and ṽ = t_y/z are the tangents,
//! which the pinhole camera limits in J but not in u.

use super::lens::Lens;
use crate::num::lanes::{Real, f32x8};
use crate::scene::camera::Model;

/// The map at eight points.
pub(super) struct Linearization {
    /// Point t, scene units.
    pub(super) t: [f32x8; 3],
    /// Reciprocal 1/t_z.
    inv_z: f32x8,
    /// Limited tangents t_x/z, t_y/z; pinhole only.
    tangent: [f32x8; 2],
    /// Sign of the active tangent limit per axis, 0 = free.
    pub(super) limited: [f32x8; 2],
    /// Terms g, G, H of [`fisheye_terms`]; fisheye only.
    fish: [f32x8; 3],
    /// Jacobian J, pixels per scene unit.
    pub(super) jac: [[f32x8; 3]; 2],
}

impl Linearization {
    /// Returns u in pixels.
    #[inline(always)]
    pub(super) fn mean_px(&self, lens: &Lens) -> [f32x8; 2] {
        std::array::from_fn(|i| {
            let (f, c) = (f32x8::splat(lens.focal[i]), f32x8::splat(lens.center[i]));
            match lens.model {
                Model::Pinhole => (f * self.t[i]) * self.inv_z + c,
                Model::Orthographic => f * self.t[i] + c,
                Model::Fisheye => (f * self.t[i]) * self.fish[0] + c,
            }
        })
    }
}

/// Cotangents of the map at eight points.
pub(super) struct LinearizationBar {
    /// Cotangent ū.
    pub(super) mean_px: [f32x8; 2],
    /// Cotangent of the depth t_z as a separate output.
    pub(super) z: f32x8,
    /// Cotangent J̄.
    pub(super) jac: [[f32x8; 3]; 2],
}

/// Evaluates the map at `t`; `frozen` contains the signs of the active limits instead of comparing.
#[inline(always)]
pub(super) fn forward(lens: &Lens, t: [f32x8; 3], frozen: Option<[f32x8; 2]>) -> Linearization {
    let c = f32x8::splat;
    let (zero, one) = (c(0.0), c(1.0));
    let inv_z = one / t[2];
    let mut tangent = [zero; 2];
    let mut limited = [zero; 2];
    let mut fish = [zero; 3];
    let f = lens.focal.map(f32x8::splat);
    let jac = match lens.model {
        Model::Pinhole => {
            for i in 0..2 {
                let [lo, hi] = lens.limits[i].map(f32x8::splat);
                let free = t[i] * inv_z;
                limited[i] = match &frozen {
                    Some(signs) => signs[i],
                    None => {
                        let low = Real::select(Real::lt(free, lo), c(-1.0), zero);
                        Real::select(Real::gt(free, hi), one, low)
                    }
                };
                let with_low = Real::select(Real::lt(limited[i], zero), lo, free);
                tangent[i] = Real::select(Real::gt(limited[i], zero), hi, with_low);
            }
            [
                [f[0] * inv_z, zero, -(f[0] * tangent[0]) * inv_z],
                [zero, f[1] * inv_z, -(f[1] * tangent[1]) * inv_z],
            ]
        }
        Model::Orthographic => [[f[0], zero, zero], [zero, f[1], zero]],
        Model::Fisheye => {
            fish = fisheye_lanes(t);
            let [x, y, z] = t;
            let n2 = (x * x + y * y) + z * z;
            let cross = (x * y) * fish[1];
            [
                [f[0] * (fish[0] + (x * x) * fish[1]), f[0] * cross, -(f[0] * x) / n2],
                [f[1] * cross, f[1] * (fish[0] + (y * y) * fish[1]), -(f[1] * y) / n2],
            ]
        }
    };
    Linearization { t, inv_z, tangent, limited, fish, jac }
}

/// Returns t̄. `inria_bwd` uses the original program's ∂J/∂z of a limited tangent.
#[inline(always)]
pub(super) fn adjoint(lens: &Lens, x: &Linearization, bar: &LinearizationBar, inria_bwd: bool) -> [f32x8; 3] {
    let c = f32x8::splat;
    let (zero, two) = (c(0.0), c(2.0));
    let f = lens.focal.map(f32x8::splat);
    let (u_bar, jac_bar) = (&bar.mean_px, &bar.jac);
    let iz = x.inv_z;
    let mut t_bar = [zero, zero, bar.z];
    match lens.model {
        Model::Pinhole => {
            for i in 0..2 {
                // u = f t/z + c
                t_bar[i] = t_bar[i] + (f[i] * u_bar[i]) * iz;
                t_bar[2] = t_bar[2] - ((f[i] * u_bar[i]) * (x.t[i] * iz)) * iz;
                // J_ii = f/z
                t_bar[2] = t_bar[2] - ((x.jac[i][i] * jac_bar[i][i]) * iz);
                // J_i2 = −f ũ/z: ũ = t/z where free, constant where limited
                let g = (f[i] * jac_bar[i][2]) * iz;
                let free = Real::eq(x.limited[i], zero);
                t_bar[i] = t_bar[i] - Real::select(free, g * iz, zero);
                let times = if inria_bwd { two } else { Real::select(free, two, c(1.0)) };
                t_bar[2] = t_bar[2] + times * ((g * x.tangent[i]) * iz);
            }
        }
        Model::Orthographic => {
            for i in 0..2 {
                t_bar[i] = t_bar[i] + f[i] * u_bar[i];
            }
        }
        Model::Fisheye => {
            let [tx, ty, tz] = x.t;
            let [g, big_g, h] = x.fish;
            let n2 = (tx * tx + ty * ty) + tz * tz;
            let n4 = n2 * n2;
            // Scaled cotangents of the six entries without f.
            let j = std::array::from_fn::<_, 2, _>(|i| jac_bar[i].map(|b| b * f[i]));
            let ub = std::array::from_fn::<_, 2, _>(|i| u_bar[i] * f[i]);
            let cross = j[0][1] + j[1][0];
            // ∂g/∂t = (xG, yG, −1/n²), ∂G/∂t = (xH, yH, 2/n⁴)
            let g_bar = ((ub[0] * tx + ub[1] * ty) + j[0][0]) + j[1][1];
            let big_g_bar = ((tx * tx) * j[0][0] + (tx * ty) * cross) + (ty * ty) * j[1][1];
            let n_bar = (tx * j[0][2] + ty * j[1][2]) / n4; // of n², from −t/n²
            let common = g_bar * big_g + big_g_bar * h;
            t_bar[0] = t_bar[0]
                + (((ub[0] * g + (two * tx * big_g) * j[0][0]) + (ty * big_g) * cross) - j[0][2] / n2)
                + tx * (common + two * n_bar);
            t_bar[1] = t_bar[1]
                + (((ub[1] * g + (two * ty * big_g) * j[1][1]) + (tx * big_g) * cross) - j[1][2] / n2)
                + ty * (common + two * n_bar);
            t_bar[2] = t_bar[2] + ((two * (big_g_bar / n4) - g_bar / n2) + two * (tz * n_bar));
        }
    }
    t_bar
}

/// Returns θ/ρ and its derivatives for the equidistant fisheye, per lane in f64: g, G = (1/ρ) ∂g/∂ρ, H =
/// (1/ρ) ∂G/∂ρ.
fn fisheye_terms(x: f32, y: f32, z: f32) -> [f32; 3] {
    let (x, y, z) = (f64::from(x), f64::from(y), f64::from(z));
    let rho2 = x * x + y * y;
    let w = rho2 / (z * z);
    let terms = if z > 0.0 && w < 1e-3 {
        // g = (1/z) Σ (−w)ᵏ/(2k+1) is differentiated term by term; the remainder after seven terms is below
        // 1e-19.
        let mut sums = [0.0_f64; 3];
        let (mut p0, mut p1, mut p2) = (1.0_f64, 0.0_f64, 0.0_f64);
        for k in 0..8_i32 {
            let (kf, sign) = (f64::from(k), if k % 2 == 0 { 1.0 } else { -1.0 });
            let c = sign / (2.0 * kf + 1.0);
            sums[0] += c * p0;
            sums[1] += c * kf * p1;
            sums[2] += c * kf * (kf - 1.0) * p2;
            // p1 = w^(k−1), p2 = w^(k−2) for the next k
            p2 = if k == 1 { 1.0 } else { p2 * w };
            p1 = if k == 0 { 1.0 } else { p1 * w };
            p0 *= w;
        }
        let z2 = z * z;
        [sums[0] / z, 2.0 * sums[1] / (z * z2), 4.0 * sums[2] / (z * z2 * z2)]
    } else {
        let rho = rho2.sqrt();
        let n2 = rho2 + z * z;
        let g = libm::atan2(rho, z) / rho;
        let big_g = (z / n2 - g) / rho2;
        [g, big_g, (-2.0 * z / (n2 * n2) - 3.0 * big_g) / rho2]
    };
    terms.map(|t| t as f32)
}

/// Evaluates [`fisheye_terms`] at eight points.
#[inline(always)]
fn fisheye_lanes(t: [f32x8; 3]) -> [f32x8; 3] {
    let (ta, mut lanes) = (t.map(f32x8::to_array), [[0.0_f32; 8]; 3]);
    for l in 0..8 {
        let terms = fisheye_terms(ta[0][l], ta[1][l], ta[2][l]);
        for k in 0..3 {
            lanes[k][l] = terms[k];
        }
    }
    lanes.map(f32x8::new)
}
