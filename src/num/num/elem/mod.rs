//! Elementary functions whose bits do not depend on the platform.
//!
//! The functions here take single precision in any width ([`Real`]: `f32` or `f32x8`), compute in double
//! precision with one body of `+ − × ÷ √`, selections and integer operations, and round once. A lane
//! therefore has the same bits as the scalar call, on every platform. [`table`] lists the error of each
//! function, and `tests/foundation/num/` measures it. [`exp_lanes`] is the exception: it uses single
//! precision throughout, for the blending loop. [`mod@f64`] contains the double-precision functions.
//!
//! The `_slice` forms write `y[i] = f(x[i])`, eight lanes at a time; the bits equal those of the scalar
//! calls.
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::num::elem;
//! assert_eq!(elem::exp(0.0_f32), 1.0);
//! assert_eq!(elem::sigmoid(0.0_f32), 0.5);
//! assert_eq!(elem::ln(2.0_f32), std::f32::consts::LN_2);
//! ```

mod body;
pub mod f64;
mod fast;
pub mod table;
mod trig;

use super::double::Body;
use super::lanes::{Real, f32x8};
use super::registers::{Loops, widest};
use std::marker::PhantomData;

pub use fast::{EXP_LANES_MAX, EXP_LANES_MIN, exp_lanes};
pub use table::TABLE;

macro_rules! functions {
    ($($(#[$doc:meta])* $name:ident, $slice:ident = $body:path;)*) => { $(
        $(#[$doc])*
        #[inline]
        pub fn $name<L: Real>(x: L) -> L {
            x.through_f64::<$body>()
        }

        #[doc = concat!("[`", stringify!($name), "`] of every element of `x`, into `y`.")]
        ///
        /// # Panics
        /// Panics if the lengths differ.
        pub fn $slice(x: &[f32], y: &mut [f32]) {
            slice(x, y, $name::<f32>, $name::<f32x8>);
        }
    )* };
}

/// Processes eight lanes at a time, then the remainder as scalars.
#[inline(always)]
fn slice(x: &[f32], y: &mut [f32], one: impl Fn(f32) -> f32, eight: impl Fn(f32x8) -> f32x8) {
    assert_eq!(x.len(), y.len(), "x and y have the same length");
    let (x8, x1) = x.as_chunks::<8>();
    let (y8, y1) = y.as_chunks_mut::<8>();
    for (x, y) in x8.iter().zip(y8) {
        *y = eight(f32x8::new(*x)).to_array();
    }
    for (x, y) in x1.iter().zip(y1) {
        *y = one(*x);
    }
}

functions! {
    /// eˣ. It overflows to +∞ above 88.72 and underflows gradually to 0 at −103.98.
    exp, exp_slice = body::Exp;
    /// eˣ − 1, accurate also near 0; the sign of a zero is kept.
    expm1, expm1_slice = body::Expm1;
    /// Natural logarithm; −∞ at ±0, NaN below 0.
    ln, ln_slice = body::Ln;
    /// ln(1 + x), accurate also near 0; the sign of a zero is kept. The result is −∞ at −1 and NaN below.
    log1p, log1p_slice = body::Log1p;
    /// ln(p / (1 − p)), accurate also near ½. The result is −∞ at 0, +∞ at 1 and NaN outside 0..=1.
    logit, logit_slice = body::Logit;
    /// Sine of an angle in radians, for every finite argument; NaN at ±∞.
    sin, sin_slice = trig::Sin;
    /// Cosine of an angle in radians, for every finite argument; NaN at ±∞.
    cos, cos_slice = trig::Cos;
    /// Arc cosine in 0..=π; NaN outside −1..=1.
    acos, acos_slice = trig::Acos;
    /// Hyperbolic tangent.
    tanh, tanh_slice = body::Tanh;
    /// 1 / (1 + e⁻ˣ).
    sigmoid, sigmoid_slice = body::Sigmoid;
    /// ln(1 + eˣ).
    softplus, softplus_slice = body::Softplus;
    /// Error function.
    erf, erf_slice = body::Erf;
}

/// x·Φ(x), where Φ is the distribution function of the standard normal distribution.
#[inline]
pub fn gelu<L: Real>(x: L) -> L {
    x.through_f64::<body::Gelu>()
}

/// The derivative of [`gelu`], Φ(x) + x·e^(−x²/2)/√(2π).
#[inline]
pub fn gelu_slope<L: Real>(x: L) -> L {
    x.through_f64::<body::GeluSlope>()
}

/// [`gelu`] of every element of `x`, into `y`.
///
/// # Panics
/// Panics if the lengths differ.
pub fn gelu_slice(x: &[f32], y: &mut [f32]) {
    widest(Slice::<body::Gelu> { x, y, body: PhantomData });
}

/// [`gelu_slope`] of every element of `x`, into `y`.
///
/// # Panics
/// Panics if the lengths differ.
pub fn gelu_slope_slice(x: &[f32], y: &mut [f32]) {
    widest(Slice::<body::GeluSlope> { x, y, body: PhantomData });
}

/// A body without branches, of every element.
struct Slice<'a, B> {
    x: &'a [f32],
    y: &'a mut [f32],
    body: PhantomData<B>,
}

impl<B: Body> Loops for Slice<'_, B> {
    #[inline(always)]
    fn run<const WIDE: bool>(self) {
        let Self { mut x, mut y, .. } = self;
        assert_eq!(x.len(), y.len(), "x and y have the same length");
        if WIDE {
            let ((x16, x1), (y16, y1)) = (x.as_chunks::<16>(), y.as_chunks_mut::<16>());
            for (x, y) in x16.iter().zip(y16) {
                for (x, y) in x.iter().zip(y) {
                    *y = x.through_f64::<B>();
                }
            }
            (x, y) = (x1, y1);
        }
        slice(x, y, f32::through_f64::<B>, f32x8::through_f64::<B>);
    }
}

/// Returns the angle of (x, y) from the x axis, in −π..=π; signed zeros are treated as in IEEE 754: atan2(±0,
/// +0) = ±0.
#[inline]
pub fn atan2<L: Real>(y: L, x: L) -> L {
    y.through_f64_pair::<trig::Atan2>(x)
}

/// Returns xʸ for x ≥ 0. For x < 0 the result is NaN unless y = 0; −0 is treated as 0; x⁰ = 1 and 1ʸ = 1.
#[inline]
pub fn pow<L: Real>(x: L, y: L) -> L {
    x.through_f64_pair::<body::Pow>(y)
}

/// Writes xʸ of every element of `x`, with one exponent, to `out`.
///
/// # Panics
/// Panics if the lengths differ.
pub fn pow_slice(x: &[f32], y: f32, out: &mut [f32]) {
    slice(x, out, |x| pow(x, y), |x| pow(x, f32x8::splat(y)));
}

/// Writes [`exp_lanes`] of every element of `x` to `y`.
///
/// # Panics
/// Panics if the lengths differ.
pub fn exp_lanes_slice(x: &[f32], y: &mut [f32]) {
    slice(x, y, exp_lanes::<f32>, exp_lanes::<f32x8>);
}
