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

/// Power of two by which a vector is multiplied before it is squared, and its inverse: 1 where the largest component lies in 2⁻⁴⁰..2⁶⁰, else
/// one that brings it to 2⁻⁴⁹..2⁶⁰.
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

/// Largest absolute component.
#[inline(always)]
pub fn largest<L: Real>(a: [L; 3]) -> L {
    a[0].abs().max(a[1].abs()).max(a[2].abs())
}

/// a/‖a‖ and ‖a‖ for any finite a: a power of two keeps the squares within range and changes no bit of the others. The zero vector stays zero
/// and has length 0; a length beyond f32 is infinite.
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

/// a × b up to a positive factor, 1 where the largest components of both lie in 2⁻⁴⁰..2⁶⁰: products of edges of any length stay within
/// range.
#[inline(always)]
pub fn cross_direction<L: Real>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    let within = |v: [L; 3]| scale(v, gauge(largest(v))[0]);
    cross(within(a), within(b))
}

/// Both times the same power of two, 1 where the largest component of all lies in 2⁻⁴⁰..2⁶⁰.
#[inline(always)]
pub fn together<L: Real>([a, b]: [[L; 3]; 2]) -> [[L; 3]; 2] {
    let to = gauge(largest(a).max(largest(b)))[0];
    [scale(a, to), scale(b, to)]
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::lanes::f32x8;

    /// Directions and lengths at every scale, against f64.
    #[test]
    fn unit_vectors_of_any_length() {
        let shapes = [[1.0_f32, 0.0, 0.0], [0.3, -0.9, 0.7], [1e-6, 1.0, -2e-7], [-0.5, 0.5, 0.5]];
        for shape in shapes {
            for e in -140..=127 {
                // the whole range of f32: subnormal components are exact multiples of 2⁻¹⁴⁹
                let a = shape.map(|x| (f64::from(x) * libm::exp2(f64::from(e))) as f32);
                let d = a.map(f64::from);
                let want = ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]).sqrt();
                let (u, length) = unit(a);
                assert!(
                    (f64::from(length) - want).abs() <= 2e-7 * want + 1e-45,
                    "2^{e} {shape:?}: length {length:e}, want {want:e}"
                );
                for k in 0..3 {
                    assert!((f64::from(u[k]) - d[k] / want).abs() <= 2e-7, "2^{e} {shape:?}: {u:?}");
                }
                let wide = unit(a.map(f32x8::splat));
                assert_eq!(
                    wide.0.map(|x| x.to_array()[3].to_bits()),
                    u.map(f32::to_bits),
                    "lanes: direction"
                );
                assert_eq!(wide.1.to_array()[3].to_bits(), length.to_bits(), "lanes: length");
            }
        }
        assert_eq!(unit([0.0_f32, -0.0, 0.0]), ([0.0; 3], 0.0), "zero");
        assert_eq!(unit([f32::MAX; 3]).1, f32::INFINITY, "a length beyond f32");
        assert!((unit([f32::MAX; 3]).0[0] - 0.577_350_3).abs() < 1e-6, "whose direction is known");
    }

    #[test]
    fn ordinary_lengths_keep_their_bits() {
        for i in 0..2000 {
            let r = crate::num::rng::Rng::new(4);
            let size = libm::exp2f((i % 80) as f32 - 38.0);
            let a: [f32; 3] = std::array::from_fn(|k| size * r.normal_f32(i, k as u32, 0, 0));
            let b: [f32; 3] = std::array::from_fn(|k| size * r.normal_f32(i, k as u32, 0, 1));
            let length = dot(a, a).sqrt();
            if largest(a) < TWO_M40 || largest(b) < TWO_M40 {
                continue;
            }
            assert_eq!(unit(a), (a.map(|x| x / length), length), "row {i}");
            assert_eq!(cross_direction(a, b), cross(a, b), "row {i}");
        }
    }

    /// The normal of a triangle whose edges are far from 1, and from each other.
    #[test]
    fn faces_of_any_size() {
        for e in -145..=125 {
            for f in -145..=125 {
                let size = [e, f].map(|e: i32| libm::exp2(f64::from(e)));
                let a = [3.0, 0.0, 0.0].map(|x: f64| (size[0] * x) as f32);
                let b = [1.0, 2.0, 2.0].map(|x: f64| (size[1] * x) as f32);
                let n = unit(cross_direction(a, b)).0;
                let want = std::f32::consts::FRAC_1_SQRT_2;
                assert!(
                    n[0] == 0.0 && (n[1] + want).abs() < 1e-6 && (n[2] - want).abs() < 1e-6,
                    "edges of 2^{e} and 2^{f}: {n:?}"
                );
            }
        }
    }
}
