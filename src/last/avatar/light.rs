//! How bright each moment is, and from where: one colour per Gaussian cannot follow a light that moves.
//!
//! A moment has a gain γ per channel ([`mod@crate::shade::gain`]) and, with colours of degree 0, a direction d of the light
//! ([`mod@crate::shade::diffuse`]), in which the normal is that of the nearest point of the template. What the front shows of it says how bright the
//! side is that the camera never sees.
//!
//! | symbol | shape | meaning |
//! |---|---|---|
//! | γ | (T, 3) | logarithms of the gains, from 0; a moment the fit has not seen takes their mean |
//! | d | (T, 3) | where the light comes from, world axes, from 0, likewise |

use crate::num::array::Arrays;
use crate::optim::adam::Rule;
use crate::optim::optimiser::{ArrayNames, Optimiser};
use crate::tape::Params;
use crate::{Error, Result};
use ndarray::{ArrayD, IxDyn};
use std::collections::BTreeMap;

/// Name of γ (T, 3).
pub(super) const GAINS: &str = "light/gains";
/// Name of d (T, 3).
const TOWARD: &str = "light/toward";
/// Name of what says which moments the fit has pictures of.
const SEEN: &str = "light/seen";

/// Gains of every moment, and their optimiser.
#[derive(Clone, Debug)]
pub struct Light {
    /// (T) whether a fit has pictures of it
    pub seen: Vec<bool>,
    params: Params,
    optimiser: Optimiser,
}

/// γ and d of a moment, or their gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// γ
    pub gain: [f32; 3],
    /// d
    pub toward: [f32; 3],
}

impl Light {
    /// No gain for T moments, all of them seen.
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

    /// (T) γ
    pub fn gains(&self) -> &[[f32; 3]] {
        self.rows(GAINS)
    }

    /// (T) d
    pub fn toward(&self) -> &[[f32; 3]] {
        self.rows(TOWARD)
    }

    /// Replaces d of all moments.
    ///
    /// # Panics
    /// When there are not as many.
    pub(super) fn set_toward(&mut self, toward: Vec<[f32; 3]>) {
        self.set(TOWARD, toward);
    }

    fn set(&mut self, name: &str, rows: Vec<[f32; 3]>) {
        let shape = [self.seen.len(), 3];
        let values = ArrayD::from_shape_vec(IxDyn(&shape), rows.into_flattened());
        self.params.set(name, values.expect("one row for every moment"));
    }

    /// Puts γ, d and which moments were seen, and with `state` the optimiser.
    pub(super) fn save(&self, state: bool, out: &mut Arrays) {
        out.put(SEEN, &[self.seen.len()], self.seen.iter().map(|&s| i64::from(s)).collect());
        ArrayNames::Beside.save(&self.params, out);
        if state {
            self.optimiser.save(ArrayNames::Beside, out);
        }
    }

    /// Takes back what [`Self::save`] put, for as many moments as there are.
    ///
    /// # Errors
    /// Missing arrays, other shapes, numbers out of range.
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

    /// γ and d of a moment; the means of those the fit has seen where it is none of them.
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

    /// One step of the optimiser for a moment.
    ///
    /// # Errors
    /// A result that is not finite.
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
