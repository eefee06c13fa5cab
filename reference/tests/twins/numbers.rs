//! Random numbers, digests, scalars, finite differences.

use reference::dual::Dual;
use reference::fd;
use reference::num::bits::{digest_f32, digest_f64, fnv1a};
use reference::num::elem::{sigmoid, softplus};
use reference::num::rng::{Key, block, normal_quantile, philox, uniform_f32, uniform_f64};
use reference::scalar::Scalar;

const KEY: Key =
    Key { seed: 0x1122_3344_5566_7788, item: 0x99aa_bbcc_ddee_ff00, step: 7, purpose: 3, draw: 5 };

#[test]
fn philox_gives_the_published_vectors() {
    // Random123, kat_vectors, philox4x32 10.
    assert_eq!(philox([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
    assert_eq!(philox([!0; 4], [!0; 2]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
    let counter = [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344];
    assert_eq!(
        philox(counter, [0xa409_3822, 0x299f_31d0]),
        [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
    );
}

#[test]
fn keys_are_laid_out_as_documented() {
    let counter = [0xddee_ff00, 0x99aa_bbcc, 7, 3 << 16 | 5];
    assert_eq!(block(KEY), philox(counter, [0x5566_7788, 0x1122_3344]));
}

#[test]
fn uniforms_are_exact_multiples_inside_the_open_interval() {
    let words = block(KEY);
    let m = (u64::from(words[1]) << 32 | u64::from(words[0])) >> 12;
    assert_eq!(uniform_f64(KEY) * 4_503_599_627_370_496.0, m as f64 + 0.5);
    assert_eq!(uniform_f32(KEY) * 8_388_608.0, (words[0] >> 9) as f32 + 0.5);
    for item in 0..1000 {
        let u = uniform_f64(Key { item, ..KEY });
        assert!(u > 0.0 && u < 1.0, "{u}");
    }
}

#[test]
fn normal_quantiles_are_those_of_tables() {
    // Wichura 1988, section 3: PPND16 at 0.25, 0.001, 1e-20; and the two-sided 5 % point.
    for (p, x) in [
        (0.25, -0.674_489_750_196_081_7),
        (0.001, -3.090_232_306_167_813_5),
        (1e-20, -9.262_340_089_798_408),
        (0.975, 1.959_963_984_540_054),
        (0.5, 0.0),
    ] {
        assert!((normal_quantile(p) - x).abs() <= 4e-16 * x.abs(), "{p}: {}", normal_quantile(p));
    }
}

#[test]
fn digests_are_fnv1a_over_header_and_bits() {
    // Vectors of the FNV reference code.
    assert_eq!(fnv1a(b""), 0xcbf2_9ce4_8422_2325);
    assert_eq!(fnv1a(b"a"), 0xaf63_dc4c_8601_ec8c);
    assert_eq!(fnv1a(b"foobar"), 0x8594_4171_f739_67e8);
    let bytes: Vec<u8> =
        [8_u64, 1, 1].iter().flat_map(|x| x.to_le_bytes()).chain(1.5_f64.to_le_bytes()).collect();
    assert_eq!(digest_f64(&[1], &[1.5]), Ok(fnv1a(&bytes)));
    assert_ne!(digest_f64(&[1], &[0.0]), digest_f64(&[1], &[-0.0]), "the sign of zero counts");
    assert_ne!(digest_f32(&[1, 2], &[1.0, 2.0]), digest_f32(&[2, 1], &[1.0, 2.0]), "the shape counts");
    assert!(digest_f32(&[1], &[f32::NAN]).is_err(), "a NaN has no digest");
}

/// A function of one number for each function of the trait.
fn every_function<S: Scalar>(x: S) -> [S; 18] {
    let two = S::from_f64(2.0);
    [
        x.sqrt(),
        x.exp(),
        x.expm1(),
        x.ln(),
        x.log1p(),
        x.sin(),
        x.cos(),
        x.atan2(two),
        two.atan2(x),
        x.acos(),
        x.tanh(),
        x.erf(),
        x.pow(two + 0.5),
        two.pow(x),
        (-x).abs(),
        sigmoid(x) / x,
        softplus(x) - x * x,
        (x * 3.0 + 1.0) / 7.0 - x,
    ]
}

#[test]
fn derivatives_of_all_functions_agree_with_differences() {
    for at in [0.2, 0.5, 0.8] {
        let dual = every_function(Dual { value: at, tangent: 1.0 });
        for (k, d) in dual.iter().enumerate() {
            assert_eq!(d.value, every_function(at)[k], "function {k}: the value is that of f64");
            let difference = fd::richardson(|h| every_function(at + h)[k], 2e-4);
            let error = (difference - d.tangent).abs() / (1.0 + d.tangent.abs());
            assert!(error <= 1e-10, "function {k} at {at}: {error:e}");
        }
    }
}

#[test]
fn slopes_at_kinks_are_the_documented_ones() {
    let at = |value: f64| Dual { value, tangent: 1.0 };
    for slope in [
        at(0.0).sqrt(),
        at(0.0).abs(),
        at(1.0).acos(),
        at(-1.0).acos(),
        at(0.0).atan2(at(0.0)),
        at(0.0).pow(at(2.0)),
        at(0.0).pow(Dual::from_f64(0.5)),
    ] {
        assert_eq!(slope.tangent, 0.0);
    }
    assert_eq!(at(0.0).pow(Dual::from_f64(1.0)).tangent, 1.0);
    assert_eq!(at(-2.0).abs(), Dual { value: 2.0, tangent: -1.0 });
}

#[test]
fn the_observed_order_of_central_differences_is_two() {
    let f = |h: f64| reference::num::elem::sin(1.0 + h);
    let order = fd::order(f, reference::num::elem::cos(1.0), &[1e-1, 3e-2, 1e-2, 3e-3], 1e-12)
        .expect("errors above the floor");
    assert!((order - 2.0).abs() < 0.01, "{order}");
    let linear = |h: f64| 2.0 * h;
    assert_eq!(fd::order(linear, 2.0, &[1e-2, 1e-3], 1e-12), None, "a line has no error to measure");
}
