//! `loss.prior`: priors for Gaussians that no camera sees.
//!
//! P = Σ_a w_a/(N K) Σ_g Σ_{h ∈ near(g)} ‖a_g − a_h‖²  +  w_r/N Σ_g Σ_k (s_gk − s̄_g)²
//!   + w_f/N Σ_g (s̄_g − ln(κ d_g))²  +  w_t/N Σ_g ‖x_g − t_g‖²/r²  −  w_o/N Σ_g σ(l_g)
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | a | constant coefficients of `sh`, `opacity_logits`, `scales_log` | (N, C, 3), (N), (N, 3) |
//! | x, t | `means`, `anchors` | (N, 3) |
//! | s, l | `scales_log`, `opacity_logits` | |
//! | near | `near` | (N, K), −1 where there are fewer |
//! | ln d | `gap` | (N) |
//! | w, κ, r | settings | () |
//! | P | `value` | () |
//!
//! # Kinks and domain
//! No kinks. κ > 0 and r > 0; without Gaussians P is 0.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `loss.prior`.
    pub struct In<'a, S> {
        means: &'a Arr<S> = Port::var("N,3", "centres, scene units"),
        scales_log: &'a Arr<S> = Port::var("N,3", "logarithms of the scales"),
        opacity_logits: &'a Arr<S> = Port::var("N", "logits of the opacities"),
        sh: &'a Arr<S> = Port::var("N,C,3", "colour coefficients; the constant ones are compared"),
        near: &'a Arr<S> = Port::int("N,6", Dtype::I32, "indices of the nearest, -1 where there are fewer"),
        gap: &'a Arr<S> = Port::fixed("N", "logarithm of the distance to the nearest"),
        anchors: &'a Arr<S> = Port::fixed("N,3", "positions that the centres are anchored to"),
    }
}

/// `loss.prior`
pub static SIGNATURE: Signature = Signature {
    name: "loss.prior",
    summary: "priors for Gaussians that no camera sees",
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "")],
    settings: &[
        SettingSpec::number("color", "0", "weight of the colour difference of neighbours"),
        SettingSpec::number("opacity", "0", "weight of the difference of neighbours' opacity logits"),
        SettingSpec::number("scale", "0", "weight of the difference of neighbours' scales"),
        SettingSpec::number("round", "0", "weight of roundness"),
        SettingSpec::number(
            "fill",
            "0",
            "weight of the difference between size and gap to the nearest neighbour",
        ),
        SettingSpec::number("reach", "1", "target ratio of size to gap, above 0"),
        SettingSpec::number("anchor", "0", "weight of the distance from the anchors"),
        SettingSpec::number("solid", "0", "weight of the mean opacity, subtracted"),
        SettingSpec::number(
            "radius",
            "1",
            "distance from the anchor at which its term equals its weight, above 0",
        ),
    ],
    ..Signature::EMPTY
};

/// Settings of `loss.prior`.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Weights of the differences of colours, opacity logits and scales.
    pub likeness: [f64; 3],
    /// Weight of roundness.
    pub round: f64,
    /// Weight of the size.
    pub fill: f64,
    /// κ.
    pub reach: f64,
    /// Weight of the distance from the anchors.
    pub anchor: f64,
    /// Weight of the mean opacity.
    pub solid: f64,
    /// r.
    pub radius: f64,
}

impl Settings {
    fn of<S>(call: &Call<'_, S>) -> Self {
        let number = |key| call.settings.number(key);
        Self {
            likeness: ["color", "opacity", "scale"].map(number),
            round: number("round"),
            fill: number("fill"),
            reach: number("reach"),
            anchor: number("anchor"),
            solid: number("solid"),
            radius: number("radius"),
        }
    }
}

fn square<S: Scalar>(x: S) -> S {
    x * x
}

/// The twin of `loss.prior`.
///
/// # Errors
/// When the index of a neighbour is out of range, or κ or r is not above 0.
pub fn forward<S: Scalar>(input: &In<'_, S>, settings: Settings, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { means, scales_log, opacity_logits, sh, near, gap, anchors } = *input;
    let ([n, k], coefficients) = ([near.shape[0], near.shape[1]], sh.shape[1]);
    if !(settings.reach > 0.0 && settings.radius > 0.0) {
        return Err("settings reach, radius: expected numbers above 0".to_owned());
    }
    let value = out.array("value", &[]);
    let (each, pairs) = (n as f64, (n * k) as f64);
    let [color, opacity, scale] = settings.likeness;
    for g in 0..n {
        for slot in 0..k {
            let index = near.data[g * k + slot].value();
            if index < 0.0 {
                continue;
            }
            let h = index as usize;
            if h >= n {
                return Err(format!("input near: expected an index below {n}, got {index}"));
            }
            let mut term = square(opacity_logits.data[g] - opacity_logits.data[h]) * opacity;
            for c in 0..3 {
                let row = |g: usize| sh.data[g * 3 * coefficients + c];
                term = term + square(row(g) - row(h)) * color;
                term = term + square(scales_log.data[3 * g + c] - scales_log.data[3 * h + c]) * scale;
            }
            out.add(value, 0, term / pairs, 1.0);
            out.flush();
        }
        let (s, x, t): ([S; 3], [S; 3], [S; 3]) = (scales_log.row(g), means.row(g), anchors.row(g));
        let mean = (s[0] + s[1] + s[2]) / 3.0;
        let lack = mean - (gap.data[g] + libm::log(settings.reach));
        let mut term = square(lack) * settings.fill;
        for c in 0..3 {
            term = term + square(s[c] - mean) * settings.round;
            term = term + square((x[c] - t[c]) / settings.radius) * settings.anchor;
        }
        let visible = S::one() / ((-opacity_logits.data[g]).exp() + 1.0);
        out.add(value, 0, (term - visible * settings.solid) / each, 1.0);
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, Settings::of(call), out)
}
