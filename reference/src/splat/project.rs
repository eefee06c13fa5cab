//! `splat.project`: projects Gaussians to ellipses in the image.
//!
//! t = R μ + t₀,   u = π(t),   V = J·R·F,   Σ' = V·Vᵀ + ε·I     (EWA splatting, Zwicker 2002; 3DGS, eq. 5)
//!
//! p is the axis of the larger diagonal entry of Σ' (tie: x), q the other one, and the ellipse is written as
//!
//! s = Σ'pq/Σ'pp,   k1 = 1/√Σ'pp,   k2 = √(Σ'pp/det),   det = Σ (2×2 minors of V)² + ε(a₀ + c₀ + ε)
//!
//! so that det ≥ ε² and the exponent ½((d_p k1)² + ((d_q − s d_p) k2)²) ≥ 0 without any cancellation; a₀, c₀
//! are the diagonal entries of V·Vᵀ.
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | μ | `means` | (N, 3) | scene units |
//! | F | `factors`, or from `quats`, `scales` | (N, 3, 3) | scene units |
//! | | `opacities` | (N) | optional; needed for footprints, and in antialiased mode |
//! | u | `means_px` | (C, N, 2) | pixels; pixel (0, 0) has its centre at (0.5, 0.5) |
//! | t_z | `depths_z` | (C, N) | scene units |
//! | Σ'⁻¹ | `conics` | (C, N, 3) | xx, xy, yy; px⁻² |
//! | | `radii_px` | (C, N, 2) | half-axes of the bounding box of the visible part, whole pixels; 0: outside the image |
//! | s, k1, k2 | `shape` | (C, N, 3) | 1, px⁻¹, px⁻¹ |
//! | p | `axis` | (C, N) | 0: x, 1: y |
//! | | `compensation` | (C, N) | √max(0.005², det(V·Vᵀ)/det); antialiased mode only |
//!
//! # Kinks and domain
//! Visible iff near ≤ t_z ≤ far; all results of a Gaussian that is not visible are 0. In J of the pinhole
//! camera t_x/z and t_y/z are limited (`t_clamp` −1, 0, 1); at a limit the unclamped branch is taken, beyond
//! it t̃ = z·limit is differentiated as written. The compensation has zero gradient at its floor.
//!
//! # Adjoint
//! With `inria_bwd`: t̃ is taken as a constant beyond a limit, which doubles ∂J/∂z there; the gradient
//! through Σ' into the conic is multiplied by det²/(det² + 1e-7).

use crate::array::{Arr, Named, Out};
use crate::inputs::{inputs, required};
use crate::ports::{Signature, ports};
use crate::scalar::Scalar;
use crate::scene::camera::{Camera, Model, cameras, size_px};
use crate::scene::profile::{Profile, TangentClamp};
use crate::splat::footprint::radii_px;
use crate::splat::ports::{
    AXIS, CAMERA_START, COMPENSATION, CONICS, DEPTHS_Z, FACTORS, HEIGHT, INTRINSICS, MEANS, MEANS_PX, NEAR,
    OPACITIES, ORDER, PIVOT, QUATS, RADII, SCALES, SETTINGS, SHAPE, T_CLAMP, VIEWS, WIDTH,
};
use crate::splat::{covariance, plan};
use crate::twins::Call;

inputs! {
    /// Inputs of `splat.project`: `quats` and `scales`, or `factors`.
    pub struct In<'a, S> {
        means: &'a Arr<S> = MEANS,
        quats: Option<&'a Arr<S>> = QUATS,
        scales: Option<&'a Arr<S>> = SCALES,
        factors: Option<&'a Arr<S>> = FACTORS,
        opacities: Option<&'a Arr<S>> = OPACITIES.without_gradient(),
        view_from_world: &'a Arr<S> = VIEWS,
        intrinsics: &'a Arr<S> = INTRINSICS,
        width: &'a Arr<S> = WIDTH,
        height: &'a Arr<S> = HEIGHT,
        near: Option<&'a Arr<S>> = NEAR,
    }
}

/// `splat.project`
pub static SIGNATURE: Signature = Signature {
    name: "splat.project",
    summary: "projects Gaussians to ellipses in the image",
    inputs: In::<f64>::PORTS,
    outputs: ports![
        means_px: MEANS_PX,
        depths_z: DEPTHS_Z,
        conics: CONICS,
        radii_px: RADII,
        shape: SHAPE,
        axis: AXIS,
        compensation: COMPENSATION,
    ],
    plan: ports![order: ORDER, camera_start: CAMERA_START, t_clamp: T_CLAMP, pivot: PIVOT],
    settings: SETTINGS,
    ..Signature::EMPTY
};

/// Decisions about one Gaussian in one view; those that are `None` are computed from the values.
#[derive(Clone, Copy, Debug, Default)]
pub struct Decision {
    /// Whether it is drawn at all.
    pub visible: Option<bool>,
    /// Side on which t_x/z, t_y/z are limited: −1, 0, 1.
    pub t_clamp: Option<[i8; 2]>,
    /// Axis p.
    pub pivot: Option<usize>,
}

/// One Gaussian in one view.
#[derive(Clone, Copy, Debug)]
pub struct Projected<S> {
    /// u, pixels.
    pub mean_px: [S; 2],
    /// Camera depth.
    pub depth_z: S,
    /// xx, xy, yy of Σ'⁻¹.
    pub conic: [S; 3],
    /// s, k1, k2.
    pub shape: [S; 3],
    /// det Σ', px⁴.
    pub det: S,
    /// Axis p.
    pub pivot: usize,
    /// Side on which the tangents were limited.
    pub t_clamp: [i8; 2],
    /// √max(0.005², det(V·Vᵀ)/det).
    pub compensation: S,
}

/// Smallest compensation of the antialiased mode.
const COMPENSATION_MIN: f64 = 0.005;

/// The point and the Jacobian of the projection, and on which side the tangents were limited.
fn camera_jacobian<S: Scalar>(
    t: [S; 3],
    camera: &Camera,
    profile: &Profile,
    t_clamp: Option<[i8; 2]>,
) -> ([S; 2], [[S; 3]; 2], [i8; 2]) {
    let [x, y, z] = t;
    let ([fx, fy], [cx, cy], zero) = (camera.focal_px, camera.center_px, S::zero());
    match camera.model {
        Model::Orthographic => (
            [x * fx + cx, y * fy + cy],
            [[S::from_f64(fx), zero, zero], [zero, S::from_f64(fy), zero]],
            [0, 0],
        ),
        Model::Pinhole => {
            let mut side = [0_i8; 2];
            let limited: [S; 2] = std::array::from_fn(|k| {
                let (f, center, size) = (camera.focal_px[k], camera.center_px[k], camera.size_px[k] as f64);
                let tan = size / (2.0 * f);
                let [low, high] = match profile.clamp {
                    TangentClamp::Gsplat => [-(center / f + 0.3 * tan), (size - center) / f + 0.3 * tan],
                    TangentClamp::Inria => [-1.3 * tan, 1.3 * tan],
                };
                let slope = t[k].value() / z.value();
                side[k] = match t_clamp {
                    Some(side) => side[k],
                    None => i8::from(slope > high) - i8::from(slope < low),
                };
                let limited = match side[k] {
                    0 => return t[k],
                    1 => z * high,
                    _ => z * low,
                };
                if profile.inria_bwd { limited.detach() } else { limited }
            });
            let (one, zz) = (S::one(), z * z);
            let j = [
                [one / z * fx, zero, -(limited[0] / zz) * fx],
                [zero, one / z * fy, -(limited[1] / zz) * fy],
            ];
            ([x / z * fx + cx, y / z * fy + cy], j, side)
        }
        Model::Fisheye => {
            let square = x * x + y * y;
            let (ratio, difference) = fisheye_terms(square, z);
            let beyond = square + z * z;
            let j = [
                [(ratio + x * x * difference) * fx, x * y * difference * fx, -(x / beyond) * fx],
                [x * y * difference * fy, (ratio + y * y * difference) * fy, -(y / beyond) * fy],
            ];
            ([x * ratio * fx + cx, y * ratio * fy + cy], j, [0, 0])
        }
    }
}

/// θ/ρ, and a − b = (z/(ρ²+z²) − θ/ρ)/ρ², for ρ² = `square`; near the axis both by their series in ρ²/z².
fn fisheye_terms<S: Scalar>(square: S, z: S) -> (S, S) {
    if z.value() > 0.0 && square.value() < 0.01 * (z.value() * z.value()) {
        let u = square / (z * z);
        let (mut ratio, mut difference) = (S::zero(), S::zero());
        for k in (0..9).rev() {
            let odd = 2.0 * f64::from(k) + 1.0;
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            ratio = ratio * u + sign / odd;
            difference = difference * u - sign * (odd + 1.0) / (odd + 2.0);
        }
        (ratio / z, difference / (z * z * z))
    } else {
        let rho = square.sqrt();
        let ratio = rho.atan2(z) / rho;
        (ratio, (z / (square + z * z) - ratio) / square)
    }
}

/// Projects one Gaussian; `None` when it is not visible.
pub fn project_one<S: Scalar>(
    mean: [S; 3],
    factor: [[S; 3]; 3],
    camera: &Camera,
    profile: &Profile,
    decision: Decision,
) -> Option<Projected<S>> {
    let t = camera.view(mean);
    let z = t[2];
    if !decision.visible.unwrap_or(z.value() >= profile.near && z.value() <= profile.far) {
        return None;
    }
    let (mean_px, j, t_clamp) = camera_jacobian(t, camera, profile, decision.t_clamp);
    let r = &camera.rotation;
    // R·F, then V = J·(R·F), each entry a left fold.
    let rf: [[S; 3]; 3] = std::array::from_fn(|i| {
        std::array::from_fn(|k| factor[0][k] * r[i][0] + factor[1][k] * r[i][1] + factor[2][k] * r[i][2])
    });
    let v: [[S; 3]; 2] = std::array::from_fn(|i| {
        std::array::from_fn(|k| j[i][0] * rf[0][k] + j[i][1] * rf[1][k] + j[i][2] * rf[2][k])
    });
    let dot = |a: [S; 3], b: [S; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let minors = |v: [[S; 3]; 2]| {
        let minor = |i: usize, k: usize| v[0][i] * v[1][k] - v[0][k] * v[1][i];
        let m = [minor(0, 1), minor(0, 2), minor(1, 2)];
        dot(m, m)
    };
    let ellipse = |v: [[S; 3]; 2]| {
        let (a0, b, c0) = (dot(v[0], v[0]), dot(v[0], v[1]), dot(v[1], v[1]));
        let det = minors(v) + (a0 + c0 + profile.blur_px2) * profile.blur_px2;
        ([a0 + profile.blur_px2, b, c0 + profile.blur_px2], det)
    };
    let (_, det_plain) = ellipse(v);
    // Deviation of Inria's backward pass: same values, derivatives multiplied by det²/(det² + 1e-7).
    let v_conic = if profile.inria_bwd {
        let square = det_plain.value() * det_plain.value();
        let slope = square / (square + 1e-7);
        v.map(|row| row.map(|x| x.chain(x.value(), slope)))
    } else {
        v
    };
    let ([a, b, c], det) = ellipse(v_conic);
    let pivot = decision.pivot.unwrap_or(usize::from(c.value() > a.value()));
    let larger = if pivot == 0 { a } else { c };
    let shape = [b / larger, S::one() / larger.sqrt(), (larger / det).sqrt()];
    let ratio = minors(v) / det_plain;
    let compensation = if ratio.value() >= COMPENSATION_MIN * COMPENSATION_MIN {
        ratio.sqrt()
    } else {
        S::from_f64(COMPENSATION_MIN)
    };
    let conic = [c / det, -(b / det), a / det];
    Some(Projected { mean_px, depth_z: z, conic, shape, det, pivot, t_clamp, compensation })
}

/// The decisions a plan has taken for Gaussian `i` in view `c`, row c·N + i.
pub fn decision_of(plan: Option<&Named<f64>>, visible: Option<&[bool]>, row: usize) -> Decision {
    let array = |name: &str| plan.and_then(|plan| plan.get(name));
    Decision {
        visible: visible.map(|visible| visible[row]),
        t_clamp: array("t_clamp").map(|side| side.row::<2>(row).map(|side| side as i8)),
        pivot: array("pivot").map(|pivot| pivot.data[row] as usize),
    }
}

/// The views of a call.
pub struct Views {
    /// Cameras.
    pub cameras: Vec<Camera>,
    /// Constants.
    pub profile: Profile,
}

impl Views {
    /// Reads cameras and `near`.
    ///
    /// # Errors
    /// When a camera is invalid, or opacities are missing in antialiased mode.
    pub fn of<S: Scalar>(input: &In<'_, S>, mut profile: Profile) -> Result<Self, String> {
        if let Some(near) = input.near {
            profile.near = near.data[0].value();
        }
        if profile.antialiased && input.opacities.is_none() {
            return Err("input opacities is missing: the antialiased mode needs them".to_owned());
        }
        let size_px = size_px(input.width, input.height)?;
        let cameras = cameras(input.view_from_world, input.intrinsics, size_px, profile.camera)?;
        Ok(Self { cameras, profile })
    }
}

/// The factor of Gaussian `i` from `factors`, or from `quats` and `scales`.
fn factor_of<S: Scalar>(input: &In<'_, S>, i: usize) -> Result<[[S; 3]; 3], String> {
    if let Some(factors) = input.factors {
        let f: [S; 9] = factors.row(i);
        return Ok([[f[0], f[1], f[2]], [f[3], f[4], f[5]], [f[6], f[7], f[8]]]);
    }
    let (quats, scales) = (required("quats", input.quats)?, required("scales", input.scales)?);
    covariance::factor_of(&covariance::In { quats, scales }, i)
}

/// Writes the projection of every Gaussian in every view; shared by `splat.project` and `splat.render`.
/// `also` is called for each visible Gaussian with (camera index, Gaussian, row, its projection) before the
/// row is flushed. Completes the plan with `order`, `camera_start`, `t_clamp`, `pivot`.
///
/// # Errors
/// When a Gaussian has no finite ellipse, or the plan does not match.
pub fn write<S: Scalar>(
    input: &In<'_, S>,
    views: &Views,
    plan: Option<&Named<f64>>,
    out: &mut Out<'_, S>,
    mut also: impl FnMut(&mut Out<'_, S>, usize, usize, usize, &Projected<S>),
) -> Result<(), String> {
    let Views { cameras, profile } = views;
    let means = input.means;
    let (n, views) = (means.shape[0], cameras.len());
    let given = plan::visible(plan, views, n)?;
    plan::check_rows(plan, views, n)?;
    let means_px = out.array("means_px", &[views, n, 2]);
    let depths_z = out.array("depths_z", &[views, n]);
    let conics = out.array("conics", &[views, n, 3]);
    let radii = out.array("radii_px", &[views, n, 2]);
    let shape = out.array("shape", &[views, n, 3]);
    let axis = out.array("axis", &[views, n]);
    let compensation = profile.antialiased.then(|| out.array("compensation", &[views, n]));
    let mut t_clamp = Arr::filled(&[views, n, 2], 0.0);
    let mut pivot = Arr::filled(&[views, n], 0.0);
    let mut depths = vec![None; views * n];
    for (c, camera) in cameras.iter().enumerate() {
        for i in 0..n {
            let row = c * n + i;
            let decision = decision_of(plan, given.as_deref(), row);
            let factor = factor_of(input, i)?;
            if let Some(p) = project_one(means.row(i), factor, camera, profile, decision) {
                let all =
                    p.mean_px.iter().chain(&p.conic).chain(&p.shape).chain([&p.depth_z, &p.compensation]);
                if !all.map(|x| x.value()).all(f64::is_finite) {
                    return Err(format!(
                        "inputs of Gaussian {i}: expected a finite ellipse in view {c}, got none"
                    ));
                }
                out.put_row(means_px, row, p.mean_px);
                out.put(depths_z, row, p.depth_z);
                out.put_row(conics, row, p.conic);
                out.put_row(shape, row, p.shape);
                out.put(axis, row, S::from_f64(p.pivot as f64));
                let mut opacity = input.opacities.map(|o| o.data[i].value());
                if let Some(compensation) = compensation {
                    out.put(compensation, row, p.compensation);
                    opacity = opacity.map(|o| o * p.compensation.value());
                }
                let values = (p.mean_px.map(S::value), p.shape.map(S::value));
                let r = radii_px(values.0, values.1, p.pivot, opacity, camera, profile);
                out.put_row(radii, row, r.map(S::from_f64));
                t_clamp.data[2 * row] = f64::from(p.t_clamp[0]);
                t_clamp.data[2 * row + 1] = f64::from(p.t_clamp[1]);
                pivot.data[row] = p.pivot as f64;
                depths[row] = Some(p.depth_z.value());
                also(out, c, i, row, &p);
            }
            out.flush();
        }
    }
    plan::write_order(plan, &depths, views, n, &mut out.plan);
    out.plan.insert("t_clamp".to_owned(), t_clamp);
    out.plan.insert("pivot".to_owned(), pivot);
    Ok(())
}

/// The twin of `splat.project`.
///
/// # Errors
/// When a camera is invalid, the shape of the Gaussians or the opacities of the antialiased mode are missing,
/// a Gaussian has no finite ellipse, or the plan does not match.
pub fn forward<S: Scalar>(
    input: &In<'_, S>,
    profile: Profile,
    plan: Option<&Named<f64>>,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    write(input, &Views::of(input, profile)?, plan, out, |_, _, _, _, _| {})
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or the plan does not match it.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, Profile::of(&call.settings), call.plan, out)
}
