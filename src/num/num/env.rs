//! The floating-point environment of a thread.
//!
//! A library built with fast-math start-up code can switch a thread to flush-to-zero, and a host program can
//! change the rounding mode. Results would then differ without any warning. Every worker thread is therefore
//! probed before it computes ([`super::par::with_threads`] does this), and a deviation is reported as an
//! error. The probe consists of arithmetic on values that the compiler cannot evaluate; it reads no control
//! register.

use crate::{Error, Result};
use std::hint::black_box;

/// Checks that this thread rounds to nearest, ties to even, and supports subnormal results and operands.
///
/// # Errors
/// The error names the property that does not hold and suggests a remedy.
pub fn probe() -> Result<()> {
    if let Some(found) = flaw_f32().or_else(flaw_f64) {
        return Err(Error::input("floating-point environment")
            .at(format!("thread {}", std::thread::current().name().unwrap_or("without a name")))
            .expected("round to nearest even with subnormal numbers")
            .got(found)
            .hint(
                "a library loaded into this process, or the host program, changed the control register of the \
                 thread; start lastlight before it, load it in another process, or build it without fast-math",
            ));
    }
    Ok(())
}

/// Returns what is wrong with single precision in this thread, if anything.
fn flaw_f32() -> Option<&'static str> {
    let one = black_box(1.0_f32);
    let ulp = black_box(f32::EPSILON); // 2⁻²³
    // 1 + ¼ulp and −1 − ¼ulp change only if the mode rounds up or down, 1 − ⅛ulp only if it rounds down or to
    // zero.
    let nearest = one + ulp * black_box(0.25) == one
        && -one - ulp * black_box(0.25) == -one
        && one - ulp * black_box(0.125) == one
        && -one + ulp * black_box(0.125) == -one;
    // Ties: 1 + ½ulp stays at the even 1; 1 + 1½ulp rounds up to the even 1 + 2ulp.
    let even =
        one + ulp * black_box(0.5) == one && (one + ulp) + ulp * black_box(0.5) == one + ulp * black_box(2.0);
    let half_of_smallest_normal = black_box(f32::MIN_POSITIVE) * black_box(0.5);
    let flushed = half_of_smallest_normal.to_bits() != 0x0040_0000;
    let ignored = black_box(f32::from_bits(0x0040_0000)) * black_box(2.0) != f32::MIN_POSITIVE;
    flaw(nearest && even, ignored, flushed)
}

/// Returns what is wrong with double precision in this thread, if anything.
fn flaw_f64() -> Option<&'static str> {
    let one = black_box(1.0_f64);
    let ulp = black_box(f64::EPSILON); // 2⁻⁵²
    let nearest = one + ulp * black_box(0.25) == one
        && -one - ulp * black_box(0.25) == -one
        && one - ulp * black_box(0.125) == one
        && -one + ulp * black_box(0.125) == -one;
    let even =
        one + ulp * black_box(0.5) == one && (one + ulp) + ulp * black_box(0.5) == one + ulp * black_box(2.0);
    let half_of_smallest_normal = black_box(f64::MIN_POSITIVE) * black_box(0.5);
    let flushed = half_of_smallest_normal.to_bits() != 0x0008_0000_0000_0000;
    let ignored = black_box(f64::from_bits(0x0008_0000_0000_0000)) * black_box(2.0) != f64::MIN_POSITIVE;
    flaw(nearest && even, ignored, flushed)
}

fn flaw(rounds_to_nearest_even: bool, ignored: bool, flushed: bool) -> Option<&'static str> {
    if !rounds_to_nearest_even {
        return Some("another rounding mode");
    }
    match (ignored, flushed) {
        (true, true) => Some("denormals-are-zero and flush-to-zero"),
        (true, false) => Some("denormals-are-zero"),
        (false, true) => Some("flush-to-zero"),
        (false, false) => None,
    }
}
