//! Clips the gradient of an array to a largest length.
//!
//! g ← g·min(1, L/‖g‖)        (Pascanu et al. 2013, per array)
//!
//! ‖g‖² is the sum over 16 lanes in f64 of exact squares ([`sum`]); the factor is rounded once to f32, and so is each product. A gradient that is
//! not longer keeps its bits. It has no adjoint.
//!
//! # Example
//! ```
//! # use lastlight_train as lastlight;
//! use lastlight::optim::clip::clip;
//! let mut g = [3.0, 4.0];
//! assert_eq!(clip(&mut g, 2.5), 5.0);
//! assert_eq!(g, [1.5, 2.0]);
//! assert_eq!(clip(&mut g, 3.0), 2.5);
//! ```

use crate::num::sum;

/// Shortens a gradient to the length `most`; returns its length before.
pub fn clip(gradient: &mut [f32], most: f64) -> f64 {
    let square = sum::sum16_f64_by(gradient.len(), |i| f64::from(gradient[i]) * f64::from(gradient[i]));
    let length = square.sqrt();
    if length > most {
        let factor = (most / length) as f32;
        gradient.iter_mut().for_each(|g| *g *= factor);
    }
    length
}
