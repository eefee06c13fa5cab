//! Mean absolute error, `MAE`: Σ |clamp(x) − y| / n over the n kept values, in f64.

use crate::Result;
use crate::loss::{CHANNELS, In, finite, image_sum, metric::clamped};

/// Name of the variant.
pub const NAME: &str = "MAE";

/// Returns the mean absolute error.
///
/// # Errors
/// Returns an error for wrong sizes, a mask value other than 0 and 1, a mask that keeps no pixel, or images
/// that are not finite.
pub fn forward(x: &In<'_>) -> Result<f64> {
    let count = CHANNELS * x.check("metric.mae")?;
    let total = finite("metric.mae", image_sum(x, |a, b| (clamped(a) - f64::from(b)).abs()))?;
    Ok(total / count as f64)
}
