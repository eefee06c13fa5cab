//! `loss.latent`: distance between the factors of two images, and between their exogenous noise.
//!
//! L = 1/(h d) Σ over i of ((u_i − u'_i)/s_i)² + ((ε_i − ε'_i)/t_i)²,   d = n k values, h = 2 halves
//!
//! It is the latent difference of LAST, eq. 9, where latent factors supervise the fit. The first half
//! compares factors, the second their noise under the mechanisms: a child that differs only because its
//! parent differs has no difference in ε. Without the second half h = 1.
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | u, u' | `factors`, `factors_real` | (d) | of the render, and of the input image, which is a constant |
//! | s | `factors_spread` | (d) | > 0: standard deviations over the training set, constants |
//! | ε, ε', t | `noise`, `noise_real`, `noise_spread` | (d), optional | likewise |
//! | L | return | () | ≥ 0 |
//!
//! # Rounding
//! All values are f64. One left fold covers the values of the first half, then those of the second, each
//! square times the share 1/(h d).
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

/// One half of the loss: factors, or noise.
#[derive(Clone, Copy, Debug)]
pub struct Half<'a> {
    /// Values of the render, shape (d).
    pub x: &'a [f64],
    /// Values of the input image, shape (d).
    pub real: &'a [f64],
    /// Standard deviations, shape (d).
    pub spread: &'a [f64],
}

/// Checks the shapes of the halves and returns 1/(h d).
fn share(halves: &[Half<'_>]) -> f64 {
    let d = halves.first().expect("there is at least one half").x.len();
    let fits = |half: &Half<'_>| [half.x.len(), half.real.len(), half.spread.len()] == [d; 3];
    assert!(halves.iter().all(fits), "all arrays have the same length");
    1.0 / (halves.len() * d) as f64
}

/// Returns L of one half or both.
///
/// # Panics
/// Panics if there is no half, or if arrays differ in length.
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

/// Adds the gradient of x of half `which`, for the cotangent `value_bar`, to `x_bar` (d).
///
/// # Panics
/// Panics if the half does not exist, or if arrays differ in length.
pub fn adjoint(halves: &[Half<'_>], which: usize, value_bar: f64, x_bar: &mut [f64]) {
    let (scale, half) = (2.0 * value_bar * share(halves), &halves[which]);
    assert_eq!(x_bar.len(), half.x.len(), "there is one gradient per value");
    for (at, bar) in x_bar.iter_mut().enumerate() {
        let off = (half.x[at] - half.real[at]) / half.spread[at];
        *bar += scale * off / half.spread[at];
    }
}
