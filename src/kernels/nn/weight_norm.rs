//! `nn.weight_norm`: a matrix as the directions of its rows and a length for each.
//!
//! W(o,·) = g(o)·v(o,·)/‖v(o,·)‖        (Salimans and Kingma 2016)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | v | `v` | (N, K) | no row is zero |
//! | g | `g` | (N) | finite |
//! | W | `weight` | (N, K) | |
//!
//! # Rounding
//! ‖v‖² is the sum over 16 lanes in f64 of exact squares ([`sum`]); the factor g/‖v‖ in f64; its product with v is rounded once.
//!
//! # Kinks and domain
//! ‖v‖ has a kink at 0, where W is not defined: a row of zeros gives NaN here, and the operator list refuses it.
//!
//! # Adjoint
//! ḡ += ⟨W̄, v⟩/‖v‖,   v̄ += (g/‖v‖)·(W̄ − v·⟨W̄, v⟩/‖v‖²), the inner product as ‖v‖²; in f64, rounded once before it is added. Nothing is saved.
//! Hence v̄ is orthogonal to v: a step along it makes v longer.
//!
//! Twin: `reference::nn::weight_norm`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::weight_norm::{In, forward};
//! let mut weight = [0.0; 2];
//! forward(&In { v: &[3.0, 4.0], g: &[10.0] }, &mut weight);
//! assert_eq!(weight, [6.0, 8.0]);
//! ```

use crate::num::{par, sum};

/// Rows per task; the number changes no bit.
const ROWS: usize = 16;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (N, K).
    pub v: &'a [f32],
    /// Shape (N), not empty.
    pub g: &'a [f32],
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (N, K).
    pub v: Vec<f32>,
    /// Shape (N).
    pub g: Vec<f32>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        Self { v: vec![0.0; x.v.len()], g: vec![0.0; x.g.len()] }
    }
}

impl In<'_> {
    /// Returns K.
    fn width(&self) -> usize {
        let n = self.g.len();
        assert!(n > 0 && !self.v.is_empty() && self.v.len().is_multiple_of(n), "v is (N, K)");
        self.v.len() / n
    }
}

/// ⟨a, b⟩.
fn inner(a: &[f32], b: &[f32]) -> f64 {
    sum::sum16_f64_by(a.len(), |i| f64::from(a[i]) * f64::from(b[i]))
}

/// Writes W (N, K).
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>, weight: &mut [f32]) {
    let k = x.width();
    assert_eq!(weight.len(), x.v.len(), "the matrix has the shape of v");
    par::chunks_mut(weight, ROWS * k, |c, rows| {
        let from = x.v[c * ROWS * k..].chunks_exact(k).zip(&x.g[c * ROWS..]);
        for (row, (v, g)) in rows.chunks_exact_mut(k).zip(from) {
            let factor = f64::from(*g) / inner(v, v).sqrt();
            row.iter_mut().zip(v).for_each(|(w, v)| *w = (factor * f64::from(*v)) as f32);
        }
    });
}

/// Adds the gradients for the cotangent `weight_bar` (N, K) to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, weight_bar: &[f32], x_bar: &mut InBar) {
    let k = x.width();
    assert_eq!(weight_bar.len(), x.v.len(), "the cotangent has the shape of v");
    par::chunks_mut2(&mut x_bar.v, ROWS * k, &mut x_bar.g, ROWS, |c, v_bars, g_bars| {
        let from = x.v[c * ROWS * k..].chunks_exact(k).zip(weight_bar[c * ROWS * k..].chunks_exact(k));
        for (((v_bar, g_bar), (v, bar)), g) in
            v_bars.chunks_exact_mut(k).zip(g_bars).zip(from).zip(&x.g[c * ROWS..])
        {
            let square = inner(v, v);
            let (length, along) = (square.sqrt(), inner(bar, v));
            *g_bar += (along / length) as f32;
            let (factor, share) = (f64::from(*g) / length, along / square);
            for ((v_bar, v), bar) in v_bar.iter_mut().zip(v).zip(bar) {
                *v_bar += (factor * (f64::from(*bar) - share * f64::from(*v))) as f32;
            }
        }
    });
}
