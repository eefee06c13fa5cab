//! Sums against their definition, written out slowly.

use crate::chains::{assert_same_bits, values};
use lastlight::num::{par, sum};

/// The definition for one chunk.
fn lanes(x: &[f64], round: fn(f64) -> f64) -> f64 {
    let mut acc = [0.0; 16];
    for (i, v) in x.iter().enumerate() {
        acc[i % 16] = round(acc[i % 16] + v);
    }
    for w in [8, 4, 2, 1] {
        for l in 0..w {
            acc[l] = round(acc[l] + acc[l + w]);
        }
    }
    acc[0]
}

/// The definition of the tree, recursively: the left part is the largest power of two below n.
fn tree(x: &[f64], round: fn(f64) -> f64) -> f64 {
    match x.len() {
        0 => 0.0,
        1 => x[0],
        n => {
            let left = n.next_power_of_two() / 2;
            round(tree(&x[..left], round) + tree(&x[left..], round))
        }
    }
}

fn definition(x: &[f64], round: fn(f64) -> f64) -> f64 {
    let partials: Vec<f64> = x.chunks(4096).map(|c| lanes(c, round)).collect();
    tree(&partials, round)
}

/// Sums of two single-precision numbers in f64, rounded to single precision, are rounded as by one operation.
fn single(x: f64) -> f64 {
    f64::from(x as f32)
}

const LENGTHS: [usize; 19] = [
    0, 1, 2, 15, 16, 17, 31, 33, 255, 4095, 4096, 4097, 8192, 8193, 12_289, 20_481, 65_536, 100_000, 300_001,
];

#[test]
fn sums_equal_their_definition_for_any_number_of_threads() {
    for n in LENGTHS {
        let x = values(n, n as u64);
        let wide: Vec<f64> = x.iter().map(|&v| f64::from(v)).collect();
        let squares: Vec<f64> = x.iter().map(|&v| f64::from(v * v)).collect();
        for threads in [1, 3] {
            let got = par::with_threads(threads, || {
                (
                    sum::sum16(&x),
                    sum::sum16_by(n, |i| x[i]),
                    sum::dot16(&x, &x),
                    sum::sum16_wide(&x),
                    sum::sum16_f64(&wide),
                )
            })
            .expect("the environment of a fresh pool is the default one");
            let f32s = definition(&wide, single) as f32;
            assert_same_bits(&[got.0, got.1], &[f32s, f32s], &format!("{n} elements, {threads} threads"));
            assert_eq!(
                got.2.to_bits(),
                (definition(&squares, single) as f32).to_bits(),
                "squares of {n} elements"
            );
            let f64s = definition(&wide, |x| x);
            assert_eq!(
                (got.3.to_bits(), got.4.to_bits()),
                (f64s.to_bits(), f64s.to_bits()),
                "{n} elements in f64"
            );
        }
    }
}

#[test]
fn the_empty_sum_is_plus_zero_and_so_is_a_sum_of_minus_zeros() {
    for x in [sum::sum16(&[]), sum::tree_f32(&[]), sum::sum16(&[-0.0; 20])] {
        assert_eq!(x.to_bits(), 0);
    }
    assert_eq!(sum::tree_f64(&[]).to_bits(), 0);
    assert_eq!(sum::tree_f32(&[-0.0]).to_bits(), (-0.0_f32).to_bits(), "a tree of one entry is the entry");
}

#[test]
fn trees_pair_neighbours_and_move_an_odd_last_entry_up() {
    let x = [1.0_f32, 1e8, -1e8, 3.0, 0.1, 0.2, 0.3];
    let by_hand = ((x[0] + x[1]) + (x[2] + x[3])) + ((x[4] + x[5]) + x[6]);
    assert_eq!(sum::tree_f32(&x).to_bits(), by_hand.to_bits());
    for n in 0..70 {
        let x = values(n, 17);
        let wide: Vec<f64> = x.iter().map(|&v| f64::from(v)).collect();
        assert_eq!(sum::tree_f32(&x), tree(&wide, single) as f32, "{n} entries");
        assert_eq!(sum::tree_f64(&wide).to_bits(), tree(&wide, |x| x).to_bits(), "{n} entries");
    }
}

#[test]
fn buffers_are_added_as_single_entries_are() {
    for n in [0, 1, 2, 3, 5, 6, 7, 8, 11] {
        let buffers: Vec<Vec<f32>> = (0..n).map(|i| values(20_000, i)).collect();
        let total = sum::tree_arrays(buffers.clone());
        let each = |i: usize| sum::tree_f32(&buffers.iter().map(|b| b[i]).collect::<Vec<_>>());
        let expected: Vec<f32> = (0..total.len()).map(each).collect();
        assert_eq!(total.len(), if n == 0 { 0 } else { 20_000 });
        assert_same_bits(&total, &expected, &format!("{n} buffers"));
    }
}
