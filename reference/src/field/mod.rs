//! Fields of an object: feature planes, heads, densities, compositing along rays.

pub mod composite;
mod decisions;
pub mod density;
pub mod embed;
pub mod fetch;
pub mod interval;
mod network;
pub mod normal;
pub mod normal_head;
pub mod render;
pub mod sdf_head;
pub mod value_head;

use crate::ports::SettingSpec;

/// Half size of the box.
const HALF_SIZE: SettingSpec =
    SettingSpec::number("half_size", "0.525", "half the side R of the box, above 0");

/// The setting `half_size`.
///
/// # Errors
/// When it is not above 0.
fn half_size(settings: &crate::settings::Settings<'_>) -> Result<f64, String> {
    match settings.number("half_size") {
        r if r > 0.0 => Ok(r),
        r => Err(format!("setting half_size: expected a number above 0, got {r}")),
    }
}

/// ‖x‖, slope 0 at 0.
fn length<S: crate::scalar::Scalar>([x, y, z]: [S; 3]) -> S {
    (x * x + y * y + z * z).sqrt()
}

/// Sum of the arrays' shapes: the number of rows times the number of weights.
fn products<'a>(rows: usize, weights: impl Iterator<Item = &'a crate::array::Arr<f64>>) -> u64 {
    weights.fold(0, |sum, w| sum + (rows * w.data.len()) as u64)
}
