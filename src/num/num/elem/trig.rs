//! Sine, cosine and their inverses over f64 lanes.

use super::body::{ROUND, poly, with_sign};
use crate::num::double::{Body, BodyPair, Double};
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2, FRAC_PI_4, PI};

// π/2 in three parts. The first two have at most 31 bits, so that their products with n < 2²² are exact.
const HALF_PI_1: f64 = 1.570_796_325_802_803;
const HALF_PI_2: f64 = 9.920_935_791_635_221e-10;
const HALF_PI_3: f64 = 5.170_182_981_794_105e-19;
/// From this magnitude on, the argument reduction multiplies by 128 bits of 2/π.
const LARGE: f64 = 4_194_304.0; // 2²²
/// 64 zero bits, followed by 2/π = 0.a2f9836e…
const TWO_OVER_PI: [u64; 6] = [
    0,
    0xa2f9_836e_4e44_1529,
    0xfc27_57d1_f534_ddc0,
    0xdb62_9599_3c43_9041,
    0xfe51_63ab_debb_c561,
    0xb724_6e3a_424d_d2e0,
];

/// Returns the quadrant (lowest two bits) and the remainder r, |r| ≤ π/4, of a single-precision number with a
/// magnitude of at least 2²².
///
/// x = m·2ᵉ, where m is an integer of 24 bits. Bits of 2/π whose product with m·2ᵉ is a multiple of 4 do not
/// contribute, so a window of 128 bits that begins at weight 2 suffices: it gives x·2/π mod 4 with 126 bits
/// after the point and an error below 2⁻¹⁰².
fn reduce_large(x: f64) -> (u64, f64) {
    if !x.is_finite() {
        return (0, f64::NAN);
    }
    let bits = x.abs().to_bits();
    let m = (bits & ((1 << 52) - 1) | 1 << 52) >> 29; // 24 bits: the rest of a converted f32 is zero
    // |x| = m·2ᵉ with e = exponent field − 1023 − 23 ≥ −1. Bit i of 2/π (index i + 63 of the padded table)
    // times 2ᵉ has weight 2 for i = e − 1.
    let start = (bits >> 52) as usize - (1023 + 23 - 62);
    let (word, shift) = (start / 64, (start % 64) as u32);
    let high = u128::from(TWO_OVER_PI[word]) << 64 | u128::from(TWO_OVER_PI[word + 1]);
    let window =
        if shift == 0 { high } else { high << shift | u128::from(TWO_OVER_PI[word + 2] >> (64 - shift)) };
    let turns = window.wrapping_mul(u128::from(m)); // quarter turns·2¹²⁶, modulo 4
    let quadrant = turns.wrapping_add(1 << 125) >> 126;
    let rest = turns.wrapping_sub(quadrant << 126) as i128; // −2¹²⁵..2¹²⁵
    let r = rest as f64 * (1.0 / (1_u128 << 126) as f64) * FRAC_PI_2;
    if x < 0.0 { ((4 - quadrant as u64) & 3, -r) } else { (quadrant as u64 & 3, r) }
}

/// Returns the quadrant in the lowest bits, and the remainder.
#[inline(always)]
fn reduce<W: Double>(x: W) -> (W::Bits, W) {
    let t = x * W::splat(FRAC_2_PI) + W::splat(ROUND);
    let n = t - W::splat(ROUND);
    let r = ((x - n * W::splat(HALF_PI_1)) - n * W::splat(HALF_PI_2)) - n * W::splat(HALF_PI_3);
    if W::all(x.abs().lt(W::splat(LARGE))) {
        return (t.to_bits(), r);
    }
    let is_large = |i: usize| x.lane(i).abs() >= LARGE || x.lane(i).is_nan();
    let t = W::from_fn(|i| if is_large(i) { ROUND + reduce_large(x.lane(i)).0 as f64 } else { t.lane(i) });
    let r = W::from_fn(|i| if is_large(i) { reduce_large(x.lane(i)).1 } else { r.lane(i) });
    (t.to_bits(), r)
}

/// (sin r − r)/r³ in r² for |r| ≤ π/4, error 2⁻⁵⁷.
const SIN: [f64; 6] = [
    -0.166_666_666_666_666_46,
    0.008_333_333_333_325_052,
    -0.000_198_412_698_315_697_77,
    2.755_731_422_210_257_3e-6,
    -2.505_083_195_538_279_4e-8,
    1.590_067_120_739_305_2e-10,
];
/// (cos r − 1 + r²/2)/r⁴ in r² for |r| ≤ π/4, error 2⁻⁶².
const COS: [f64; 6] = [
    0.041_666_666_666_666_66,
    -0.001_388_888_888_888_451,
    2.480_158_729_576_261e-5,
    -2.755_731_610_034_478e-7,
    2.087_595_188_791_557_4e-9,
    -1.137_104_043_821_888_8e-11,
];

/// Returns sin(quadrant·π/2 + r).
#[inline(always)]
fn sin_quadrant<W: Double>(quadrant: W::Bits, r: W) -> W {
    let z = r * r;
    let sin = r * (W::splat(1.0) + z * poly(z, &SIN));
    let cos = W::splat(1.0) - (W::splat(0.5) * z - z * z * poly(z, &COS));
    // The lowest bit becomes the bits of 2.0 or 0.0 and serves as a mask; the second bit becomes the sign.
    let odd = W::from_bits(W::shl(W::and_const(quadrant, 1), 62)).gt(W::splat(0.0));
    let v = W::select(odd, cos, sin);
    W::from_bits(W::xor_bits(v.to_bits(), W::shl(W::and_const(quadrant, 2), 62)))
}

/// Sine.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sin;
impl Body for Sin {
    #[inline(always)]
    fn at<W: Double>(x: W) -> W {
        let (quadrant, r) = reduce(x);
        sin_quadrant(quadrant, r)
    }
}

/// Cosine, computed as the sine one quadrant later.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cos;
impl Body for Cos {
    #[inline(always)]
    fn at<W: Double>(x: W) -> W {
        let (quadrant, r) = reduce(x);
        sin_quadrant(W::add_const(quadrant, 1), r)
    }
}

/// (asin t − t)/t³ in t² on 0..½, error 2⁻⁵⁵.
const ASIN: [f64; 12] = [
    0.166_666_666_666_665_44,
    0.075_000_000_000_885_18,
    0.044_642_857_017_642_6,
    0.030_381_951_902_614_984,
    0.022_371_919_617_021_504,
    0.017_357_424_005_439_96,
    0.013_906_421_617_881_639,
    0.012_037_841_864_301_202,
    0.007_066_591_293_195_56,
    0.018_126_132_195_540_32,
    -0.014_124_881_012_211_998,
    0.030_535_446_729_171_38,
];

/// Arc cosine: π/2 − asin x for |x| ≤ ½, otherwise 2 asin √((1 − |x|)/2) or π minus that.
#[derive(Clone, Copy, Debug)]
pub(super) struct Acos;
impl Body for Acos {
    #[inline(always)]
    fn at<W: Double>(x: W) -> W {
        let (zero, half) = (W::splat(0.0), W::splat(0.5));
        let a = x.abs();
        let outer = a.gt(half);
        let z = W::select(outer, (W::splat(1.0) - a) * half, a * a);
        let t = W::select(outer, z.sqrt(), a);
        let asin = t + t * z * poly(z, &ASIN);
        let inner = W::splat(FRAC_PI_2) - with_sign(asin, x);
        let twice = asin + asin;
        W::select(outer, W::select(x.lt(zero), W::splat(PI) - twice, twice), inner)
    }
}

/// (atan t − t)/t³ in t² on 0..√2 − 1, error 2⁻⁵³.
const ATAN: [f64; 10] = [
    -0.333_333_333_333_330_04,
    0.199_999_999_997_384_24,
    -0.142_857_142_459_775_46,
    0.111_111_085_983_436_91,
    -0.090_908_247_118_214_4,
    0.076_906_254_365_683_13,
    -0.066_456_524_108_787_86,
    0.057_147_883_849_689_766,
    -0.044_195_639_700_741_446,
    0.021_958_339_322_333_27,
];

/// Angle of (x, y) from the x axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Atan2;
impl BodyPair for Atan2 {
    #[inline(always)]
    fn at<W: Double>(y: W, x: W) -> W {
        let (zero, one) = (W::splat(0.0), W::splat(1.0));
        let (ay, ax) = (y.abs(), x.abs());
        let steep = ay.gt(ax);
        let (lo, hi) = (W::select(steep, ax, ay), W::select(steep, ay, ax));
        // atan(lo/hi) is evaluated directly up to tan(π/8), beyond it as π/4 + atan((lo − hi)/(lo + hi)).
        let inf = W::splat(f64::INFINITY);
        let (lo, hi) = (W::select(lo.eq(inf), one, lo), W::select(lo.eq(inf), one, hi)); // both infinite: 45°
        let far = lo.gt(hi * W::splat(std::f64::consts::SQRT_2 - 1.0));
        let num = W::select(far, lo - hi, lo);
        let den = W::select(far, lo + hi, hi);
        let t = num / W::select(den.eq(zero), one, den); // both zero: 0
        let z = t * t;
        let atan = t + t * z * poly(z, &ATAN);
        let octant = W::select(far, W::splat(FRAC_PI_4) + atan, atan);
        let quadrant = W::select(steep, W::splat(FRAC_PI_2) - octant, octant);
        // The sign bit decides the half plane: atan2(±0, −0) = ±π.
        let left = with_sign(one, x).lt(zero);
        with_sign(W::select(left, W::splat(PI) - quadrant, quadrant), y)
    }
}
