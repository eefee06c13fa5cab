//! `splat.project`: projects Gaussians into one image as position, depth and ellipse.
//!
//! t = R μ + τ (camera axes x right, y down, z forward);   u = π(t) in pixels;   V = J R F  (2×3);
//! Σ' = V Vᵀ + ε I                                                            (3DGS 2023, eq. 5; EWA 2001)
//!
//! Instead of the inverse of Σ', the ellipse is stored, free of cancellation, as **shape** (s, k1, k2) along
//! the pivot axis p (the axis of the larger diagonal entry of Σ'; a tie gives x) and the other axis q:
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
//! | s, k1, k2 | `Row::shape` | (N, 3) | 1, 1/px, 1/px; all 0 if not visible |
//! | p | `Row::axis` | (N) | 0 = x, 1 = y |
//! | ρ | `Row::compensation` | (N) | √max(0.005², det₀/det) in antialiased mode, else 1 |
//! | | `Row::radii` | (N, 2) | pixels; 0 if no pixel can reach α_min |
//!
//! The Jacobians are as follows (ũ = t_x/z, ṽ = t_y/z limited as the profile specifies, pinhole only):
//! pinhole `[[f_x/z, 0, −f_x ũ/z], [0, f_y/z, −f_y ṽ/z]]`; orthographic `[[f_x, 0, 0], [0, f_y, 0]]`; fisheye
//! (equidistant) with g = θ/ρ, n² = ρ²+z², G = (z/n² − g)/ρ²:
//! `[[f_x (g + x²G), f_x xyG, −f_x x/n²], [f_y xyG, f_y (g + y²G), −f_y y/n²]]`.
//!
//! This file contains the rows and the chain t = R μ + τ, V = (J R) F with its adjoint. `lens` is the camera,
//! `linearization` the map t → u and its Jacobian J, `ellipse` the shape of V; the last two have their own
//! adjoints.
//!
//! # Rounding
//! Dot products of three are left folds. V = (J R) F. det: minors by plain products, squares added m01, m02,
//! m12, then the blur term. g, G (and H below) of the fisheye are f64 with the pinned `libm`, rounded once.
//!
//! # Kinks and domain
//! There are kinks at near and far (visibility jumps; the decision is recorded), at the tangent limits
//! (gradient of the limited branch, where ũ is constant; the free branch at equality), and at the floor of ρ,
//! below which ρ is constant. The choice of the pivot is smooth, because both pivots describe the same
//! ellipse. det ≥ ε² > 0 by construction, so there is no branch for degenerate ellipses. Radii have no
//! gradient.
//!
//! # Adjoint
//! The adjoint is written by hand through (s, k1, k2) → (Σ', det) → V → J, F and u → t → μ. It recomputes all
//! values from the inputs and uses the stored decisions `t_clamp` and `axis`. `inria_bwd` reproduces the
//! original program's ∂J/∂z where the tangent is limited, and its 1e-7 added to det².
//!
//! Twin: `reference::splat::project`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::scene::camera::{Camera, Model};
//! use lastlight::scene::profile::Profile;
//! use lastlight::splat::project::{In, Lens, Row, forward};
//! let camera = Camera {
//!     rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
//!     translation: [0.0; 3],
//!     focal_px: [40.0; 2],
//!     center_px: [8.5; 2],
//!     width: 16,
//!     height: 16,
//!     model: Model::Pinhole,
//! };
//! let (profile, factors) = (Profile::EXACT, [[0.2, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.1]]);
//! let lens = Lens::new(&camera, &profile);
//! let means = [[0.0, 0.0, 4.0]];
//! let x = In { means: &means, factors: &factors, opacities: &[0.5], lens: &lens, profile: &profile };
//! let mut rows = [Row::default()];
//! forward(&x, None, &mut rows);
//! // V = (40/4)·F has the rows (2, 0, 0) and (0, 1, 0), so Σ' = diag(4 + 0.3, 1 + 0.3)
//! let Row { mean_px, z, shape: [s, k1, k2], axis, .. } = rows[0];
//! assert_eq!((mean_px, z, s, axis), ([8.5, 8.5], 4.0, 0.0, 0));
//! assert!((k1 - 1.0 / 4.3_f32.sqrt()).abs() < 1e-6 && (k2 - 1.0 / 1.3_f32.sqrt()).abs() < 1e-6);
//! ```

mod ellipse;
mod lens;
mod linearization;

pub use lens::Lens;

use super::covariance::{gather, scatter_add};
use super::plan::Ellipse;
use crate::num::lanes::{Real, f32x8};
use crate::num::order;
use crate::scene::profile::Profile;
use ellipse::{COMPENSATION_FLOOR, ImageEllipse, ImageEllipseBar};
use linearization::{Linearization, LinearizationBar};

/// Inputs: N Gaussians and one camera.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (N, 3).
    pub means: &'a [[f32; 3]],
    /// Shape (N, 3, 3).
    pub factors: &'a [[f32; 9]],
    /// Opacities, shape (N); they affect only the footprint.
    pub opacities: &'a [f32],
    /// Camera with the limits of `profile`.
    pub lens: &'a Lens,
    /// Profile with the constants of the renderer.
    pub profile: &'a Profile,
}

/// Gradients; [`adjoint`] adds to them.
#[derive(Debug)]
pub struct InBar<'a> {
    /// Shape (N, 3).
    pub means: &'a mut [[f32; 3]],
    /// Shape (N, 3, 3).
    pub factors: &'a mut [[f32; 9]],
}

/// One projected Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Row {
    /// Projected centre u, pixels.
    pub mean_px: [f32; 2],
    /// Depth in camera space.
    pub z: f32,
    /// Shape s, k1, k2.
    pub shape: [f32; 3],
    /// Opacity factor of the antialiased mode, otherwise 1.
    pub compensation: f32,
    /// √(2 ln(o ρ/α_min)), the Mahalanobis radius at which α falls to α_min; negative if α never reaches it.
    pub cut: f32,
    /// Half-widths of the footprint, pixels; 0 if it covers no pixel.
    pub radii: [i32; 2],
    /// Sign of the active tangent limit per axis, 0 = free.
    pub t_clamp: [i8; 2],
    /// Pivot axis: 0 = x, 1 = y.
    pub axis: u8,
    /// Whether near ≤ z ≤ far.
    pub visible: bool,
}

impl Row {
    fn decision(&self) -> Decision {
        Decision { visible: self.visible, t_clamp: self.t_clamp, axis: self.axis }
    }
}

/// Cotangents of one [`Row`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RowBar {
    /// Cotangent ∂L/∂u.
    pub mean_px: [f32; 2],
    /// Cotangent ∂L/∂t_z.
    pub z: f32,
    /// Cotangents ∂L/∂(s, k1, k2).
    pub shape: [f32; 3],
    /// Cotangent ∂L/∂ρ.
    pub compensation: f32,
}

/// Stored discrete decisions that replace new ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decision {
    /// Whether near ≤ z ≤ far.
    pub visible: bool,
    /// Signs of the active tangent limits.
    pub t_clamp: [i8; 2],
    /// Pivot axis.
    pub axis: u8,
}

/// Returns the first visible row whose ellipse exceeds the range of f32, for callers that must refuse such
/// input.
pub fn out_of_range(rows: &[Row]) -> Option<usize> {
    let finite = |r: &Row| {
        let [s, k1, k2] = r.shape;
        r.mean_px.iter().chain([&r.z, &s, &k1, &k2]).all(|x| x.is_finite()) && k1 > 0.0 && k2 > 0.0
    };
    rows.iter().position(|r| r.visible && !finite(r))
}

/// Returns √(2 ln(o/α_min)), or −1 if o < α_min; +∞ is represented by 1e18 if α_min is 0.
pub fn cut_radius(opacity: f32, alpha_min: f32) -> f32 {
    if !(opacity >= alpha_min) || opacity <= 0.0 {
        -1.0
    } else if alpha_min <= 0.0 {
        1e18
    } else {
        (2.0 * order::max(crate::num::elem::ln(opacity / alpha_min), 0.0)).sqrt()
    }
}

/// Inputs of eight Gaussians, or their cotangents.
struct GaussianLanes {
    /// Centre μ.
    mean: [f32x8; 3],
    /// Factor F, row-major.
    factor: [f32x8; 9],
}

impl GaussianLanes {
    #[inline(always)]
    fn gather(x: &In<'_>, at: usize) -> Self {
        Self { mean: gather(x.means, at), factor: gather(x.factors, at) }
    }
}

/// Decisions about eight Gaussians.
struct DecisionLanes {
    /// Mask of near ≤ z ≤ far.
    visible: f32x8,
    /// Signs of the active tangent limits, 0 = free.
    t_clamp: [f32x8; 2],
    /// Mask of the lanes with pivot y.
    axis_y: f32x8,
}

impl DecisionLanes {
    /// Returns the decisions of up to eight rows, each read by `read`; rows past the end count as invisible.
    #[inline(always)]
    fn gather<D>(rows: &[D], read: impl Fn(&D) -> Decision) -> Self {
        let half = f32x8::splat(0.5);
        let of = |f: &dyn Fn(Decision) -> f32| f32x8::from_fn(|l| rows.get(l).map_or(0.0, |d| f(read(d))));
        Self {
            visible: Real::gt(of(&|d| f32::from(u8::from(d.visible))), half),
            t_clamp: [of(&|d| f32::from(d.t_clamp[0])), of(&|d| f32::from(d.t_clamp[1]))],
            axis_y: Real::gt(of(&|d| f32::from(d.axis)), half),
        }
    }
}

/// Cotangents of eight rows.
struct RowBarLanes {
    mean_px: [f32x8; 2],
    z: f32x8,
    shape: [f32x8; 3],
    compensation: f32x8,
}

impl RowBarLanes {
    /// Returns the cotangents of up to eight rows; ρ̄ is read in antialiased mode only.
    #[inline(always)]
    fn gather(bars: &[RowBar], antialiased: bool) -> Self {
        let bar = |f: &dyn Fn(&RowBar) -> f32| f32x8::from_fn(|l| bars.get(l).map_or(0.0, f));
        Self {
            mean_px: [bar(&|b| b.mean_px[0]), bar(&|b| b.mean_px[1])],
            z: bar(&|b| b.z),
            shape: [bar(&|b| b.shape[0]), bar(&|b| b.shape[1]), bar(&|b| b.shape[2])],
            compensation: if antialiased { bar(&|b| b.compensation) } else { f32x8::splat(0.0) },
        }
    }
}

/// Intermediate values of eight Gaussians between the inputs and [`Row`] that the adjoint needs.
struct Projection {
    /// Mask of near ≤ z ≤ far.
    visible: f32x8,
    map: Linearization,
    /// Product J R, 2×3, row-major.
    jr: [[f32x8; 3]; 2],
    ellipse: ImageEllipse,
}

impl Projection {
    /// Projects `g`; `frozen` contains decisions that replace new ones.
    #[inline(always)]
    fn new(x: &In<'_>, g: &GaussianLanes, frozen: Option<&DecisionLanes>) -> Self {
        let c = f32x8::splat;
        let (zero, one) = (c(0.0), c(1.0));
        let mut t: [f32x8; 3] = std::array::from_fn(|i| x.lens.camera_space(i, g.mean));
        let visible = match frozen {
            Some(d) => d.visible,
            None => <f32x8 as Real>::and(Real::ge(t[2], c(x.profile.near)), Real::le(t[2], c(x.profile.far))),
        };
        // An invisible Gaussian gets an arbitrary valid depth: its results are dropped, but must not be NaN.
        for (i, harmless) in [zero, zero, one].into_iter().enumerate() {
            t[i] = Real::select(visible, t[i], harmless);
        }
        let map = linearization::forward(x.lens, t, frozen.map(|d| d.t_clamp));
        let (jac, r) = (&map.jac, x.lens.rotation.map(|row| row.map(f32x8::splat)));
        let jr: [[f32x8; 3]; 2] = std::array::from_fn(|i| {
            std::array::from_fn(|k| (jac[i][0] * r[0][k] + jac[i][1] * r[1][k]) + jac[i][2] * r[2][k])
        });
        let v: [[f32x8; 3]; 2] = std::array::from_fn(|i| {
            std::array::from_fn(|k| {
                (jr[i][0] * g.factor[k] + jr[i][1] * g.factor[3 + k]) + jr[i][2] * g.factor[6 + k]
            })
        });
        let ellipse = ellipse::forward(&v, x.profile.blur_px2, frozen.map(|d| d.axis_y));
        Self { visible, map, jr, ellipse }
    }

    /// Stores the rows of up to eight Gaussians from index `at` on.
    #[inline(always)]
    fn store(&self, x: &In<'_>, at: usize, rows: &mut [Row]) {
        let profile = x.profile;
        let shape = self.ellipse.shape().map(f32x8::to_array);
        let mean_px = self.map.mean_px(x.lens).map(f32x8::to_array);
        let ratio = (self.ellipse.det0 / self.ellipse.det).to_array();
        let (visible, axis_y) =
            (<f32x8 as Real>::bits(self.visible), <f32x8 as Real>::bits(self.ellipse.axis_y));
        let limited = self.map.limited.map(f32x8::to_array);
        let z = self.map.t[2].to_array();
        for (l, row) in rows[at..].iter_mut().take(8).enumerate() {
            *row = if visible >> l & 1 == 0 {
                Row::default()
            } else {
                let compensation =
                    if profile.antialiased { order::max(ratio[l], COMPENSATION_FLOOR).sqrt() } else { 1.0 };
                let axis = (axis_y >> l & 1) as u8;
                let u = [mean_px[0][l], mean_px[1][l]];
                let shape = [shape[0][l], shape[1][l], shape[2][l]];
                let cut = cut_radius(x.opacities[at + l] * compensation, profile.alpha_min);
                Row {
                    mean_px: u,
                    z: z[l],
                    shape,
                    compensation,
                    cut,
                    radii: Ellipse::new(shape, axis).radii(profile, u, cut, x.lens.size),
                    t_clamp: [limited[0][l] as i8, limited[1][l] as i8],
                    axis,
                    visible: true,
                }
            };
        }
    }

    /// Returns (μ̄, F̄).
    #[inline(always)]
    fn adjoint_lanes(&self, x: &In<'_>, factor: &[f32x8; 9], bar: &RowBarLanes) -> GaussianLanes {
        let shape_bar = ImageEllipseBar { shape: bar.shape, compensation: bar.compensation };
        let v_bar = ellipse::adjoint(x.profile, &self.ellipse, &shape_bar);
        // Adjoint of V = (J R) F.
        let factor_bar: [f32x8; 9] = std::array::from_fn(|e| {
            let (k, j) = (e / 3, e % 3);
            self.jr[0][k] * v_bar[0][j] + self.jr[1][k] * v_bar[1][j]
        });
        let jr_bar: [[f32x8; 3]; 2] = std::array::from_fn(|i| {
            std::array::from_fn(|k| {
                (v_bar[i][0] * factor[3 * k] + v_bar[i][1] * factor[3 * k + 1])
                    + v_bar[i][2] * factor[3 * k + 2]
            })
        });
        // Adjoint of J R.
        let jac = std::array::from_fn(|i| std::array::from_fn(|k| x.lens.turn(k, jr_bar[i])));
        // Adjoint of J(t) and u(t).
        let map_bar = LinearizationBar { mean_px: bar.mean_px, z: bar.z, jac };
        let t_bar = linearization::adjoint(x.lens, &self.map, &map_bar, x.profile.inria_bwd);
        // Adjoint of t = R μ + τ.
        let r = x.lens.rotation.map(|row| row.map(f32x8::splat));
        let mean_bar =
            std::array::from_fn(|k| (r[0][k] * t_bar[0] + r[1][k] * t_bar[1]) + r[2][k] * t_bar[2]);
        GaussianLanes { mean: mean_bar, factor: factor_bar }
    }
}

/// Projects N Gaussians to `rows` (N); `frozen` (N) contains decisions that replace new ones.
pub fn forward(x: &In<'_>, frozen: Option<&[Decision]>, rows: &mut [Row]) {
    let n = x.means.len();
    assert!(
        x.factors.len() == n && x.opacities.len() == n && rows.len() == n,
        "means, factors, opacities and rows have N rows"
    );
    for at in (0..n).step_by(8) {
        let decided = frozen.map(|d| DecisionLanes::gather(&d[at..], |d| *d));
        Projection::new(x, &GaussianLanes::gather(x, at), decided.as_ref()).store(x, at, rows);
    }
}

/// Adds the gradients of `rows_bar` (N) to `x_bar`; rows that are not visible get no gradient.
pub fn adjoint(x: &In<'_>, rows: &[Row], rows_bar: &[RowBar], x_bar: InBar<'_>) {
    let n = x.means.len();
    for at in (0..n).step_by(8) {
        let group = &rows[at..Ord::min(at + 8, n)];
        if group.iter().all(|r| !r.visible) {
            continue;
        }
        let decided = DecisionLanes::gather(group, Row::decision);
        let g = GaussianLanes::gather(x, at);
        let projection = Projection::new(x, &g, Some(&decided));
        let bar = RowBarLanes::gather(&rows_bar[at..], x.profile.antialiased);
        let g_bar = projection.adjoint_lanes(x, &g.factor, &bar);
        let keep = |v: f32x8| Real::select(decided.visible, v, f32x8::splat(0.0));
        scatter_add(x_bar.means, at, g_bar.mean.map(keep));
        scatter_add(x_bar.factors, at, g_bar.factor.map(keep));
    }
}
