//! AdamW (Loshchilov & Hutter 2019): [`super::adam`] with decoupled weight decay, decay first.
//!
//! θ ← θ − lr·weight_decay·θ, then Adam's update with the gradient as given. `weight_decay` defaults to 0.01.

use crate::array::{Named, Out};
use crate::optim::adam::{Constants, run};
use crate::settings::Settings;

/// The twin of `optim.adamw`.
///
/// # Errors
/// When an input is missing or shaped otherwise, or a setting has a value it cannot have.
pub fn forward(x: &Named<f64>, settings: &Settings<'_>, out: &mut Out<f64>) -> Result<(), String> {
    run(x, Constants::of(settings, 0.01)?, out)
}
