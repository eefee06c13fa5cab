//! An environment map for testing orientation.
//!
//! The map shows six discs of 25°, one around every axis: +x red, −x cyan, +y green, −y magenta, +z blue, −z
//! yellow. Discs of negative axes have a dark centre of 8°, so that they can be distinguished without colour.
//! The remainder is grey, darker below the horizon.
//!
//! In the image of the map (u to the right, v down), [`crate::scene::light`] places +y in the centre of the
//! middle row, +x a quarter of the width to the right of it, −x a quarter to the left, −y at both sides; +z
//! is the top edge, −z the bottom edge.

use super::environment::texel_center;
use super::vector::dot;
use crate::scene::light::Environment;

/// Axes and the colours around them.
pub const AXES: [([f32; 3], [f32; 3]); 6] = [
    ([1.0, 0.0, 0.0], [1.0, 0.05, 0.05]),
    ([-1.0, 0.0, 0.0], [0.05, 1.0, 1.0]),
    ([0.0, 1.0, 0.0], [0.05, 1.0, 0.05]),
    ([0.0, -1.0, 0.0], [1.0, 0.05, 1.0]),
    ([0.0, 0.0, 1.0], [0.05, 0.05, 1.0]),
    ([0.0, 0.0, -1.0], [1.0, 1.0, 0.05]),
];
/// Cosine of the disc's radius, 25°.
const DISC: f32 = 0.906_307_8;
/// Cosine of the dark centre's radius, 8°.
const MIDDLE: f32 = 0.990_268_1;

/// Returns the radiance of the test map in a direction.
pub fn radiance(towards: [f32; 3]) -> [f32; 3] {
    for (i, (axis, color)) in AXES.iter().enumerate() {
        let c = dot(*axis, towards);
        if c > DISC {
            return if i % 2 == 1 && c > MIDDLE { color.map(|x| 0.25 * x) } else { *color };
        }
    }
    if towards[2] > 0.0 { [0.4; 3] } else { [0.2; 3] }
}

/// Returns the test map with 2·`height` columns.
pub fn map(height: usize) -> Environment {
    let width = 2 * height;
    let radiance =
        (0..width * height).map(|t| radiance(texel_center(width, height, t / width, t % width))).collect();
    Environment { width, height, radiance }
}
