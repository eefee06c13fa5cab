//! Stateless random numbers: Philox4x32-10 (Salmon et al. 2011) as a function of the coordinates of a draw.
//!
//! key = (seed low, seed high), counter = (item low, item high, step, purpose·2¹⁶ + draw). Each draw uses one
//! block, so a number depends only on its own coordinates and never on the number, the order or the threads
//! of other draws. `purpose` separates uses (each caller has its own constant); `draw` numbers the draws of
//! one item.
//!
//! Uniforms are (m + ½)·2⁻²³ with m = x₀ ≫ 9 in f32, and (m + ½)·2⁻⁵² with m the top 52 bits of x₁·2³² + x₀
//! in f64: exact, symmetric about ½, never 0 or 1. Normals use the inverse distribution function AS 241
//! (PPND16, Wichura 1988) in f64 with the pinned logarithm.
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::num::rng::Rng;
//! let rng = Rng::new(7);
//! let u = rng.uniform_f32(12, 0, 3, 0);
//! assert!(0.0 < u && u < 1.0);
//! assert_eq!(u, Rng::new(7).uniform_f32(12, 0, 3, 0));
//! ```

/// A random number generator, defined by its seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rng {
    /// The seed as (low, high) words.
    key: [u32; 2],
}

/// Runs ten rounds of Philox4x32.
#[inline]
pub fn philox(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    for round in 0..10 {
        if round > 0 {
            key = [key[0].wrapping_add(0x9e37_79b9), key[1].wrapping_add(0xbb67_ae85)];
        }
        let a = u64::from(counter[0]) * 0xd251_1f53;
        let b = u64::from(counter[2]) * 0xcd9e_8d57;
        counter = [
            (b >> 32) as u32 ^ counter[1] ^ key[0],
            b as u32,
            (a >> 32) as u32 ^ counter[3] ^ key[1],
            a as u32,
        ];
    }
    counter
}

impl Rng {
    /// Returns the generator for a seed.
    pub fn new(seed: u64) -> Self {
        Self { key: [seed as u32, (seed >> 32) as u32] }
    }

    /// Returns the four words of one draw.
    #[inline]
    pub fn block(&self, item: u64, step: u32, purpose: u16, draw: u16) -> [u32; 4] {
        philox([item as u32, (item >> 32) as u32, step, u32::from(purpose) << 16 | u32::from(draw)], self.key)
    }

    /// Returns a separate seed for step `step` of item `item`: the 64 bits x₁·2³² + x₀ of its block with draw
    /// 0.
    #[inline]
    pub fn derive(&self, item: u64, step: u32, purpose: u16) -> u64 {
        let x = self.block(item, step, purpose, 0);
        u64::from(x[1]) << 32 | u64::from(x[0])
    }

    /// Returns a uniform number in (0, 1), one of 2²³ midpoints.
    #[inline]
    pub fn uniform_f32(&self, item: u64, step: u32, purpose: u16, draw: u16) -> f32 {
        uniform_f32(self.block(item, step, purpose, draw))
    }

    /// Returns a uniform number in (0, 1), one of 2⁵² midpoints.
    #[inline]
    pub fn uniform_f64(&self, item: u64, step: u32, purpose: u16, draw: u16) -> f64 {
        uniform_f64(self.block(item, step, purpose, draw))
    }

    /// Returns a standard normal number.
    pub fn normal_f64(&self, item: u64, step: u32, purpose: u16, draw: u16) -> f64 {
        inverse_normal(self.uniform_f64(item, step, purpose, draw))
    }

    /// Returns a standard normal number, computed in f64 and rounded once.
    pub fn normal_f32(&self, item: u64, step: u32, purpose: u16, draw: u16) -> f32 {
        self.normal_f64(item, step, purpose, draw) as f32
    }

    /// Returns an index in 0..n: the 64 bits x₁·2³² + x₀ times n, divided by 2⁶⁴. The bias is below n·2⁻⁶⁴.
    ///
    /// # Panics
    /// Panics if `n` is 0.
    pub fn index(&self, n: usize, item: u64, step: u32, purpose: u16, draw: u16) -> usize {
        assert!(n > 0, "n is at least 1");
        let x = self.block(item, step, purpose, draw);
        let word = u64::from(x[1]) << 32 | u64::from(x[0]);
        ((u128::from(word) * n as u128) >> 64) as usize
    }

    /// Returns a permutation of 0..n: the indices i sorted by (x₁·2³² + x₀ of item i, i), with draw 0.
    pub fn permutation(&self, n: usize, step: u32, purpose: u16) -> Vec<usize> {
        let mut keys: Vec<(u64, usize)> = (0..n)
            .map(|i| {
                let x = self.block(i as u64, step, purpose, 0);
                (u64::from(x[1]) << 32 | u64::from(x[0]), i)
            })
            .collect();
        keys.sort_unstable(); // keys are unique because they contain the index
        keys.into_iter().map(|(_, i)| i).collect()
    }
}

/// Returns the seed of item `item` under `seed`, which is [`Rng::derive`] at step 0. Numbers drawn under two
/// such seeds are unrelated, even at equal coordinates. Each image of a set uses its own seed, so that no two
/// images have the same noise.
pub fn derive(seed: u64, item: u64, purpose: u16) -> u64 {
    Rng::new(seed).derive(item, 0, purpose)
}

/// Returns the f32 uniform of a block: (m + ½)·2⁻²³, m = x₀ ≫ 9.
#[inline]
pub fn uniform_f32(block: [u32; 4]) -> f32 {
    ((block[0] >> 9) as f32 + 0.5) * (1.0 / 8_388_608.0)
}

/// Returns the f64 uniform of a block: (m + ½)·2⁻⁵², m = top 52 bits of x₁·2³² + x₀.
#[inline]
pub fn uniform_f64(block: [u32; 4]) -> f64 {
    let word = u64::from(block[1]) << 32 | u64::from(block[0]);
    ((word >> 12) as f64 + 0.5) * (1.0 / 4_503_599_627_370_496.0)
}

/// Evaluates c₀ + x (c₁ + x (c₂ + …)).
fn horner(x: f64, c: &[f64]) -> f64 {
    c.iter().rev().fold(0.0, |acc, &k| acc * x + k)
}

/// Returns the quantile of the standard normal distribution for p in (0, 1): AS 241, PPND16 (Wichura 1988),
/// accurate to about 1e-16.
pub fn inverse_normal(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180_625 - q * q;
        return q * horner(r, &A) / horner(r, &B);
    }
    let tail = if q < 0.0 { p } else { 1.0 - p };
    let r = (-libm::log(tail)).sqrt();
    let x = if r <= 5.0 {
        let r = r - 1.6;
        horner(r, &C) / horner(r, &D)
    } else {
        let r = r - 5.0;
        horner(r, &E) / horner(r, &F)
    };
    if q < 0.0 { -x } else { x }
}

// Coefficients of AS 241: numerators and denominators in ascending order for |p − ½| ≤ 0.425, for √(−ln p) ≤
// 5, and beyond.
const A: [f64; 8] = [
    3.387_132_872_796_366_608_0,
    1.331_416_678_917_843_774_5e2,
    1.971_590_950_306_551_442_7e3,
    1.373_169_376_550_946_112_5e4,
    4.592_195_393_154_987_145_7e4,
    6.726_577_092_700_870_085_3e4,
    3.343_057_558_358_812_810_5e4,
    2.509_080_928_730_122_672_7e3,
];
const B: [f64; 8] = [
    1.0,
    4.231_333_070_160_091_125_2e1,
    6.871_870_074_920_579_083_0e2,
    5.394_196_021_424_751_107_7e3,
    2.121_379_430_158_659_586_7e4,
    3.930_789_580_009_271_061_0e4,
    2.872_908_573_572_194_267_4e4,
    5.226_495_278_852_854_561_0e3,
];
const C: [f64; 8] = [
    1.423_437_110_749_683_577_34,
    4.630_337_846_156_545_295_90,
    5.769_497_221_460_691_405_50,
    3.647_848_324_763_204_605_04,
    1.270_458_252_452_368_382_58,
    2.417_807_251_774_506_117_70e-1,
    2.272_384_498_926_918_458_33e-2,
    7.745_450_142_783_414_076_40e-4,
];
const D: [f64; 8] = [
    1.0,
    2.053_191_626_637_758_821_87,
    1.676_384_830_183_803_849_40,
    6.897_673_349_851_000_045_50e-1,
    1.481_039_764_274_800_745_90e-1,
    1.519_866_656_361_645_719_66e-2,
    5.475_938_084_995_344_946_00e-4,
    1.050_750_071_644_416_843_24e-9,
];
const E: [f64; 8] = [
    6.657_904_643_501_103_777_20,
    5.463_784_911_164_114_369_90,
    1.784_826_539_917_291_335_80,
    2.965_605_718_285_048_912_30e-1,
    2.653_218_952_657_612_309_30e-2,
    1.242_660_947_388_078_438_60e-3,
    2.711_555_568_743_487_578_15e-5,
    2.010_334_399_292_288_132_65e-7,
];
const F: [f64; 8] = [
    1.0,
    5.998_322_065_558_879_376_90e-1,
    1.369_298_809_227_358_053_10e-1,
    1.487_536_129_085_061_485_25e-2,
    7.868_691_311_456_132_591_00e-4,
    1.846_318_317_510_054_681_80e-5,
    1.421_511_758_316_445_888_70e-7,
    2.044_263_103_389_939_785_64e-15,
];
