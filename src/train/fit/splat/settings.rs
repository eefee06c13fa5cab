//! Settings that decide the result of a fit, and its memory estimate.

use crate::fit::render::image_bytes;
use crate::scene::views::{View, Views};
use crate::splat::render;
use crate::{Error, Result};
use serde_json::{Value, json};

/// Strategy of density control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Strategy {
    /// clone, split, prune, reset: the original program
    Inria,
    /// the same constants with the rules of gsplat
    Gsplat,
    /// the same on absolute screen gradients
    GsplatAbs,
    /// relocation, growth and noise
    Mcmc,
}

impl Strategy {
    /// The name used in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Inria => "inria",
            Self::Gsplat => "gsplat",
            Self::GsplatAbs => "gsplat-abs",
            Self::Mcmc => "mcmc",
        }
    }

    /// The strategy of that name.
    ///
    /// # Errors
    /// When there is no strategy of that name.
    pub fn parse(name: &str) -> Result<Self> {
        [Self::Inria, Self::Gsplat, Self::GsplatAbs, Self::Mcmc]
            .into_iter()
            .find(|s| s.name() == name)
            .ok_or_else(|| Error::input("--strategy").expected("inria, gsplat, gsplat-abs or mcmc").got(name))
    }
}

/// Settings that decide the result, together with the images and the initial Gaussians.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// number of iterations; the published schedule of 30 000 is scaled to it
    pub iterations: usize,
    /// seed of all random draws
    pub seed: u64,
    /// SH degree, 0 to 3
    pub sh_degree: usize,
    /// density control
    pub strategy: Strategy,
    /// maximum number of Gaussians
    pub max_gaussians: usize,
    /// settings of the renderer
    pub render: render::Settings,
    /// colour behind the scene, sRGB-encoded
    pub background: [f32; 3],
}

/// See [`Settings::determined`].
const PIXELS_PER_GAUSSIAN: usize = 60;
/// Maximum number of iterations of a fit.
const MAX_ITERATIONS: usize = 10_000_000;
/// Maximum number of Gaussians without `--max-gaussians`, unless the start has more.
const MAX_DETERMINED: usize = 1_000_000;
/// Maximum number of Gaussians of a fit.
pub const MAX_GAUSSIANS: usize = (1 << 24) - 1; // list positions are kept in f32

impl Settings {
    /// Checks ranges.
    ///
    /// # Errors
    /// Names the option.
    pub fn validate(&self) -> Result<()> {
        let within = |name: &str, n: usize, most: usize| {
            if (1..=most).contains(&n) {
                return Ok(());
            }
            Err(Error::input(name).expected(format!("1 to {most}")).got(n.to_string()))
        };
        within("--iterations", self.iterations, MAX_ITERATIONS)?;
        within("--max-gaussians", self.max_gaussians, MAX_GAUSSIANS)?;
        if self.sh_degree > 3 {
            return Err(Error::input("--sh-degree").expected("0 to 3").got(self.sh_degree.to_string()));
        }
        if self.render.tile != 16 {
            return Err(Error::input("--tile").expected("16 for a fit").got(self.render.tile.to_string()));
        }
        if !self.background.iter().all(|x| (0.0..=1.0).contains(x)) {
            return Err(Error::input("--background")
                .expected("numbers in 0..1")
                .got(format!("{:?}", self.background)));
        }
        Ok(())
    }

    /// Number of Gaussians that the training images can determine: one per 60 pixels that count and show
    /// something, limited to 10 000 … 1 000 000. A Gaussian of SH degree 3 has 59 parameters, a pixel has three
    /// values, and each parameter should be observed about three times. A pixel shows nothing if it and its
    /// neighbours have exactly the colour of the background.
    pub fn determined(views: &Views, background: [f32; 3]) -> usize {
        let plain = background.map(|x| (x * 255.0 + 0.5) as u8);
        let pixels = views.train.iter().fold(0, |s, &i| s + informative(&views.views[i], plain));
        (pixels / PIXELS_PER_GAUSSIAN).clamp(10_000, MAX_DETERMINED)
    }

    /// Default limit for a start of `first` Gaussians: [`Self::determined`], but at least the start, and one and a
    /// half times the start if it comes from a file.
    pub fn limit(determined: usize, first: usize, is_file: bool) -> usize {
        determined.max(if is_file { first + first / 2 } else { first }).min(MAX_GAUSSIANS)
    }

    /// The settings as a flat JSON object, which is compared with that of a checkpoint.
    pub fn json(&self) -> Value {
        let p = &self.render.profile;
        json!({
            "iterations": self.iterations,
            "seed": self.seed,
            "sh_degree": self.sh_degree,
            "strategy": self.strategy.name(),
            "max_gaussians": self.max_gaussians,
            "profile": p.name,
            "alpha_max": p.alpha_max,
            "antialiased": p.antialiased,
            "background": self.background,
        })
    }

    /// Estimated number of bytes of the fit when it reaches `max_gaussians`, or the part of it that density
    /// control usually keeps.
    pub fn memory_estimate(&self, views: &Views) -> u64 {
        let coefficients = ((self.sh_degree + 1) * (self.sh_degree + 1)) as u64;
        let floats = 3 + 4 + 3 + 1 + 3 * coefficients;
        // parameters, two moments, gradients; five counters; statistics; projected rows and their cotangents
        let per_gaussian = floats * 4 * 4 + 5 * 4 + 12 + 400;
        let photos = views
            .views
            .iter()
            .fold(0, |s, v| s + v.rgb.len() as u64 * 5 + v.mask.as_ref().map_or(0, |m| m.len() as u64 * 5));
        let largest = views.views.iter().fold(0, |m, v| m.max(image_bytes(v.camera.width, v.camera.height)));
        // SSIM keeps four maps, filters four images, and the tape holds cotangents: about eight images.
        photos + self.max_gaussians as u64 * per_gaussian + 4 * largest
    }
}

/// Pixels of a view that count and are not in the midst of plain background.
fn informative(view: &View, plain: [u8; 3]) -> usize {
    let (w, h) = (view.camera.width, view.camera.height);
    let is_plain = |p: usize| view.rgb[3 * p..3 * p + 3] == plain;
    let shows = |p: usize| {
        let (x, y) = (p % w, p / w);
        let (rows, columns) = (y.saturating_sub(1)..(y + 2).min(h), x.saturating_sub(1)..(x + 2).min(w));
        rows.into_iter().any(|v| columns.clone().any(|u| !is_plain(v * w + u)))
    };
    let counts = |p: &usize| view.mask.as_ref().is_none_or(|m| m[*p] != 0);
    (0..w * h).filter(counts).filter(|&p| !is_plain(p) || shows(p)).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> Settings {
        Settings {
            iterations: 7000,
            seed: 0,
            sh_degree: 3,
            strategy: Strategy::Inria,
            max_gaussians: 1000,
            render: render::Settings::default(),
            background: [0.0; 3],
        }
    }

    #[test]
    fn ranges_are_checked() {
        settings().validate().expect("valid");
        for bad in [
            Settings { iterations: 0, ..settings() },
            Settings { sh_degree: 4, ..settings() },
            Settings { max_gaussians: 0, ..settings() },
            Settings { background: [f32::NAN, 0.0, 0.0], ..settings() },
            Settings { render: render::Settings { tile: 8, ..render::Settings::default() }, ..settings() },
        ] {
            assert!(bad.validate().is_err(), "{bad:?} is an error");
        }
        assert_eq!(Strategy::parse("mcmc").ok(), Some(Strategy::Mcmc), "a name");
        assert!(Strategy::parse("x").is_err(), "no such name");
    }
}
