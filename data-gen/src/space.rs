//! Small vectors.

use reference::num::elem::{cos, sin};

pub(crate) type V3 = [f64; 3];

pub(crate) fn add(a: V3, b: V3) -> V3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn sub(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn scaled(a: V3, s: f64) -> V3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

pub(crate) fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn length(a: V3) -> f64 {
    dot(a, a).sqrt()
}

/// The vector divided by its length, which must not be 0.
pub(crate) fn unit(a: V3) -> V3 {
    let n = length(a);
    [a[0] / n, a[1] / n, a[2] / n]
}

/// Linear interpolation a + t (b − a) per component.
pub(crate) fn mix<const N: usize>(a: [f64; N], b: [f64; N], t: f64) -> [f64; N] {
    std::array::from_fn(|i| a[i] + t * (b[i] - a[i]))
}

/// Clamps between low and high.
pub(crate) fn clamp(x: f64, low: f64, high: f64) -> f64 {
    if x < low {
        low
    } else if x > high {
        high
    } else {
        x
    }
}

/// The larger value.
pub(crate) fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The smaller value.
pub(crate) fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// 0 below the first edge, 1 above the second edge, 3t² − 2t³ in between.
pub(crate) fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = clamp((x - low) / (high - low), 0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// |x|ᵖ for p > 0.
pub(crate) fn power(x: f64, p: f64) -> f64 {
    let x = x.abs();
    if x > 0.0 { reference::num::elem::exp(p * reference::num::elem::ln(x)) } else { 0.0 }
}

/// Rows of the matrix of the rotation by an angle about a unit axis (Rodrigues).
pub(crate) fn rotation(axis: V3, angle: f64) -> [V3; 3] {
    let (s, c) = (sin(angle), cos(angle));
    let [x, y, z] = axis;
    let d = 1.0 - c;
    [
        [c + x * x * d, x * y * d - z * s, x * z * d + y * s],
        [y * x * d + z * s, c + y * y * d, y * z * d - x * s],
        [z * x * d - y * s, z * y * d + x * s, c + z * z * d],
    ]
}

pub(crate) fn rotated(m: &[V3; 3], a: V3) -> V3 {
    [dot(m[0], a), dot(m[1], a), dot(m[2], a)]
}
