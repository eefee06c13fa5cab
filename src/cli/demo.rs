//! `demo`: a small built-in scene end to end.

use super::meter::Meter;
use super::splat::fit::Job;
use super::{claim, say};
use crate::fit::splat::{Settings, Strategy};
use crate::fit::training::Watch;
use crate::fit::{built_in, seeds};

use crate::splat::render;
use crate::{Error, Result};
use std::path::PathBuf;

/// Splat a small built-in scene end to end and write a report with pictures.
///
/// Photographs of a scene of known Gaussians are rendered, new Gaussians are fitted to them from a random start,
/// and the views that were held out are compared. Takes less than a minute on two cores and needs no input.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight demo
  lastlight demo --out /tmp/demo --seed 1 --iterations 3000")]
pub(super) struct Args {
    /// Folder for the results [default: demo; an earlier demo there is replaced]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace files in --out that exist
    #[arg(long)]
    force: bool,
    /// Iterations of the fit
    #[arg(long, value_name = "N", default_value_t = 1500)]
    iterations: usize,
    /// Seed of every random draw
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Print the result record as JSON
    #[arg(long)]
    json: bool,
    /// No progress, no remarks
    #[arg(long)]
    quiet: bool,
}

/// Held-out views must reach this on the built-in scene; below it, something is broken.
const LEAST_PSNR_DB: f64 = 28.0;
/// Iterations from which the bound above holds.
const ENOUGH_ITERATIONS: usize = 1000;
/// Gaussians of the random start.
const INITIAL: usize = 2500;
/// Largest number of Gaussians: about four times that of the truth.
const MOST: usize = 8000;

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new(args.quiet);
    let default = PathBuf::from("demo");
    let dir = args.out.as_deref().unwrap_or(&default);
    // The default folder belongs to the demo, so that it can be run twice; it is known by its own result.
    let is_ours = args.out.is_none() && dir.join("result.json").is_file();
    let dir = claim::folder(dir, false, args.force || is_ours)?;
    let render = render::Settings::default();
    let views = built_in::demo(&render)?;
    meter.note(&format!(
        "built-in scene: {} pictures to fit, {} held out",
        views.train.len(),
        views.test.len()
    ));
    meter.lap("rendering the photographs");
    let settings = Settings {
        iterations: args.iterations,
        seed: args.seed,
        sh_degree: 1,
        strategy: Strategy::Inria,
        max_gaussians: MOST,
        render,
        background: built_in::BACKGROUND,
    };
    settings.validate()?;
    let first = seeds::gaussians(&seeds::Start::Random { count: INITIAL, bounds: None }, &views, &settings)?;
    let job = Job {
        kind: "demo",
        title: "A built-in scene".to_owned(),
        settings,
        views: &views,
        dir: dir.clone(),
        checkpoint_every: 500,
        resume: false,
    };
    let outcome = job.run(first, &mut meter)?;
    outcome.publish(&dir, args.json)?;
    let psnr = outcome.held_out_db;
    if !args.json {
        say("")?;
        say("Next:")?;
        let d = dir.display();
        say(&format!("  open {d}/report/index.html in a browser"))?;
        say(&format!(
            "  lastlight splat render {d}/scene.ply --cameras orbit:36 --size 320x320 --out turntable"
        ))?;
        say(
            "  lastlight splat fit PHOTOS --out DIR     your own posed photographs (transforms.json or COLMAP)",
        )?;
        say("  lastlight oracle list                    operators to compare your own code with")?;
    }
    let is_good = psnr >= LEAST_PSNR_DB;
    if args.iterations >= ENOUGH_ITERATIONS && !is_good {
        return Err(Error::check("demo")
            .at("mean PSNR of the held-out views")
            .expected(format!("at least {LEAST_PSNR_DB} dB"))
            .got(format!("{psnr:.2} dB")));
    }
    Ok(())
}
