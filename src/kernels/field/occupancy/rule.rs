//! The rules: from a signed distance, or bounds of it, to cells that are removed or occupied.

use crate::field::density;
use crate::num::elem;
use crate::{Error, Result};

/// α below which the published rule removes a cell, and the optical depth that the conservative rule may
/// remove from a ray.
pub const THRESHOLD: f32 = 1e-4;
/// Cells per axis.
pub const SIDE: usize = 250;

/// Which cells are removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rule {
    /// Those with a small α at their middle.
    #[default]
    Published,
    /// Those in which the density is nowhere large enough to matter.
    Conservative,
}

/// What filling depends on besides the signed distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Cells per axis, even.
    pub side: usize,
    /// Half size R of the box.
    pub half_size: f32,
    /// Which cells are removed.
    pub rule: Rule,
    /// Length h of a step.
    pub step: f32,
    /// Scale of the density.
    pub beta: f32,
}

/// What bounds prove about a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Removed,
    Occupied,
    Open,
}

impl Settings {
    /// Returns the published rule on 250³ cells for a number of steps along the diagonal of the box.
    pub fn new(half_size: f32, samples: usize, beta: f32) -> Self {
        let step = (2.0 * 3.0_f64.sqrt() * f64::from(half_size) / samples as f64) as f32;
        Self { side: SIDE, half_size, rule: Rule::Published, step, beta }
    }

    /// Checks that step and β are positive.
    pub(super) fn validate(&self) -> Result<()> {
        let is_right = |x: f32| x.is_finite() && x > 0.0;
        if !is_right(self.step) || !is_right(self.beta) {
            let e = Error::input("occupancy").expected("a positive step and a positive β");
            return Err(e.got(format!("{}, {}", self.step, self.beta)));
        }
        Ok(())
    }

    /// Returns α of a step with the signed distance s.
    pub fn alpha(&self, s: f32) -> f32 {
        -elem::expm1(-(density::density(s, self.beta)[0] * self.step))
    }

    /// Returns the signed distance above which the conservative rule removes: β·ln(2√3R/(2βτ)).
    pub fn limit(&self) -> f32 {
        let ratio =
            3.0_f64.sqrt() * f64::from(self.half_size) / (f64::from(self.beta) * f64::from(THRESHOLD));
        ((f64::from(self.beta) * elem::f64::ln(ratio)) as f32).next_up()
    }

    /// Returns what the bounds of s in a block prove; `limit` is [`Self::limit`].
    pub(super) fn verdict(&self, [low, high]: [f32; 2], limit: f32) -> Verdict {
        let margin = 1.0 / 65_536.0;
        let [is_removed, is_occupied] = match self.rule {
            Rule::Published => {
                [self.alpha(low) < THRESHOLD * (1.0 - margin), self.alpha(high) >= THRESHOLD * (1.0 + margin)]
            }
            Rule::Conservative => [low > limit, high <= limit],
        };
        match [is_removed, is_occupied] {
            [true, _] => Verdict::Removed,
            [_, true] => Verdict::Occupied,
            _ => Verdict::Open,
        }
    }
}
