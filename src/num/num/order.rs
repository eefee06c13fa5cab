//! Comparisons with a defined tie rule, and total orders.
//!
//! The standard library does not specify the result of `min(+0, −0)`; here the first argument is returned for
//! a tie. NaN must not be passed to these functions (invalid input is refused earlier); debug builds assert
//! this.

/// Returns the smaller value; a tie gives `a`.
#[inline(always)]
pub fn min<T: PartialOrd>(a: T, b: T) -> T {
    if b < a { b } else { a }
}

/// Returns the larger value; a tie gives `a`.
#[inline(always)]
pub fn max<T: PartialOrd>(a: T, b: T) -> T {
    if b > a { b } else { a }
}

/// Limits `x` to `lo..=hi`; inside the range (bounds included) the result is `x` itself.
#[inline(always)]
pub fn clamp<T: PartialOrd>(x: T, lo: T, hi: T) -> T {
    if x < lo {
        lo
    } else if x > hi {
        hi
    } else {
        x
    }
}

/// Returns a `u32` with the same order as the floats: −∞ < … < −0 = +0 < … < +∞. NaN must not be passed.
#[inline(always)]
pub fn key_f32(x: f32) -> u32 {
    debug_assert!(!x.is_nan(), "NaN cannot be ordered");
    let bits = (x + 0.0).to_bits(); // −0 + 0 = +0, so both zeros have the same key
    if bits >> 31 == 0 { bits | 0x8000_0000 } else { !bits }
}
