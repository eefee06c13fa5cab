//! Drawn numbers, comparison bit for bit, and the definition of a matrix product.

use lastlight::num::rng::Rng;
use lastlight::num::sum;

/// Numbers in −1..1 with zeros of both signs among them.
pub(crate) fn values(n: usize, seed: u64) -> Vec<f32> {
    let rng = Rng::new(seed);
    let value = |i: usize| match rng.block(i as u64, 0, 1, 0)[3] % 16 {
        0 => 0.0,
        1 => -0.0,
        _ => 2.0 * rng.uniform_f32(i as u64, 0, 0, 0) - 1.0,
    };
    (0..n).map(value).collect()
}

/// Fails at the first element with other bits.
pub(crate) fn assert_same_bits(got: &[f32], expected: &[f32], what: &str) {
    assert_eq!(got.len(), expected.len(), "{what}: length");
    for (i, (g, e)) in got.iter().zip(expected).enumerate() {
        assert_eq!(g.to_bits(), e.to_bits(), "{what}: element {i} is {g:e}, expected {e:e}");
    }
}

/// The definition: one chain per chunk of 4096, the tree over the chunks.
pub(crate) fn three_loops(
    m: usize,
    n: usize,
    k: usize,
    a: impl Fn(usize, usize) -> f32,
    b: impl Fn(usize, usize) -> f32,
) -> Vec<f32> {
    let mut c = Vec::with_capacity(m * n);
    for i in 0..m {
        for j in 0..n {
            let chain =
                |start: usize| (start..k.min(start + 4096)).fold(0.0_f32, |acc, k| acc + a(i, k) * b(k, j));
            let partials: Vec<f32> = (0..k).step_by(4096).map(chain).collect();
            c.push(sum::tree_f32(&partials));
        }
    }
    c
}
