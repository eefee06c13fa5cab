//! What decides the result of a fit.

use super::density_settings::Density;
use super::prior_settings::{self, Prior};
use super::progressive::Progressive;
use crate::scene::profile::Profile;
use crate::splat::render;
use crate::{Error, Result};
use serde_json::{Value, json};

/// The published number of iterations; schedules are scaled from it.
pub const PUBLISHED: usize = 1200;

/// Learning rates of the host. Those of the Gaussians are per scene unit where they have one (extent 1, a single camera spans nothing).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Learning {
    /// centres, at the first iteration
    pub means: f64,
    /// centres, at the last; log-linear between
    pub means_end: f64,
    /// logarithms of the scales
    pub scales_log: f64,
    /// quaternions
    pub quats: f64,
    /// opacity logits
    pub opacity_logits: f64,
    /// constant colour
    pub sh_dc: f64,
    /// what the rates of scales, rotations, opacities and colours have become at the last iteration, log-linear; 1 keeps them
    pub decay: f64,
    /// both networks
    pub networks: f64,
    /// gains of the moments; 0 keeps them at 1
    pub gains: f64,
}

/// What decides the result, besides the capture and the guide.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// in all; the schedule of 1 200 is scaled to it
    pub iterations: usize,
    /// of every random draw
    pub seed: u64,
    /// 0 to 3; 0 is the default, one camera shows no dependence on direction
    pub sh_degree: usize,
    /// scale of a first Gaussian, in root mean squared distances to its three neighbours
    pub first_scale: f32,
    /// its opacity
    pub first_opacity: f32,
    /// never more Gaussians than this
    pub max_gaussians: usize,
    /// the renderer
    pub render: render::Settings,
    /// colour behind the person in finished pictures, sRGB-encoded
    pub background: [f32; 3],
    /// Draw another colour behind person and photograph in every iteration. Before one colour, a Gaussian outside the person may take that colour
    /// instead of vanishing, and shows from other sides.
    pub random_background: bool,
    /// rates
    pub learning: Learning,
    /// length of the first d of every moment, toward the first training camera: a person is photographed from where the light is. Colours take up
    /// what it makes of the front, the hidden side stays as dark as it says.
    pub first_light: f32,
    /// weight of 1 − SSIM on the box crop
    pub ssim_weight: f32,
    /// weight of the squared error of alpha in the box
    pub alpha_weight: f32,
    /// what is assumed of what the camera does not see
    pub prior: Prior,
    /// learn what is added to the logarithms of the skinning weights
    pub weights_network: bool,
    /// learn a correction of every pose
    pub pose_network: bool,
    /// where Gaussians are added
    pub density: Density,
    /// in which order they are updated; `None` updates all at once
    pub progressive: Option<Progressive>,
    /// weight of the latent discrepancy in the loss
    pub latent_weight: f32,
}

impl Settings {
    /// The host: [`Self::published`] and what a person asks for who never turns round: another background in every iteration, the assumptions of
    /// [`Prior`], gains of the moments. Constants found on the built-in subject.
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

    /// What is left of GauHuman's host (last.md §10.2) without LPIPS, SH degree 0: its losses, rates and schedules. Not taken over: the
    /// networks (here by `weights_network` and `pose_network`), the divergence from neighbours as a further condition for refinement, clones drawn
    /// beside their original, the merging of pairs.
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

    /// An iteration constant of the published schedule, in iterations of this run, at least 1.
    pub fn scaled(&self, constant: usize) -> usize {
        Ord::max(1, (constant * self.iterations + PUBLISHED / 2) / PUBLISHED)
    }

    /// Whether anything asks for a guide.
    pub fn needs_guide(&self) -> bool {
        self.density.mode.is_latent()
            || self.latent_weight > 0.0
            || self.progressive.as_ref().is_some_and(Progressive::needs_guide)
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// Names the setting.
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
                return Err(Error::input(name).expected("a finite number, not negative").got(x.to_string()));
            }
        }
        if !self.background.iter().all(|x| (0.0..=1.0).contains(x)) {
            return Err(Error::input("--background")
                .expected("numbers in 0..1")
                .got(format!("{:?}", self.background)));
        }
        prior_settings::validate(&self.prior)?;
        self.density.validate()?;
        self.progressive.as_ref().map_or(Ok(()), Progressive::validate)
    }

    /// As a flat JSON object: what a checkpoint is compared by.
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

    /// What [`Self::json`] says about the renderer, for a run that is read back.
    ///
    /// # Errors
    /// When the record is not one of a fit.
    pub fn drawing(record: &Value) -> Result<(render::Settings, [f32; 3])> {
        let wrong = |key: &str| Error::input("settings").at(key.to_owned()).expected("the settings of a fit");
        let profile = Profile::parse(record["profile"].as_str().ok_or_else(|| wrong("profile"))?)?;
        let number = |i: usize| record["background"][i].as_f64().ok_or_else(|| wrong("background"));
        let background = [number(0)? as f32, number(1)? as f32, number(2)? as f32];
        Ok((render::Settings { profile, ..render::Settings::default() }, background))
    }
}
