//! Three-dimensional vectors in f64.
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::math::vector::unit;
//! assert_eq!(unit([0.0, 3.0, 4.0]), [0.0, 0.6, 0.8]);
//! assert_eq!(unit([0.0; 3]), [0.0; 3]);
//! ```

use crate::num::order;

/// Returns v / ‖v‖, or the zero vector for a zero vector.
///
/// # Rounding
/// The components are divided by the largest magnitude first, so that no square overflows or underflows to 0;
/// then √((x² + y²) + z²) and three quotients follow.
pub fn unit(v: [f64; 3]) -> [f64; 3] {
    let largest = v.iter().fold(0.0f64, |a, x| order::max(a, x.abs()));
    if !(largest > 0.0) {
        return [0.0; 3];
    }
    let v = v.map(|x| x / largest);
    let n = ((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]).sqrt();
    v.map(|x| x / n)
}
