//! Initial values of network parameters.
//!
//! Each entry is a counter-based draw keyed by (seed, index of the entry, number of the array, purpose), so
//! no value depends on the order in which arrays are initialised. The first axis of weights counts outputs;
//! the inputs of an output are the product of the other axes.
//!
//! | function | distribution | source |
//! |---|---|---|
//! | [`uniform`](Initial::uniform), [`uniform_f64`](Initial::uniform_f64) | U(±b) | |
//! | [`normal`](Initial::normal) | N(0, σ²) | |
//! | [`he_uniform`](Initial::he_uniform) | U(±√(6/((1 + slope²)·inputs))), for a leaky ReLU of that slope | He et al. 2015 |
//! | [`xavier_uniform`](Initial::xavier_uniform) | U(±gain·√(6/(inputs + outputs))) | Glorot and Bengio 2010 |

use crate::num::array::entries;
use crate::num::bits::Digest;
use crate::num::rng::Rng;
use ndarray::{ArrayD, IxDyn};

/// The draws of one array.
#[derive(Clone, Copy, Debug)]
pub struct Initial {
    rng: Rng,
    array: u32,
    purpose: u16,
}

impl Initial {
    /// The draws of the array of that number.
    pub fn numbered(seed: u64, purpose: u16, array: u32) -> Self {
        Self { rng: Rng::new(seed), array, purpose }
    }

    /// The draws of the array of that name; its number is the lower half of the digest of the name.
    pub fn named(seed: u64, purpose: u16, name: &str) -> Self {
        let mut digest = Digest::new();
        digest.bytes(name.as_bytes());
        Self::numbered(seed, purpose, digest.value() as u32)
    }

    fn draw(&self, shape: &[usize], value: impl Fn(u64) -> f32) -> ArrayD<f32> {
        let size = entries(shape);
        let values = (0..size).map(|i| value(i as u64)).collect();
        ArrayD::from_shape_vec(IxDyn(shape), values).expect("as many values as the shape has")
    }

    /// Uniform in ±`bound`, computed in single precision.
    pub fn uniform(&self, shape: &[usize], bound: f32) -> ArrayD<f32> {
        self.draw(shape, |i| (2.0 * self.rng.uniform_f32(i, self.array, self.purpose, 0) - 1.0) * bound)
    }

    /// Uniform in ±`bound`, computed in double precision and rounded once.
    pub fn uniform_f64(&self, shape: &[usize], bound: f64) -> ArrayD<f32> {
        let draw = |i| bound * (2.0 * self.rng.uniform_f64(i, self.array, self.purpose, 0) - 1.0);
        self.draw(shape, |i| draw(i) as f32)
    }

    /// Normal of mean 0, computed in double precision and rounded once.
    pub fn normal(&self, shape: &[usize], deviation: f64) -> ArrayD<f32> {
        self.draw(shape, |i| (deviation * self.rng.normal_f64(i, self.array, self.purpose, 0)) as f32)
    }

    /// He-uniform weights for a leaky ReLU of this slope.
    ///
    /// # Panics
    /// When the array has no inputs.
    pub fn he_uniform(&self, shape: &[usize], slope: f32) -> ArrayD<f32> {
        self.uniform(shape, (6.0 / ((1.0 + slope * slope) * inputs(shape) as f32)).sqrt())
    }

    /// Xavier-uniform weights.
    ///
    /// # Panics
    /// When the array has no inputs.
    pub fn xavier_uniform(&self, shape: &[usize], gain: f32) -> ArrayD<f32> {
        self.uniform(shape, gain * (6.0 / (inputs(shape) + shape[0]) as f32).sqrt())
    }
}

/// Inputs of an output: the product of all axes but the first.
///
/// # Panics
/// When there are none.
pub fn inputs(shape: &[usize]) -> usize {
    let inputs = shape.get(1..).map_or(0, entries);
    assert!(shape.len() > 1 && inputs > 0, "weights have an axis of outputs and at least one of inputs");
    inputs
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A purpose used by no other draw.
    const PURPOSE: u16 = 0x0805;

    #[test]
    fn values_have_their_spread_and_belong_to_their_name() {
        let draws = Initial::named(3, PURPOSE, "a.weight");
        let mean_square =
            |a: &ArrayD<f32>| a.iter().fold(0.0, |s, x| s + f64::from(*x) * f64::from(*x)) / a.len() as f64;
        let near = |a: &ArrayD<f32>, variance: f64| {
            let ratio = mean_square(a) / variance;
            assert!((0.95..1.05).contains(&ratio), "{ratio} times the variance");
        };
        let shape = [64, 4, 4, 8];
        near(&draws.normal(&shape, 0.02), 0.02 * 0.02);
        near(&draws.uniform(&shape, 0.5), 0.25 / 3.0);
        near(&draws.uniform_f64(&shape, 0.5), 0.25 / 3.0);
        near(&draws.he_uniform(&shape, 0.2), 2.0 / (1.04 * 128.0));
        near(&draws.xavier_uniform(&shape, 0.25), 0.0625 * 2.0 / 192.0);
        let again = Initial::named(3, PURPOSE, "a.weight").normal(&shape, 0.02);
        assert_eq!(again, draws.normal(&shape, 0.02), "a function of seed and name");
        for other in [Initial::named(3, PURPOSE, "b.weight"), Initial::named(4, PURPOSE, "a.weight")] {
            assert_ne!(other.normal(&shape, 0.02), again, "another name or seed");
        }
    }

    #[test]
    fn weights_without_inputs_are_refused_with_the_reason() {
        assert_eq!(inputs(&[3, 2, 5]), 10, "all axes but the first");
        for shape in [&[][..], &[3], &[3, 0]] {
            let panic = std::panic::catch_unwind(|| inputs(shape)).expect_err("no inputs");
            let text = panic.downcast_ref::<&str>().copied().unwrap_or_default();
            assert!(text.contains("an axis of outputs"), "{shape:?}: {text}");
        }
    }
}
