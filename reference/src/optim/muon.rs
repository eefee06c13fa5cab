//! `optim.muon`: Muon (Jordan et al. 2024) with the step length of Liu et al. 2025.
//!
//! m ← μ m + (1−μ) g,   u = μ m + (1−μ) g,   X = u/‖u‖,   five times X ← a X + (b A + c A²) X with A = X Xᵀ
//!
//! θ ← θ − lr·weight_decay·θ − lr·rms·√max(R, C)·X
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | θ | `param` | (B, R, C), B matrices, each by itself |
//! | g | `grads` | (S, B, R, C), one per step |
//! | | `trajectory` | (S, B, R, C), θ after each step |
//! | m | `m` | (B, R, C), after the last step |
//!
//! Settings: `lr` (1e-3), `momentum` μ (0.95), `weight_decay` (0), `rms` (0.2). (a, b, c) = (3.4445, −4.7750, 2.0315). ‖u‖ is the Frobenius norm; where it is
//! 0, X is 0. Matrices with more rows than columns are transposed, which changes X by rounding alone.
//!
//! # Rounding
//! Sums of products from 0 in ascending order; A² as A·A; b·A + c·A², then a·X + that·X; decay first.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::optim::adam::LR;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::twins::Call;

inputs! {
    /// Inputs of `optim.muon`.
    pub struct In<'a, S> {
        param: &'a Arr<S> = Port::fixed("B,R,C", "start, B matrices"),
        grads: &'a Arr<S> = Port::fixed("S,B,R,C", "one gradient per step"),
    }
}

/// `optim.muon`
pub static SIGNATURE: Signature = Signature {
    name: "optim.muon",
    summary: "momentum made nearly orthogonal, matrix by matrix",
    inputs: In::<f64>::PORTS,
    outputs: ports![trajectory: Port::fixed("S,B,R,C", "parameters after each step")],
    intermediates: ports![m: Port::fixed("B,R,C", "momentum after the last step")],
    settings: &[
        LR,
        SettingSpec::number("momentum", "0.95", "decay of the momentum"),
        SettingSpec::number("weight_decay", "0", "parameters shrink by lr·weight_decay each step"),
        SettingSpec::number("rms", "0.2", "root mean square of a step, in units of lr"),
    ],
    ..Signature::EMPTY
};

/// Coefficients of X, A·X and A²·X.
const POLYNOMIAL: [f64; 3] = [3.4445, -4.7750, 2.0315];

/// Settings of an update.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Learning rate.
    pub lr: f64,
    /// Decay of the momentum.
    pub momentum: f64,
    /// θ ← θ − lr·weight_decay·θ before each update.
    pub weight_decay: f64,
    /// Root mean square of a step in units of the rate.
    pub rms: f64,
}

impl Settings {
    /// Reads the settings.
    ///
    /// # Errors
    /// When the momentum is not below 1.
    pub fn of(call: &Call<'_, f64>) -> Result<Self, String> {
        let number = |key| call.settings.number(key);
        let momentum = number("momentum");
        if !(0.0..1.0).contains(&momentum) {
            return Err(format!("setting momentum: expected 0 or more and less than 1, got {momentum}"));
        }
        Ok(Self { lr: number("lr"), momentum, weight_decay: number("weight_decay"), rms: number("rms") })
    }
}

/// x (r, n) · y (n, c)
fn product(x: &[f64], y: &[f64], [r, n, c]: [usize; 3]) -> Vec<f64> {
    let mut made = Vec::with_capacity(r * c);
    for i in 0..r {
        for j in 0..c {
            made.push((0..n).fold(0.0, |sum, k| sum + x[i * n + k] * y[k * c + j]));
        }
    }
    made
}

fn transposed(x: &[f64], [r, c]: [usize; 2]) -> Vec<f64> {
    (0..c).flat_map(|j| (0..r).map(move |i| x[i * c + j])).collect()
}

/// The iteration on a matrix (r, c) with r ≤ c.
fn iterated(u: &[f64], [r, c]: [usize; 2]) -> Vec<f64> {
    let norm = u.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
    let [first, second, third] = POLYNOMIAL;
    let mut x: Vec<f64> = u.iter().map(|x| if norm > 0.0 { x / norm } else { 0.0 }).collect();
    for _ in 0..5 {
        let a = product(&x, &transposed(&x, [r, c]), [r, c, r]);
        let square = product(&a, &a, [r, r, r]);
        let sum: Vec<f64> = a.iter().zip(&square).map(|(a, s)| second * a + third * s).collect();
        let moved = product(&sum, &x, [r, r, c]);
        x = x.iter().zip(&moved).map(|(x, y)| first * x + y).collect();
    }
    x
}

/// The twin of `optim.muon`.
pub fn forward(input: &In<'_, f64>, settings: Settings, out: &mut Out<'_, f64>) {
    let In { param, grads } = *input;
    let [steps, rows, columns] = [grads.shape[0], param.shape[1], param.shape[2]];
    let Settings { lr, momentum, weight_decay, rms } = settings;
    let (entries, size) = (param.data.len(), rows * columns);
    let (mut theta, mut m) = (param.data.clone(), vec![0.0; entries]);
    let trajectory = out.array("trajectory", &grads.shape);
    let length = lr * rms * (Ord::max(rows, columns) as f64).sqrt();
    for step in 0..steps {
        let g = &grads.data[step * entries..][..entries];
        let mut u = vec![0.0; entries];
        for i in 0..entries {
            m[i] = momentum * m[i] + (1.0 - momentum) * g[i];
            u[i] = momentum * m[i] + (1.0 - momentum) * g[i];
        }
        for at in (0..entries).step_by(size.max(1)) {
            let own = &u[at..at + size];
            let x = if rows > columns {
                transposed(&iterated(&transposed(own, [rows, columns]), [columns, rows]), [columns, rows])
            } else {
                iterated(own, [rows, columns])
            };
            for (i, x) in x.into_iter().enumerate() {
                let shrunk = theta[at + i] - lr * weight_decay * theta[at + i];
                theta[at + i] = shrunk - length * x;
            }
        }
        for (i, x) in theta.iter().enumerate() {
            out.put(trajectory, step * entries + i, *x);
        }
    }
    let slot = out.array("m", &param.shape);
    m.iter().enumerate().for_each(|(i, &x)| out.put(slot, i, x));
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or a setting has an inadmissible value.
pub fn run(call: &Call<'_, f64>, out: &mut Out<'_, f64>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, Settings::of(call)?, out);
    Ok(())
}
