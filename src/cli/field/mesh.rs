//! `field mesh`: a textured mesh of a field.

use super::read;
use crate::choices::{Choices, choices};
use crate::fit::field::mesh::{Baked, Base, Normals, Settings, bake};
use crate::fit::training::Watch;
use crate::io::memory;
use crate::meter::Meter;
use crate::scene::field::Field;
use crate::scene::model;
use crate::units::counted;
use crate::{Error, Result, claim, console as cli};
use serde_json::json;
use std::path::PathBuf;

/// Make a textured mesh of a field.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight field mesh fit --out object.glb
  lastlight field mesh fit --out object.obj --side 128 --texture 512
  lastlight field mesh fit --out seen.glb --base color          as it was seen, whatever the light

The surface is where the signed distance is 0: closed, without cavities, smoothed, with an atlas of its charts. With --base albedo, base colour is the albedo (the colour, if the field has no materials), and roughness and metallic are packed as glTF does (green, blue). With --base color, the colour of the field, seen along the normal, is an emission over black: it contains the light of the images and is not lit again. An .obj has its material library and maps beside it.")]
pub(crate) struct Args {
    /// Folder of a fit, or a field.safetensors
    #[arg(value_name = "FILE")]
    field: PathBuf,
    /// Mesh: .glb or .obj
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    form: FormArgs,
    /// Replace the file if it exists
    #[arg(long)]
    force: bool,
}

/// How a mesh is made.
#[derive(clap::Args)]
pub(crate) struct FormArgs {
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
    /// Where normals of vertices come from
    #[arg(long, value_name = "NAME", default_value = "head", value_parser = choices(NORMALS))]
    vertex_normals: String,
    /// What the maps hold
    #[arg(long, value_name = "NAME", default_value = "albedo", value_parser = choices(BASES))]
    base: String,
}

/// Values of `--vertex-normals`.
const NORMALS: &Choices =
    &[("head", "the normal head, where the field has one"), ("surface", "the triangles")];

/// Values of `--base`.
const BASES: &Choices = &[
    ("albedo", "base colour, roughness and metallic: a surface that is lit"),
    ("color", "the colour of the images as an emission: a surface that is not lit"),
];

impl FormArgs {
    /// As settings.
    ///
    /// # Errors
    /// When one is out of range, or they need more memory than is allowed.
    pub(super) fn settings(&self) -> Result<Settings> {
        let settings = Settings {
            side: self.side,
            texture: self.texture,
            smoothing: self.smoothing,
            least_part: self.least_part,
            normals: Normals::parse(&self.vertex_normals)?,
            base: Base::parse(&self.base)?,
        };
        settings.validate()?;
        memory::check("field mesh", settings.memory_estimate())
            .map_err(|e| e.hint("--side and --texture lower the estimate, --max-memory raises the limit"))?;
        Ok(settings)
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let settings = args.form.settings()?;
    let ending = args.out.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    if ending != "glb" && ending != "obj" {
        return Err(Error::input("--out")
            .expected("a name that ends in .glb or .obj")
            .got(args.out.display().to_string()));
    }
    claim::file(&args.out, args.force)?;
    if ending == "obj" {
        claim::file(&args.out.with_extension("mtl"), args.force)?;
    }
    let field = read::field(&args.field)?;
    meter.lap("reading");
    note_no_albedo(&field, &settings, &meter);
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
    cli::say(&format!("{}: {} ({:.1} s)", args.out.display(), summary(&baked), meter.seconds()))
}

/// Notes that the colour of a field takes the place of an albedo that it does not have.
pub(super) fn note_no_albedo(field: &Field, settings: &Settings, meter: &Meter) {
    if settings.base == Base::Albedo && field.heads.albedo.is_none() {
        meter.note("the field has no albedo: its colour, with the light of the images in it, becomes the base colour");
    }
}

/// Triangles, charts and texels, as text.
pub(super) fn summary(baked: &Baked) -> String {
    format!(
        "{}, {}, {:.0} % of the texels used",
        counted(baked.object.mesh.triangles.len(), "triangle"),
        counted(baked.charts, "chart"),
        100.0 * baked.used
    )
}
