//! Adam (Kingma & Ba 2015), row by row.
//!
//! m ← β1 m + (1−β1) g,   v ← β2 v + (1−β2) g²,   θ ← θ − lr·m̂/(√v̂ + ε),   m̂ = m/(1−β1ᵗ),   v̂ = v/(1−β2ᵗ)
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | θ | `param` | (N, …) |
//! | g | `grads` | (S, N, …), one per step |
//! | | `active` | (S, N), optional: a row's value, moments and counter move only where it is 1 |
//! | | `trajectory` | (S, N, …), θ after each step |
//! | m, v | `m`, `v` | (N, …), after the last step |
//! | t | `steps` | (N), after the last step |
//!
//! Settings: `lr` (1e-3), `beta1` (0.9), `beta2` (0.999), `eps` (1e-8), `counters`: `row` (t counts a row's own active
//! steps) or `global` (t counts all steps, as other programs do, so that a row born late starts with a step of
//! (1−β1)/√(1−β2)·lr).
//!
//! # Rounding
//! β1ᵗ and β2ᵗ by repeated multiplication. m = β1·m + (1−β1)·g; v = β2·v + (1−β2)·(g·g);
//! θ − (lr·(m/(1−β1ᵗ)))/(√(v/(1−β2ᵗ)) + ε).

use crate::array::{ANY, Arr, Named, Out, expect};
use crate::settings::Settings;

/// Constants of an update.
#[derive(Clone, Copy, Debug)]
pub struct Constants {
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

impl Constants {
    /// Reads the settings; `weight_decay` is the default decay.
    ///
    /// # Errors
    /// When a setting has a value it cannot have.
    pub fn of(settings: &Settings<'_>, weight_decay: f64) -> Result<Self, String> {
        let row_counters = match settings.text("counters", "row")?.as_str() {
            "row" => true,
            "global" => false,
            other => return Err(format!("setting counters: expected row or global, got {other}")),
        };
        let constants = Self {
            lr: settings.number("lr", 1e-3)?,
            beta1: settings.number("beta1", 0.9)?,
            beta2: settings.number("beta2", 0.999)?,
            eps: settings.number("eps", 1e-8)?,
            weight_decay: settings.number("weight_decay", weight_decay)?,
            row_counters,
        };
        for (name, beta) in [("beta1", constants.beta1), ("beta2", constants.beta2)] {
            if !(0.0..1.0).contains(&beta) {
                return Err(format!("setting {name}: expected 0 or more and less than 1, got {beta}"));
            }
        }
        Ok(constants)
    }
}

/// Powers of the decays and the number of steps behind them.
#[derive(Clone, Copy, Debug)]
struct Counter {
    beta1: f64,
    beta2: f64,
    steps: f64,
}

/// All steps; shared with [`super::adamw`].
///
/// # Errors
/// When an input is missing or shaped otherwise.
pub fn run(x: &Named<f64>, constants: Constants, out: &mut Out<f64>) -> Result<(), String> {
    let param = x.get("param").ok_or("input param is missing")?;
    let Some(&rows) = param.shape.first() else {
        return Err("input param: expected at least one axis, got a 0-d array".to_owned());
    };
    let mut shape = vec![ANY];
    shape.extend(&param.shape);
    let grads = expect(x, "grads", &shape)?;
    let steps = grads.shape[0];
    shape[0] = steps;
    let active = x.contains_key("active").then(|| expect(x, "active", &[steps, rows])).transpose()?;
    if let Some(a) = active.and_then(|active| active.data.iter().find(|a| ![0.0, 1.0].contains(*a))) {
        return Err(format!("input active: expected 0 or 1, got {a}"));
    }
    let entries = param.data.len();
    let width = entries.checked_div(rows).unwrap_or(0);
    let Constants { lr, beta1, beta2, eps, weight_decay, row_counters } = constants;
    let (mut theta, mut m, mut v) = (param.data.clone(), vec![0.0; entries], vec![0.0; entries]);
    let start = Counter { beta1: 1.0, beta2: 1.0, steps: 0.0 };
    let advance =
        |c: Counter| Counter { beta1: c.beta1 * beta1, beta2: c.beta2 * beta2, steps: c.steps + 1.0 };
    let (mut counters, mut global) = (vec![start; rows], start);
    let trajectory = out.array("trajectory", &shape);
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
/// When an input is missing or shaped otherwise, or a setting has a value it cannot have.
pub fn forward(x: &Named<f64>, settings: &Settings<'_>, out: &mut Out<f64>) -> Result<(), String> {
    let constants = Constants::of(settings, 0.0)?;
    if constants.weight_decay != 0.0 {
        return Err("setting weight_decay: optim.adam has none; optim.adamw has".to_owned());
    }
    run(x, constants, out)
}
