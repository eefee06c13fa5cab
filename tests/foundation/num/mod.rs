//! Tests of level 0: where bits are decided.

mod elem;
mod gemm;
mod lanes;
mod order;
mod rng;
mod sum;

/// Numbers in −1..1 with zeros of both signs among them.
fn values(n: usize, seed: u64) -> Vec<f32> {
    let rng = lastlight::num::rng::Rng::new(seed);
    let value = |i: usize| match rng.block(i as u64, 0, 1, 0)[3] % 16 {
        0 => 0.0,
        1 => -0.0,
        _ => 2.0 * rng.uniform_f32(i as u64, 0, 0, 0) - 1.0,
    };
    (0..n).map(value).collect()
}

fn assert_same_bits(got: &[f32], expected: &[f32], what: &str) {
    assert_eq!(got.len(), expected.len(), "{what}: length");
    for (i, (g, e)) in got.iter().zip(expected).enumerate() {
        assert_eq!(g.to_bits(), e.to_bits(), "{what}: element {i} is {g:e}, expected {e:e}");
    }
}
