//! `field relight`: images of a field under new light, by way of its mesh.

use super::mesh::FormArgs;
use super::read;
use crate::fit::field::mesh::bake;
use crate::mesh::render::{Images, Subject};
use crate::meter::Meter;
use crate::scene::model;
use crate::{Result, io};
use serde_json::{Map, json};
use std::path::{Path, PathBuf};

/// Render a field under new light, by way of its mesh.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight field relight fit --env studio --cameras orbit:8 --out relit
  lastlight field relight fit --env probe.exr --cameras object/uniform --out relit
  lastlight field relight object.glb --env sunset --out relit          a mesh that field mesh wrote

A field is made a mesh, as field mesh does, which is rendered as mesh render does: --out is a capture with the same passes. To render several times, write the mesh once and give it instead of the field. --base color is not lit: it shows the images again.")]
pub(crate) struct Args {
    /// Folder of a fit, a field.safetensors, or a mesh (.glb, .gltf, .obj, .ply)
    #[arg(value_name = "FILE")]
    field: PathBuf,
    #[command(flatten)]
    images: Images,
    #[command(flatten)]
    form: FormArgs,
}

pub(super) fn run(args: &Args) -> Result<()> {
    write(&args.field, &args.images, &args.form)
}

/// Renders the mesh of a field, or a mesh.
///
/// # Errors
/// If a file cannot be read or written, or a setting is out of its range.
pub(crate) fn write(path: &Path, images: &Images, form: &FormArgs) -> Result<()> {
    let settings = form.settings()?;
    images.write(path, &mut |meter: &mut Meter| {
        if is_mesh(path) {
            let (object, notes) = model::read_with_notes(path)?;
            let record = Map::from_iter([("model".to_owned(), io::identity(path)?)]);
            return Ok(Subject { object, notes, key: "field_relight", record });
        }
        let field = read::field(path)?;
        super::mesh::note_no_albedo(&field, &settings, meter);
        let baked = bake(&field, &settings)?;
        meter.note(&super::mesh::summary(&baked));
        let record = Map::from_iter([
            ("field".to_owned(), json!(field.digest()?)),
            ("mesh".to_owned(), settings.json()),
        ]);
        Ok(Subject { object: baked.object, notes: Vec::new(), key: "field_relight", record })
    })
}

/// Whether a path names a mesh, by its extension.
fn is_mesh(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    ["glb", "gltf", "obj", "ply"].contains(&extension.as_str())
}
