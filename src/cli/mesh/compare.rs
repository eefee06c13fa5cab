//! `mesh compare`: how far two surfaces are apart.

use crate::console as cli;
use crate::geometry::compare::{Comparison, Distances, compare};
use crate::scene::model;
use crate::{Error, Result};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Compare two surfaces.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight mesh compare truth.obj reconstruction.glb
  lastlight mesh compare a.glb b.glb --surface-samples 200000 --tau 0.01 --json

Surfaces are compared where they are: nothing is aligned or scaled. Distances are in the units of the files. Chamfer distances between samples do not vanish for equal surfaces; distances to the mesh do.")]
pub(crate) struct Args {
    /// Surface A: .gltf, .glb, .obj or .ply
    #[arg(value_name = "FILE")]
    a: PathBuf,
    /// Surface B: .gltf, .glb, .obj or .ply
    #[arg(value_name = "FILE")]
    b: PathBuf,
    /// Samples of each surface
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    surface_samples: u32,
    /// Distance that counts as a match [default: 1 % of the diagonal of A]
    #[arg(long, value_name = "D")]
    tau: Option<f64>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(tau) = args.tau
        && !(tau >= 0.0 && tau.is_finite())
    {
        return Err(Error::input("--tau").expected("a distance").got(tau.to_string()));
    }
    let (a, b) = (model::read(&args.a)?, model::read(&args.b)?);
    let c = compare(&a.mesh, &b.mesh, args.surface_samples as usize, args.seed, args.tau)
        .map_err(|e| e.within(format!("{}, {}", args.a.display(), args.b.display())))?;
    if cli::is_json() {
        return cli::say_json(&record(args, &c));
    }
    cli::say(&format!(
        "A {}: {} triangles, area {:.6}, diagonal {:.6}",
        args.a.display(),
        a.mesh.triangles.len(),
        c.area[0],
        c.diagonal[0]
    ))?;
    cli::say(&format!(
        "B {}: {} triangles, area {:.6}, diagonal {:.6}",
        args.b.display(),
        b.mesh.triangles.len(),
        c.area[1],
        c.diagonal[1]
    ))?;
    cli::say(&format!("{:<28} {:>14.6e}", "Chamfer, mean (L1)", c.chamfer_mean))?;
    cli::say(&format!("{:<28} {:>14.6e}", "Chamfer, sum (L1)", c.chamfer_sum))?;
    cli::say(&format!("{:<28} {:>14.6e}", "Chamfer, squared (L2)", c.chamfer_squared))?;
    cli::say(&format!("{:<28} {:>14.6}", "normal consistency", c.normal_consistency))?;
    cli::say(&format!("{:<28} {:>14.6}  within {:.6e}", "F-score", c.f_score, c.tau))?;
    cli::say(&format!("{:<28} {:>14} {:>14} {:>14}", "distance to the mesh", "mean", "rms", "max"))?;
    for (name, d) in [("A to B", c.a_to_b), ("B to A", c.b_to_a)] {
        cli::say(&format!("{name:<28} {:>14.6e} {:>14.6e} {:>14.6e}", d.mean, d.rms, d.max))?;
    }
    Ok(())
}

fn record(args: &Args, c: &Comparison) -> Value {
    let distances = |d: Distances| json!({ "mean": d.mean, "rms": d.rms, "max": d.max, "within": d.within });
    json!({
        "a": args.a, "b": args.b, "samples": args.surface_samples, "seed": args.seed,
        "chamfer_mean": c.chamfer_mean, "chamfer_sum": c.chamfer_sum, "chamfer_squared": c.chamfer_squared,
        "normal_consistency": c.normal_consistency, "f_score": c.f_score, "tau": c.tau,
        "a_to_b": distances(c.a_to_b), "b_to_a": distances(c.b_to_a), "area": c.area, "diagonal": c.diagonal,
    })
}
