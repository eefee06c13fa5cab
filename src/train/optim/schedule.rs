//! Schedules: learning rates and the number of spherical-harmonics bands as functions of the iteration.

use crate::num::order;
use crate::{Error, Result};

/// Log-linear decay with an optional delayed start.
///
/// lr(t) = d(t)·exp((1−u)·ln a + u·ln b),  u = clamp(t/T, 0, 1)
/// (3DGS `get_expon_lr_func`, after Barron et al. 2021)
///
/// d(t) = q + (1−q)·sin(½π·clamp(t/D, 0, 1)) for D > 0, otherwise 1
///
/// | symbol | field |
/// |---|---|
/// | a, b | `start`, `end` |
/// | T | `iterations` |
/// | q | `delay_multiplier` |
/// | D | `delay_iterations` |
///
/// # Rounding
/// f64 with the pinned `libm`; the ends are exact (t = 0 without delay gives a, t ≥ T gives d·b).
///
/// # Example
/// ```
/// # use lastlight_train as lastlight;
/// use lastlight::optim::schedule::LogLinear;
/// let lr = LogLinear::new(1.6e-4, 1.6e-6, 30_000)?;
/// assert_eq!(lr.at(0), 1.6e-4);
/// assert!((lr.at(15_000) - 1.6e-5).abs() < 1e-19);
/// assert_eq!(lr.at(40_000), 1.6e-6);
/// # Ok::<(), lastlight::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogLinear {
    /// Rate at iteration 0, > 0.
    pub start: f64,
    /// Rate at and after the last iteration, > 0.
    pub end: f64,
    /// Iterations from `start` to `end`.
    pub iterations: u32,
    /// Factor at iteration 0 while the start is delayed.
    pub delay_multiplier: f64,
    /// Iterations of the delayed start; 0 (the default) disables it, regardless of the multiplier.
    pub delay_iterations: u32,
}

impl LogLinear {
    /// A schedule without delay.
    ///
    /// # Errors
    /// Rates that are not positive and finite.
    pub fn new(start: f64, end: f64, iterations: u32) -> Result<Self> {
        for rate in [start, end] {
            if !(rate > 0.0 && rate.is_finite()) {
                return Err(Error::input("learning-rate schedule")
                    .expected("positive rates")
                    .got(rate.to_string()));
            }
        }
        Ok(Self { start, end, iterations, delay_multiplier: 0.01, delay_iterations: 0 })
    }

    /// The rate of an iteration.
    pub fn at(&self, iteration: u32) -> f64 {
        let share =
            |of: u32| if of == 0 { 1.0 } else { order::min(f64::from(iteration) / f64::from(of), 1.0) };
        let u = share(self.iterations);
        let rate = if u <= 0.0 {
            self.start
        } else if u >= 1.0 {
            self.end
        } else {
            libm::exp((1.0 - u) * libm::log(self.start) + u * libm::log(self.end))
        };
        if self.delay_iterations == 0 {
            return rate;
        }
        let q = self.delay_multiplier;
        (q + (1.0 - q) * libm::sin(std::f64::consts::FRAC_PI_2 * share(self.delay_iterations))) * rate
    }
}

/// Spherical-harmonics bands in use: one more every `every` iterations, up to `max`. Iterations count from 1.
///
/// ```
/// # use lastlight_train as lastlight;
/// use lastlight::optim::schedule::sh_degree;
/// assert_eq!([1, 999, 1000, 2000, 30_000].map(|i| sh_degree(i, 1000, 3)), [0, 0, 1, 2, 3]);
/// ```
pub fn sh_degree(iteration: u32, every: u32, max: usize) -> usize {
    iteration.checked_div(every).map_or(max, |bands| (bands as usize).min(max))
}

/// An iteration constant of the 30 000-iteration schedule, scaled to another length: n·length/30 000, rounded
/// to nearest, at least 1 (0 stays 0).
///
/// ```
/// # use lastlight_train as lastlight;
/// use lastlight::optim::schedule::scaled;
/// assert_eq!([100, 500, 3000, 15_000].map(|n| scaled(n, 7000)), [23, 117, 700, 3500]);
/// assert_eq!(scaled(100, 30_000), 100);
/// ```
pub fn scaled(constant: u32, iterations: u32) -> u32 {
    let n = (u64::from(constant) * u64::from(iterations) + 15_000) / 30_000;
    u32::try_from(n).unwrap_or(u32::MAX).max(u32::from(constant > 0))
}
