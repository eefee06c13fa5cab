//! Three-vectors over lanes. Every sum of three products is (x + y) + z.

use crate::num::lanes::Real;

/// Returns a·b.
#[inline(always)]
pub fn dot<L: Real>(a: [L; 3], b: [L; 3]) -> L {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

/// Returns a × b.
#[inline(always)]
pub fn cross<L: Real>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns a + b.
#[inline(always)]
pub fn add<L: Real>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Returns a − b.
#[inline(always)]
pub fn sub<L: Real>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Returns a times a number.
#[inline(always)]
pub fn scale<L: Real>(a: [L; 3], s: L) -> [L; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// Returns the componentwise product.
#[inline(always)]
pub fn mul<L: Real>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}

/// Returns `yes` where the mask is set, otherwise `no`.
#[inline(always)]
pub fn select<L: Real>(mask: L::Mask, yes: [L; 3], no: [L; 3]) -> [L; 3] {
    [L::select(mask, yes[0], no[0]), L::select(mask, yes[1], no[1]), L::select(mask, yes[2], no[2])]
}

/// Returns the power of two by which a vector is multiplied before it is squared, and its inverse: 1 if the
/// largest component is in 2⁻⁴⁰..2⁶⁰, otherwise one that scales it to 2⁻⁴⁹..2⁶⁰.
#[inline(always)]
fn gauge<L: Real>(largest: L) -> [L; 2] {
    let s = L::splat;
    let (one, up, down) = (s(1.0), s(TWO_100), s(TWO_M80));
    let (small, large) = (largest.lt(s(TWO_M40)), largest.ge(s(TWO_60)));
    [
        L::select(small, up, L::select(large, down, one)),
        L::select(small, s(TWO_M100), L::select(large, s(TWO_80), one)),
    ]
}

const TWO_60: f32 = f32::from_bits((127 + 60) << 23);
const TWO_80: f32 = f32::from_bits((127 + 80) << 23);
const TWO_100: f32 = f32::from_bits((127 + 100) << 23);
const TWO_M40: f32 = f32::from_bits((127 - 40) << 23);
const TWO_M80: f32 = f32::from_bits((127 - 80) << 23);
const TWO_M100: f32 = f32::from_bits((127 - 100) << 23);

/// Returns the largest absolute component.
#[inline(always)]
pub fn largest<L: Real>(a: [L; 3]) -> L {
    a[0].abs().max(a[1].abs()).max(a[2].abs())
}

/// Returns a/‖a‖ and ‖a‖ for any finite a: scaling by a power of two keeps the squares in range and changes
/// no bit of other results. The zero vector stays zero and has length 0; a length beyond f32 is infinite.
#[inline(always)]
pub fn unit<L: Real>(a: [L; 3]) -> ([L; 3], L) {
    let zero = L::splat(0.0);
    let [to, from] = gauge(largest(a));
    let a = scale(a, to);
    let length = dot(a, a).sqrt();
    let there = length.gt(zero);
    let safe = L::select(there, length, L::splat(1.0));
    (select(there, a.map(|x| x / safe), [zero; 3]), length * from)
}

/// Returns a × b up to a positive factor, which is 1 if the largest components of both are in 2⁻⁴⁰..2⁶⁰;
/// products of edges of any length stay in range.
#[inline(always)]
pub fn cross_direction<L: Real>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    let within = |v: [L; 3]| scale(v, gauge(largest(v))[0]);
    cross(within(a), within(b))
}

/// Returns both vectors times the same power of two, which is 1 if the largest component of all is in
/// 2⁻⁴⁰..2⁶⁰.
#[inline(always)]
pub fn together<L: Real>([a, b]: [[L; 3]; 2]) -> [[L; 3]; 2] {
    let to = gauge(largest(a).max(largest(b)))[0];
    [scale(a, to), scale(b, to)]
}

/// Returns two unit vectors that form a right-handed frame with the unit vector `n` (Duff et al. 2017).
#[inline(always)]
pub fn frame<L: Real>(n: [L; 3]) -> [[L; 3]; 2] {
    let one = L::splat(1.0);
    let sign = L::select(n[2].lt(L::splat(0.0)), -one, one);
    let a = -one / (sign + n[2]);
    let b = n[0] * n[1] * a;
    [[one + sign * (n[0] * n[0] * a), sign * b, -(sign * n[0])], [b, sign + n[1] * n[1] * a, -n[1]]]
}
