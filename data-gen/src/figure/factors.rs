//! What each factor drives.
//!
//! | index | factor | effect |
//! |---|---|---|
//! | 0 | u_P posture | arms raised by 0.45 u_P rad, knees bent by 0.9 σ(1.5 u_P) rad |
//! | 1 | u_O self-occlusion | right elbow bent by 1.4 σ(1.5 u_O) rad |
//! | 2 | u_W wrinkles | cloth of the trunk displaced along its normal by 0.03 u_W sin(12 z + 3 φ) before skinning |
//! | 3 | u_L light | azimuth 0.8 u_L rad, elevation 30°, ambient share 0.35; no effect on positions |
//! | 4 | u_B body width | displaced along the normal by u_B min(w, r/5), r the radius: trunk w = 0.02, limbs w = 0.006, head 0 |
//! | 5 | u_S skirt length | heights of the skirt, or of a shirt over trousers, below a rim times exp(0.15 u_S) |
//! | 6 | u_H hue | colours of cloth turned by 0.5 u_H rad about grey |
//! | 7 | u_Y head yaw | 0.35 u_Y rad |
//!
//! Lengths are those of the figure's frame, φ = atan2(y, x). Factors that a data set does not have are 0.
//!
//! z and φ of the folds are those of the place at rest: a fold depends on u_W alone, whatever width and length add to it.
//! `last.md` folds "torso and skirt". Its torso is the trunk; here the capsule of the pelvis covers belly and waist, the torso's the
//! chest, so the points of both and of the skirt are folded.

use super::skeleton::V3;
use reference::num::elem::{cos, exp, sigmoid, sin};

/// Letters of the factors, in index order.
pub const LETTERS: [char; super::MAX_FACTORS] = ['P', 'O', 'W', 'L', 'B', 'S', 'H', 'Y'];

/// Share of the light that comes from everywhere.
pub const AMBIENT: f64 = 0.35;

/// Amplitude of the wrinkles at u_W = 1.
pub const WRINKLE: f64 = 0.03;

/// Displacement of the trunk at u_B = 1.
pub const TRUNK_WIDTH: f64 = 0.02;

/// Displacement of limbs at u_B = 1.
pub const LIMB_WIDTH: f64 = 0.006;

/// Factors turned into angles, lengths and factors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Of the arms, rad.
    pub raise: f64,
    /// Of the knees, rad.
    pub knee: f64,
    /// Of the right elbow, rad.
    pub elbow: f64,
    /// u_W
    pub wrinkle: f64,
    /// Of the light, rad; 0 is in front of the figure, positive towards its left.
    pub light_azimuth: f64,
    /// u_B
    pub width: f64,
    /// Factor of the skirt's length.
    pub skirt: f64,
    /// Of the cloth's colours, rad.
    pub hue: f64,
    /// Of the head, rad.
    pub yaw: f64,
}

impl Drive {
    /// From the factors, at most eight; those missing are 0.
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

    /// Displacement of the wrinkles at a canonical point, along its normal, and the gradient of that field.
    ///
    /// # Kinks and domain
    /// φ has no gradient on the axis: within 0.05 of it the gradient of 3 φ is taken as at 0.05.
    pub fn wrinkles(&self, x: V3) -> (f64, V3) {
        let square = x[0] * x[0] + x[1] * x[1];
        let angle = 12.0 * x[2] + 3.0 * reference::scalar::Scalar::atan2(x[1], x[0]);
        let slope = WRINKLE * self.wrinkle * cos(angle);
        let floor = 0.05 * 0.05;
        let around = 3.0 / if square > floor { square } else { floor };
        (WRINKLE * self.wrinkle * sin(angle), [slope * around * -x[1], slope * around * x[0], slope * 12.0])
    }

    /// Displacement by the body's width where the radius is `radius`, w that of the part at u_B = 1: u_B min(w, r/5). Nothing turns
    /// inside out above u_B = −5.
    pub fn girth(&self, w: f64, radius: f64) -> f64 {
        let most = 0.2 * radius;
        self.width * if w < most { w } else { most }
    }

    /// A height below the skirt's rim, moved by the length of the skirt.
    pub fn skirt_height(&self, rim: f64, z: f64) -> f64 {
        if z < rim { rim + (z - rim) * self.skirt } else { z }
    }
}

/// The sRGB transfer function, 0..1.
pub fn srgb_of_linear(x: f64) -> f64 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * libm_pow(x, 1.0 / 2.4) - 0.055 }
}

/// Its inverse.
pub fn linear_of_srgb(x: f64) -> f64 {
    if x <= 0.040_45 { x / 12.92 } else { libm_pow((x + 0.055) / 1.055, 2.4) }
}

fn libm_pow(x: f64, y: f64) -> f64 {
    reference::scalar::Scalar::pow(x, y)
}

/// The larger one; x where they are equal.
fn at_least(x: f64, low: f64) -> f64 {
    if x < low { low } else { x }
}

/// The smaller one; x where they are equal.
fn at_most(x: f64, high: f64) -> f64 {
    if x > high { high } else { x }
}

/// Limits to 0..1.
pub(super) fn unit_interval(x: f64) -> f64 {
    at_most(at_least(x, 0.0), 1.0)
}

/// A colour turned about the grey axis and limited to 0..1.
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
