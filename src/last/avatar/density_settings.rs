//! Constants of density control.

use crate::{Error, Result};
use serde_json::{Value, json};

/// The criterion that selects candidates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The pixel criterion (eq. 8).
    Pixel,
    /// The latent criterion (eq. 9).
    Replace,
    /// Either criterion.
    Or,
    /// As many candidates as the pixel criterion selects, ranked by the latent criterion.
    Budget,
}

impl Mode {
    const ALL: [(Self, &'static str); 4] =
        [(Self::Pixel, "pixel"), (Self::Replace, "replace"), (Self::Or, "or"), (Self::Budget, "budget")];

    /// The name used in settings.
    pub fn name(self) -> &'static str {
        Self::ALL.into_iter().find(|(m, _)| *m == self).map_or("", |(_, n)| n)
    }

    /// The mode with the given name.
    ///
    /// # Errors
    /// If there is no such mode.
    pub fn parse(name: &str) -> Result<Self> {
        (Self::ALL.into_iter().find(|(_, n)| *n == name).map(|(m, _)| m))
            .ok_or_else(|| Error::input("--density").expected("pixel, replace, or, budget").got(name))
    }

    /// Whether the mode needs a guide.
    pub fn is_latent(self) -> bool {
        self != Self::Pixel
    }
}

/// Constants of density control; iterations refer to the published schedule of 1 200.
#[derive(Clone, Debug, PartialEq)]
pub struct Density {
    /// The criterion that selects candidates.
    pub mode: Mode,
    /// Threshold of the mean screen-space gradient, NDC units.
    pub pixel_threshold: f32,
    /// Threshold τ_rec of the latent criterion.
    pub latent_threshold: f64,
    /// The factor c_τ of the latent mean; see [`calibrate`](super::calibrate).
    pub latent_scale: f64,
    /// L_lat is computed at multiples of this number of iterations.
    pub latent_every: usize,
    /// Refinement happens in iterations after this one.
    pub start: usize,
    /// Refinement happens in iterations before this one.
    pub stop: usize,
    /// Refinement happens at multiples of this number of iterations.
    pub every: usize,
    /// Largest standard deviation of a Gaussian that is cloned instead of split, scene units.
    pub split_scale: f64,
    /// Gaussians with a lower opacity are pruned.
    pub prune_opacity: f32,
    /// Distance from the template beyond which a Gaussian is removed, metres.
    pub prune_distance_m: f64,
}

impl Density {
    /// The settings of the pixel criterion.
    pub fn pixel() -> Self {
        Self {
            mode: Mode::Pixel,
            pixel_threshold: 2e-4,
            latent_threshold: 0.003,
            latent_scale: 1.0,
            latent_every: 1,
            start: 400,
            stop: 1000,
            every: 100,
            split_scale: 0.01,
            prune_opacity: 0.005,
            prune_distance_m: 0.05,
        }
    }

    pub(super) fn validate(&self) -> Result<()> {
        let numbers = [
            ("pixel threshold", f64::from(self.pixel_threshold)),
            ("--tau-rec", self.latent_threshold),
            ("--tau-scale", self.latent_scale),
            ("split scale", self.split_scale),
            ("prune opacity", f64::from(self.prune_opacity)),
            ("prune distance", self.prune_distance_m),
        ];
        for (name, x) in numbers {
            if !(x.is_finite() && x >= 0.0) {
                return Err(Error::input(name).expected("a finite, non-negative number").got(x.to_string()));
            }
        }
        for (name, n) in [("--latent-every", self.latent_every), ("density interval", self.every)] {
            if n == 0 {
                return Err(Error::input(name).expected("at least 1").got("0"));
            }
        }
        Ok(())
    }

    pub(super) fn describe(&self, record: &mut Value) {
        record["density"] = Value::from(self.mode.name());
        for (key, value) in [
            ("density_pixel_threshold", json!(self.pixel_threshold)),
            ("density_start", json!(self.start)),
            ("density_stop", json!(self.stop)),
            ("density_every", json!(self.every)),
            ("density_split_scale", json!(self.split_scale)),
            ("density_prune_opacity", json!(self.prune_opacity)),
            ("density_prune_distance_m", json!(self.prune_distance_m)),
        ] {
            record[key] = value;
        }
        if self.mode.is_latent() {
            record["tau_rec"] = json!(self.latent_threshold);
            record["tau_scale"] = json!(self.latent_scale);
            record["latent_every"] = json!(self.latent_every);
        }
    }
}
