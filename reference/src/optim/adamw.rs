//! `optim.adamw`: AdamW (Loshchilov & Hutter 2019): [`super::adam`] with decoupled weight decay, decay first.
//!
//! θ ← θ − lr·weight_decay·θ, then Adam's update with the gradient as given. `weight_decay` defaults to 0.01.

use crate::array::Out;
use crate::optim::adam::{self, ADAM, BETA1, BETA2, COUNTERS, EPS, In, LR, Settings};
use crate::ports::{SettingSpec, Signature};
use crate::twins::Call;

/// `optim.adamw`
pub static SIGNATURE: Signature = Signature {
    name: "optim.adamw",
    summary: "Adam with decoupled weight decay, decay first",
    settings: &[
        LR,
        BETA1,
        BETA2,
        EPS,
        SettingSpec::number("weight_decay", "0.01", "parameters shrink by lr·weight_decay each step"),
        COUNTERS,
    ],
    ..ADAM
};

/// The twin of `optim.adamw`.
///
/// # Errors
/// When an entry of `active` is neither 0 nor 1.
pub fn forward(input: &In<'_, f64>, settings: Settings, out: &mut Out<'_, f64>) -> Result<(), String> {
    adam::all_steps(input, settings, out)
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or a setting has an inadmissible value.
pub fn run(call: &Call<'_, f64>, out: &mut Out<'_, f64>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, Settings::of(call)?, out)
}
