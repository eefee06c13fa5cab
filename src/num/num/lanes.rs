//! Lanes: one generic body for scalars and vectors.
//!
//! A kernel that is generic over [`Real`] has the same bits per lane on `f32` and on [`f32x8`], because the
//! trait offers only operations that IEEE 754 rounds correctly (`+ − × ÷ √`), comparisons and selections.
//! `clippy.toml` bans every function of `wide` that may fuse, estimate or re-associate.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::double::{Body, BodyPair};
pub use wide::{f32x8, f64x4, i32x8, u32x8, u64x4};

/// Lanes of single precision: `f32` (1 lane) or [`f32x8`] (8 lanes).
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Number of lanes.
    const N: usize;
    /// Result of a comparison: all-ones or zero per lane.
    type Mask: Copy;
    /// Returns the same number in every lane.
    fn splat(x: f32) -> Self;
    /// Returns lane `i`.
    fn lane(self, i: usize) -> f32;
    /// Builds lanes from a function of the lane index.
    fn from_fn(f: impl FnMut(usize) -> f32) -> Self;
    /// Returns the correctly rounded square root.
    fn sqrt(self) -> Self;
    /// Returns the absolute value.
    fn abs(self) -> Self;
    /// Compares self < other.
    fn lt(self, other: Self) -> Self::Mask;
    /// Compares self ≤ other.
    fn le(self, other: Self) -> Self::Mask;
    /// Compares self > other.
    fn gt(self, other: Self) -> Self::Mask;
    /// Compares self ≥ other.
    fn ge(self, other: Self) -> Self::Mask;
    /// Compares self = other.
    fn eq(self, other: Self) -> Self::Mask;
    /// Selects `yes` where the mask is set, and `no` elsewhere.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Mask of the lanes that are set in both.
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Mask of the lanes that are set in at least one.
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Returns one bit per lane; lane 0 is the lowest bit.
    fn bits(mask: Self::Mask) -> u32;
    /// Returns 2ⁿ for integral n in −126..=127, by constructing the exponent field.
    fn exp2_int(n: Self) -> Self;
    /// Returns self·2ⁿ by integer addition to the exponent field, where `rounded` = n + 1.5·2²³ (so that n
    /// occupies its lowest bits). The result is exact while `self` and the result are normal numbers.
    fn scale_exp2(self, rounded: Self) -> Self;
    /// Limits `self` to `lo..=hi`; NaN stays NaN. The bounds are not zero, so there are no ties between
    /// zeros.
    fn clamp(self, lo: f32, hi: f32) -> Self;
    /// Converts every lane to f64 (exactly), applies the body, and rounds once.
    fn through_f64<F: Body>(self) -> Self;
    /// Like [`Self::through_f64`] for two arguments.
    fn through_f64_pair<F: BodyPair>(self, other: Self) -> Self;
    /// Returns the smaller value; a tie gives `self`.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::select(other.lt(self), other, self)
    }
    /// Returns the larger value; a tie gives `self`.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self::select(other.gt(self), other, self)
    }
}

impl Real for f32 {
    const N: usize = 1;
    type Mask = bool;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        x
    }
    #[inline(always)]
    fn lane(self, _: usize) -> f32 {
        self
    }
    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> f32) -> Self {
        f(0)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f32::abs(self)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self <= other
    }
    #[inline(always)]
    fn gt(self, other: Self) -> bool {
        self > other
    }
    #[inline(always)]
    fn ge(self, other: Self) -> bool {
        self >= other
    }
    #[inline(always)]
    fn eq(self, other: Self) -> bool {
        self == other
    }
    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    #[inline(always)]
    fn and(a: bool, b: bool) -> bool {
        a & b
    }
    #[inline(always)]
    fn or(a: bool, b: bool) -> bool {
        a | b
    }
    #[inline(always)]
    fn bits(mask: bool) -> u32 {
        u32::from(mask)
    }
    #[inline(always)]
    fn exp2_int(n: Self) -> Self {
        f32::from_bits((((n as i32) + 127) as u32) << 23)
    }
    #[inline(always)]
    fn scale_exp2(self, rounded: Self) -> Self {
        f32::from_bits(self.to_bits().wrapping_add(rounded.to_bits() << 23))
    }
    #[inline(always)]
    fn clamp(self, lo: f32, hi: f32) -> Self {
        super::order::clamp(self, lo, hi)
    }
    #[inline(always)]
    fn through_f64<F: Body>(self) -> Self {
        F::at(f64::from(self)) as f32
    }
    #[inline(always)]
    fn through_f64_pair<F: BodyPair>(self, other: Self) -> Self {
        F::at(f64::from(self), f64::from(other)) as f32
    }
}

impl Real for f32x8 {
    const N: usize = 8;
    type Mask = f32x8;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        f32x8::splat(x)
    }
    #[inline(always)]
    fn lane(self, i: usize) -> f32 {
        self.to_array()[i]
    }
    #[inline(always)]
    fn from_fn(f: impl FnMut(usize) -> f32) -> Self {
        f32x8::new(std::array::from_fn(f))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f32x8::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f32x8::abs(self)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self {
        self.simd_lt(other)
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self {
        self.simd_le(other)
    }
    #[inline(always)]
    fn gt(self, other: Self) -> Self {
        self.simd_gt(other)
    }
    #[inline(always)]
    fn ge(self, other: Self) -> Self {
        self.simd_ge(other)
    }
    #[inline(always)]
    fn eq(self, other: Self) -> Self {
        self.simd_eq(other)
    }
    #[inline(always)]
    fn select(mask: Self, yes: Self, no: Self) -> Self {
        mask.select(yes, no)
    }
    #[inline(always)]
    fn and(a: Self, b: Self) -> Self {
        a & b
    }
    #[inline(always)]
    fn or(a: Self, b: Self) -> Self {
        a | b
    }
    #[inline(always)]
    fn bits(mask: Self) -> u32 {
        mask.to_bitmask()
    }
    #[inline(always)]
    fn exp2_int(n: Self) -> Self {
        let e = n.fast_trunc_int() + i32x8::splat(127);
        wide::bytemuck::cast(e << 23)
    }
    #[inline(always)]
    fn scale_exp2(self, rounded: Self) -> Self {
        let p: u32x8 = wide::bytemuck::cast(self);
        let n: u32x8 = wide::bytemuck::cast(rounded);
        wide::bytemuck::cast(p + (n << 23))
    }
    #[inline(always)]
    fn clamp(self, lo: f32, hi: f32) -> Self {
        // x86 returns the second operand if one is NaN.
        f32x8::splat(lo).fast_max(f32x8::splat(hi).fast_min(self))
    }
    #[inline(always)]
    fn through_f64<F: Body>(self) -> Self {
        let (lo, hi) = widen(self);
        narrow(F::at(lo), F::at(hi))
    }
    #[inline(always)]
    fn through_f64_pair<F: BodyPair>(self, other: Self) -> Self {
        let ((x0, x1), (y0, y1)) = (widen(self), widen(other));
        narrow(F::at(x0, y0), F::at(x1, y1))
    }
}

/// Converts eight single-precision lanes to two vectors of four doubles.
#[inline(always)]
fn widen(x: f32x8) -> (f64x4, f64x4) {
    let x = x.to_array();
    let four = |i: usize| {
        f64x4::new([f64::from(x[i]), f64::from(x[i + 1]), f64::from(x[i + 2]), f64::from(x[i + 3])])
    };
    (four(0), four(4))
}

/// Rounds two vectors of four doubles to single precision.
#[inline(always)]
fn narrow(lo: f64x4, hi: f64x4) -> f32x8 {
    let (l, h) = (lo.to_array(), hi.to_array());
    f32x8::new([
        l[0] as f32,
        l[1] as f32,
        l[2] as f32,
        l[3] as f32,
        h[0] as f32,
        h[1] as f32,
        h[2] as f32,
        h[3] as f32,
    ])
}
