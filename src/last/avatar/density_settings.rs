//! Constants of density control.

use crate::{Error, Result};
use serde_json::{Value, json};

/// Which criterion decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The host's.
    Pixel,
    /// The latent one.
    Replace,
    /// Either.
    Or,
    /// As many as the host's, ranked by the latent one.
    Budget,
}

impl Mode {
    const ALL: [(Self, &'static str); 4] =
        [(Self::Pixel, "pixel"), (Self::Replace, "replace"), (Self::Or, "or"), (Self::Budget, "budget")];

    /// The name used by settings.
    pub fn name(self) -> &'static str {
        Self::ALL.into_iter().find(|(m, _)| *m == self).map_or("", |(_, n)| n)
    }

    /// The mode of that name.
    ///
    /// # Errors
    /// When there is none.
    pub fn parse(name: &str) -> Result<Self> {
        (Self::ALL.into_iter().find(|(_, n)| *n == name).map(|(m, _)| m))
            .ok_or_else(|| Error::input("--density").expected("pixel, replace, or, budget").got(name))
    }

    /// Whether it needs a guide.
    pub fn is_latent(self) -> bool {
        self != Self::Pixel
    }
}

/// Constants of density control; iterations are those of the published 1 200.
#[derive(Clone, Debug, PartialEq)]
pub struct Density {
    /// Which criterion decides.
    pub mode: Mode,
    /// Mean screen gradient in NDC units.
    pub pixel_threshold: f32,
    /// τ_rec
    pub latent_threshold: f64,
    /// c_τ, multiplies the latent mean; see [`calibrate`](super::calibrate)
    pub latent_scale: f64,
    /// L_lat is asked for at multiples of this
    pub latent_every: usize,
    /// Refinement happens in iterations after this one,
    pub start: usize,
    /// before this one,
    pub stop: usize,
    /// at multiples of this.
    pub every: usize,
    /// Largest standard deviation of a clone, scene units.
    pub split_scale: f64,
    /// Opacity below it is pruned.
    pub prune_opacity: f32,
    /// Distance from the template beyond which a Gaussian is removed, metres.
    pub prune_distance_m: f64,
}

impl Density {
    /// The host's.
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
                return Err(Error::input(name).expected("a finite number, not negative").got(x.to_string()));
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
