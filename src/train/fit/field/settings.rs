//! Settings that decide the result of a fit.

use crate::scene::field::{Combine, Rule};
use crate::{Error, Result};
use serde_json::{Value, json};

/// Where materials come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Materials {
    /// There are none.
    #[default]
    Off,
    /// Albedo, roughness and metallic are compared with the passes of the images.
    Passes,
    /// Shading under a light is compared with the images.
    Shaded,
}

impl Materials {
    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Passes => "passes",
            Self::Shaded => "shaded",
        }
    }
}

/// The networks of a field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HeadForm {
    /// One per value (LIRM).
    #[default]
    Separate,
    /// One for signed distance and colour (the form of EG3D).
    Trunk,
}

/// The course of 1/β.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Beta {
    /// Linear, then constant.
    #[default]
    Linear,
    /// A parameter like the others; less stable, according to LIRM.
    Learned,
}

/// Settings that decide the result, together with the images.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Number of iterations.
    pub iterations: usize,
    /// Seed of all draws.
    pub seed: u64,
    /// Number of planes, 6 or 3.
    pub planes: usize,
    /// Texels per side of a plane in the last stage.
    pub side: usize,
    /// Channels of a plane.
    pub channels: usize,
    /// How the features of planes are combined.
    pub combine: Combine,
    /// Form of the networks.
    pub heads: HeadForm,
    /// Whether the colour reads the directional embedding.
    pub embedding: bool,
    /// Whether it reads the cosine of normal and reflection with it, which LIRM does not.
    pub cosine: bool,
    /// Steps along the diagonal of the box in the last stage.
    pub samples: usize,
    /// Where densities are taken.
    pub rule: Rule,
    /// Pixels per side of a crop.
    pub crop: usize,
    /// Crops per iteration.
    pub crops: usize,
    /// First and last 1/β.
    pub inverse_beta: [f32; 2],
    /// Course of 1/β.
    pub beta: Beta,
    /// Where materials come from.
    pub materials: Materials,
    /// Largest learning rates of planes and panoramas, and of networks.
    pub rates: [f64; 2],
    /// Weight of the eikonal term; it is 0 by default, because fits of three objects without it were nearer to the true surface.
    pub eikonal: f32,
    /// Weight of the squared variation of planes, for texels as large as the box.
    pub variation: f32,
    /// Weight of the squared jump of the signed distance across the centre planes, in texels.
    pub seams: f32,
    /// Rays whose cotangents of features are in memory at once; changes no bit.
    pub chunk: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            iterations: 4000,
            seed: 0,
            planes: 6,
            side: 128,
            channels: 16,
            combine: Combine::Concat,
            heads: HeadForm::Separate,
            embedding: false,
            cosine: true,
            samples: 192,
            rule: Rule::Analytic,
            crop: 32,
            crops: 4,
            inverse_beta: [10.0, 200.0],
            beta: Beta::Linear,
            materials: Materials::Off,
            rates: [0.01, 0.005],
            eikonal: 0.0,
            variation: 2e-3,
            seams: 1e-2,
            chunk: 1024,
        }
    }
}

/// Refuses a number outside a range; NaN is outside.
fn within(option: &str, x: f64, range: std::ops::RangeInclusive<f64>) -> Result<()> {
    if range.contains(&x) {
        return Ok(());
    }
    Err(Error::input(option).expected(format!("{} to {}", range.start(), range.end())).got(x.to_string()))
}

impl Settings {
    /// Checks ranges and combinations.
    ///
    /// # Errors
    /// Names the option.
    pub fn validate(&self) -> Result<()> {
        let Self { iterations, side, channels, samples, crop, crops, .. } = *self;
        within("--iterations", iterations as f64, 1.0..=1e7)?;
        if self.planes != 6 && self.planes != 3 {
            return Err(Error::input("--planes").expected("6 or 3").got(self.planes.to_string()));
        }
        within("--side", side as f64, 8.0..=1024.0)?;
        within("--channels", channels as f64, 1.0..=128.0)?;
        within("--ray-samples", samples as f64, 8.0..=4096.0)?;
        within("--crop-side", crop as f64, 16.0..=512.0)?;
        within("--crops", crops as f64, 1.0..=64.0)?;
        let [first, last] = self.inverse_beta.map(f64::from);
        within("--first-inverse-beta", first, 1.0..=1e4)?;
        within("--inverse-beta", last, 1.0..=1e4)?;
        if first > last {
            return Err(Error::input("--first-inverse-beta")
                .expected(format!("at most {last}, that of --inverse-beta: it never falls"))
                .got(first.to_string()));
        }
        let [planes, networks] = self.rates;
        within("--plane-rate", planes, 1e-8..=1.0)?;
        within("--network-rate", networks, 1e-8..=1.0)?;
        within("--eikonal", f64::from(self.eikonal), 0.0..=1e3)?;
        within("--seams", f64::from(self.seams), 0.0..=1e3)?;
        within("--variation", f64::from(self.variation), 0.0..=1e3)?;
        if self.heads == HeadForm::Trunk {
            let refuse = |option: &str, expected: &str, got: &str| {
                Err(Error::input(option).expected(expected).got(got))
            };
            if self.embedding {
                return refuse("--nde", "separate heads, or no embedding", "--heads trunk");
            }
            if self.rule != Rule::Midpoint {
                // A trunk gives s and the colour at one point, so the step must be sampled at its middle.
                return refuse("--rule", "midpoint, with --heads trunk", self.rule.name());
            }
        }
        Ok(())
    }

    /// Returns an estimate of the memory that a fit takes besides its images, in bytes: eight times the planes (values,
    /// gradients and moments, once more in a checkpoint), and the samples of the rays of an iteration.
    pub fn memory_estimate(&self) -> u64 {
        let texels = (self.planes * self.side * self.side * self.channels) as u64;
        let samples = (self.crops * self.crop * self.crop * self.samples) as u64;
        32 * texels + 16 * samples
    }

    /// Whether there is a head of normals.
    pub fn has_normal_head(&self) -> bool {
        self.embedding || self.materials == Materials::Passes
    }

    /// Returns the settings as a flat JSON object, which is compared with that of a checkpoint. The chunk is not
    /// part of it: it changes no bit.
    pub fn json(&self) -> Value {
        json!({
            "iterations": self.iterations,
            "seed": self.seed,
            "planes": self.planes,
            "side": self.side,
            "channels": self.channels,
            "combine": self.combine.name(),
            "heads": if self.heads == HeadForm::Trunk { "trunk" } else { "separate" },
            "embedding": self.embedding,
            "cosine": self.embedding && self.cosine,
            "samples": self.samples,
            "rule": self.rule.name(),
            "crop": self.crop,
            "crops": self.crops,
            "inverse_beta": self.inverse_beta,
            "beta": if self.beta == Beta::Learned { "learned" } else { "linear" },
            "materials": self.materials.name(),
            "rates": self.rates,
            "eikonal": self.eikonal,
            "variation": self.variation,
            "seams": self.seams,
        })
    }
}
