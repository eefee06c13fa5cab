//! `field mesh`: a textured mesh of a field.

use super::read;
use crate::fit::field::mesh::{Settings, bake};
use crate::fit::training::Watch;
use crate::io::memory;
use crate::meter::Meter;
use crate::scene::model;
use crate::units::counted;
use crate::{Error, Result, console as cli};
use serde_json::json;
use std::path::PathBuf;

/// Make a textured mesh of a field.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight field mesh fit --out object.glb
  lastlight field mesh fit --out object.obj --side 128 --texture 512
  lastlight mesh render object.glb --env studio --out relit

The surface is where the signed distance is 0: closed, without cavities, smoothed, with an atlas of its charts. Base colour is the albedo (the colour, if the field has no materials), roughness and metallic are packed as glTF does (green, blue).")]
pub(crate) struct Args {
    /// Folder of a fit, or a field.safetensors
    #[arg(value_name = "FILE")]
    field: PathBuf,
    /// Mesh: .glb or .obj
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Points of the grid along each axis
    #[arg(long, value_name = "N", default_value_t = 256)]
    side: usize,
    /// Texels per side of the maps
    #[arg(long, value_name = "N", default_value_t = 1024)]
    texture: usize,
    /// Passes of smoothing; 0 for none
    #[arg(long, value_name = "N", default_value_t = 10)]
    smoothing: usize,
    /// Smallest part that is kept, as a fraction of the area of the largest
    #[arg(long, value_name = "X", default_value_t = 0.01)]
    least_part: f64,
    /// Replace the file if it exists
    #[arg(long)]
    force: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let settings = Settings {
        side: args.side,
        texture: args.texture,
        smoothing: args.smoothing,
        least_part: args.least_part,
    };
    settings.validate()?;
    memory::check("field mesh", settings.memory_estimate())
        .map_err(|e| e.hint("--side and --texture lower the estimate, --max-memory raises the limit"))?;
    let ending = args.out.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    if ending != "glb" && ending != "obj" {
        return Err(Error::input("--out")
            .expected("a name that ends in .glb or .obj")
            .got(args.out.display().to_string()));
    }
    if args.out.exists() && !args.force {
        return Err(Error::input("--out")
            .at(args.out.display().to_string())
            .expected("a new file")
            .got("one that exists")
            .hint("--force replaces it"));
    }
    let field = read::field(&args.field)?;
    meter.lap("reading");
    let baked = bake(&field, &settings)?;
    meter.lap("mesh and maps");
    model::write(&args.out, &baked.object)?;
    let (v, t) = (baked.object.mesh.positions.len(), baked.object.mesh.triangles.len());
    if cli::is_json() {
        return cli::say_json(&json!({
            "field": args.field, "out": args.out, "vertices": v, "triangles": t, "charts": baked.charts,
            "texels_used": baked.used, "parts": baked.parts, "filled_points": baked.cavities, "settings": settings.json(),
            "seconds": meter.seconds(),
        }));
    }
    cli::say(&format!(
        "{}: {}, {}, {:.0} % of the texels used ({:.1} s)",
        args.out.display(),
        counted(t, "triangle"),
        counted(baked.charts, "chart"),
        100.0 * baked.used,
        meter.seconds()
    ))
}
