//! Double-precision lanes: one generic body for `f64` and [`f64x4`].
//!
//! The elementary functions of [`super::elem`] are generic over [`Double`], so that a scalar call and a call
//! on eight lanes perform the same operations on the same bits.

use std::ops::{Add, Div, Mul, Neg, Sub};

pub use wide::{f64x4, u64x4};

/// A function of one argument, written once for all widths of f64 lanes.
pub trait Body {
    /// Returns the value of the function.
    fn at<W: Double>(x: W) -> W;
}

/// A function of two arguments, written once for all widths of f64 lanes.
pub trait BodyPair {
    /// Returns the value of the function.
    fn at<W: Double>(x: W, y: W) -> W;
}

/// Lanes of double precision: `f64` (1 lane) or [`f64x4`] (4 lanes). The bodies in `num::elem` are generic
/// over this trait.
pub trait Double:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Result of a comparison.
    type Mask: Copy;
    /// Bit patterns as unsigned integers.
    type Bits: Copy;
    /// Returns the same number in every lane.
    fn splat(x: f64) -> Self;
    /// Builds lanes from a function of the lane index.
    fn from_fn(f: impl FnMut(usize) -> f64) -> Self;
    /// Returns lane `i`.
    fn lane(self, i: usize) -> f64;
    /// Returns the correctly rounded square root.
    fn sqrt(self) -> Self;
    /// Returns the absolute value.
    fn abs(self) -> Self;
    /// Compares self < other.
    fn lt(self, other: Self) -> Self::Mask;
    /// Compares self > other.
    fn gt(self, other: Self) -> Self::Mask;
    /// Compares self = other.
    fn eq(self, other: Self) -> Self::Mask;
    /// Selects `yes` where the mask is set, and `no` elsewhere.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Whether the mask is set in every lane.
    fn all(mask: Self::Mask) -> bool;
    /// Returns the bit patterns.
    fn to_bits(self) -> Self::Bits;
    /// Builds numbers from bit patterns.
    fn from_bits(b: Self::Bits) -> Self;
    /// Returns a + b modulo 2⁶⁴.
    fn add_bits(a: Self::Bits, b: Self::Bits) -> Self::Bits;
    /// Returns a + b modulo 2⁶⁴ with the same b in every lane.
    fn add_const(a: Self::Bits, b: u64) -> Self::Bits;
    /// Bitwise and of a and b.
    fn and_const(a: Self::Bits, b: u64) -> Self::Bits;
    /// Bitwise or of a and b.
    fn or_const(a: Self::Bits, b: u64) -> Self::Bits;
    /// Bitwise exclusive or of a and b.
    fn xor_bits(a: Self::Bits, b: Self::Bits) -> Self::Bits;
    /// Returns a·2ⁿ modulo 2⁶⁴.
    fn shl(a: Self::Bits, n: u32) -> Self::Bits;
    /// Returns ⌊a·2⁻ⁿ⌋.
    fn shr(a: Self::Bits, n: u32) -> Self::Bits;
}

impl Double for f64 {
    type Mask = bool;
    type Bits = u64;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> f64) -> Self {
        f(0)
    }
    #[inline(always)]
    fn lane(self, _: usize) -> f64 {
        self
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn gt(self, other: Self) -> bool {
        self > other
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
    fn all(mask: bool) -> bool {
        mask
    }
    #[inline(always)]
    fn to_bits(self) -> u64 {
        f64::to_bits(self)
    }
    #[inline(always)]
    fn from_bits(b: u64) -> Self {
        f64::from_bits(b)
    }
    #[inline(always)]
    fn add_bits(a: u64, b: u64) -> u64 {
        a.wrapping_add(b)
    }
    #[inline(always)]
    fn add_const(a: u64, b: u64) -> u64 {
        a.wrapping_add(b)
    }
    #[inline(always)]
    fn and_const(a: u64, b: u64) -> u64 {
        a & b
    }
    #[inline(always)]
    fn or_const(a: u64, b: u64) -> u64 {
        a | b
    }
    #[inline(always)]
    fn xor_bits(a: u64, b: u64) -> u64 {
        a ^ b
    }
    #[inline(always)]
    fn shl(a: u64, n: u32) -> u64 {
        a << n
    }
    #[inline(always)]
    fn shr(a: u64, n: u32) -> u64 {
        a >> n
    }
}

impl Double for f64x4 {
    type Mask = f64x4;
    type Bits = u64x4;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        f64x4::splat(x)
    }
    #[inline(always)]
    fn from_fn(f: impl FnMut(usize) -> f64) -> Self {
        f64x4::new(std::array::from_fn(f))
    }
    #[inline(always)]
    fn lane(self, i: usize) -> f64 {
        self.to_array()[i]
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64x4::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64x4::abs(self)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self {
        self.simd_lt(other)
    }
    #[inline(always)]
    fn gt(self, other: Self) -> Self {
        self.simd_gt(other)
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
    fn all(mask: Self) -> bool {
        mask.all()
    }
    #[inline(always)]
    fn to_bits(self) -> u64x4 {
        wide::bytemuck::cast(self)
    }
    #[inline(always)]
    fn from_bits(b: u64x4) -> Self {
        wide::bytemuck::cast(b)
    }
    #[inline(always)]
    fn add_bits(a: u64x4, b: u64x4) -> u64x4 {
        a + b
    }
    #[inline(always)]
    fn add_const(a: u64x4, b: u64) -> u64x4 {
        a + u64x4::splat(b)
    }
    #[inline(always)]
    fn and_const(a: u64x4, b: u64) -> u64x4 {
        a & u64x4::splat(b)
    }
    #[inline(always)]
    fn or_const(a: u64x4, b: u64) -> u64x4 {
        a | u64x4::splat(b)
    }
    #[inline(always)]
    fn xor_bits(a: u64x4, b: u64x4) -> u64x4 {
        a ^ b
    }
    #[inline(always)]
    fn shl(a: u64x4, n: u32) -> u64x4 {
        a << n
    }
    #[inline(always)]
    fn shr(a: u64x4, n: u32) -> u64x4 {
        a >> n
    }
}
