//! Counter-based random numbers: Philox4x32-10 (Salmon et al. 2011). No state, no order.
//!
//! key = (seed low, seed high); counter = (item low, item high, step, purpose·2¹⁶ + draw). One block per
//! draw: a single-precision uniform comes from word x0, a double-precision one from x1·2³² + x0.

/// Ten rounds of Philox4x32.
pub fn philox(counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
    let (mut x, mut k) = (counter, key);
    for round in 0..10 {
        if round > 0 {
            k = [k[0].wrapping_add(0x9E37_79B9), k[1].wrapping_add(0xBB67_AE85)];
        }
        let even = u64::from(x[0]) * 0xD251_1F53;
        let odd = u64::from(x[2]) * 0xCD9E_8D57;
        x = [(odd >> 32) as u32 ^ x[1] ^ k[0], odd as u32, (even >> 32) as u32 ^ x[3] ^ k[1], even as u32];
    }
    x
}

/// The key of a random number: the same key always yields the same number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key {
    /// Seed of the run.
    pub seed: u64,
    /// Index of the item (Gaussian, pixel, ray).
    pub item: u64,
    /// Index of the iteration.
    pub step: u32,
    /// Purpose of the number.
    pub purpose: u16,
    /// Index of the number among those of this purpose.
    pub draw: u16,
}

/// The four words of the block of a key.
pub fn block(key: Key) -> [u32; 4] {
    let Key { seed, item, step, purpose, draw } = key;
    let last = u32::from(purpose) << 16 | u32::from(draw);
    philox([item as u32, (item >> 32) as u32, step, last], [seed as u32, (seed >> 32) as u32])
}

/// (m + ½)·2⁻⁵², m the top 52 bits of x1·2³² + x0: exact, never 0 or 1.
pub fn uniform_f64(key: Key) -> f64 {
    let x = block(key);
    let word = u64::from(x[1]) << 32 | u64::from(x[0]);
    ((word >> 12) as f64 + 0.5) * (1.0 / 4_503_599_627_370_496.0)
}

/// (m + ½)·2⁻²³, m the top 23 bits of x0: exact, never 0 or 1.
pub fn uniform_f32(key: Key) -> f32 {
    ((block(key)[0] >> 9) as f32 + 0.5) * (1.0 / 8_388_608.0)
}

/// A standard normal number: the quantile of the double-precision uniform.
pub fn normal_f64(key: Key) -> f64 {
    normal_quantile(uniform_f64(key))
}

/// [`normal_f64`], rounded once.
pub fn normal_f32(key: Key) -> f32 {
    normal_f64(key) as f32
}

/// Ratio of two polynomials, Horner from the highest coefficient; the denominator's constant term is 1.
fn ratio(r: f64, numerator: [f64; 8], denominator: [f64; 7]) -> f64 {
    let top = numerator.iter().rev().fold(0.0, |sum, c| sum * r + c);
    let bottom = denominator.iter().rev().fold(0.0, |sum, c| sum * r + c) * r + 1.0;
    top / bottom
}

/// Quantile of the standard normal distribution for 0 < p < 1: AS 241, PPND16 (Wichura 1988), about 1e-16
/// relative.
///
/// # Rounding
/// Horner from the highest coefficient; the logarithm is `libm`'s.
pub fn normal_quantile(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180625 - q * q;
        return q * ratio(r, CENTRE.0, CENTRE.1);
    }
    let tail = if q < 0.0 { p } else { 1.0 - p };
    let r = (-libm::log(tail)).sqrt();
    let x = if r <= 5.0 { ratio(r - 1.6, MIDDLE.0, MIDDLE.1) } else { ratio(r - 5.0, FAR.0, FAR.1) };
    if q < 0.0 { -x } else { x }
}

const CENTRE: ([f64; 8], [f64; 7]) = (
    [
        3.387_132_872_796_366_608,
        1.331_416_678_917_843_774_5e2,
        1.971_590_950_306_551_442_7e3,
        1.373_169_376_550_946_112_5e4,
        4.592_195_393_154_987_145_7e4,
        6.726_577_092_700_870_085_3e4,
        3.343_057_558_358_812_810_5e4,
        2.509_080_928_730_122_672_7e3,
    ],
    [
        4.231_333_070_160_091_125_2e1,
        6.871_870_074_920_579_083e2,
        5.394_196_021_424_751_107_7e3,
        2.121_379_430_158_659_586_7e4,
        3.930_789_580_009_271_061e4,
        2.872_908_573_572_194_267_4e4,
        5.226_495_278_852_854_561e3,
    ],
);
const MIDDLE: ([f64; 8], [f64; 7]) = (
    [
        1.423_437_110_749_683_577_34,
        4.630_337_846_156_545_295_9,
        5.769_497_221_460_691_405_5,
        3.647_848_324_763_204_605_04,
        1.270_458_252_452_368_382_58,
        2.417_807_251_774_506_117_7e-1,
        2.272_384_498_926_918_458_33e-2,
        7.745_450_142_783_414_076_4e-4,
    ],
    [
        2.053_191_626_637_758_821_87,
        1.676_384_830_183_803_849_4,
        6.897_673_349_851_000_045_5e-1,
        1.481_039_764_274_800_745_9e-1,
        1.519_866_656_361_645_719_66e-2,
        5.475_938_084_995_344_946e-4,
        1.050_750_071_644_416_843_24e-9,
    ],
);
const FAR: ([f64; 8], [f64; 7]) = (
    [
        6.657_904_643_501_103_777_2,
        5.463_784_911_164_114_369_9,
        1.784_826_539_917_291_335_8,
        2.965_605_718_285_048_912_3e-1,
        2.653_218_952_657_612_309_3e-2,
        1.242_660_947_388_078_438_6e-3,
        2.711_555_568_743_487_578_15e-5,
        2.010_334_399_292_288_132_65e-7,
    ],
    [
        5.998_322_065_558_879_376_9e-1,
        1.369_298_809_227_358_053_1e-1,
        1.487_536_129_085_061_485_25e-2,
        7.868_691_311_456_132_591e-4,
        1.846_318_317_510_054_681_8e-5,
        1.421_511_758_316_445_888_7e-7,
        2.044_263_103_389_939_785_64e-15,
    ],
);
