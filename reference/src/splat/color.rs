//! `splat.color`: colour of Gaussians seen from a camera, from spherical harmonics.
//!
//! c = max(0, ½ + Σ_k Y_k(d)·sh_k),   d = (μ − o)/‖μ − o‖,   o = −Rᵀt     (3DGS; real basis of degree 0 to 3)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | μ | `means` | (N, 3) | scene units |
//! | sh | `sh` | (N, K, 3) | K ≥ (degree+1)² coefficients per channel |
//! | degree | `sh_degree` | () | 0 to 3; bands above it have exactly zero gradient |
//! | R, t | `view_from_world` | (C, 4, 4) | R need not be orthogonal |
//! | c | `colors` | (C, N, 3) | sRGB-encoded, ≥ 0 |
//!
//! # Rounding
//! ½ is added last to the left fold over k.
//!
//! # Kinks and domain
//! A channel below 0 becomes 0 with zero gradient; at exactly 0 it counts as not clamped (`color_mask` 1
//! means not clamped). A Gaussian at the camera centre has direction 0 and zero gradient through the
//! direction.

use crate::array::{Arr, Named, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::scene::camera;
use crate::splat::ports::{COLOR_MASK, MEANS, SH, SH_DEGREE, VIEWS};
use crate::twins::Call;

inputs! {
    /// Inputs of `splat.color`.
    pub struct In<'a, S> {
        means: &'a Arr<S> = MEANS,
        sh: &'a Arr<S> = SH,
        sh_degree: &'a Arr<S> = SH_DEGREE,
        view_from_world: &'a Arr<S> = VIEWS,
    }
}

/// `splat.color`
pub static SIGNATURE: Signature = Signature {
    name: "splat.color",
    summary: "view-dependent colour from spherical harmonics of degree 0 to 3",
    inputs: In::<f64>::PORTS,
    outputs: ports![colors: Port::var("C,N,3", "sRGB-encoded, ≥ 0")],
    plan: ports![color_mask: COLOR_MASK],
    ..Signature::EMPTY
};

const C0: f64 = 0.282_094_791_773_878_14;
const C1: f64 = 0.488_602_511_902_919_9;
const C2: [f64; 5] = [
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];
const C3: [f64; 7] = [
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_8,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];

/// The (degree+1)² basis functions at a unit direction.
pub fn basis<S: Scalar>(degree: usize, [x, y, z]: [S; 3]) -> Vec<S> {
    let mut basis = vec![S::from_f64(C0)];
    if degree >= 1 {
        basis.extend([y * -C1, z * C1, x * -C1]);
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    if degree >= 2 {
        basis.extend([
            x * y * C2[0],
            y * z * C2[1],
            (zz * 2.0 - xx - yy) * C2[2],
            x * z * C2[3],
            (xx - yy) * C2[4],
        ]);
    }
    if degree >= 3 {
        basis.extend([
            y * (xx * 3.0 - yy) * C3[0],
            x * y * z * C3[1],
            y * (zz * 4.0 - xx - yy) * C3[2],
            z * (zz * 2.0 - xx * 3.0 - yy * 3.0) * C3[3],
            x * (zz * 4.0 - xx - yy) * C3[4],
            z * (xx - yy) * C3[5],
            x * (xx - yy * 3.0) * C3[6],
        ]);
    }
    basis
}

/// Unit vector from `center` to `mean`; 0 with zero gradient where they coincide.
pub fn direction<S: Scalar>(mean: [S; 3], center: [f64; 3]) -> [S; 3] {
    let d: [S; 3] = std::array::from_fn(|i| mean[i] - center[i]);
    let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    if length.value() == 0.0 { [S::zero(); 3] } else { d.map(|d| d / length) }
}

/// The colour of one Gaussian and which channels are not clamped. `sh` holds its coefficients, three channels
/// each.
pub fn color_one<S: Scalar>(
    direction: [S; 3],
    sh: &[S],
    degree: usize,
    mask: Option<[bool; 3]>,
) -> ([S; 3], [bool; 3]) {
    let basis = basis(degree, direction);
    let raw: [S; 3] = std::array::from_fn(|channel| {
        basis.iter().enumerate().fold(S::zero(), |sum, (k, &y)| sum + y * sh[3 * k + channel]) + 0.5
    });
    let mask = mask.unwrap_or(raw.map(|c| c.value() >= 0.0));
    (std::array::from_fn(|channel| if mask[channel] { raw[channel] } else { S::zero() }), mask)
}

/// Spherical harmonics with the degree in use.
pub struct Sh<'a, S> {
    sh: &'a Arr<S>,
    degree: usize,
}

impl<'a, S: Scalar> Sh<'a, S> {
    /// Coefficients `sh` (N,K,3) with the degree `sh_degree`.
    ///
    /// # Errors
    /// When their numbers do not match.
    pub fn of(sh: &'a Arr<S>, sh_degree: &Arr<S>) -> Result<Self, String> {
        let degree = sh_degree.data[0].value();
        if !(0.0..=3.0).contains(&degree) || degree.fract() != 0.0 {
            return Err(format!("input sh_degree: expected 0, 1, 2 or 3, got {degree}"));
        }
        let degree = degree as usize;
        if sh.shape[1] < (degree + 1) * (degree + 1) {
            return Err(format!(
                "input sh: degree {degree} needs {} coefficients, got {}",
                (degree + 1) * (degree + 1),
                sh.shape[1]
            ));
        }
        Ok(Self { sh, degree })
    }
    /// Colour of Gaussian `i` seen along `direction`.
    pub fn color(&self, i: usize, direction: [S; 3], mask: Option<[bool; 3]>) -> ([S; 3], [bool; 3]) {
        let width = 3 * self.sh.shape[1];
        color_one(direction, &self.sh.data[i * width..(i + 1) * width], self.degree, mask)
    }
}

/// The three bits of row `i` of a (C,N,3) `color_mask`.
pub fn mask_of(plan: Option<&Named<f64>>, i: usize) -> Option<[bool; 3]> {
    plan.and_then(|plan| plan.get("color_mask")).map(|mask| mask.row::<3>(i).map(|bit| bit != 0.0))
}

/// The twin of `splat.color`.
///
/// # Errors
/// When the degree is invalid or has too few coefficients.
pub fn forward<S: Scalar>(
    input: &In<'_, S>,
    plan: Option<&Named<f64>>,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    let means = input.means;
    let n = means.shape[0];
    let sh = Sh::of(input.sh, input.sh_degree)?;
    let cameras = camera::poses(input.view_from_world);
    let colors = out.array("colors", &[cameras.len(), n, 3]);
    let mut color_mask = Arr::filled(&[cameras.len(), n, 3], 0.0);
    for (c, camera) in cameras.iter().enumerate() {
        for i in 0..n {
            let row = c * n + i;
            let (color, mask) = sh.color(i, direction(means.row(i), camera.center()), mask_of(plan, row));
            out.put_row(colors, row, color);
            for (channel, bit) in mask.into_iter().enumerate() {
                color_mask.data[3 * row + channel] = f64::from(u8::from(bit));
            }
            out.flush();
        }
    }
    out.plan.insert("color_mask".to_owned(), color_mask);
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.plan, out)
}
