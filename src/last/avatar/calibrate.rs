//! Calibration of c_τ, the factor that makes the threshold τ_rec dimensionless (eq. 9 of the LAST paper).
//!
//! The pixel criterion (eq. 8) is a screen-space gradient of the loss; the latent criterion (eq. 9) is a
//! world-space gradient of L_lat, whose magnitude depends on the model. The latent gradient is therefore
//! multiplied by c_τ, which is determined once for each model and scene, by a fit in density mode `budget`,
//! in which both criteria add the same number of Gaussians. At the refinement of iteration 600 of 1 200,
//!
//! c_τ = 0.003 / t, where t is the latent mean that is reached by as many Gaussians as reach the pixel
//! criterion.
//!
//! With this c_τ, τ_rec = 0.003 selects as many candidates at that iteration as the pixel criterion at 2e-4,
//! except for Gaussians exactly at the threshold.

use super::density::{Density, Mode};
use super::fit::PersonFit;
use super::guide::Guide;
use super::settings::Settings;
use crate::Result;
use crate::fit::training::{Fit, Watch};
use crate::scene::person::PersonCapture;

/// Iteration of the published schedule at which the numbers of candidates are made equal.
const AT: usize = 600;
/// The τ_rec for which the numbers of candidates are made equal.
const TAU: f64 = 0.003;

/// Returns c_τ of a model on a capture, determined by a fit of half the iterations in `settings`, without the
/// progressive update. Returns `None` if c_τ cannot be determined: no refinement occurs that early, no
/// Gaussian reaches the pixel criterion, or too few have a latent gradient.
///
/// # Errors
/// Any error of the fit.
pub fn latent_scale(
    settings: &Settings,
    capture: &PersonCapture,
    guide: &dyn Guide,
    watch: &mut dyn Watch,
) -> Result<Option<f64>> {
    let density = Density { mode: Mode::Budget, latent_scale: 1.0, ..settings.density.clone() };
    let settings = Settings { density, progressive: None, latent_weight: 0.0, ..settings.clone() };
    let iterations = settings.scaled(AT);
    let mut fit = PersonFit::new(settings, capture, Some(guide))?;
    for i in 0..Ord::min(iterations, fit.iterations()) {
        fit.step(i, watch)?;
    }
    let at = fit.events().last().map_or(0.0, |event| event.latent_at_count);
    Ok((at > 0.0).then_some(TAU / at))
}
