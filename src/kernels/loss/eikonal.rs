//! `loss.eikonal`: deviation of the gradients of a signed distance from unit length.
//!
//! value = Σ (‖g‖² − 1)² / N
//!
//! This form has no square root, so that it is smooth at g = 0 (IGR, Gropp et al. 2020, use (‖g‖ − 1)²).
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | g | `gradient` | (N, 3) | N ≥ 1 |
//! | value | return | () | ≥ 0 |
//!
//! # Rounding
//! Terms are computed in f64 and added with 16 lanes ([`sum`]); one division, rounded once.
//!
//! # Kinks and domain
//! Smooth; at g = 0 the gradient is 0.
//!
//! # Adjoint
//! ḡ = (4v̄/N)(‖g‖² − 1)·g, in f64, rounded once. Nothing is saved.
//!
//! Twin: `reference::loss::eikonal`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::eikonal::forward;
//! assert_eq!(forward(&[[1.0, 0.0, 0.0], [1.0, 1.0, 1.0]]), 2.0); // (0² + 2²)/2
//! ```

use crate::num::{par, sum};

/// Rows per task.
const ROWS: usize = 1024;

/// Returns ‖g‖² − 1.
fn excess(g: [f32; 3]) -> f64 {
    let [x, y, z] = g.map(f64::from);
    ((x * x + y * y) + z * z) - 1.0
}

/// Returns the value.
///
/// # Panics
/// Panics if there is no row.
pub fn forward(gradient: &[[f32; 3]]) -> f32 {
    assert!(!gradient.is_empty(), "at least one row");
    let total = sum::sum16_f64_by(gradient.len(), |i| {
        let e = excess(gradient[i]);
        e * e
    });
    (total / gradient.len() as f64) as f32
}

/// Adds the gradient to `gradient_bar` (N, 3).
///
/// # Panics
/// Panics if the lengths differ.
pub fn adjoint(gradient: &[[f32; 3]], value_bar: f32, gradient_bar: &mut [[f32; 3]]) {
    assert_eq!(gradient.len(), gradient_bar.len(), "one row per gradient");
    let scale = 4.0 * f64::from(value_bar) / gradient.len() as f64;
    par::chunks_mut(gradient_bar, ROWS, |c, bars| {
        for (bar, g) in bars.iter_mut().zip(&gradient[c * ROWS..]) {
            let factor = scale * excess(*g);
            (0..3).for_each(|k| bar[k] += (factor * f64::from(g[k])) as f32);
        }
    });
}
