//! The bodies of the elementary functions, written once for every width of f64 lanes with `+ − × ÷ √`,
//! selections and integer operations.
//!
//! Arguments are single-precision numbers converted exactly; results are accurate to a few units of 2⁻⁵², and
//! the caller rounds them once to single precision. Polynomials are minimax fits (Remez, 50 digits) with
//! their error given next to them; `poly` fixes the order of evaluation.

use crate::num::double::{Body, BodyPair, Double};

/// 1.5·2⁵². Adding it rounds to an integer, which then occupies the lowest bits.
pub(super) const ROUND: f64 = 6_755_399_441_055_744.0;
/// The first 44 bits of ln 2; the next constant holds the remainder.
const LN2_HI: f64 = 0.693_147_180_559_890_3;
const LN2_LO: f64 = 5.497_923_018_708_371e-14;
pub(super) const SIGN: u64 = 1 << 63;
/// Bits of 1 and of √½; the fraction of a logarithm's argument is reduced to √½..√2.
const ONE: u64 = 0x3ff0_0000_0000_0000;
const SQRT_HALF: u64 = 0x3fe6_a09e_667f_3bcd;

/// Σ cᵢxⁱ; the even and the odd powers are evaluated separately by Horner's rule in x², so that the two
/// chains are independent.
#[inline(always)]
pub(super) fn poly<W: Double, const N: usize>(x: W, c: &[f64; N]) -> W {
    let x2 = x * x;
    let (mut high, mut low) = (W::splat(c[N - 1]), W::splat(c[N - 2]));
    let mut i = N - 2;
    while i >= 2 {
        high = high * x2 + W::splat(c[i - 1]);
        low = low * x2 + W::splat(c[i - 2]);
        i -= 2;
    }
    if i == 1 {
        // N is odd: `high` contains the even powers and the constant term.
        low * x + (high * x2 + W::splat(c[0]))
    } else {
        high * x + low
    }
}

/// Limits `x` to `lo..=hi`; NaN stays NaN.
#[inline(always)]
pub(super) fn clamp<W: Double>(x: W, lo: f64, hi: f64) -> W {
    let x = W::select(x.lt(W::splat(lo)), W::splat(lo), x);
    W::select(x.gt(W::splat(hi)), W::splat(hi), x)
}

/// Returns `magnitude`, which is not negative, with the sign of `x`.
#[inline(always)]
pub(super) fn with_sign<W: Double>(magnitude: W, x: W) -> W {
    W::from_bits(W::xor_bits(magnitude.to_bits(), W::and_const(x.to_bits(), SIGN)))
}

/// Returns n and r of x = n·ln 2 + r, |r| ≤ ½ ln 2 (or slightly more); n is returned as the float n +
/// 1.5·2⁵².
#[inline(always)]
fn split_exp<W: Double>(x: W) -> (W, W) {
    let t = x * W::splat(std::f64::consts::LOG2_E) + W::splat(ROUND);
    let n = t - W::splat(ROUND);
    (t, (x - n * W::splat(LN2_HI)) - n * W::splat(LN2_LO))
}

/// (eʳ − 1 − r)/r² on |r| ≤ ½ ln 2, error 2⁻⁵¹.
const EXP: [f64; 9] = [
    0.499_999_999_999_989_8,
    0.166_666_666_666_222_6,
    0.041_666_666_667_814_89,
    0.008_333_333_366_555_834,
    0.001_388_888_856_437_904_1,
    0.000_198_411_905_932_307_72,
    2.480_190_625_581_136e-5,
    2.763_289_476_105_059e-6,
    2.747_994_620_637_916_5e-7,
];

/// eˣ for |x| ≤ 700.
#[inline(always)]
fn exp_core<W: Double>(x: W) -> W {
    let (t, r) = split_exp(x);
    let p = W::splat(1.0) + (r + r * r * poly(r, &EXP));
    W::from_bits(W::add_bits(p.to_bits(), W::shl(t.to_bits(), 52)))
}

/// eˣ − 1 for |x| ≤ 700: 2ⁿ(eʳ − 1) + (2ⁿ − 1).
#[inline(always)]
fn expm1_core<W: Double>(x: W) -> W {
    let (t, r) = split_exp(x);
    let p = r + r * r * poly(r, &EXP);
    let two_n = W::from_bits(W::add_const(W::shl(t.to_bits(), 52), ONE));
    two_n * p + (two_n - W::splat(1.0))
}

/// (2 artanh s − 2s)/s³ in z = s² for s = f/(2 + f), 1 + f in √½..√2; error 2⁻⁵⁸.
const LOG: [f64; 7] = [
    0.666_666_666_666_667_9,
    0.399_999_999_997_638_74,
    0.285_714_286_691_469_53,
    0.222_222_056_965_483_7,
    0.181_832_117_516_796_84,
    0.153_226_778_323_576_56,
    0.147_130_893_219_120_85,
];

/// Returns k and f of u = 2ᵏ(1 + f) with 1 + f in √½..√2, for positive normal u.
#[inline(always)]
fn split_log<W: Double>(u: W) -> (W, W) {
    let b = W::add_const(u.to_bits(), ONE - SQRT_HALF); // its exponent field is k + 1023
    // 2⁵² + (k + 1023) has k + 1023 in its lowest bits.
    let k = W::from_bits(W::or_const(W::shr(b, 52), 0x4330_0000_0000_0000))
        - W::splat(4_503_599_627_370_496.0 + 1023.0);
    let m = W::from_bits(W::add_const(W::and_const(b, (1 << 52) - 1), SQRT_HALF));
    (k, m - W::splat(1.0))
}

/// k ln 2 + ln(1 + f).
#[inline(always)]
fn join_log<W: Double>(k: W, f: W) -> W {
    let s = f / (W::splat(2.0) + f);
    let z = s * s;
    k * W::splat(std::f64::consts::LN_2) + (W::splat(2.0) * s + s * z * poly(z, &LOG))
}

/// ln(1 + x) for x > −1, finite; good to full relative accuracy near 0.
#[inline(always)]
fn log1p_core<W: Double>(x: W) -> W {
    let (k, f) = split_log(W::splat(1.0) + x);
    // For k = 0, f equals x up to the rounding of 1 + x, so x itself is used.
    join_log(k, W::select(k.eq(W::splat(0.0)), x, f))
}

/// Replaces a logarithm's value at the ends of its domain: −∞ if `zero` is 0, NaN if it is negative, and the
/// argument itself if it is +∞ or NaN.
#[inline(always)]
fn log_ends<W: Double>(value: W, zero: W, x: W) -> W {
    let v = W::select(x.lt(W::splat(f64::INFINITY)), value, x);
    let v = W::select(zero.eq(W::splat(0.0)), W::splat(f64::NEG_INFINITY), v);
    W::select(zero.lt(W::splat(0.0)), W::splat(f64::NAN), v)
}

#[inline(always)]
fn ln<W: Double>(x: W) -> W {
    let (k, f) = split_log(x);
    log_ends(join_log(k, f), x, x)
}

macro_rules! body {
    ($(#[$doc:meta])* $name:ident($x:ident) $value:block) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub(super) struct $name;
        impl Body for $name {
            #[inline(always)]
            fn at<W: Double>($x: W) -> W $value
        }
    };
    ($(#[$doc:meta])* $name:ident($x:ident, $y:ident) $value:block) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub(super) struct $name;
        impl BodyPair for $name {
            #[inline(always)]
            fn at<W: Double>($x: W, $y: W) -> W $value
        }
    };
}

// Beyond these limits the single-precision result is 0 or +∞.
const EXP_MIN: f64 = -104.0;
const EXP_MAX: f64 = 89.0;

body! {
    /// eˣ.
    Exp(x) { exp_core(clamp(x, EXP_MIN, EXP_MAX)) }
}

body! {
    /// eˣ − 1.
    Expm1(x) { W::select(x.eq(W::splat(0.0)), x, expm1_core(clamp(x, EXP_MIN, EXP_MAX))) }
}

body! {
    /// Natural logarithm.
    Ln(x) { ln(x) }
}

body! {
    /// ln(1 + x).
    Log1p(x) {
        let v = log_ends(log1p_core(x), x + W::splat(1.0), x);
        W::select(x.eq(W::splat(0.0)), x, v)
    }
}

body! {
    /// ln(p/(1 − p)); near ½ as ln(1 + f) with f = (2p − 1)/(1 − p).
    Logit(p) {
        let one = W::splat(1.0);
        let (k, f) = split_log(p / (one - p));
        let near = (p + p - one) / (one - p);
        let v = join_log(k, W::select(k.eq(W::splat(0.0)), near, f));
        let (zero, nan, inf) = (W::splat(0.0), W::splat(f64::NAN), W::splat(f64::INFINITY));
        let v = W::select(p.lt(one), v, W::select(p.eq(one), inf, nan));
        W::select(p.gt(zero), v, W::select(p.eq(zero), -inf, nan))
    }
}

body! {
    /// Hyperbolic tangent: e/(e + 2) with e = e^2|x| − 1, and the sign of x.
    Tanh(x) {
        let e = expm1_core(clamp(x.abs() + x.abs(), 0.0, 40.0));
        with_sign(e / (e + W::splat(2.0)), x)
    }
}

body! {
    /// 1/(1 + e⁻ˣ).
    Sigmoid(x) {
        let one = W::splat(1.0);
        one / (one + exp_core(clamp(-x, EXP_MIN, -EXP_MIN)))
    }
}

body! {
    /// ln(1 + eˣ) = max(x, 0) + ln(1 + e^−|x|).
    Softplus(x) {
        let zero = W::splat(0.0);
        let tail = log1p_core(exp_core(clamp(-x.abs(), EXP_MIN, 0.0)));
        W::select(x.lt(zero), zero, x) + tail
    }
}

/// erf(x)/x in x² on 0..1, error 2⁻⁵¹.
const ERF: [f64; 11] = [
    1.128_379_167_095_512_1,
    -0.376_126_389_031_746_83,
    0.112_837_916_705_898_35,
    -0.026_866_170_587_700_296,
    0.005_223_977_161_920_587,
    -0.000_854_830_516_333_81,
    0.000_120_546_885_404_570_98,
    -1.491_339_400_331_875_3e-5,
    1.631_114_747_052_552_2e-6,
    -1.519_200_186_747_351_3e-7,
    9.436_035_463_900_939e-9,
];
/// (1 − erf x)·e^x² in (x − 2)/(x + 2) on 1..4, absolute error of erf 2⁻⁵².
const ERFC: [f64; 11] = [
    0.255_395_676_310_507_64,
    -0.427_185_847_414_281,
    0.241_658_194_235_246_9,
    -0.078_978_580_978_804_06,
    0.003_732_893_875_602_965_3,
    0.006_997_467_687_947_852,
    -0.000_847_192_305_601_806_2,
    -0.000_982_402_165_089_487_8,
    4.300_628_747_233_192e-5,
    0.000_178_717_131_421_039_15,
    4.615_708_597_289_628e-5,
];

body! {
    /// Error function; 1 from 4 on.
    Erf(x) {
        let (one, two) = (W::splat(1.0), W::splat(2.0));
        let a = clamp(x.abs(), 0.0, 4.0);
        let near = a * poly(a * a, &ERF);
        let far = one - exp_core(-(a * a)) * poly((a - two) / (a + two), &ERFC);
        with_sign(W::select(a.lt(one), near, far), x)
    }
}

/// ½ erfc(a)·e^(a²) in (a − 4)/(a + 4), relative error 2⁻⁴⁶ on 0..10.
const TAIL: [f64; 19] = [
    0.068_499_728_812_530_73,
    -0.129_534_024_380_085_8,
    0.109_359_839_459_118_74,
    -0.082_128_908_348_663_72,
    0.054_481_588_700_397_83,
    -0.031_553_907_818_743_99,
    0.015_649_528_234_987_373,
    -0.006_421_973_059_534_038,
    0.002_030_132_098_030_101_4,
    -0.000_399_562_673_191_247_3,
    -1.088_229_057_209_356e-5,
    3.948_573_478_631_564e-5,
    -1.127_776_606_261_194_3e-5,
    -9.305_279_828_291_527e-7,
    1.494_516_924_755_206e-6,
    -2.239_800_817_194_668_7e-7,
    -1.971_751_167_694_092_5e-7,
    1.095_455_342_244_874_7e-8,
    1.131_081_839_714_249_3e-8,
];

/// Φ(x) and e^(−x²/2) for the standard normal distribution. Below 0, Φ has all its digits: it is not 1 minus a number near 1.
#[inline(always)]
fn normal<W: Double>(x: W) -> [W; 2] {
    let (one, four) = (W::splat(1.0), W::splat(4.0));
    let a = clamp(x.abs() * W::splat(std::f64::consts::FRAC_1_SQRT_2), 0.0, 10.3);
    let bell = exp_core(-(a * a));
    let beyond = bell * poly((a - four) / (a + four), &TAIL);
    // Beyond 14.5 both are 0 in single precision, also times x.
    let is_far = a.gt(W::splat(10.299));
    let [beyond, bell] = [beyond, bell].map(|v| W::select(is_far, W::splat(0.0), v));
    [W::select(x.lt(W::splat(0.0)), beyond, one - beyond), bell]
}

body! {
    /// x·Φ(x).
    Gelu(x) {
        x * normal(x)[0]
    }
}

body! {
    /// Φ(x) + x·e^(−x²/2)/√(2π).
    GeluSlope(x) {
        const DENSITY: f64 = 0.398_942_280_401_432_7;
        let [below, bell] = normal(x);
        below + x * (bell * W::splat(DENSITY))
    }
}

body! {
    /// xʸ = e^(y ln x) for x ≥ 0.
    Pow(x, y) {
        let (zero, one) = (W::splat(0.0), W::splat(1.0));
        let v = exp_core(clamp(y * ln(x), EXP_MIN, EXP_MAX));
        let v = W::select(y.eq(zero), one, v);
        W::select(x.eq(one), one, v)
    }
}
