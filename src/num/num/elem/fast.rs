//! The exponential function of the blending loop, in single precision only.

use crate::num::lanes::Real;

/// Smallest argument of [`exp_lanes`]; smaller arguments are replaced by it.
pub const EXP_LANES_MIN: f32 = -87.3;
/// Largest argument of [`exp_lanes`]; larger arguments are replaced by it.
pub const EXP_LANES_MAX: f32 = 88.0;

/// 1.5·2²³. Adding it rounds to an integer, which then occupies the lowest bits.
const ROUND: f32 = 12_582_912.0;
/// The first 15 bits of ln 2: n·LN2_HI is exact for |n| ≤ 2⁸.
const LN2_HI: f32 = f32::from_bits(0x3f31_7200);
/// ln 2 − LN2_HI.
const LN2_LO: f32 = f32::from_bits(0x35bf_be8e);

/// Returns eˣ for x in −87.3..=88, in single precision throughout. The result is at most one unit in the last
/// place from the correctly rounded value (1.0081 units from the true one, over every argument).
///
/// eˣ = 2ⁿ·eʳ,   n = round(x / ln 2),   r = x − n·ln 2,   eʳ ≈ 1 + (r + r²·q(r))        with q of degree 4
///
/// # Rounding
/// n is obtained by adding and subtracting 1.5·2²³; r = (x − n·hi) − n·lo; q = (c₂ + c₃r) + r²·((c₄ + c₅r) +
/// r²·c₆); then 1 + (r + r²q). 2ⁿ is applied by integer addition to the exponent. There are 22 operations.
///
/// # Kinks and domain
/// Arguments outside −87.3..=88 are limited to that range, so the result is always a normal number; outside
/// the range the function is constant. NaN stays NaN.
#[inline(always)]
pub fn exp_lanes<L: Real>(x: L) -> L {
    let c = L::splat;
    let x = x.clamp(EXP_LANES_MIN, EXP_LANES_MAX);
    let t = x * c(std::f32::consts::LOG2_E) + c(ROUND);
    let n = t - c(ROUND);
    let r = (x - n * c(LN2_HI)) - n * c(LN2_LO);
    let r2 = r * r;
    let q = (c(0.499_999_94) + c(0.166_665_28) * r)
        + r2 * ((c(0.041_668_263) + c(0.008_368_052_5) * r) + r2 * c(0.001_381_795_1));
    let p = c(1.0) + (r + r2 * q);
    p.scale_exp2(t)
}
