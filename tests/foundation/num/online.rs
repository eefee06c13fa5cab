//! Rows of a softmax by blocks, against the definition in scalars.

use lastlight::num::elem::exp_lanes;
use lastlight::num::online::{Rows, weights};
use lastlight::num::rng::Rng;
use lastlight::num::{order, sum};

fn normals(n: usize, purpose: u16) -> Vec<f32> {
    (0..n).map(|i| 3.0 * Rng::new(5).normal_f32(i as u64, 0, purpose, 0)).collect()
}

/// Widths around multiples of the lanes, and numbers of rows around them.
const SIZES: [(usize, usize); 7] = [(1, 1), (7, 15), (16, 16), (17, 33), (19, 64), (5, 100), (3, 4096)];

#[test]
fn blocks_have_the_bits_of_the_definition() {
    for (n, width) in SIZES {
        let mut rows = Rows::new(n);
        let mut expected = vec![[f32::NEG_INFINITY, 0.0]; n];
        for block in 0..3 {
            let x = normals(n * width, block);
            let mut p = x.clone();
            rows.block(&mut p, width, 0.7);
            for (i, row) in x.chunks_exact(width).enumerate() {
                let logits: Vec<f32> = row.iter().map(|x| x * 0.7).collect();
                let [before, total] = expected[i];
                let most = logits.iter().fold(before, |most, x| order::max(most, *x));
                let made: Vec<f32> = logits.iter().map(|x| exp_lanes(x - most)).collect();
                let c = exp_lanes(before - most);
                expected[i] = [most, total * c + sum::sum16(&made)];
                assert_eq!(p[i * width..][..width], made, "block {block} of ({n}, {width}), row {i}");
                assert_eq!([rows.most[i], rows.total[i], rows.factor[i]], [most, expected[i][1], c]);
            }
        }
    }
}

#[test]
fn weights_have_the_bits_of_the_definition() {
    for (n, width) in SIZES {
        let (x, bars) = (normals(n * width, 7), normals(n * width, 8));
        let rows: Vec<[f32; 3]> = (0..n).map(|i| [9.0, 2.0 + i as f32, 0.3 * i as f32]).collect();
        let (mut p, mut x_bar) = (x.clone(), bars.clone());
        weights(&mut p, &mut x_bar, width, 0.7, &rows);
        for (i, (x, bar)) in x.iter().zip(&bars).enumerate() {
            let [most, total, mean] = rows[i / width];
            let weight = exp_lanes(x * 0.7 - most) / total;
            assert_eq!(p[i], weight);
            assert_eq!(x_bar[i], (weight * (bar - mean)) * 0.7);
        }
    }
}
