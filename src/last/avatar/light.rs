//! Brightness and light direction of each moment, because one colour per Gaussian cannot represent a light
//! that changes over time.
//!
//! A moment has a gain γ per channel ([`mod@crate::shade::gain`]) and, with colours of degree 0, a direction
//! d of the light ([`mod@crate::shade::diffuse`]), where the normal is that of the nearest point of the
//! template. The direction, learned from the visible side, determines the brightness of the side that the
//! camera never sees.
//!
//! | symbol | shape | meaning |
//! |---|---|---|
//! | γ | (T, 3) | logarithms of the gains, initialised to 0; a moment without training images uses the mean |
//! | d | (T, 3) | direction towards the light, world axes, initialised to 0; the mean likewise |

use crate::num::array::Arrays;
use crate::optim::adam::Rule;
use crate::optim::optimiser::{ArrayNames, Optimiser};
use crate::tape::Params;
use crate::{Error, Result};
use ndarray::{ArrayD, IxDyn};
use std::collections::BTreeMap;

/// Name of the array γ (T, 3).
pub(super) const GAINS: &str = "light/gains";
/// Name of the array d (T, 3).
const TOWARD: &str = "light/toward";
/// Name of the array that marks the moments with training images.
const SEEN: &str = "light/seen";

/// Gains and light directions of all moments, and their optimiser.
#[derive(Clone, Debug)]
pub struct Light {
    /// Whether the fit has images of the moment, shape (T).
    pub seen: Vec<bool>,
    params: Params,
    optimiser: Optimiser,
}

/// γ and d of a moment, or their gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// The logarithm γ of the gain.
    pub gain: [f32; 3],
    /// The direction d of the light.
    pub toward: [f32; 3],
}

impl Light {
    /// Gains of 1 for T moments, all of which have training images.
    ///
    /// # Errors
    /// See [`Optimiser::new`].
    pub fn new(moments: usize) -> Result<Self> {
        let mut params = Params::new();
        for name in [GAINS, TOWARD] {
            params.set(name, ArrayD::zeros(IxDyn(&[moments, 3])));
        }
        Ok(Self { seen: vec![true; moments], optimiser: Optimiser::new(Rule::SPLAT, &params)?, params })
    }

    fn rows(&self, name: &str) -> &[[f32; 3]] {
        let values = self.params.get(name).expect("a parameter of the light");
        values.as_slice().expect("parameters are contiguous").as_chunks().0
    }

    /// The values γ, shape (T).
    pub fn gains(&self) -> &[[f32; 3]] {
        self.rows(GAINS)
    }

    /// The values d, shape (T).
    pub fn toward(&self) -> &[[f32; 3]] {
        self.rows(TOWARD)
    }

    /// Replaces d of all moments.
    ///
    /// # Panics
    /// If the number of directions differs from the number of moments.
    pub(super) fn set_toward(&mut self, toward: Vec<[f32; 3]>) {
        self.set(TOWARD, toward);
    }

    fn set(&mut self, name: &str, rows: Vec<[f32; 3]>) {
        let shape = [self.seen.len(), 3];
        let values = ArrayD::from_shape_vec(IxDyn(&shape), rows.into_flattened());
        self.params.set(name, values.expect("one row for every moment"));
    }

    /// Stores γ, d and the marks of moments with training images, and with `state` the optimiser.
    pub(super) fn save(&self, state: bool, out: &mut Arrays) {
        out.put(SEEN, &[self.seen.len()], self.seen.iter().map(|&s| i64::from(s)).collect());
        ArrayNames::Beside.save(&self.params, out);
        if state {
            self.optimiser.save(ArrayNames::Beside, out);
        }
    }

    /// Restores what [`Self::save`] stored, for the same number of moments.
    ///
    /// # Errors
    /// Missing arrays, other shapes, values out of range.
    pub(super) fn load(&mut self, state: bool, from: &Arrays) -> Result<()> {
        let wrong = || Error::input(format!("array '{SEEN}'")).expected("0 or 1 for every moment");
        let moments = self.seen.len().to_string();
        let seen = from.shape(SEEN, &moments, &mut BTreeMap::new())?.to_i64().ok_or_else(wrong)?;
        if seen.iter().any(|s| !(0..=1).contains(s)) {
            return Err(wrong());
        }
        self.seen = seen.into_iter().map(|s| s == 1).collect();
        ArrayNames::Beside.load(&mut self.params, from)?;
        if state { self.optimiser.load(ArrayNames::Beside, from) } else { Ok(()) }
    }

    /// γ and d of a moment; the means over the moments with training images for any other moment.
    pub fn at(&self, moment: Option<usize>) -> Moment {
        let own = moment.filter(|t| self.seen.get(*t) == Some(&true));
        let of = |all: &[[f32; 3]]| match own {
            Some(t) => all[t],
            None => std::array::from_fn(|c| {
                let seen = all.iter().zip(&self.seen).filter(|(_, seen)| **seen);
                let (sum, count) = seen.fold((0.0, 0usize), |(s, n), (g, _)| (s + f64::from(g[c]), n + 1));
                (sum / Ord::max(1, count) as f64) as f32
            }),
        };
        Moment { gain: of(self.gains()), toward: of(self.toward()) }
    }

    /// Performs one step of the optimiser for a moment.
    ///
    /// # Errors
    /// If a result is not finite.
    pub(super) fn step(&mut self, moment: usize, bar: Moment, rate: f64) -> Result<()> {
        let mut active = vec![0; self.seen.len()];
        active[moment] = 1;
        for (name, bar) in [(GAINS, bar.gain), (TOWARD, bar.toward)] {
            let mut grad = ArrayD::zeros(IxDyn(&[active.len(), 3]));
            bar.into_iter().enumerate().for_each(|(c, bar)| grad[[moment, c]] = bar);
            self.optimiser.step_rows(&mut self.params, name, &grad, rate, &active)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_without_pictures_takes_the_mean_of_those_with() {
        let mut light = Light::new(4).expect("a light");
        light.set(GAINS, vec![[1.0, 0.0, 2.0], [9.0; 3], [3.0, 1.0, -2.0], [9.0; 3]]);
        light.set(TOWARD, vec![[0.5; 3], [9.0; 3], [0.25; 3], [9.0; 3]]);
        light.seen = vec![true, false, true, false];
        assert_eq!(light.at(Some(2)), Moment { gain: [3.0, 1.0, -2.0], toward: [0.25; 3] });
        for moment in [Some(1), Some(3), Some(4), None] {
            assert_eq!(light.at(moment), Moment { gain: [2.0, 0.5, 0.0], toward: [0.375; 3] }, "{moment:?}");
        }
    }
}
