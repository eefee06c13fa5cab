//! Any `.gltf`, `.glb`, `.obj` or `.ply` as an [`Object`], and the first three back.
//!
//! ```text
//! (x, y, z) of the file, y up  ──►  (x, −z, y), z up        texture coordinates: (0, 0) top left (v of OBJ is turned over)
//! node transforms, default scene, rest pose of skins  ──►  one mesh in the world
//! ```
//!
//! * Vertices that no triangle uses are left out, the others keep their order; a primitive (a group) shares
//!   none with another one.
//! * Normals are made unit. A zero one becomes the area-weighted mean of the faces around its vertex; a part
//!   without normals is flat, as glTF specifies, and gets zeros if another part has normals.
//! * A transform that mirrors (negative determinant) turns the triangles over, so that they stay
//!   counter-clockwise from outside.
//! * Texture transforms are applied to the coordinates. All maps of a material must use one set and one
//!   transform.
//! * Back faces are as visible as front faces: `doubleSided` is not kept.
//! * A PLY file does not name its axes; it is read with y up as well.
//! * Degenerate triangles stay: rays pass through them.
//!
//! # Rounding
//! World transforms and the blend of skins are f64; a position is rounded once. A mesh without transforms
//! keeps its bits.

mod axes;
mod export;
mod flatten;
mod placed;
mod polygons;
mod wavefront;

pub use axes::{MAX_FLAT, y_up, z_up};
pub use export::{to_gltf, to_obj};
pub(super) use flatten::{Part, flatten};
pub use placed::from_gltf;
pub(super) use placed::{affine, compose, globals, local, normal, normals, z_up_map};
pub use polygons::from_ply;
pub use wavefront::from_obj;

use super::mesh::Object;
use crate::io::{atomic, gltf, obj, ply_mesh};
use crate::{Error, Result};
use std::path::Path;

/// Reads and validates a model.
///
/// # Errors
/// When the extension is unknown, the file or one it refers to is bad, or there is no visible geometry.
pub fn read(path: &Path) -> Result<Object> {
    read_with_notes(path).map(|(object, _)| object)
}

/// Like [`read`], with a sentence for each kind of thing in the file that an object does not hold.
///
/// # Errors
/// See [`read`].
pub fn read_with_notes(path: &Path) -> Result<(Object, Vec<String>)> {
    let name = path.display().to_string();
    match extension(path).as_str() {
        "gltf" | "glb" => {
            let g = gltf::read(path)?;
            Ok((from_gltf(&g, &name)?, g.notes))
        }
        "obj" => {
            let o = obj::read(path)?;
            Ok((from_obj(&o, &name)?, o.notes))
        }
        "ply" => {
            let mut p = ply_mesh::read(path)?;
            p.notes.push("a PLY does not name its axes: y is taken to be up".into());
            Ok((from_ply(&p, &name)?, p.notes))
        }
        other => Err(unknown(&name, other)),
    }
}

fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase()
}

fn unknown(name: &str, extension: &str) -> Error {
    let got = if extension.is_empty() { "none".to_owned() } else { format!(".{extension}") };
    let e = Error::input(name).at("extension").expected(".gltf, .glb, .obj or .ply").got(got);
    match extension {
        "usdz" | "usd" | "usda" | "usdc" | "fbx" | "stl" | "dae" | "3ds" | "blend" | "abc" => {
            e.hint("convert it to .glb, for example by importing it into Blender and exporting glTF")
        }
        "splat" | "spz" | "sog" | "ksplat" => {
            e.hint("this is a scene of Gaussians; `lastlight splat render` renders scenes")
        }
        _ => e,
    }
}

/// Writes an object atomically: `.glb` with everything, or `.obj` with a material library and images beside
/// it.
///
/// # Errors
/// When the extension is another one, the object is not valid, or a file cannot be written.
pub fn write(path: &Path, object: &Object) -> Result<()> {
    let name = path.display().to_string();
    object.validate(&name)?;
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    match extension(path).as_str() {
        "glb" => atomic::write_bytes(path, &gltf::to_glb(&to_gltf(object, &stem))?),
        "obj" => obj::write(path, &to_obj(object, &stem)),
        other => Err(Error::input(name).at("extension").expected(".glb or .obj").got(format!(".{other}"))),
    }
}
