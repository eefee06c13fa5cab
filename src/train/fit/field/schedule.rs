//! Resolution, samples, 1/β and learning rates as functions of the iteration.
//!
//! | stage | iterations | side | samples |
//! |---|---|---|---|
//! | 1 | first quarter | ¼ | ⅓ |
//! | 2 | second quarter | ½ | ⅔ |
//! | 3 | second half | 1 | 1 |
//!
//! 1/β grows linearly over the first three quarters. Rates rise linearly over the first twentieth of a stage,
//! and follow one cosine over the whole fit, down to a fiftieth.

use super::settings::Settings;
use crate::num::elem::f64 as elem;
use crate::num::order;

/// One of the stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stage {
    /// 0, 1 or 2.
    pub(super) index: usize,
    /// Texels per side.
    pub(super) side: usize,
    /// Steps along the diagonal.
    pub(super) samples: usize,
    /// First iteration.
    pub(super) first: usize,
    /// Iteration after the last one.
    pub(super) end: usize,
}

/// Smallest side of planes.
const LEAST_SIDE: usize = 8;
/// Part of a stage over which rates rise.
const RISE: f64 = 0.05;
/// Last learning rate as a part of the largest.
const LAST: f64 = 0.02;

impl Settings {
    /// Returns the stages.
    pub(super) fn stages(&self) -> [Stage; 3] {
        [0, self.iterations / 4, self.iterations / 2].map(|first| self.stage(first))
    }

    /// Returns the stage of an iteration.
    pub(super) fn stage(&self, iteration: usize) -> Stage {
        let ends = [self.iterations / 4, self.iterations / 2, self.iterations];
        let index = ends.iter().position(|end| iteration < *end).unwrap_or(2);
        let first = if index == 0 { 0 } else { ends[index - 1] };
        let side = [self.side / 4, self.side / 2, self.side][index];
        let samples = [self.samples / 3, 2 * self.samples / 3, self.samples][index];
        Stage {
            index,
            side: Ord::max(side, Ord::min(LEAST_SIDE, self.side)),
            samples,
            first,
            end: ends[index],
        }
    }

    /// Returns the scheduled 1/β of an iteration.
    pub(super) fn inverse_beta_at(&self, iteration: usize) -> f32 {
        let part = order::min(iteration as f64 / (0.75 * self.iterations as f64), 1.0);
        let [first, last] = self.inverse_beta.map(f64::from);
        (first + part * (last - first)) as f32
    }

    /// Returns the learning rates of an iteration: planes and panoramas, networks.
    pub(super) fn rates_at(&self, iteration: usize) -> [f64; 2] {
        let stage = self.stage(iteration);
        let rise = RISE * (stage.end - stage.first) as f64;
        let up = order::min((iteration - stage.first + 1) as f64 / order::max(rise, 1.0), 1.0);
        let turn = std::f64::consts::PI * iteration as f64 / self.iterations as f64;
        let down = LAST + (1.0 - LAST) * 0.5 * (1.0 + elem::cos(turn));
        self.rates.map(|rate| rate * up * down)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_follow_each_other_and_grow() {
        let s = Settings { iterations: 100, ..Settings::default() };
        let all: Vec<_> = [0, 24, 25, 49, 50, 99].map(|i| s.stage(i)).into();
        assert_eq!(all.iter().map(|s| s.index).collect::<Vec<_>>(), [0, 0, 1, 1, 2, 2]);
        assert_eq!(all.iter().map(|s| s.side).collect::<Vec<_>>(), [32, 32, 64, 64, 128, 128]);
        assert_eq!((all[0].samples, all[5].samples), (64, 192), "samples of a ray");
        assert_eq!(
            (s.inverse_beta_at(0), s.inverse_beta_at(75), s.inverse_beta_at(99)),
            (10.0, 200.0, 200.0)
        );
        assert!(
            s.rates_at(0)[0] < s.rates_at(4)[0] && s.rates_at(99)[0] < 0.03 * s.rates[0],
            "warm-up and decay"
        );
        let short = Settings { iterations: 1, side: 8, ..s };
        assert_eq!((short.stage(0).index, short.stage(0).side), (2, 8), "one iteration is of the last stage");
    }
}
