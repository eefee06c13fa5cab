//! All settings that affect the result of a fit.

use super::density_settings::Density;
use super::prior_settings::{self, Prior};
use super::progressive::Progressive;
use crate::scene::profile::Profile;
use crate::splat::render;
use crate::{Error, Result};
use serde_json::{Value, json};

/// The published number of iterations; all schedules are scaled from it.
pub const PUBLISHED: usize = 1200;

/// Learning rates. Rates of positions are per scene unit (the extent is 1, because a single camera position
/// defines none).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Learning {
    /// Rate of the centres at the first iteration.
    pub means: f64,
    /// Rate of the centres at the last iteration; log-linear in between.
    pub means_end: f64,
    /// Rate of the logarithms of the scales.
    pub scales_log: f64,
    /// Rate of the quaternions.
    pub quats: f64,
    /// Rate of the opacity logits.
    pub opacity_logits: f64,
    /// Rate of the constant colours.
    pub sh_dc: f64,
    /// Factor of the rates of scales, rotations, opacities and colours at the last iteration, log-linear; 1
    /// keeps the rates constant.
    pub decay: f64,
    /// Rate of both networks.
    pub networks: f64,
    /// Rate of the gains of the moments; 0 keeps the gains at 1.
    pub gains: f64,
}

/// All settings that affect the result, apart from the capture and the guide.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Total number of iterations; the published schedule of 1 200 is scaled to it.
    pub iterations: usize,
    /// Seed of every random draw.
    pub seed: u64,
    /// SH degree, 0 to 3; 0 by default, because a single camera provides no information about the dependence
    /// on direction.
    pub sh_degree: usize,
    /// Initial scale of a Gaussian, relative to the root mean squared distance to its three nearest
    /// neighbours.
    pub first_scale: f32,
    /// Initial opacity of a Gaussian.
    pub first_opacity: f32,
    /// Maximum number of Gaussians.
    pub max_gaussians: usize,
    /// Settings of the renderer.
    pub render: render::Settings,
    /// Background colour of final images, sRGB-encoded.
    pub background: [f32; 3],
    /// Whether to draw a different background colour for render and input image in every iteration. With a
    /// constant background, a Gaussian outside the person may take its colour instead of vanishing, and
    /// becomes visible from other sides.
    pub random_background: bool,
    /// Learning rates.
    pub learning: Learning,
    /// Length of the initial direction d of every moment, towards the first training camera, since the light
    /// usually comes from the camera side. The colours compensate for the effect of d on the visible side;
    /// the unseen side stays as dark as d implies.
    pub first_light: f32,
    /// Weight of 1 − SSIM on the box crop.
    pub ssim_weight: f32,
    /// Weight of the squared error of alpha in the box.
    pub alpha_weight: f32,
    /// Weights of the prior for unseen surfaces.
    pub prior: Prior,
    /// Whether to learn an offset of the logarithms of the skinning weights.
    pub weights_network: bool,
    /// Whether to learn a correction of every pose.
    pub pose_network: bool,
    /// Settings of density control.
    pub density: Density,
    /// Settings of the progressive update; with `None`, all Gaussians are updated at once.
    pub progressive: Option<Progressive>,
    /// Weight of the latent discrepancy in the loss.
    pub latent_weight: f32,
}

impl Settings {
    /// The default settings without a guide: [`Self::published`] with additions for a person who never turns
    /// round, namely a different background in every iteration, the assumptions of [`Prior`] and gains of the
    /// moments. The constants were determined on the built-in subject.
    pub fn baseline() -> Self {
        let published = Self::published();
        Self {
            random_background: true,
            first_scale: 0.6,
            first_opacity: 0.5,
            first_light: 0.2,
            prior: Prior {
                color: 0.1,
                opacity: 0.1,
                scale: 0.0,
                round: 0.1,
                fill: 0.1,
                reach: 0.6,
                anchor: 0.1,
                solid: 0.0,
            },
            learning: Learning { gains: 0.01, ..published.learning },
            ..published
        }
    }

    /// The losses, rates and schedules published for GauHuman (see the chapter *Bibliography*), without LPIPS
    /// and with SH degree 0. Not implemented: its networks (`weights_network` and `pose_network` replace
    /// them), the divergence from neighbours as a further condition for refinement, clones drawn beside their
    /// originals, and the merging of pairs.
    pub fn published() -> Self {
        Self {
            iterations: PUBLISHED,
            seed: 0,
            sh_degree: 0,
            first_scale: 1.0,
            first_opacity: 0.1,
            max_gaussians: 8000,
            render: render::Settings::default(),
            background: [0.0; 3],
            random_background: false,
            learning: Learning {
                means: 1.6e-4,
                means_end: 1.6e-4,
                scales_log: 5e-3,
                quats: 1e-3,
                opacity_logits: 0.05,
                sh_dc: 2.5e-3,
                decay: 1.0,
                networks: 5e-5,
                gains: 0.0,
            },
            first_light: 0.0,
            ssim_weight: 0.01,
            alpha_weight: 0.1,
            prior: Prior::NONE,
            weights_network: false,
            pose_network: false,
            density: Density::pixel(),
            progressive: None,
            latent_weight: 0.0,
        }
    }

    /// Scales an iteration count of the published schedule to this run; at least 1.
    pub fn scaled(&self, constant: usize) -> usize {
        Ord::max(1, (constant * self.iterations + PUBLISHED / 2) / PUBLISHED)
    }

    /// Whether any setting requires a guide.
    pub fn needs_guide(&self) -> bool {
        self.density.mode.is_latent()
            || self.latent_weight > 0.0
            || self.progressive.as_ref().is_some_and(Progressive::needs_guide)
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// If a setting is out of range; the error names it.
    pub fn validate(&self) -> Result<()> {
        let within = |name: &str, n: usize, most: usize| {
            if (1..=most).contains(&n) {
                return Ok(());
            }
            Err(Error::input(name).expected(format!("1 to {most}")).got(n.to_string()))
        };
        within("--iterations", self.iterations, 1_000_000)?;
        within("--max-gaussians", self.max_gaussians, 1 << 20)?;
        if self.sh_degree > 3 {
            return Err(Error::input("--sh-degree").expected("0 to 3").got(self.sh_degree.to_string()));
        }
        if self.render.tile != 16 {
            return Err(Error::input("--tile").expected("16 for a fit").got(self.render.tile.to_string()));
        }
        if !(self.first_scale > 0.0
            && self.first_scale.is_finite()
            && self.first_opacity > 0.0
            && self.first_opacity < 1.0)
        {
            return Err(Error::input("first Gaussians")
                .expected("a positive scale and an opacity between 0 and 1")
                .got(format!("{} and {}", self.first_scale, self.first_opacity)));
        }
        let l = &self.learning;
        let rates =
            [l.means, l.means_end, l.scales_log, l.quats, l.opacity_logits, l.sh_dc, l.decay, l.networks];
        let weights = [
            ("weight of 1 - SSIM", f64::from(self.ssim_weight)),
            ("weight of alpha", f64::from(self.alpha_weight)),
            ("weight of the latent discrepancy", f64::from(self.latent_weight)),
            ("first light", f64::from(self.first_light)),
            ("rate of gains", l.gains),
        ];
        let named = rates.map(|r| ("learning rate", r, true)).into_iter();
        for (name, x, positive) in named.chain(weights.map(|(name, w)| (name, w, false))) {
            if !(x.is_finite() && x >= 0.0 && (x > 0.0 || !positive)) {
                return Err(Error::input(name).expected("a finite, non-negative number").got(x.to_string()));
            }
        }
        if !self.background.iter().all(|x| (0.0..=1.0).contains(x)) {
            return Err(Error::input("--background")
                .expected("numbers between 0 and 1")
                .got(format!("{:?}", self.background)));
        }
        prior_settings::validate(&self.prior)?;
        self.density.validate()?;
        self.progressive.as_ref().map_or(Ok(()), Progressive::validate)
    }

    /// The settings as a flat JSON object, with which checkpoints are compared.
    pub fn json(&self) -> Value {
        let (p, l) = (&self.render.profile, &self.learning);
        let mut record = json!({
            "iterations": self.iterations, "seed": self.seed, "sh_degree": self.sh_degree,
            "max_gaussians": self.max_gaussians, "first_scale": self.first_scale, "first_opacity": self.first_opacity,
            "profile": p.name, "antialiased": p.antialiased,
            "background": self.background, "random_background": self.random_background,
            "rate_means": l.means, "rate_means_end": l.means_end, "rate_scales": l.scales_log,
            "rate_quats": l.quats, "rate_opacities": l.opacity_logits, "rate_colors": l.sh_dc,
            "rate_decay": l.decay, "rate_networks": l.networks, "rate_gains": l.gains,
            "first_light": self.first_light, "ssim_weight": self.ssim_weight, "alpha_weight": self.alpha_weight,
            "weights_network": self.weights_network, "pose_network": self.pose_network,
            "latent_weight": self.latent_weight,
        });
        prior_settings::describe(&self.prior, &mut record);
        self.density.describe(&mut record);
        match &self.progressive {
            Some(p) => p.describe(&mut record),
            None => record["progressive"] = Value::from("off"),
        }
        record
    }

    /// Reads the renderer settings from [`Self::json`], for a run that is read back.
    ///
    /// # Errors
    /// If the record is not that of a fit.
    pub fn drawing(record: &Value) -> Result<(render::Settings, [f32; 3])> {
        let wrong = |key: &str| Error::input("settings").at(key.to_owned()).expected("the settings of a fit");
        let profile = Profile::parse(record["profile"].as_str().ok_or_else(|| wrong("profile"))?)?;
        let number = |i: usize| record["background"][i].as_f64().ok_or_else(|| wrong("background"));
        let background = [number(0)? as f32, number(1)? as f32, number(2)? as f32];
        Ok((render::Settings { profile, ..render::Settings::default() }, background))
    }
}
