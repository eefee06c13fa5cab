//! The effects of the factors.
//!
//! | index | factor | effect |
//! |---|---|---|
//! | 0 | u_P posture | arms raised by 0.45 u_P rad, knees bent by 0.9 σ(1.5 u_P) rad |
//! | 1 | u_O self-occlusion | right elbow bent by 1.4 σ(1.5 u_O) rad |
//! | 2 | u_W wrinkles | cloth of the trunk displaced along its normal by 0.03 u_W sin(12 z + 3 φ) before skinning |
//! | 3 | u_L light | azimuth 0.8 u_L rad, elevation 30°, ambient fraction 0.35; no effect on positions |
//! | 4 | u_B body width | displaced along the normal by u_B min(w, r/5), r the radius: trunk w = 0.02, limbs w = 0.006, head 0 |
//! | 5 | u_S skirt length | heights of the skirt, or of a shirt over trousers, below a rim times exp(0.15 u_S) |
//! | 6 | u_H hue | colours of cloth rotated by 0.5 u_H rad about the grey axis |
//! | 7 | u_Y head yaw | 0.35 u_Y rad |
//!
//! Lengths are in the figure frame, φ = atan2(y, x). Factors that a data set does not have are 0.
//!
//! The z and φ of the folds are those of the position at rest: a fold depends only on u_W, even if width and
//! length displace the surface further. Folds apply to the points of trunk and skirt; the trunk consists of
//! the capsule of the pelvis, which covers belly and waist, and that of the torso, which covers the chest.

use super::skeleton::V3;
use reference::num::elem::{cos, exp, sigmoid, sin};

/// Letters of the factors, in index order.
pub const LETTERS: [char; super::MAX_FACTORS] = ['P', 'O', 'W', 'L', 'B', 'S', 'H', 'Y'];

/// Fraction of the light that is ambient.
pub const AMBIENT: f64 = 0.35;

/// Amplitude of the wrinkles at u_W = 1.
pub const WRINKLE: f64 = 0.03;

/// Displacement of the trunk at u_B = 1.
pub const TRUNK_WIDTH: f64 = 0.02;

/// Displacement of limbs at u_B = 1.
pub const LIMB_WIDTH: f64 = 0.006;

/// Angles, lengths and scales computed from the factors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Raise of the arms, rad.
    pub raise: f64,
    /// Flexion of the knees, rad.
    pub knee: f64,
    /// Flexion of the right elbow, rad.
    pub elbow: f64,
    /// The factor u_W.
    pub wrinkle: f64,
    /// Azimuth of the light, rad; 0 is in front of the figure, positive towards its left.
    pub light_azimuth: f64,
    /// The factor u_B.
    pub width: f64,
    /// Scale of the skirt's length.
    pub skirt: f64,
    /// Rotation of the hue of the cloth, rad.
    pub hue: f64,
    /// Yaw of the head, rad.
    pub yaw: f64,
}

impl Drive {
    /// Computes the drive from at most eight factors; missing factors are 0.
    pub fn new(u: &[f64]) -> Self {
        let u: [f64; super::MAX_FACTORS] = std::array::from_fn(|j| u.get(j).copied().unwrap_or(0.0));
        Self {
            raise: 0.45 * u[0],
            knee: 0.9 * sigmoid(1.5 * u[0]),
            elbow: 1.4 * sigmoid(1.5 * u[1]),
            wrinkle: u[2],
            light_azimuth: 0.8 * u[3],
            width: u[4],
            skirt: exp(0.15 * u[5]),
            hue: 0.5 * u[6],
            yaw: 0.35 * u[7],
        }
    }

    /// Unit vector towards the light.
    pub fn towards_light(&self) -> V3 {
        let (s, c) = (sin(self.light_azimuth), cos(self.light_azimuth));
        // cos 30°, sin 30°
        let (flat, up) = (0.75_f64.sqrt(), 0.5);
        [flat * s, -flat * c, up]
    }

    /// Displacement by the wrinkles at a canonical point, along its normal, and the gradient of that field.
    ///
    /// # Kinks and domain
    /// φ has no gradient on the axis: within 0.05 of it, the gradient of 3 φ is evaluated at 0.05.
    pub fn wrinkles(&self, x: V3) -> (f64, V3) {
        let square = x[0] * x[0] + x[1] * x[1];
        let angle = 12.0 * x[2] + 3.0 * reference::scalar::Scalar::atan2(x[1], x[0]);
        let slope = WRINKLE * self.wrinkle * cos(angle);
        let floor = 0.05 * 0.05;
        let around = 3.0 / if square > floor { square } else { floor };
        (WRINKLE * self.wrinkle * sin(angle), [slope * around * -x[1], slope * around * x[0], slope * 12.0])
    }

    /// Displacement by the width of the body at a radius of `radius`, where w is that of the part at u_B = 1:
    /// u_B min(w, r/5). No surface turns inside out above u_B = −5.
    pub fn girth(&self, w: f64, radius: f64) -> f64 {
        let most = 0.2 * radius;
        self.width * if w < most { w } else { most }
    }

    /// A height below the rim of the skirt, changed by the length of the skirt.
    pub fn skirt_height(&self, rim: f64, z: f64) -> f64 {
        if z < rim { rim + (z - rim) * self.skirt } else { z }
    }
}

/// The sRGB transfer function, 0..1.
pub fn srgb_of_linear(x: f64) -> f64 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * libm_pow(x, 1.0 / 2.4) - 0.055 }
}

/// The inverse of the sRGB transfer function.
pub fn linear_of_srgb(x: f64) -> f64 {
    if x <= 0.040_45 { x / 12.92 } else { libm_pow((x + 0.055) / 1.055, 2.4) }
}

fn libm_pow(x: f64, y: f64) -> f64 {
    reference::scalar::Scalar::pow(x, y)
}

/// The larger value; x if they are equal.
fn at_least(x: f64, low: f64) -> f64 {
    if x < low { low } else { x }
}

/// The smaller value; x if they are equal.
fn at_most(x: f64, high: f64) -> f64 {
    if x > high { high } else { x }
}

/// Clamps to 0..1.
pub(super) fn unit_interval(x: f64) -> f64 {
    at_most(at_least(x, 0.0), 1.0)
}

/// A colour rotated about the grey axis and clamped to 0..1.
pub fn turn_hue(rgb: [f64; 3], angle: f64) -> [f64; 3] {
    let (s, c) = (sin(angle), cos(angle));
    let same = c + (1.0 - c) / 3.0;
    let third = (1.0 - c) / 3.0;
    let root = s / 3.0_f64.sqrt();
    let mix = |a: f64, b: f64, d: f64| unit_interval(same * a + (third - root) * b + (third + root) * d);
    [mix(rgb[0], rgb[1], rgb[2]), mix(rgb[1], rgb[2], rgb[0]), mix(rgb[2], rgb[0], rgb[1])]
}

/// Lambert shading of an sRGB-encoded colour: linear albedo × (0.35 + 0.65 max(0, n·l)), encoded again.
pub fn shaded(rgb: [f64; 3], normal: V3, towards_light: V3) -> [f64; 3] {
    let cosine = super::skeleton::dot(normal, towards_light);
    let light = AMBIENT + (1.0 - AMBIENT) * if cosine > 0.0 { cosine } else { 0.0 };
    rgb.map(|c| srgb_of_linear(linear_of_srgb(c) * light))
}
