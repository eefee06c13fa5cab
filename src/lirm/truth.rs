//! Shape, materials and light of an object as files: the reference for a reconstruction from its images.
//!
//! ```text
//! object.glb        mesh, materials and textures (PNG), as rendered; `scene::model` reads it back
//! environment.exr   R G B, the environment map in the orientation of `scene::light`, rotated and scaled
//!                   as for the images; only for objects that were rendered under a map
//! ```
//!
//! Positions, normals, texture coordinates, factors and radiance keep their bits, textures their bytes.
//! Cameras of the captures, the mesh read back (z up) and the map share one frame. The version `shiny` is
//! `object.glb` with the factor of every roughness multiplied by `roughness_factor` of `object.json`.
//!
//! Files are not flushed to disk explicitly; `object.json` contains their digests (FNV-1a 64), and
//! [`is_whole`] compares them.

use crate::Result;
use crate::io::{atomic, digest, gltf, image_file};
use crate::num::par;
use crate::scene::light::Environment;
use crate::scene::mesh::Object;
use crate::scene::model;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Name of the mesh.
pub const OBJECT: &str = "object.glb";
/// Name of the map.
pub const ENVIRONMENT: &str = "environment.exr";

/// Writes the files into a folder, which is created if necessary; returns the digests by file name.
///
/// # Errors
/// If the object exceeds the size of a GLB (4 GiB), or a file cannot be written.
pub fn write(folder: &Path, object: &Object, map: Option<&Environment>) -> Result<Value> {
    let glb = || gltf::to_glb(&model::to_gltf(object, "object"));
    let exr = |m: &Environment| {
        image_file::exr_bytes(m.width, m.height, &["R", "G", "B"], m.radiance.as_flattened())
    };
    let (glb, exr) = par::join(glb, || map.map(exr).transpose());
    std::fs::create_dir_all(folder).map_err(|e| crate::Error::os(folder, &e))?;
    let mut digests = Map::new();
    for (name, bytes) in [(OBJECT, Some(glb?)), (ENVIRONMENT, exr?)] {
        if let Some(bytes) = bytes {
            atomic::write_unflushed(&folder.join(name), &bytes)?;
            digests.insert(name.to_owned(), json!(digest(&bytes)));
        }
    }
    Ok(Value::Object(digests))
}

/// Removes the files from a folder.
///
/// # Errors
/// If a file cannot be removed.
pub fn clear(folder: &Path) -> Result<()> {
    [OBJECT, ENVIRONMENT].iter().try_for_each(|name| atomic::remove(&folder.join(name)))
}

/// Whether every file has the digest that [`write()`] returned.
pub fn is_whole(folder: &Path, digests: &Value) -> bool {
    digests.as_object().into_iter().flatten().all(|(name, expected)| {
        std::fs::read(folder.join(name)).is_ok_and(|bytes| expected.as_str() == Some(&*digest(&bytes)))
    })
}
