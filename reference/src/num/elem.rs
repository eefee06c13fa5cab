//! Elementary functions beyond those of [`Scalar`], and f64 functions from `libm`.

use crate::scalar::Scalar;

/// eˣ, from the pinned `libm`.
pub fn exp(x: f64) -> f64 {
    libm::exp(x)
}
/// Natural logarithm, from the pinned `libm`.
pub fn ln(x: f64) -> f64 {
    libm::log(x)
}
/// Sine of an angle in radians, from the pinned `libm`.
pub fn sin(x: f64) -> f64 {
    libm::sin(x)
}
/// Cosine of an angle in radians, from the pinned `libm`.
pub fn cos(x: f64) -> f64 {
    libm::cos(x)
}

/// 1/(1 + e⁻ˣ), computed from e^−|x| so that nothing overflows.
///
/// # Adjoint
/// σ' = e/(1 + e)² with e = e^−|x|.
pub fn sigmoid<S: Scalar>(x: S) -> S {
    let e = libm::exp(-x.value().abs());
    let value = if x.value() >= 0.0 { 1.0 / (1.0 + e) } else { e / (1.0 + e) };
    x.chain(value, e / ((1.0 + e) * (1.0 + e)))
}

/// ln(1 + eˣ) = max(x, 0) + ln(1 + e^−|x|).
///
/// # Adjoint
/// The slope is `sigmoid(x)`.
pub fn softplus<S: Scalar>(x: S) -> S {
    let positive = if x.value() > 0.0 { x.value() } else { 0.0 };
    x.chain(positive + libm::log1p(libm::exp(-x.value().abs())), sigmoid(x.value()))
}
