//! Three-vectors over lanes. Every sum of three products is (x + y) + z.

use crate::num::lanes::Real;

/// a·b.
#[inline(always)]
pub fn dot<L: Real>(a: [L; 3], b: [L; 3]) -> L {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

/// a × b.
#[inline(always)]
pub fn cross<L: Real>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// a + b.
#[inline(always)]
pub fn add<L: Real>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// a − b.
#[inline(always)]
pub fn sub<L: Real>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// a times a number.
#[inline(always)]
pub fn scale<L: Real>(a: [L; 3], s: L) -> [L; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// Component by component.
#[inline(always)]
pub fn mul<L: Real>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}

/// `yes` where the mask is set, else `no`.
#[inline(always)]
pub fn select<L: Real>(mask: L::Mask, yes: [L; 3], no: [L; 3]) -> [L; 3] {
    [L::select(mask, yes[0], no[0]), L::select(mask, yes[1], no[1]), L::select(mask, yes[2], no[2])]
}

/// a/‖a‖ and ‖a‖; a zero vector (also one whose square underflows) stays zero and has length 0.
#[inline(always)]
pub fn unit<L: Real>(a: [L; 3]) -> ([L; 3], L) {
    let zero = L::splat(0.0);
    let length = dot(a, a).sqrt();
    let there = length.gt(zero);
    let safe = L::select(there, length, L::splat(1.0));
    (select(there, a.map(|x| x / safe), [zero; 3]), length)
}

/// Two unit vectors that make a right-handed frame with the unit vector `n` (Duff et al. 2017).
#[inline(always)]
pub fn frame<L: Real>(n: [L; 3]) -> [[L; 3]; 2] {
    let one = L::splat(1.0);
    let sign = L::select(n[2].lt(L::splat(0.0)), -one, one);
    let a = -one / (sign + n[2]);
    let b = n[0] * n[1] * a;
    [[one + sign * (n[0] * n[0] * a), sign * b, -(sign * n[0])], [b, sign + n[1] * n[1] * a, -n[1]]]
}
