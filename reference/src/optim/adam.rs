//! `optim.adam`: Adam (Kingma & Ba 2015), row by row.
//!
//! m ← β1 m + (1−β1) g,   v ← β2 v + (1−β2) g²,   θ ← θ − lr·m̂/(√v̂ + ε),   m̂ = m/(1−β1ᵗ),   v̂ = v/(1−β2ᵗ)
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | θ | `param` | (N, …) |
//! | g | `grads` | (S, N, …), one per step |
//! | | `active` | (S, N), optional: a row's value, moments and counter are updated only where it is 1 |
//! | | `trajectory` | (S, N, …), θ after each step |
//! | m, v | `m`, `v` | (N, …), after the last step |
//! | t | `steps` | (N), after the last step |
//!
//! Settings: `lr` (1e-3), `beta1` (0.9), `beta2` (0.999), `eps` (1e-8), `counters`: `row` (t counts a row's
//! own active steps) or `global` (t counts all steps, as in other programs; a row added late then starts with
//! a step of (1−β1)/√(1−β2)·lr).
//!
//! # Rounding
//! β1ᵗ and β2ᵗ by repeated multiplication. m = β1·m + (1−β1)·g; v = β2·v + (1−β2)·(g·g);
//! θ − (lr·(m/(1−β1ᵗ)))/(√(v/(1−β2ᵗ)) + ε).

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, SettingSpec, Signature, ports};
use crate::twins::Call;

inputs! {
    /// Inputs of `optim.adam` and `optim.adamw`.
    pub struct In<'a, S> {
        param: &'a Arr<S> = Port::fixed("N,...", "start"),
        grads: &'a Arr<S> = Port::fixed("S,N,...", "one gradient per step"),
        active: Option<&'a Arr<S>> =
            Port::int("S,N", Dtype::U8, "1: the row is updated (value, moments, counter); absent: all"),
    }
}

pub(super) const LR: SettingSpec = SettingSpec::number("lr", "0.001", "learning rate");
pub(super) const BETA1: SettingSpec = SettingSpec::number("beta1", "0.9", "decay of the first moment");
pub(super) const BETA2: SettingSpec = SettingSpec::number("beta2", "0.999", "decay of the second moment");
pub(super) const EPS: SettingSpec = SettingSpec::number("eps", "1e-8", "added to the root");
pub(super) const COUNTERS: SettingSpec =
    SettingSpec::choice("counters", &["row", "global"], "row", "which step count the bias correction uses");

/// `optim.adam`
pub static SIGNATURE: Signature = ADAM;

pub(super) const ADAM: Signature = Signature {
    name: "optim.adam",
    summary: "Adam, row by row, from zero moments",
    inputs: In::<f64>::PORTS,
    outputs: ports![trajectory: Port::fixed("S,N,...", "parameters after each step")],
    intermediates: ports![
        m: Port::fixed("N,...", "first moments after the last step"),
        v: Port::fixed("N,...", "second moments after the last step"),
        steps: Port::int("N", Dtype::I64, "step counters after the last step"),
    ],
    settings: &[
        LR,
        BETA1,
        BETA2,
        EPS,
        SettingSpec::number(
            "weight_decay",
            "0",
            "must be 0: optim.adam has no weight decay; see optim.adamw",
        ),
        COUNTERS,
    ],
    ..Signature::EMPTY
};

/// Settings of an update.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Step length.
    pub lr: f64,
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root.
    pub eps: f64,
    /// θ ← θ − lr·weight_decay·θ before each update.
    pub weight_decay: f64,
    /// Whether t counts a row's own steps.
    pub row_counters: bool,
}

impl Settings {
    /// Reads the settings.
    ///
    /// # Errors
    /// When a decay of the moments is not below 1.
    pub fn of(call: &Call<'_, f64>) -> Result<Self, String> {
        let number = |key| call.settings.number(key);
        let settings = Self {
            lr: number("lr"),
            beta1: number("beta1"),
            beta2: number("beta2"),
            eps: number("eps"),
            weight_decay: number("weight_decay"),
            row_counters: call.settings.word("counters") == "row",
        };
        for (name, beta) in [("beta1", settings.beta1), ("beta2", settings.beta2)] {
            if !(0.0..1.0).contains(&beta) {
                return Err(format!("setting {name}: expected 0 or more and less than 1, got {beta}"));
            }
        }
        Ok(settings)
    }
}

/// Powers of the decays, and the number of steps taken.
#[derive(Clone, Copy, Debug)]
struct Counter {
    beta1: f64,
    beta2: f64,
    steps: f64,
}

/// All steps; shared with [`super::adamw`].
///
/// # Errors
/// When an entry of `active` is neither 0 nor 1.
pub fn all_steps(input: &In<'_, f64>, settings: Settings, out: &mut Out<'_, f64>) -> Result<(), String> {
    let In { param, grads, active } = *input;
    let [steps, rows] = [grads.shape[0], param.shape[0]];
    if let Some(a) = active.and_then(|active| active.data.iter().find(|a| ![0.0, 1.0].contains(*a))) {
        return Err(format!("input active: expected 0 or 1, got {a}"));
    }
    let entries = param.data.len();
    let width = entries.checked_div(rows).unwrap_or(0);
    let Settings { lr, beta1, beta2, eps, weight_decay, row_counters } = settings;
    let (mut theta, mut m, mut v) = (param.data.clone(), vec![0.0; entries], vec![0.0; entries]);
    let start = Counter { beta1: 1.0, beta2: 1.0, steps: 0.0 };
    let advance =
        |c: Counter| Counter { beta1: c.beta1 * beta1, beta2: c.beta2 * beta2, steps: c.steps + 1.0 };
    let (mut counters, mut global) = (vec![start; rows], start);
    let trajectory = out.array("trajectory", &grads.shape);
    for step in 0..steps {
        global = advance(global);
        for row in 0..rows {
            if active.is_none_or(|active| active.data[step * rows + row] == 1.0) {
                counters[row] = if row_counters { advance(counters[row]) } else { global };
                for i in row * width..(row + 1) * width {
                    let g = grads.data[step * entries + i];
                    if weight_decay != 0.0 {
                        theta[i] -= lr * weight_decay * theta[i];
                    }
                    m[i] = beta1 * m[i] + (1.0 - beta1) * g;
                    v[i] = beta2 * v[i] + (1.0 - beta2) * (g * g);
                    let m_hat = m[i] / (1.0 - counters[row].beta1);
                    let v_hat = v[i] / (1.0 - counters[row].beta2);
                    theta[i] -= lr * m_hat / (v_hat.sqrt() + eps);
                }
            }
            for i in row * width..(row + 1) * width {
                out.put(trajectory, step * entries + i, theta[i]);
            }
        }
    }
    let mut write = |name: &str, array: Arr<f64>| {
        let slot = out.array(name, &array.shape);
        array.data.iter().enumerate().for_each(|(i, &x)| out.put(slot, i, x));
    };
    write("m", Arr::new(&param.shape, m));
    write("v", Arr::new(&param.shape, v));
    write("steps", Arr::new(&[rows], counters.iter().map(|c| c.steps).collect()));
    Ok(())
}

/// The twin of `optim.adam`.
///
/// # Errors
/// When an entry of `active` is neither 0 nor 1, or there is a weight decay.
pub fn forward(input: &In<'_, f64>, settings: Settings, out: &mut Out<'_, f64>) -> Result<(), String> {
    if settings.weight_decay != 0.0 {
        return Err("setting weight_decay: optim.adam has no weight decay; use optim.adamw".to_owned());
    }
    all_steps(input, settings, out)
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or a setting has an inadmissible value.
pub fn run(call: &Call<'_, f64>, out: &mut Out<'_, f64>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, Settings::of(call)?, out)
}
