//! The scene of the demo: Gaussians fitted to rendered images of known Gaussians.

use super::args::Args;
use crate::Result;
use crate::fit::splat::{Settings, Strategy};
use crate::fit::training::Watch;
use crate::fit::{built_in, seeds};
use crate::meter::Meter;
use crate::shared::Outcome;
use crate::splat::fit::Job;
use crate::training::Frame;
use crate::units::counted;
use lastlight_kernels::splat::render;
use std::path::Path;

/// Default number of iterations.
pub(super) const ITERATIONS: usize = 1200;
/// Gaussians of the random start.
const INITIAL: usize = 2500;
/// Largest number of Gaussians: about four times that of the truth.
const MOST: usize = 8000;

/// Fits it in a folder.
pub(super) fn run(args: &Args, dir: &Path, meter: &mut Meter) -> Result<Outcome> {
    let render = render::Settings::default();
    let views = built_in::demo(&render)?;
    meter.note(&format!(
        "a scene: {}, {} held out, rendered from known Gaussians",
        counted(views.train.len(), "training image"),
        views.test.len()
    ));
    meter.lap("rendering the images");
    let settings = Settings {
        iterations: args.iterations.unwrap_or(ITERATIONS),
        seed: args.seed,
        sh_degree: 1,
        strategy: Strategy::Inria,
        max_gaussians: MOST,
        render,
        background: built_in::BACKGROUND,
    };
    settings.validate()?;
    let defaults = Settings { iterations: ITERATIONS, seed: 0, ..settings.clone() }.json();
    let first = seeds::gaussians(&seeds::Start::Random { count: INITIAL, bounds: None }, &views, &settings)?;
    let job = Job {
        kind: "demo",
        title: "Scene from built-in images".to_owned(),
        settings,
        views: &views,
        defaults: Some(defaults),
        frame: Frame::inside(dir.to_path_buf(), 500)?,
    };
    job.run(first, meter)
}
