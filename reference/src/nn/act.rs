//! Activations.
//!
//! y = x where x > 0, s·x elsewhere
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | any |
//! | s | setting `slope` | () |
//! | y | `y` | as x |
//!
//! # Kinks and domain
//! At x = 0 the lower branch is taken.

use crate::array::{Named, Out};
use crate::scalar::Scalar;
use crate::settings::Settings;

/// The twin of `nn.leaky_relu`.
///
/// # Errors
/// When the input is missing or the setting is no finite number.
pub fn leaky_relu<S: Scalar>(
    arrays: &Named<S>,
    settings: &Settings<'_>,
    out: &mut Out<S>,
) -> Result<(), String> {
    let x = arrays.get("x").ok_or("input x is missing")?;
    let slope = settings.number("slope", 0.2)?;
    let y = out.array("y", &x.shape);
    for (i, &x) in x.data.iter().enumerate() {
        out.put(y, i, if x.value() > 0.0 { x } else { x * slope });
    }
    out.flush();
    Ok(())
}
