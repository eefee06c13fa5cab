//! `field eval`: a field beside the images of a capture, under their light or under another.

use super::page::{self, Input};
use super::read;
use super::scoring::{self, Benchmark};
use crate::fit::exposure::Common;
use crate::fit::field::scores::means;
use crate::fit::field::targets::Pictures;
use crate::fit::field::{Target, benchmark, score, view};
use crate::fit::render::flat_name;
use crate::fit::training::Watch;
use crate::light::MapArgs;
use crate::loss::lpips::Metric;
use crate::meter::Meter;
use crate::report::run::Run;
use crate::splat::missing;
use crate::{Error, Result, claim, console as cli};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Score a field on the images of a capture.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight field eval fit object/uniform                  held-out images of the capture that was fitted
  lastlight field eval fit other/uniform --split all --out scores
  lastlight field eval fit object/uniform --min-psnr 30    exit code 1 below 30 dB
  lastlight field eval fit object/uniform --mesh object/object.glb
  lastlight field eval fit object/environment --relight --env object/environment.exr --split all --out relit

Scores: PSNR, SSIM and mean absolute error over white; with passes also the angles of numerical normals and of the normal head, depth, albedo (as it is, and after a scale per channel), roughness and metallic. Images that a renderer exposed one by one are brought to the exposure of the fit, which result.json beside the field records.

Scores of Stanford-ORB are printed beside them: PSNR-H, PSNR-L and SSIM-3 of linear values after a scale per channel in the eroded mask, LPIPS with the weights of --lpips or its surrogate RFD, normals (mean of 1 - cos), depth (one scale per scene), and with --mesh the shape: mean squared distances between 30 000 samples and the vertices of the true surface, as the published code returns them and as the published table prints them (2000 times the value). Linear truth is the radiance pass times the exposure of the image, else the decoded photo.

With --relight the images of the capture show the object under another light: that of --env, or the map that the capture names for each image. The field's mesh is made as by `field mesh`, path-traced under that light from the cameras of the images, and scored in place of the field's colours.")]
pub(crate) struct Args {
    /// Folder of a fit, or a field.safetensors
    #[arg(value_name = "FILE")]
    field: PathBuf,
    /// Folder with transforms.json or a COLMAP model, or the transforms.json itself
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// Which images
    #[arg(long, value_name = "NAME", default_value = "test", value_parser = ["test", "train", "all"])]
    split: String,
    /// True surface, in the units of the capture: .gltf, .glb, .obj or .ply
    #[arg(long, value_name = "FILE")]
    mesh: Option<PathBuf>,
    /// Score the object's mesh under the light of the images in place of the field's colours
    #[arg(long)]
    relight: bool,
    /// Light of the images: a .hdr, .exr, .png or .jpg panorama, or a built-in light as of mesh render [default: the map that the
    /// capture names for each image]
    #[arg(long, value_name = "FILE|NAME", requires = "relight")]
    env: Option<String>,
    #[command(flatten)]
    map: MapArgs,
    /// Samples per pixel of a relit image
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    samples: u32,
    /// Surfaces after the first that light may come by; 0 is direct light only
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(0..=64))]
    bounces: u32,
    /// Weights of LPIPS; without them the surrogate RFD is computed
    #[arg(long, value_name = "FILE")]
    lpips: Option<PathBuf>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Fail below this mean PSNR, in dB; with --relight of PSNR-mask
    #[arg(long, value_name = "DB", allow_hyphen_values = true)]
    min_psnr: Option<f64>,
    /// Shrink the images by a whole factor, averaging blocks of pixels
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    downscale: u8,
    /// Accept absolute paths and `..` in the files of a capture; only for files that you trust
    #[arg(long)]
    allow_outside: bool,
    /// Folder for renders and a report; new or empty unless --force
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace what the folder of --out contains
    #[arg(long, requires = "out")]
    force: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let field = read::field(&args.field)?;
    let weights = args.lpips.as_deref().map(|p| Metric::load(p, true)).transpose()?;
    let options = read::options(args.downscale, args.allow_outside);
    let pictures = Pictures::load(&args.capture, &options, read::exposure_of(&args.field).map(Common::of))?;
    missing::note(&pictures.views, &meter);
    let targets = pictures.targets(field.placement);
    let (train, test) = (&pictures.views.train, &pictures.views.test);
    let places = train.iter().zip(&targets.train).chain(test.iter().zip(&targets.test));
    let (from, to) = match args.split.as_str() {
        "test" => (train.len(), usize::MAX),
        "train" => (0, train.len()),
        _ => (0, usize::MAX),
    };
    let which: Vec<(usize, &Target)> =
        places.enumerate().filter(|(i, _)| (from..to).contains(i)).map(|(_, (at, t))| (*at, t)).collect();
    if which.is_empty() {
        return Err(Error::input("--split")
            .at(args.split.as_str())
            .expected("at least one image")
            .got("none"));
    }
    let lights = if args.relight {
        let given = args.map.environment(args.env.as_deref(), args.seed)?;
        Some(scoring::lights(&pictures, &which, given, &args.capture)?)
    } else {
        None
    };
    let dir = args.out.as_deref().map(|d| claim::folder(d, false, args.force)).transpose()?;
    meter.lap("reading");
    let cells = view::occupancy(&field)?;
    let truths: Vec<Vec<f32>> =
        which.iter().map(|(at, _)| benchmark::truth(&pictures.pictures[*at], pictures.exposure())).collect();
    let (mut scored, mut views) = (Vec::with_capacity(which.len()), Vec::with_capacity(which.len()));
    for (i, ((_, target), truth)) in which.iter().zip(&truths).enumerate() {
        meter.count(i, which.len(), "scoring");
        let s = score(&field, &cells, target)?;
        views.push(benchmark::view(&s, target, truth, field.placement.scale, weights.as_ref())?);
        scored.push(s);
    }
    meter.done();
    meter.lap("rendering and scoring");
    let seen: Vec<_> = views.iter().zip(&which).map(|(v, (_, t))| (v, *t)).collect();
    let mut bench = Benchmark::of(&seen, field.placement.scale, args.relight, weights.as_ref())?;
    if args.relight || args.mesh.is_some() {
        let baked = scoring::bake(&field)?;
        meter.lap("mesh and maps");
        if let Some(path) = &args.mesh {
            bench.shape = Some(scoring::shape(&baked, path, args.seed)?);
            meter.lap("shape");
        }
        if let Some(lights) = &lights {
            let settings = scoring::settings(args.samples, args.bounces, args.seed);
            let images: Vec<_> =
                which.iter().zip(&truths).map(|((at, _), t)| (&pictures.pictures[*at], &t[..])).collect();
            bench.relit = scoring::relit(&baked, &images, lights, settings, weights.as_ref(), &mut meter)?;
            meter.lap("relighting");
        }
    }
    let mut means = means(&scored);
    let mut all: Vec<Value> = scored.iter().map(|s| s.json()).collect();
    if args.relight {
        // The colours of the field are those under its own light.
        std::iter::once(&mut means).chain(&mut all).for_each(scoring::without_colors);
    }
    let record = json!({
        "field": args.field, "capture": args.capture, "split": args.split, "downscale": args.downscale,
        "evaluation": {"mean": means, "views": all}, "benchmark": bench.json(),
    });
    if cli::is_json() {
        cli::say_json(&record)?;
    } else {
        cli::say(&page::summary(&means))?;
        cli::say(&bench.summary())?;
    }
    if let Some(dir) = dir {
        let mut names = page::write_renders(&dir, &scored, &flat_name)?;
        names.extend(scoring::write_relit(&dir, &bench.relit, &flat_name)?);
        let settings = json!({
            "field": args.field, "capture": args.capture, "split": args.split, "downscale": args.downscale, "mesh": args.mesh,
            "relight": args.relight, "env": args.env, "samples": args.samples, "bounces": args.bounces, "seed": args.seed,
        });
        let title = format!("Scores of {} on {}", args.field.display(), crate::shared::name(&args.capture));
        let run = Run::new(&settings, None, &meter, &dir, &names);
        let made = page::page(&Input {
            kind: "field eval",
            title,
            digest: None,
            means: &means,
            scored: &scored,
            read: &[],
            facts: Vec::new(),
            benchmark: Some(&bench),
            run,
        })?;
        meter.note(&format!("report: {}", made.write(&dir)?.display()));
    }
    let mean = match args.relight {
        true => bench.relit_mask_db(),
        false => means["psnr_db"].as_f64(),
    };
    match args.min_psnr {
        Some(least) if !(mean.unwrap_or(f64::INFINITY) >= least) => Err(Error::check("field eval")
            .at(if args.relight { "mean PSNR-mask" } else { "mean PSNR" })
            .expected(format!("at least {least} dB"))
            .got(format!("{:.3} dB", mean.unwrap_or(f64::NAN)))),
        _ => Ok(()),
    }
}
