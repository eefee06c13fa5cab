//! Noise of a camera's sensor: photon noise, read noise and quantisation.

use crate::num::order;
use crate::num::rng::Rng;

/// Purpose of the draws; the item is the pixel, the step is the image, and the draw is 2·channel + {0
/// photons, 1 electronics}.
pub const PURPOSE: u16 = 0x0700;

/// A model of a camera sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// Number of electrons at signal 1 (full well).
    pub full_well: f32,
    /// Standard deviation of the read noise, electrons.
    pub read_noise: f32,
    /// Bit depth: there are 2^bits − 1 steps from 0 to 1.
    pub bits: u32,
}

impl Default for Sensor {
    /// A small camera indoors: 3 000 electrons, 5 electrons of read noise, 10 bits.
    fn default() -> Self {
        Self { full_well: 3000.0, read_noise: 5.0, bits: 10 }
    }
}

impl Sensor {
    /// Replaces an image of linear signals (1 = saturated) by the sensor's output.
    ///
    /// ```text
    /// e = x·F + √(x·F)·n₁ + σ·n₂        y = round(clamp(e/F, 0, 1)·L)/L,  L = 2^bits − 1
    /// ```
    ///
    /// x is the signal, limited to 0..1 beforehand; F is `full_well`; σ is `read_noise`; n₁, n₂ are standard
    /// normals of the pixel and channel.
    /// The photons' Poisson distribution is approximated by the normal distribution with the same mean and
    /// variance.
    ///
    /// # Rounding
    /// All values are f32, in the order written; the normals are rounded from f64. A pixel's result depends
    /// only on its own signal, its index, the seed and the index of the image.
    ///
    /// # Panics
    /// Panics if `bits` is not in 1..=16.
    pub fn apply(&self, signal: &mut [[f32; 3]], seed: u64, picture: u32) {
        assert!((1..=16).contains(&self.bits), "bits is in 1..=16");
        let rng = Rng::new(seed);
        let levels = ((1_u32 << self.bits) - 1) as f32;
        for (i, pixel) in signal.iter_mut().enumerate() {
            for (c, x) in pixel.iter_mut().enumerate() {
                let normal = |k: u16| rng.normal_f32(i as u64, picture, PURPOSE, 2 * c as u16 + k);
                let electrons = order::clamp(*x, 0.0, 1.0) * self.full_well;
                let noisy = electrons + electrons.sqrt() * normal(0) + self.read_noise * normal(1);
                *x = (order::clamp(noisy / self.full_well, 0.0, 1.0) * levels).round() / levels;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_the_variance_of_photons_and_electronics() {
        let sensor = Sensor { bits: 16, ..Sensor::default() };
        for x in [0.05_f32, 0.3, 0.7] {
            let mut picture = vec![[x; 3]; 40_000];
            sensor.apply(&mut picture, 3, 1);
            let n = 3.0 * picture.len() as f64;
            let mean = picture.as_flattened().iter().fold(0.0, |s, &y| s + f64::from(y)) / n;
            let square = |s: f64, &y: &f32| s + (f64::from(y) - mean) * (f64::from(y) - mean);
            let variance = picture.as_flattened().iter().fold(0.0, square) / n;
            let f = f64::from(sensor.full_well);
            let want = (f64::from(x) * f + 25.0) / (f * f);
            // Four standard errors: σ/√n of the mean, √(2/n) of the variance.
            assert!((mean - f64::from(x)).abs() < 4.0 * (want / n).sqrt(), "mean {mean} of {x}");
            assert!(
                (variance / want - 1.0).abs() < 4.0 * (2.0 / n).sqrt(),
                "variance {variance}, not {want}"
            );
        }
    }

    #[test]
    fn a_pixel_depends_on_itself_alone_and_black_stays_near_black() {
        let sensor = Sensor::default();
        let (mut long, mut short) = (vec![[0.4; 3]; 10], vec![[0.4; 3]; 4]);
        sensor.apply(&mut long, 9, 2);
        sensor.apply(&mut short, 9, 2);
        assert_eq!(long[..4], short[..], "no neighbour matters");
        let mut other = vec![[0.4; 3]; 4];
        sensor.apply(&mut other, 9, 3);
        assert_ne!(other, short, "another image has other noise");
        let mut ends = vec![[0.0, 1.0, 7.0]];
        sensor.apply(&mut ends, 9, 2);
        assert!(ends[0].iter().all(|y| (0.0..=1.0).contains(y)), "within its levels: {ends:?}");
        assert!(ends[0][0] < 0.01, "black is nearly black");
    }
}
