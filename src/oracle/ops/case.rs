//! Random numbers of generated cases: counter-based f32 draws, so that a case is the same on every machine.

use crate::num::rng::Rng;

/// The random numbers of one array of one case.
pub(super) struct Draw {
    rng: Rng,
    step: u32,
}

/// Purpose word of the draws made here (see `num::rng`).
const PURPOSE: u16 = 0x6f70; // "op"

impl Draw {
    /// The draws of array `array` of case `case`. Operators with the same seed draw the same numbers.
    pub(super) fn new(seed: u64, case: usize, array: u16) -> Self {
        Self { rng: Rng::new(seed), step: (case as u32) << 16 | u32::from(array) }
    }

    /// `n` normal numbers.
    pub(super) fn normals(&self, n: usize) -> Vec<f32> {
        (0..n).map(|i| self.rng.normal_f32(i as u64, self.step, PURPOSE, 0)).collect()
    }

    /// `n` numbers uniform in `lo..hi`.
    pub(super) fn uniforms(&self, n: usize, lo: f32, hi: f32) -> Vec<f32> {
        (0..n).map(|i| lo + (hi - lo) * self.rng.uniform_f32(i as u64, self.step, PURPOSE, 1)).collect()
    }

    /// `n` zeros and ones; 1 with probability `p`.
    pub(super) fn flags(&self, n: usize, p: f32) -> Vec<f32> {
        self.uniforms(n, 0.0, 1.0).into_iter().map(|u| f32::from(u8::from(u < p))).collect()
    }
}
