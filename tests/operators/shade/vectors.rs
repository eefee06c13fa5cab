//! Unit vectors and faces at every scale.

use lastlight::num::lanes::f32x8;
use lastlight::num::rng::Rng;
use lastlight::shade::vector::{cross, cross_direction, dot, largest, unit};

/// 2⁻⁴⁰, below which vectors are scaled.
const SMALL: f32 = 1.0 / 1_099_511_627_776.0;

/// Directions and lengths at every scale, against f64.
#[test]
fn unit_vectors_of_any_length() {
    let shapes = [[1.0_f32, 0.0, 0.0], [0.3, -0.9, 0.7], [1e-6, 1.0, -2e-7], [-0.5, 0.5, 0.5]];
    for shape in shapes {
        for e in -140..=127 {
            // the full range of f32: subnormal components are exact multiples of 2⁻¹⁴⁹
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
            assert_eq!(wide.0.map(|x| x.to_array()[3].to_bits()), u.map(f32::to_bits), "lanes: direction");
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
        let r = Rng::new(4);
        let size = libm::exp2f((i % 80) as f32 - 38.0);
        let a: [f32; 3] = std::array::from_fn(|k| size * r.normal_f32(i, k as u32, 0, 0));
        let b: [f32; 3] = std::array::from_fn(|k| size * r.normal_f32(i, k as u32, 0, 1));
        let length = dot(a, a).sqrt();
        if largest(a) < SMALL || largest(b) < SMALL {
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
