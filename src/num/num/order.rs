//! Comparisons with a written tie rule, and total orders.
//!
//! std leaves the result of `min(+0, −0)` open; here the first argument wins a tie. NaN never reaches these
//! functions (bad input is refused before); in debug builds they assert it.

/// The smaller one; a tie gives `a`.
#[inline(always)]
pub fn min<T: PartialOrd>(a: T, b: T) -> T {
    if b < a { b } else { a }
}

/// The larger one; a tie gives `a`.
#[inline(always)]
pub fn max<T: PartialOrd>(a: T, b: T) -> T {
    if b > a { b } else { a }
}

/// `x` limited to `lo..=hi`; inside (bounds included) `x` itself.
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

/// A `u32` that orders like the float: −∞ < … < −0 = +0 < … < +∞. NaN must not be passed.
#[inline(always)]
pub fn key_f32(x: f32) -> u32 {
    debug_assert!(!x.is_nan(), "NaN has no place in an order");
    let bits = (x + 0.0).to_bits(); // −0 + 0 = +0: both zeros get one key
    if bits >> 31 == 0 { bits | 0x8000_0000 } else { !bits }
}
