//! Projects Gaussians into one picture: where, how deep, and which ellipse.
//!
//! t = R μ + τ (camera axes x right, y down, z forward);   u = π(t) in pixels;   V = J R F  (2×3);
//! Σ' = V Vᵀ + ε I                                                            (3DGS 2023, eq. 5; EWA 2001)
//!
//! The ellipse is not stored as the inverse of Σ' but, free of cancellation, as **shape** (s, k1, k2) along the pivot axis p
//! (the axis of the larger diagonal entry of Σ'; a tie gives x) and the other axis q:
//!
//! s = Σ'pq/Σ'pp,  k1 = 1/√Σ'pp,  k2 = √(Σ'pp/det),  det = Σ (2×2 minors of V)² + ε (a₀ + c₀ + ε),
//! so that with d = pixel − u:  dᵀ Σ'⁻¹ d = (k1 d_p)² + (k2 (d_q − s d_p))².
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | μ | `means` | (N, 3) | scene units |
//! | F | `factors` | (N, 3, 3) | scene units, Σ = F Fᵀ |
//! | u | `Row::mean_px` | (N, 2) | pixels, first pixel's centre at 0.5 |
//! | t_z | `Row::z` | (N) | scene units; visible iff near ≤ z ≤ far |
//! | s, k1, k2 | `Row::shape` | (N, 3) | 1, 1/px, 1/px; all 0 where not visible |
//! | p | `Row::axis` | (N) | 0 = x, 1 = y |
//! | ρ | `Row::compensation` | (N) | √max(0.005², det₀/det) in antialiased mode, else 1 |
//! | | `Row::radii` | (N, 2) | pixels; 0 where no pixel can reach α_min |
//!
//! Jacobians (ũ = t_x/z, ṽ = t_y/z limited as the profile says, pinhole only):
//! pinhole `[[f_x/z, 0, −f_x ũ/z], [0, f_y/z, −f_y ṽ/z]]`; orthographic `[[f_x, 0, 0], [0, f_y, 0]]`; fisheye (equidistant)
//! with g = θ/ρ, n² = ρ²+z², G = (z/n² − g)/ρ²:
//! `[[f_x (g + x²G), f_x xyG, −f_x x/n²], [f_y xyG, f_y (g + y²G), −f_y y/n²]]`.
//!
//! # Rounding
//! Dot products of three are left folds. V = (J R) F. det: minors by plain products, squares added m01, m02, m12, then
//! the blur term. g, G (and H below) of the fisheye in f64 with the pinned `libm`, rounded once.
//!
//! # Kinks and domain
//! Visibility at near and far (a jump, recorded); the tangent limits (gradient of the limited branch: ũ is constant
//! there; at equality the free branch); the pivot (smooth: both pivots describe one ellipse); ρ is constant below its floor.
//! det ≥ ε² > 0 by construction, so no branch for degenerate ellipses exists. Radii have no gradient.
//!
//! # Adjoint
//! By hand through (s, k1, k2) → (Σ', det) → V → J, F and u → t → μ; recomputes everything from the inputs, with the
//! decisions `t_clamp` and `axis` as stored. `inria_bwd` reproduces that program's ∂J/∂z where limited and its 1e-7 on det².
//!
//! Twin: `reference::splat::project`.

use super::covariance::{gather, scatter_add};
use super::plan::Ellipse;
use crate::num::lanes::{Real, f32x8};
use crate::num::order;
use crate::scene::camera::{Camera, Model};
use crate::scene::profile::{Profile, TangentClamp};

/// The first visible row whose ellipse has left the range of f32, for callers that must refuse such input.
pub fn out_of_range(rows: &[Row]) -> Option<usize> {
    let finite = |r: &Row| {
        let [s, k1, k2] = r.shape;
        r.mean_px.iter().chain([&r.z, &s, &k1, &k2]).all(|x| x.is_finite()) && k1 > 0.0 && k2 > 0.0
    };
    rows.iter().position(|r| r.visible && !finite(r))
}

/// One projected Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Row {
    /// Picture position, pixels.
    pub mean_px: [f32; 2],
    /// Camera depth.
    pub z: f32,
    /// s, k1, k2.
    pub shape: [f32; 3],
    /// Opacity factor of the antialiased mode, else 1.
    pub compensation: f32,
    /// √(2 ln(o ρ/α_min)): Mahalanobis radius at which α falls to α_min; negative if it never reaches it.
    pub cut: f32,
    /// Half-widths of the footprint, pixels; 0 = touches no pixel.
    pub radii: [i32; 2],
    /// Sign of the active tangent limit per axis, 0 = free.
    pub t_clamp: [i8; 2],
    /// Pivot axis: 0 = x, 1 = y.
    pub axis: u8,
    /// near ≤ z ≤ far.
    pub visible: bool,
}

/// Cotangents of one [`Row`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RowBar {
    /// ∂L/∂u
    pub mean_px: [f32; 2],
    /// ∂L/∂t_z
    pub z: f32,
    /// ∂L/∂(s, k1, k2)
    pub shape: [f32; 3],
    /// ∂L/∂ρ
    pub compensation: f32,
}

/// Discrete decisions to follow instead of making them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decision {
    /// near ≤ z ≤ far
    pub visible: bool,
    /// tangent limits
    pub t_clamp: [i8; 2],
    /// pivot axis
    pub axis: u8,
}

/// A camera with the limits of a profile worked out once.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
    focal: [f32; 2],
    center: [f32; 2],
    limits: [[f32; 2]; 2],
    size: [f32; 2],
    model: Model,
}

impl Lens {
    /// Tangent limits from `profile`.
    pub fn new(camera: &Camera, profile: &Profile) -> Self {
        let size = [camera.width as f32, camera.height as f32];
        let limits = std::array::from_fn(|i| {
            let (f, c, w) = (camera.focal_px[i], camera.center_px[i], size[i]);
            let tan = w / (2.0 * f);
            match profile.clamp {
                TangentClamp::Gsplat => [-(c / f + 0.3 * tan), (w - c) / f + 0.3 * tan],
                TangentClamp::Inria => [-(1.3 * tan), 1.3 * tan],
            }
        });
        Self {
            rotation: camera.rotation,
            translation: camera.translation,
            focal: camera.focal_px,
            center: camera.center_px,
            limits,
            size,
            model: camera.model,
        }
    }

    /// Row `i` of R dotted with `v`, a left fold.
    #[inline(always)]
    fn turn(&self, i: usize, v: [f32x8; 3]) -> f32x8 {
        let [a, b, c] = self.rotation[i].map(f32x8::splat);
        (a * v[0] + b * v[1]) + c * v[2]
    }
}

/// θ/ρ and its derivatives for the equidistant fisheye, per lane in f64: g, G = (1/ρ) ∂g/∂ρ, H = (1/ρ) ∂G/∂ρ.
fn fisheye_terms(x: f32, y: f32, z: f32) -> [f32; 3] {
    let (x, y, z) = (f64::from(x), f64::from(y), f64::from(z));
    let rho2 = x * x + y * y;
    let w = rho2 / (z * z);
    let terms = if z > 0.0 && w < 1e-3 {
        // g = (1/z) Σ (−w)ᵏ/(2k+1), differentiated term by term; seven terms leave less than 1e-19
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

/// Everything of eight Gaussians between the inputs and [`Row`] that the adjoint needs again.
struct Flat {
    t: [f32x8; 3],
    inv_z: f32x8,
    /// t_x/z, t_y/z, limited
    tangent: [f32x8; 2],
    /// J R, 2×3 row-major
    jr: [[f32x8; 3]; 2],
    jac: [[f32x8; 3]; 2],
    /// V, pivot row first
    v: [[f32x8; 3]; 2],
    /// minors m01, m02, m12 of V with the pivot row first
    minors: [f32x8; 3],
    var_p: f32x8,
    cov_pq: f32x8,
    det0: f32x8,
    det: f32x8,
    fish: [f32x8; 3],
    limited: [f32x8; 2],
    axis_y: f32x8,
}

impl Flat {
    #[inline(always)]
    fn new(
        lens: &Lens,
        blur: f32,
        mean: [f32x8; 3],
        factor: [f32x8; 9],
        visible: f32x8,
        frozen: Option<([f32x8; 2], f32x8)>,
    ) -> Self {
        let c = f32x8::splat;
        let (zero, one) = (c(0.0), c(1.0));
        let mut t: [f32x8; 3] = std::array::from_fn(|i| lens.turn(i, mean) + c(lens.translation[i]));
        // an invisible Gaussian is given a harmless depth: its results are dropped, but must not be NaN
        for (i, harmless) in [zero, zero, one].into_iter().enumerate() {
            t[i] = Real::select(visible, t[i], harmless);
        }
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
                        Some((signs, _)) => signs[i],
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
                let (ta, mut lanes) = (t.map(f32x8::to_array), [[0.0_f32; 8]; 3]);
                for l in 0..8 {
                    let terms = fisheye_terms(ta[0][l], ta[1][l], ta[2][l]);
                    for k in 0..3 {
                        lanes[k][l] = terms[k];
                    }
                }
                fish = lanes.map(f32x8::new);
                let [x, y, z] = t;
                let n2 = (x * x + y * y) + z * z;
                let cross = (x * y) * fish[1];
                [
                    [f[0] * (fish[0] + (x * x) * fish[1]), f[0] * cross, -(f[0] * x) / n2],
                    [f[1] * cross, f[1] * (fish[0] + (y * y) * fish[1]), -(f[1] * y) / n2],
                ]
            }
        };
        let r = lens.rotation.map(|row| row.map(f32x8::splat));
        let jr: [[f32x8; 3]; 2] = std::array::from_fn(|i| {
            std::array::from_fn(|k| (jac[i][0] * r[0][k] + jac[i][1] * r[1][k]) + jac[i][2] * r[2][k])
        });
        let v_xy: [[f32x8; 3]; 2] = std::array::from_fn(|i| {
            std::array::from_fn(|k| {
                (jr[i][0] * factor[k] + jr[i][1] * factor[3 + k]) + jr[i][2] * factor[6 + k]
            })
        });
        let square = |v: &[f32x8; 3]| (v[0] * v[0] + v[1] * v[1]) + v[2] * v[2];
        let (a0, c0) = (square(&v_xy[0]), square(&v_xy[1]));
        let eps = c(blur);
        let var = [a0 + eps, c0 + eps];
        let axis_y = match frozen {
            Some((_, axis)) => axis,
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
        Self { t, inv_z, tangent, jr, jac, v, minors, var_p, cov_pq, det0, det, fish, limited, axis_y }
    }

    /// (s, k1, k2)
    #[inline(always)]
    fn shape(&self) -> [f32x8; 3] {
        [self.cov_pq / self.var_p, f32x8::splat(1.0) / self.var_p.sqrt(), (self.var_p / self.det).sqrt()]
    }

    #[inline(always)]
    fn mean_px(&self, lens: &Lens) -> [f32x8; 2] {
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

/// Smallest value of the ratio det₀/det under the root of the antialiased mode: 0.005².
const COMPENSATION_FLOOR: f32 = 2.5e-5;

/// √(2 ln(o/α_min)); −1 if o < α_min; +∞ is written as 1e18 when α_min is 0.
pub fn cut_radius(opacity: f32, alpha_min: f32) -> f32 {
    if !(opacity >= alpha_min) || opacity <= 0.0 {
        -1.0
    } else if alpha_min <= 0.0 {
        1e18
    } else {
        (2.0 * order::max(crate::num::elem::ln(opacity / alpha_min), 0.0)).sqrt()
    }
}

/// Projects `means` with `factors`; `opacities` (of the same rows) decide the footprint only.
pub fn forward(
    lens: &Lens,
    profile: &Profile,
    means: &[[f32; 3]],
    factors: &[[f32; 9]],
    opacities: &[f32],
    frozen: Option<&[Decision]>,
    rows: &mut [Row],
) {
    let n = means.len();
    assert!(
        factors.len() == n && opacities.len() == n && rows.len() == n,
        "means, factors, opacities, rows: N each"
    );
    for at in (0..n).step_by(8) {
        let mean = gather(means, at);
        let z = lens.turn(2, mean) + f32x8::splat(lens.translation[2]);
        let (visible, decided) = match frozen {
            None => (
                <f32x8 as Real>::and(
                    Real::ge(z, f32x8::splat(profile.near)),
                    Real::le(z, f32x8::splat(profile.far)),
                ),
                None,
            ),
            Some(d) => {
                let (visible, signs, axis) = decision_lanes(&d[at..], |d| (d.visible, d.t_clamp, d.axis));
                (visible, Some((signs, axis)))
            }
        };
        let flat = Flat::new(lens, profile.blur_px2, mean, gather(factors, at), visible, decided);
        let shape = flat.shape().map(f32x8::to_array);
        let mean_px = flat.mean_px(lens).map(f32x8::to_array);
        let ratio = (flat.det0 / flat.det).to_array();
        let (visible, axis_y) = (<f32x8 as Real>::bits(visible), <f32x8 as Real>::bits(flat.axis_y));
        let limited = flat.limited.map(f32x8::to_array);
        let za = flat.t[2].to_array();
        for l in 0..Ord::min(8, n - at) {
            rows[at + l] = if visible >> l & 1 == 0 {
                Row::default()
            } else {
                let compensation =
                    if profile.antialiased { order::max(ratio[l], COMPENSATION_FLOOR).sqrt() } else { 1.0 };
                let axis = (axis_y >> l & 1) as u8;
                let u = [mean_px[0][l], mean_px[1][l]];
                let shape = [shape[0][l], shape[1][l], shape[2][l]];
                let cut = cut_radius(opacities[at + l] * compensation, profile.alpha_min);
                Row {
                    mean_px: u,
                    z: za[l],
                    shape,
                    compensation,
                    cut,
                    radii: Ellipse::new(shape, axis).radii(profile, u, cut, lens.size),
                    t_clamp: [limited[0][l] as i8, limited[1][l] as i8],
                    axis,
                    visible: true,
                }
            };
        }
    }
}

/// Lanes of stored decisions; rows past the end count as invisible.
#[inline(always)]
fn decision_lanes<D>(rows: &[D], read: impl Fn(&D) -> (bool, [i8; 2], u8)) -> (f32x8, [f32x8; 2], f32x8) {
    let half = f32x8::splat(0.5);
    let of =
        |f: &dyn Fn((bool, [i8; 2], u8)) -> f32| f32x8::from_fn(|l| rows.get(l).map_or(0.0, |d| f(read(d))));
    (
        Real::gt(of(&|d| f32::from(u8::from(d.0))), half),
        [of(&|d| f32::from(d.1[0])), of(&|d| f32::from(d.1[1]))],
        Real::gt(of(&|d| f32::from(d.2)), half),
    )
}

/// Adds into `means_bar` (N, 3) and `factors_bar` (N, 3, 3); rows that are not visible get nothing.
pub fn adjoint(
    lens: &Lens,
    profile: &Profile,
    means: &[[f32; 3]],
    factors: &[[f32; 9]],
    rows: &[Row],
    rows_bar: &[RowBar],
    means_bar: &mut [[f32; 3]],
    factors_bar: &mut [[f32; 9]],
) {
    let n = means.len();
    for at in (0..n).step_by(8) {
        let group = &rows[at..Ord::min(at + 8, n)];
        if group.iter().all(|r| !r.visible) {
            continue;
        }
        let (visible, signs, axis) = decision_lanes(group, |r| (r.visible, r.t_clamp, r.axis));
        let flat = Flat::new(
            lens,
            profile.blur_px2,
            gather(means, at),
            gather(factors, at),
            visible,
            Some((signs, axis)),
        );
        let bars = &rows_bar[at..];
        let bar = |f: &dyn Fn(&RowBar) -> f32| f32x8::from_fn(|l| bars.get(l).map_or(0.0, f));
        let u_bar = [bar(&|b| b.mean_px[0]), bar(&|b| b.mean_px[1])];
        let shape_bar = [bar(&|b| b.shape[0]), bar(&|b| b.shape[1]), bar(&|b| b.shape[2])];
        let comp_bar = if profile.antialiased { bar(&|b| b.compensation) } else { f32x8::splat(0.0) };
        let (mean_bar, factor_bar) = adjoint_lanes(
            lens,
            profile,
            &flat,
            gather(factors, at),
            u_bar,
            bar(&|b| b.z),
            shape_bar,
            comp_bar,
        );
        let keep = |x: f32x8| Real::select(visible, x, f32x8::splat(0.0));
        scatter_add(means_bar, at, mean_bar.map(keep));
        scatter_add(factors_bar, at, factor_bar.map(keep));
    }
}

#[inline(always)]
fn adjoint_lanes(
    lens: &Lens,
    profile: &Profile,
    x: &Flat,
    factor: [f32x8; 9],
    u_bar: [f32x8; 2],
    z_bar: f32x8,
    shape_bar: [f32x8; 3],
    comp_bar: f32x8,
) -> ([f32x8; 3], [f32x8; 9]) {
    let c = f32x8::splat;
    let (zero, two) = (c(0.0), c(2.0));
    let [s, k1, k2] = x.shape();
    let [s_bar, k1_bar, k2_bar] = shape_bar;
    // undo s = Σpq/Σpp, k1 = 1/√Σpp, k2 = √(Σpp/det)
    let cov_bar = s_bar / x.var_p;
    let half_k2 = (c(0.5) * k2_bar) * k2;
    let mut var_bar = ((half_k2 - (c(0.5) * k1_bar) * k1) - s_bar * s) / x.var_p;
    let mut det_bar = -half_k2 / x.det;
    let mut cov_bar = cov_bar;
    if profile.inria_bwd {
        // that program divides by det² + 1e-7 when it undoes the inverse, forward only by det
        let factor = c(1.0) / (c(1.0) + c(1e-7) / (x.det * x.det));
        (var_bar, det_bar, cov_bar) = (var_bar * factor, det_bar * factor, cov_bar * factor);
    }
    // undo ρ = √(det₀/det), constant below the floor
    let mut det0_bar = zero;
    if profile.antialiased {
        let ratio = x.det0 / x.det;
        let above = Real::ge(ratio, c(COMPENSATION_FLOOR));
        let rho = Real::select(above, ratio, c(COMPENSATION_FLOOR)).sqrt();
        let ratio_bar = Real::select(above, c(0.5) * (comp_bar / rho), zero);
        det0_bar = ratio_bar / x.det;
        det_bar = det_bar - (ratio_bar * ratio) / x.det;
    }
    // undo det = Σ minors² + ε(a₀ + c₀ + ε)
    let minors_bar = x.minors.map(|m| (two * (det_bar + det0_bar)) * m);
    let square_bar = two * (c(profile.blur_px2) * det_bar);
    let [p, q] = &x.v;
    let [m01, m02, m12] = minors_bar;
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
    // rows back in the order x, y
    let v_bar: [[f32x8; 3]; 2] = [
        std::array::from_fn(|k| Real::select(x.axis_y, q_bar[k], p_bar[k])),
        std::array::from_fn(|k| Real::select(x.axis_y, p_bar[k], q_bar[k])),
    ];
    // undo V = (J R) F
    let factor_bar: [f32x8; 9] = std::array::from_fn(|e| {
        let (k, j) = (e / 3, e % 3);
        x.jr[0][k] * v_bar[0][j] + x.jr[1][k] * v_bar[1][j]
    });
    let jr_bar: [[f32x8; 3]; 2] = std::array::from_fn(|i| {
        std::array::from_fn(|k| {
            (v_bar[i][0] * factor[3 * k] + v_bar[i][1] * factor[3 * k + 1]) + v_bar[i][2] * factor[3 * k + 2]
        })
    });
    // undo J R
    let jac_bar: [[f32x8; 3]; 2] = std::array::from_fn(|i| std::array::from_fn(|k| lens.turn(k, jr_bar[i])));
    // undo J(t) and u(t)
    let f = lens.focal.map(f32x8::splat);
    let iz = x.inv_z;
    let mut t_bar = [zero, zero, z_bar];
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
                let times = if profile.inria_bwd { two } else { Real::select(free, two, c(1.0)) };
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
            // scaled cotangents of the six entries without f
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
    // undo t = R μ + τ
    let r = lens.rotation.map(|row| row.map(f32x8::splat));
    let mean_bar = std::array::from_fn(|k| (r[0][k] * t_bar[0] + r[1][k] * t_bar[1]) + r[2][k] * t_bar[2]);
    (mean_bar, factor_bar)
}
