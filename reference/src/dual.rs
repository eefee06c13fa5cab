//! Dual numbers: exact directional derivatives without a step size.

use crate::scalar::{Scalar, operators};

/// value + tangent·ε with ε² = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual {
    /// The number.
    pub value: f64,
    /// Its derivative in the chosen direction.
    pub tangent: f64,
}

/// slope · tangent, defined as 0 if either is 0, even if the other is infinite.
fn scaled(slope: f64, tangent: f64) -> f64 {
    if slope == 0.0 || tangent == 0.0 { 0.0 } else { slope * tangent }
}

impl Scalar for Dual {
    fn from_f64(x: f64) -> Self {
        Self { value: x, tangent: 0.0 }
    }
    fn value(self) -> f64 {
        self.value
    }
    fn chain(self, value: f64, slope: f64) -> Self {
        Self { value, tangent: scaled(slope, self.tangent) }
    }
    fn chain2(self, other: Self, value: f64, slopes: [f64; 2]) -> Self {
        Self { value, tangent: scaled(slopes[0], self.tangent) + scaled(slopes[1], other.tangent) }
    }
}

operators!(Dual);
