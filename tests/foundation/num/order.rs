//! Ties, orders, ordered maps, digests.

use lastlight::num::array::Array;
use lastlight::num::{bits, order, par};

#[test]
fn ties_go_to_the_first_argument() {
    for (a, b) in [(0.0_f32, -0.0_f32), (-0.0, 0.0)] {
        assert_eq!(order::min(a, b).to_bits(), a.to_bits());
        assert_eq!(order::max(a, b).to_bits(), a.to_bits());
    }
    assert_eq!(order::clamp(-0.0_f32, 0.0, 1.0).to_bits(), (-0.0_f32).to_bits());
    assert_eq!((order::clamp(2.0, 0.0, 1.0), order::clamp(-2.0, 0.0, 1.0)), (1.0, 0.0));
}

#[test]
fn keys_order_like_numbers() {
    let inf = f32::INFINITY;
    let rising = [-inf, -3.4e38, -1.0, -1e-45, 0.0, 1e-45, 1.0, 1.000_000_1, 3.4e38, inf];
    assert!(rising.windows(2).all(|w| order::key_f32(w[0]) < order::key_f32(w[1])), "strictly rising");
    assert_eq!(order::key_f32(-0.0), order::key_f32(0.0));
}

#[test]
fn maps_keep_the_order_of_indices() {
    for threads in [1, 2, 7] {
        let (plain, batched, chunks) = par::with_threads(threads, || {
            let mut chunks = vec![0; 1001];
            par::chunks_mut(&mut chunks, 64, |c, part| part.iter_mut().for_each(|x| *x = c));
            (par::map(1000, |i| 3 * i), par::map_batched(1000, 37, |i| 3 * i), chunks)
        })
        .expect("the environment of a fresh pool is the default one");
        assert!((0..1000).all(|i| plain[i] == 3 * i && batched[i] == 3 * i), "{threads} threads");
        assert!((0..1001).all(|i| chunks[i] == i / 64), "{threads} threads");
    }
}

#[test]
fn two_buffers_are_cut_alike() {
    let (mut a, mut b) = (vec![0; 10], vec![0; 5]);
    par::chunks_mut2(&mut a, 4, &mut b, 2, |i, a, b| {
        a.fill(i);
        b.fill(10 * i);
    });
    assert_eq!((a, b), (vec![0, 0, 0, 0, 1, 1, 1, 1, 2, 2], vec![0, 0, 10, 10, 20]));
}

/// FNV-1a of bytes, as its authors define it.
fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, &b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

#[test]
fn a_digest_is_fnv_over_width_rank_dimensions_and_elements() {
    assert_eq!(fnv(b"foobar"), 0x8594_4171_f739_67e8, "published value");
    let x = [1.5_f32, -0.0, 3.0, 1e-45, 5.0, 6.0];
    let mut bytes = Vec::new();
    for head in [4_u64, 2, 2, 3] {
        bytes.extend(head.to_le_bytes());
    }
    for v in x {
        bytes.extend(v.to_le_bytes());
    }
    let expected = fnv(&bytes);
    assert_eq!(bits::digest_f32(&[2, 3], &x).unwrap(), expected);
    assert_eq!(bits::digest(&Array::new(&[2, 3], x.to_vec())).unwrap(), expected);
    assert_eq!(
        bits::digest_f64(&[], &[2.0]).unwrap(),
        fnv(&[8_u64, 0, 2.0_f64.to_bits()].map(u64::to_le_bytes).concat())
    );
    let integers = [4_u64.to_le_bytes(), 1_u64.to_le_bytes(), 2_u64.to_le_bytes()].concat();
    let integers = [integers, 7_i32.to_le_bytes().to_vec(), (-1_i32).to_le_bytes().to_vec()].concat();
    assert_eq!(bits::digest(&Array::new(&[2], vec![7, -1_i32])).unwrap(), fnv(&integers));
}

#[test]
fn a_nan_or_a_wrong_shape_has_no_digest() {
    let nan = bits::digest_f32(&[2], &[0.0, f32::NAN]).unwrap_err();
    assert!(nan.to_string().contains("element 1"), "{nan}");
    assert!(bits::digest_f64(&[1], &[f64::NAN]).is_err(), "NaN in f64");
    assert!(bits::digest_f32(&[3], &[0.0, 1.0]).is_err(), "two elements are not three");
}

#[test]
fn distances_count_representable_steps() {
    assert_eq!(bits::ulp_f32(0.0, -0.0), 0);
    assert_eq!(bits::ulp_f32(1e-45, -1e-45), 2);
    assert_eq!(bits::ulp_f32(1.0, 1.000_000_1), 1);
    assert_eq!(bits::ulp_f32(f32::MAX, f32::INFINITY), 1);
    assert_eq!(bits::ulp_f32(f32::NAN, 1.0), u64::MAX);
    assert_eq!(bits::ulp_f64(1.0, 1.0 + 3.0 * f64::EPSILON), 3);
    assert_eq!(bits::ulp_f64(-f64::MAX, f64::MAX), 2 * f64::MAX.to_bits());
}
