//! Sums over channels, eight lanes at a time, with the association of [`sum::sum16_by`].

use crate::num::lanes::f32x8;
use crate::num::sum::{self, CHUNK, LANES};

/// Returns K sums over the channels 0..n: `eight` returns the terms of eight channels from the given one on, `one`
/// those of one channel.
#[inline(always)]
pub(super) fn sums<const K: usize>(
    n: usize,
    eight: impl Fn(usize) -> [f32x8; K],
    one: impl Fn(usize) -> [f32; K] + Sync + Send,
) -> [f32; K] {
    if n > CHUNK {
        return std::array::from_fn(|k| sum::sum16_by(n, |c| one(c)[k]));
    }
    let mut halves = [[f32x8::ZERO; K]; 2];
    let whole = n - n % LANES;
    for first in (0..whole).step_by(LANES) {
        for (h, acc) in halves.iter_mut().enumerate() {
            let terms = eight(first + 8 * h);
            for k in 0..K {
                acc[k] = acc[k] + terms[k];
            }
        }
    }
    let mut rest = whole;
    let mut sums = [[[0.0; 8]; 2]; K];
    if rest + 8 <= n {
        let terms = eight(rest);
        for k in 0..K {
            halves[0][k] = halves[0][k] + terms[k];
        }
        rest += 8;
    }
    for k in 0..K {
        sums[k] = [halves[0][k].to_array(), halves[1][k].to_array()];
    }
    for c in rest..n {
        let terms = one(c);
        for k in 0..K {
            sums[k][(c - whole) / 8][c % 8] += terms[k];
        }
    }
    sums.map(|[low, high]| {
        let eight: [f32; 8] = std::array::from_fn(|l| low[l] + high[l]);
        let four: [f32; 4] = std::array::from_fn(|l| eight[l] + eight[l + 4]);
        (four[0] + four[2]) + (four[1] + four[3])
    })
}

/// Loads eight numbers from `at` on.
#[inline(always)]
pub(super) fn load(x: &[f32], at: usize) -> f32x8 {
    f32x8::new(*x[at..].first_chunk().expect("eight numbers"))
}

#[cfg(test)]
mod tests {
    use super::{load, sums};
    use crate::num::sum;

    #[test]
    fn every_length_has_the_bits_of_the_scalar_sum() {
        let x: Vec<f32> = (0..5000_u32)
            .map(|i| ((i * 7919) % 1009) as f32 * 0.37 - if i % 3 == 0 { 1e3 } else { 1.0 })
            .collect();
        for n in (0..100).chain([4088, 4096, 4097, 5000]) {
            let two = |c: usize| [x[c], x[c] * 0.3];
            let found = sums(n, |c| [load(&x, c), load(&x, c) * f32x8_of(0.3)], two);
            let wanted = [0, 1].map(|k| sum::sum16_by(n, |c| two(c)[k]));
            assert_eq!(found.map(f32::to_bits), wanted.map(f32::to_bits), "{n} terms");
        }
        let zero = sums(3, |_| [f32x8_of(-0.0)], |_| [-0.0]);
        assert_eq!(zero[0].to_bits(), sum::sum16_by(3, |_| -0.0).to_bits(), "the sum begins at +0");
    }

    fn f32x8_of(x: f32) -> crate::num::lanes::f32x8 {
        crate::num::lanes::f32x8::splat(x)
    }
}
