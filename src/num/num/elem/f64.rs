//! Double-precision functions from the pinned `libm`, whose bits depend on its source code and not on the
//! platform.
//!
//! Code inside `src/` that computes in f64 (statistics, optimisers, causal operators) uses these functions.
//! The claimed error of each is below one unit in the last place.

macro_rules! pinned {
    ($($(#[$doc:meta])* $name:ident = $source:ident;)*) => { $(
        $(#[$doc])*
        #[inline]
        pub fn $name(x: f64) -> f64 {
            libm::$source(x)
        }
    )* };
}

pinned! {
    /// eˣ.
    exp = exp;
    /// 2ˣ.
    exp2 = exp2;
    /// eˣ − 1.
    expm1 = expm1;
    /// Natural logarithm.
    ln = log;
    /// ln(1 + x).
    log1p = log1p;
    /// Binary logarithm.
    log2 = log2;
    /// Decimal logarithm.
    log10 = log10;
    /// Sine.
    sin = sin;
    /// Cosine.
    cos = cos;
    /// Tangent.
    tan = tan;
    /// Arc sine.
    asin = asin;
    /// Arc cosine.
    acos = acos;
    /// Arc tangent.
    atan = atan;
    /// Hyperbolic tangent.
    tanh = tanh;
    /// Cube root.
    cbrt = cbrt;
    /// Error function.
    erf = erf;
    /// 1 − erf(x).
    erfc = erfc;
    /// ln Γ(x).
    lgamma = lgamma;
}

/// Returns the angle of (x, y) from the x axis, in −π..=π.
#[inline]
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// Returns xʸ.
#[inline]
pub fn pow(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}

/// 1 / (1 + e⁻ˣ).
#[inline]
pub fn sigmoid(x: f64) -> f64 {
    if x >= 0.0 {
        1.0 / (1.0 + libm::exp(-x))
    } else {
        let e = libm::exp(x);
        e / (1.0 + e)
    }
}

/// ln(1 + eˣ) = max(x, 0) + ln(1 + e^−|x|).
#[inline]
pub fn softplus(x: f64) -> f64 {
    crate::num::order::max(x, 0.0) + libm::log1p(libm::exp(-x.abs()))
}

/// Returns ln(p / (1 − p)), near ½ as ln(1 + (2p − 1)/(1 − p)) without cancellation.
#[inline]
pub fn logit(p: f64) -> f64 {
    if (0.25..=0.75).contains(&p) {
        libm::log1p((2.0 * p - 1.0) / (1.0 - p))
    } else {
        libm::log(p / (1.0 - p))
    }
}
