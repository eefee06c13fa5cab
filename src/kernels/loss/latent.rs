//! `loss.latent`: how far the factors of two images are apart, and the mechanisms behind them.
//!
//! L = 1/(h d) Σ over i of ((u_i − u'_i)/s_i)² + ((ε_i − ε'_i)/t_i)²                         (LAST, latent factors as supervision; d = n k numbers, h = 2 halves)
//!
//! The first half compares factors, the second mechanisms: a child that is off only because its parent is off has no difference in ε. Without the second
//! half h = 1.
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | u, u' | `factors`, `factors_real` | (d) | of the render and of the input image, which is a constant |
//! | s | `factors_spread` | (d) | > 0: standard deviations over the training set, constants |
//! | ε, ε', t | `noise`, `noise_real`, `noise_spread` | (d), optional | likewise |
//! | L | return | () | ≥ 0 |
//!
//! # Rounding
//! f64. One left fold over the numbers of the first half, then of the second, each square times the share 1/(h d).
//!
//! # Kinks and domain
//! No kinks. d ≥ 1.
//!
//! # Adjoint
//! ū += ((2 L̄/(h d)) (u − u')/s)/s, ε̄ likewise. Nothing is saved.
//!
//! Twin: `reference::loss::latent`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::latent::{Half, forward};
//! let half = Half { x: &[1.0, 0.0], real: &[0.0, 0.0], spread: &[0.5, 1.0] };
//! assert_eq!(forward(&[half]), 2.0); // (1/½)²/2
//! ```

/// One half: factors, or noise.
#[derive(Clone, Copy, Debug)]
pub struct Half<'a> {
    /// (d) of the render
    pub x: &'a [f64],
    /// (d) of the input image
    pub real: &'a [f64],
    /// (d)
    pub spread: &'a [f64],
}

/// 1/(h d), after the halves were held to their shape.
fn share(halves: &[Half<'_>]) -> f64 {
    let d = halves.first().expect("at least one half").x.len();
    let fits = |half: &Half<'_>| [half.x.len(), half.real.len(), half.spread.len()] == [d; 3];
    assert!(halves.iter().all(fits), "arrays of one length");
    1.0 / (halves.len() * d) as f64
}

/// L of one half or both.
///
/// # Panics
/// When there is no half, or arrays differ in length.
pub fn forward(halves: &[Half<'_>]) -> f64 {
    let share = share(halves);
    let mut value = 0.0;
    for half in halves {
        for (at, x) in half.x.iter().enumerate() {
            let off = (x - half.real[at]) / half.spread[at];
            value += share * (off * off);
        }
    }
    value
}

/// Adds the gradient by x of half `which` for the cotangent `value_bar` to `x_bar` (d).
///
/// # Panics
/// When there is no such half, or arrays differ in length.
pub fn adjoint(halves: &[Half<'_>], which: usize, value_bar: f64, x_bar: &mut [f64]) {
    let (scale, half) = (2.0 * value_bar * share(halves), &halves[which]);
    assert_eq!(x_bar.len(), half.x.len(), "one gradient per number");
    for (at, bar) in x_bar.iter_mut().enumerate() {
        let off = (half.x[at] - half.real[at]) / half.spread[at];
        *bar += scale * off / half.spread[at];
    }
}
