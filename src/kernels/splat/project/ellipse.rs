//! The ellipse of Σ' = V Vᵀ + ε I in its shape (s, k1, k2), computed from V (2×3), forward and adjoint.
//!
//! s = Σ'pq/Σ'pp,  k1 = 1/√Σ'pp,  k2 = √(Σ'pp/det),  det = det₀ + ε (a₀ + c₀ + ε),  det₀ = Σ (2×2 minors of
//! V)², a₀ and c₀ the squared lengths of the rows of V; ρ = √max(0.005², det₀/det) in antialiased mode.

use crate::num::lanes::{Real, f32x8};
use crate::scene::profile::Profile;

/// Lower bound 0.005² of the ratio det₀/det under the root of the antialiased mode.
pub(super) const COMPENSATION_FLOOR: f32 = 2.5e-5;

/// Eight ellipses with the intermediate values that their adjoint needs.
pub(super) struct ImageEllipse {
    /// V with the pivot row first.
    v: [[f32x8; 3]; 2],
    /// Minors m01, m02, m12 of V with the pivot row first.
    minors: [f32x8; 3],
    /// Entry Σ'pp.
    var_p: f32x8,
    /// Entry Σ'pq.
    cov_pq: f32x8,
    /// Determinant det₀ without blur.
    pub(super) det0: f32x8,
    /// Determinant det Σ'.
    pub(super) det: f32x8,
    /// Mask of the lanes with pivot y.
    pub(super) axis_y: f32x8,
}

impl ImageEllipse {
    /// Returns (s, k1, k2).
    #[inline(always)]
    pub(super) fn shape(&self) -> [f32x8; 3] {
        [self.cov_pq / self.var_p, f32x8::splat(1.0) / self.var_p.sqrt(), (self.var_p / self.det).sqrt()]
    }
}

/// Cotangents of eight ellipses.
pub(super) struct ImageEllipseBar {
    /// Cotangents of (s, k1, k2).
    pub(super) shape: [f32x8; 3],
    /// Cotangent ρ̄, 0 outside antialiased mode.
    pub(super) compensation: f32x8,
}

/// Returns the ellipses of V with rows x, y and the blur ε in px²; `frozen` contains the pivots instead of
/// comparing.
#[inline(always)]
pub(super) fn forward(v_xy: &[[f32x8; 3]; 2], blur: f32, frozen: Option<f32x8>) -> ImageEllipse {
    let square = |v: &[f32x8; 3]| (v[0] * v[0] + v[1] * v[1]) + v[2] * v[2];
    let (a0, c0) = (square(&v_xy[0]), square(&v_xy[1]));
    let eps = f32x8::splat(blur);
    let var = [a0 + eps, c0 + eps];
    let axis_y = match frozen {
        Some(axis) => axis,
        None => Real::gt(var[1], var[0]),
    };
    let v: [[f32x8; 3]; 2] = [
        std::array::from_fn(|k| Real::select(axis_y, v_xy[1][k], v_xy[0][k])),
        std::array::from_fn(|k| Real::select(axis_y, v_xy[0][k], v_xy[1][k])),
    ];
    let minor = |i: usize, j: usize| v[0][i] * v[1][j] - v[0][j] * v[1][i];
    let minors = [minor(0, 1), minor(0, 2), minor(1, 2)];
    let det0 = (minors[0] * minors[0] + minors[1] * minors[1]) + minors[2] * minors[2];
    let det = det0 + eps * ((a0 + c0) + eps);
    let var_p = Real::select(axis_y, var[1], var[0]);
    let cov_pq = (v[0][0] * v[1][0] + v[0][1] * v[1][1]) + v[0][2] * v[1][2];
    ImageEllipse { v, minors, var_p, cov_pq, det0, det, axis_y }
}

/// Returns V̄ with rows x, y.
#[inline(always)]
pub(super) fn adjoint(profile: &Profile, x: &ImageEllipse, bar: &ImageEllipseBar) -> [[f32x8; 3]; 2] {
    let c = f32x8::splat;
    let (zero, two) = (c(0.0), c(2.0));
    let [s, k1, k2] = x.shape();
    let [s_bar, k1_bar, k2_bar] = bar.shape;
    // Adjoint of s = Σpq/Σpp, k1 = 1/√Σpp, k2 = √(Σpp/det).
    let mut cov_bar = s_bar / x.var_p;
    let half_k2 = (c(0.5) * k2_bar) * k2;
    let mut var_bar = ((half_k2 - (c(0.5) * k1_bar) * k1) - s_bar * s) / x.var_p;
    let mut det_bar = -half_k2 / x.det;
    if profile.inria_bwd {
        // The original program divides by det² + 1e-7 in the adjoint of the inverse, but only by det in the
        // forward pass.
        let factor = c(1.0) / (c(1.0) + c(1e-7) / (x.det * x.det));
        (var_bar, det_bar, cov_bar) = (var_bar * factor, det_bar * factor, cov_bar * factor);
    }
    // Adjoint of ρ = √(det₀/det), which is constant below its floor.
    let mut det0_bar = zero;
    if profile.antialiased {
        let ratio = x.det0 / x.det;
        let above = Real::ge(ratio, c(COMPENSATION_FLOOR));
        let rho = Real::select(above, ratio, c(COMPENSATION_FLOOR)).sqrt();
        let ratio_bar = Real::select(above, c(0.5) * (bar.compensation / rho), zero);
        det0_bar = ratio_bar / x.det;
        det_bar = det_bar - (ratio_bar * ratio) / x.det;
    }
    // Adjoint of det = Σ minors² + ε(a₀ + c₀ + ε).
    let [m01, m02, m12] = x.minors.map(|m| (two * (det_bar + det0_bar)) * m);
    let square_bar = two * (c(profile.blur_px2) * det_bar);
    let [p, q] = &x.v;
    let var2 = two * var_bar + square_bar;
    let p_bar = [
        ((m01 * q[1] + m02 * q[2]) + var2 * p[0]) + cov_bar * q[0],
        ((m12 * q[2] - m01 * q[0]) + var2 * p[1]) + cov_bar * q[1],
        (var2 * p[2] - (m02 * q[0] + m12 * q[1])) + cov_bar * q[2],
    ];
    let q_bar = [
        (square_bar * q[0] - (m01 * p[1] + m02 * p[2])) + cov_bar * p[0],
        ((m01 * p[0] - m12 * p[2]) + square_bar * q[1]) + cov_bar * p[1],
        ((m02 * p[0] + m12 * p[1]) + square_bar * q[2]) + cov_bar * p[2],
    ];
    // The rows are returned in the order x, y.
    [
        std::array::from_fn(|k| Real::select(x.axis_y, q_bar[k], p_bar[k])),
        std::array::from_fn(|k| Real::select(x.axis_y, p_bar[k], q_bar[k])),
    ]
}
