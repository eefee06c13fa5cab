//! The trait [`Scalar`], over which every twin is generic, and its simplest implementation, `f64`.
//!
//! A twin is a function of `S: Scalar`. With `f64` it is the reference forward, with [`crate::dual::Dual`] an
//! exact directional derivative, with [`crate::rev::Rev`] a gradient. Decisions are taken on
//! [`Scalar::value`], so all three take the same branches.
//!
//! # Derivatives at kinks and borders of domains
//! √ at 0, |x| at 0, acos at ±1 and atan2 at the origin have slope 0; x^y at x = 0 has slope 0 in y, and in x
//! 0 for y ≠ 1 and 1 for y = 1. Outside their domains the functions return what `libm` returns.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number, possibly with a derivative.
pub trait Scalar:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
{
    /// A constant.
    fn from_f64(x: f64) -> Self;
    /// The number without its derivative.
    fn value(self) -> f64;
    /// A number of the given value whose derivative is `slope` times that of `self`.
    fn chain(self, value: f64, slope: f64) -> Self;
    /// A number of the given value whose derivative is `slopes` times those of `self` and `other`, summed.
    fn chain2(self, other: Self, value: f64, slopes: [f64; 2]) -> Self;
    /// Reverse mode: adds `cotangent` to the adjoint of this number. Does nothing in the other modes.
    fn seed(self, cotangent: f64) {
        let _ = cotangent;
    }
    /// Reverse mode: propagates adjoints to the leaves and drops the nodes above them. Does nothing in the
    /// other modes.
    fn sweep() {}

    /// The same number as a constant.
    fn detach(self) -> Self {
        Self::from_f64(self.value())
    }
    /// 0.
    fn zero() -> Self {
        Self::from_f64(0.0)
    }
    /// 1.
    fn one() -> Self {
        Self::from_f64(1.0)
    }
    /// √x, slope 0 at 0.
    fn sqrt(self) -> Self {
        let y = self.value().sqrt();
        self.chain(y, if y == 0.0 { 0.0 } else { 0.5 / y })
    }
    /// eˣ.
    fn exp(self) -> Self {
        let y = libm::exp(self.value());
        self.chain(y, y)
    }
    /// eˣ − 1.
    fn expm1(self) -> Self {
        self.chain(libm::expm1(self.value()), libm::exp(self.value()))
    }
    /// Natural logarithm.
    fn ln(self) -> Self {
        self.chain(libm::log(self.value()), 1.0 / self.value())
    }
    /// ln(1 + x).
    fn log1p(self) -> Self {
        self.chain(libm::log1p(self.value()), 1.0 / (1.0 + self.value()))
    }
    /// Sine of an angle in radians.
    fn sin(self) -> Self {
        self.chain(libm::sin(self.value()), libm::cos(self.value()))
    }
    /// Cosine of an angle in radians.
    fn cos(self) -> Self {
        self.chain(libm::cos(self.value()), -libm::sin(self.value()))
    }
    /// Angle of the point (`x`, `self`), in radians; slopes 0 at the origin.
    fn atan2(self, x: Self) -> Self {
        let (b, a) = (self.value(), x.value());
        let square = a * a + b * b;
        let slopes = if square == 0.0 { [0.0, 0.0] } else { [a / square, -b / square] };
        self.chain2(x, libm::atan2(b, a), slopes)
    }
    /// Arc cosine in radians, slope 0 at ±1.
    fn acos(self) -> Self {
        let x = self.value();
        let square = (1.0 - x) * (1.0 + x);
        self.chain(libm::acos(x), if square == 0.0 { 0.0 } else { -1.0 / square.sqrt() })
    }
    /// Hyperbolic tangent.
    fn tanh(self) -> Self {
        let y = libm::tanh(self.value());
        self.chain(y, (1.0 - y) * (1.0 + y))
    }
    /// Error function.
    fn erf(self) -> Self {
        let x = self.value();
        self.chain(libm::erf(x), std::f64::consts::FRAC_2_SQRT_PI * libm::exp(-(x * x)))
    }
    /// selfʸ for self ≥ 0.
    fn pow(self, y: Self) -> Self {
        let (base, exponent) = (self.value(), y.value());
        let value = libm::pow(base, exponent);
        let slopes = if base == 0.0 {
            [if exponent == 1.0 { 1.0 } else { 0.0 }, 0.0]
        } else {
            [exponent * libm::pow(base, exponent - 1.0), value * libm::log(base)]
        };
        self.chain2(y, value, slopes)
    }
    /// |x|, slope 0 at 0.
    fn abs(self) -> Self {
        let x = self.value();
        if x > 0.0 {
            self
        } else if x < 0.0 {
            -self
        } else {
            self.chain(0.0, 0.0)
        }
    }
}

impl Scalar for f64 {
    fn from_f64(x: f64) -> Self {
        x
    }
    fn value(self) -> f64 {
        self
    }
    fn chain(self, value: f64, _: f64) -> Self {
        value
    }
    fn chain2(self, _: Self, value: f64, _: [f64; 2]) -> Self {
        value
    }
}

/// Implements the operators between a scalar with a derivative and itself or `f64` with `chain` and `chain2`.
macro_rules! operators {
    ($type:ty) => {
        impl std::ops::Add for $type {
            type Output = Self;
            fn add(self, other: Self) -> Self {
                self.chain2(other, self.value() + other.value(), [1.0, 1.0])
            }
        }
        impl std::ops::Sub for $type {
            type Output = Self;
            fn sub(self, other: Self) -> Self {
                self.chain2(other, self.value() - other.value(), [1.0, -1.0])
            }
        }
        impl std::ops::Mul for $type {
            type Output = Self;
            fn mul(self, other: Self) -> Self {
                self.chain2(other, self.value() * other.value(), [other.value(), self.value()])
            }
        }
        impl std::ops::Div for $type {
            type Output = Self;
            fn div(self, other: Self) -> Self {
                let quotient = self.value() / other.value();
                self.chain2(other, quotient, [1.0 / other.value(), -quotient / other.value()])
            }
        }
        impl std::ops::Neg for $type {
            type Output = Self;
            fn neg(self) -> Self {
                self.chain(-self.value(), -1.0)
            }
        }
        impl std::ops::Add<f64> for $type {
            type Output = Self;
            fn add(self, other: f64) -> Self {
                self.chain(self.value() + other, 1.0)
            }
        }
        impl std::ops::Sub<f64> for $type {
            type Output = Self;
            fn sub(self, other: f64) -> Self {
                self.chain(self.value() - other, 1.0)
            }
        }
        impl std::ops::Mul<f64> for $type {
            type Output = Self;
            fn mul(self, other: f64) -> Self {
                self.chain(self.value() * other, other)
            }
        }
        impl std::ops::Div<f64> for $type {
            type Output = Self;
            fn div(self, other: f64) -> Self {
                self.chain(self.value() / other, 1.0 / other)
            }
        }
    };
}
pub(crate) use operators;
