//! The scene of the demo: Gaussians fitted to photographs of known Gaussians.

use super::Args;
use crate::cli::meter::Meter;
use crate::cli::shared::Outcome;
use crate::cli::splat::fit::Job;
use crate::fit::splat::{Settings, Strategy};
use crate::fit::training::Watch;
use crate::fit::{built_in, seeds};
use crate::splat::render;
use crate::{Error, Result};
use std::path::Path;

/// Iterations unless told otherwise.
pub(super) const ITERATIONS: usize = 1500;
/// Gaussians of the random start.
const INITIAL: usize = 2500;
/// Largest number of Gaussians: about four times that of the truth.
const MOST: usize = 8000;

/// Fits it in a folder.
pub(super) fn run(args: &Args, dir: &Path, meter: &mut Meter) -> Result<Outcome> {
    let render = render::Settings::default();
    let views = built_in::demo(&render)?;
    meter.note(&format!("a scene: {} pictures to fit, {} held out", views.train.len(), views.test.len()));
    meter.lap("photographs of the scene");
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
    let first = seeds::gaussians(&seeds::Start::Random { count: INITIAL, bounds: None }, &views, &settings)?;
    std::fs::create_dir_all(dir).map_err(|e| Error::os(dir, &e))?;
    let job = Job {
        kind: "demo",
        title: "A built-in scene".to_owned(),
        settings,
        views: &views,
        dir: dir.to_path_buf(),
        checkpoint_every: 500,
        resume: false,
    };
    job.run(first, meter)
}
