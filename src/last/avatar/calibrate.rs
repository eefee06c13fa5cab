//! c_τ: what makes τ_rec a number without a scale (last.md §11).
//!
//! The pixel criterion is a screen gradient of the host's loss, the latent one a world gradient of L_lat; the size of the second depends on the model. So
//! it is multiplied by c_τ, chosen once for a model and a scene: in a fit with density mode `budget`, where both criteria add as many Gaussians, at the
//! refinement of iteration 600 of 1 200,
//!
//! c_τ = 0.003 / (the latent mean that as many Gaussians reach as reach the pixel criterion)
//!
//! so that τ_rec = 0.003 has there as many candidates as the pixel criterion at 2e-4, but for those that lie exactly at it.

use super::density::{Density, Mode};
use super::fit::PersonFit;
use super::guide::Guide;
use super::settings::Settings;
use crate::Result;
use crate::fit::training::{Fit, Watch};
use crate::scene::person::PersonCapture;

/// The iteration of the published schedule at which counts are made equal.
const AT: usize = 600;
/// The τ_rec for which they are.
const TAU: f64 = 0.003;

/// c_τ of a model on a capture, by a fit of half the iterations that `settings` asks for, without the progressive update. None where there is nothing to
/// make equal: no refinement so early, no Gaussian that reaches the pixel criterion, or as many without a latent gradient.
///
/// # Errors
/// What the fit reports.
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
