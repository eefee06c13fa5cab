//! `field.normal`: gradient and normal of a signed distance, from its values at a stencil.
//!
//! gₖ = (s(x + εeₖ) − s(x))/ε or (s(x + εeₖ) − s(x − εeₖ))/2ε,   n = g/max(‖g‖, 10⁻⁴)
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | s | `sdf` | (N, 4): x, then x + εeₖ; (N, 6): x + εe₁, x − εe₁, x + εe₂, … |
//! | ε | setting `epsilon` | () |
//! | | setting `mode` | `forward` or `central` |
//! | g, n | `gradient`, `normal` | (N, 3) |
//!
//! # Rounding
//! As written.
//!
//! # Kinks and domain
//! At ‖g‖ = 10⁻⁴ the slope of g/‖g‖.

use super::length;
use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `field.normal`.
    pub struct In<'a, S> {
        sdf: &'a Arr<S> = Port::var("N,4|N,6", "at the points of the stencil"),
    }
}

/// `field.normal`
pub static SIGNATURE: Signature = Signature {
    name: "field.normal",
    summary: "gradient and normal of a signed distance by differences",
    inputs: In::<f64>::PORTS,
    outputs: ports![gradient: Port::var("N,3", ""), normal: Port::var("N,3", "unit where the gradient is not tiny")],
    settings: &[
        SettingSpec::number("epsilon", "0.0041", "step of the differences, scene units"),
        SettingSpec::choice("mode", &["forward", "central"], "forward", "4 or 6 values per point"),
    ],
    ..Signature::EMPTY
};

/// Gradient from four values (forward) or six (central).
pub fn differences<S: Scalar>(s: &[S], epsilon: f64) -> [S; 3] {
    std::array::from_fn(|k| {
        if s.len() == 6 { (s[2 * k] - s[2 * k + 1]) / (2.0 * epsilon) } else { (s[k + 1] - s[0]) / epsilon }
    })
}

/// g/max(‖g‖, 1e-4).
pub fn direction<S: Scalar>(g: [S; 3]) -> [S; 3] {
    direction_by(g, |is_long| is_long)
}

/// g/max(‖g‖, 1e-4); `choose` decides whether ‖g‖ is not the smaller one.
pub(super) fn direction_by<S: Scalar>(g: [S; 3], mut choose: impl FnMut(bool) -> bool) -> [S; 3] {
    let length = length(g);
    let divisor = if choose(length.value() >= 1e-4) { length } else { S::from_f64(1e-4) };
    g.map(|g| g / divisor)
}

/// The twin of `field.normal`.
///
/// # Errors
/// When the number of values does not match the mode, or ε is not above 0.
pub fn forward<S: Scalar>(
    input: &In<'_, S>,
    epsilon: f64,
    is_central: bool,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    let [n, width] = [input.sdf.shape[0], input.sdf.shape[1]];
    if (width == 6) != is_central {
        return Err(format!("input sdf: {width} values per point do not match the mode"));
    }
    if !(epsilon > 0.0) {
        return Err(format!("setting epsilon: expected a number above 0, got {epsilon}"));
    }
    let (gradient, normal) = (out.array("gradient", &[n, 3]), out.array("normal", &[n, 3]));
    for row in 0..n {
        let s = &input.sdf.data[row * width..(row + 1) * width];
        let g = differences(s, epsilon);
        out.put_row(gradient, row, g);
        out.put_row(normal, row, direction(g));
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let is_central = call.settings.word("mode") == "central";
    forward(&In::of(call.arrays)?, call.settings.number("epsilon"), is_central, out)
}
