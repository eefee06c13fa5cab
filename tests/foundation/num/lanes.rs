//! Lane parity: every operation of eight lanes has the bits of the scalar operation.

use lastlight::num::lanes::{Real, f32x8};
use lastlight::num::rng::Rng;

/// Edges, numbers of moderate size and any bit patterns, in pairs.
fn pairs() -> Vec<([f32; 8], [f32; 8])> {
    let edges =
        [0.0, -0.0, 1.0, -1.0, 1e-45, -1e-45, 1.175_494_4e-38, 3.402_823_5e38, f32::INFINITY, -f32::INFINITY];
    let mut all = Vec::new();
    for &a in &edges {
        for chunk in edges.chunks(5) {
            let mut b = [a; 8];
            b[..chunk.len()].copy_from_slice(chunk);
            all.push(([a; 8], b));
        }
    }
    let rng = Rng::new(4);
    for i in 0..4000 {
        let pick = |l: usize, draw: u16| {
            let [bits, kind, ..] = rng.block(i * 8 + l as u64, 0, 0, draw);
            match kind % 8 {
                0 => edges[bits as usize % edges.len()],
                1 | 2 => f32::from_bits(bits),
                _ => (bits >> 8) as f32 / 16_777_216.0 * 200.0 - 100.0,
            }
        };
        let number = |x: f32| if x.is_nan() { 1.5 } else { x };
        all.push((std::array::from_fn(|l| number(pick(l, 0))), std::array::from_fn(|l| number(pick(l, 1)))));
    }
    all
}

/// Same bits, or both NaN: payloads are not specified.
fn agree(one: f32, eight: f32) -> bool {
    one.to_bits() == eight.to_bits() || one.is_nan() && eight.is_nan()
}

#[test]
fn arithmetic_agrees() {
    type Op<L> = fn(L, L) -> L;
    let operations: [(&str, Op<f32>, Op<f32x8>); 12] = [
        ("+", |a, b| a + b, |a, b| a + b),
        ("−", |a, b| a - b, |a, b| a - b),
        ("×", |a, b| a * b, |a, b| a * b),
        ("÷", |a, b| a / b, |a, b| a / b),
        ("neg", |a, _| -a, |a, _| -a),
        ("sqrt", |a, _| Real::sqrt(a), |a, _| Real::sqrt(a)),
        ("abs", |a, _| Real::abs(a), |a, _| Real::abs(a)),
        ("min", Real::min, Real::min),
        ("max", Real::max, Real::max),
        ("clamp", |a, _| Real::clamp(a, -2.5, 7.5), |a, _| Real::clamp(a, -2.5, 7.5)),
        ("a·b + a", |a, b| a * b + a, |a, b| a * b + a),
        ("a·b − a·a", |a, b| a * b - a * a, |a, b| a * b - a * a),
    ];
    for (a, b) in pairs() {
        for (name, one, eight) in operations {
            let y = eight(f32x8::new(a), f32x8::new(b)).to_array();
            for l in 0..8 {
                let x = one(a[l], b[l]);
                assert!(agree(x, y[l]), "{name} of {:e}, {:e}: one lane {x:e}, eight {:e}", a[l], b[l], y[l]);
            }
        }
    }
}

#[test]
fn comparisons_and_selections_agree() {
    for (a, b) in pairs() {
        let (va, vb) = (f32x8::new(a), f32x8::new(b));
        let masks =
            [Real::lt(va, vb), Real::le(va, vb), Real::gt(va, vb), Real::ge(va, vb), Real::eq(va, vb)];
        for l in 0..8 {
            let one = [a[l] < b[l], a[l] <= b[l], a[l] > b[l], a[l] >= b[l], a[l] == b[l]];
            for (i, (&mask, &one)) in masks.iter().zip(&one).enumerate() {
                let (p, q) = (a[l], b[l]);
                assert_eq!(
                    <f32x8 as Real>::bits(mask) >> l & 1,
                    u32::from(one),
                    "comparison {i} of {p:e}, {q:e}"
                );
                let picked = <f32x8 as Real>::select(mask, va, vb).lane(l);
                assert_eq!(
                    picked.to_bits(),
                    f32::select(one, p, q).to_bits(),
                    "selection {i} of {p:e}, {q:e}"
                );
            }
            let both = <f32x8 as Real>::bits(<f32x8 as Real>::and(masks[1], masks[3])) >> l & 1;
            let either = <f32x8 as Real>::bits(<f32x8 as Real>::or(masks[0], masks[2])) >> l & 1;
            assert_eq!((both, either), (u32::from(one[1] && one[3]), u32::from(one[0] || one[2])), "and, or");
        }
    }
}

#[test]
fn minimum_and_maximum_of_a_tie_are_the_first_argument() {
    for (a, b) in [(0.0_f32, -0.0_f32), (-0.0, 0.0)] {
        assert_eq!(Real::min(a, b).to_bits(), a.to_bits());
        assert_eq!(Real::max(a, b).to_bits(), a.to_bits());
        assert_eq!(Real::min(f32x8::splat(a), f32x8::splat(b)).lane(3).to_bits(), a.to_bits());
        assert_eq!(Real::max(f32x8::splat(a), f32x8::splat(b)).lane(3).to_bits(), a.to_bits());
    }
}

#[test]
fn powers_of_two_are_exact() {
    for n in -126..=127 {
        let power = libm::ldexpf(1.0, n);
        assert_eq!(f32::exp2_int(n as f32), power);
        assert_eq!(<f32x8 as Real>::exp2_int(f32x8::splat(n as f32)).lane(5), power);
        let rounded = n as f32 + 12_582_912.0;
        for x in [1.0_f32, 1.25, 1.999_999_9] {
            assert_eq!(x.scale_exp2(rounded), x * power);
            assert_eq!(f32x8::splat(x).scale_exp2(f32x8::splat(rounded)).lane(2), x * power);
        }
    }
}

#[test]
fn lanes_are_numbered_as_they_are_filled() {
    let x = <f32x8 as Real>::from_fn(|i| i as f32);
    assert!((0..8).all(|i| x.lane(i) == i as f32), "{x:?}");
    assert_eq!((<f32 as Real>::N, <f32x8 as Real>::N), (1, 8));
    assert_eq!(<f32 as Real>::from_fn(|i| i as f32 + 3.0), 3.0);
}
